"""The categories of packets, and the account of all octets, so that every lost octet is counted."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

# Categories of packets.
PAYLOAD: Final = 0
NO_PAYLOAD: Final = 1
RETRANSMISSION: Final = 2
KEEP_ALIVE: Final = 3
FRAGMENT_USED: Final = 4
NOT_IP: Final = 5
NOT_TCP: Final = 6
FRAGMENT_WAITING: Final = 7
FRAGMENT_DROPPED: Final = 8
OTHER_PROTOCOL: Final = 9
BEFORE_START: Final = 10
AFTER_CLOSE: Final = 11
RESET_IGNORED: Final = 12
CUT: Final = 13
BAD_HEADER: Final = 14
BAD_CHECKSUM: Final = 15
LINK_TYPE: Final = 16
FAILED: Final = 17
LEFT_OUT: Final = 18

#: Names of the categories, by the numbers above.
CATEGORIES: Final[list[str]] = [
    "payload",
    "no_payload",
    "retransmission",
    "keep_alive",
    "fragment_used",
    "not_ip",
    "not_tcp",
    "fragment_waiting",
    "fragment_dropped",
    "other_protocol",
    "before_start",
    "after_close",
    "reset_ignored",
    "cut",
    "bad_header",
    "bad_checksum",
    "link_type",
    "failed",
    "left_out",
]
#: From this category on, the packet was not used.
FIRST_IGNORED: Final = NOT_IP


class OctetAccount:
    """Octets of TCP payload, summed over the directions of finished connections.

    ``delivered`` equals ``framed`` + ``skipped`` + ``buffered`` unless the analyzer failed on something; ``failed`` is the
    difference. ``missing`` counts octets in gaps, which were not delivered; ``holes`` counts the gaps, ``inside`` the gaps that
    begin inside a message.
    """

    __slots__ = ("buffered", "delivered", "framed", "holes", "inside", "missing", "skipped")

    def __init__(self) -> None:
        self.delivered: i64 = 0
        self.framed: i64 = 0
        self.skipped: i64 = 0
        self.buffered: i64 = 0
        self.missing: i64 = 0
        self.holes: i64 = 0
        self.inside: i64 = 0

    @property
    def failed(self) -> int:
        """Octets that are in no other sum; 0 unless the analyzer has a bug (finding ``internal.bug``)."""
        return self.delivered - self.framed - self.skipped - self.buffered

    def as_dict(self) -> dict[str, int]:
        """Return the sums by name."""
        return {
            "delivered": self.delivered,
            "framed": self.framed,
            "skipped": self.skipped,
            "buffered": self.buffered,
            "missing": self.missing,
            "holes": self.holes,
            "holes_inside_messages": self.inside,
            "failed": self.failed,
        }
