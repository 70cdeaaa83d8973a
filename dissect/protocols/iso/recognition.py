"""Recognises ISO-on-TCP by its content, on any port; port 102 is only a hint (reference sections 1.3 and 1.4)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.iso.tables import CR
from dissect.protocols.iso.tpkt import YES, judge_beginning, plausible
from dissect.protocols.iso.upper import TLS, UNKNOWN, classify

# The results of `recognise`.
UNDECIDED: Final = 0  # examine more
HERE: Final = 1  # a TPKT begins with the octets
WITHIN: Final = 2  # a TPKT begins somewhere inside
OTHER: Final = 3  # another protocol

#: This many segments with data are examined before a connection counts as a different protocol.
PROBES: Final = 8
#: The same for a connection on port 102, where ISO-on-TCP is expected.
_PROBES_102: Final = 64


def recognise(octets: bytes, at_start: bool, on_102: bool, probed: i64) -> i64:
    """Return whether ``octets`` are ISO-on-TCP: `UNDECIDED`, `HERE`, `WITHIN` or `OTHER`.

    ``at_start``: they are the first octets that their side sent. ``probed`` segments of the connection were examined before.
    TPKTs that begin after the first octet are found only on port 102.
    """
    if plausible(octets, 0, len(octets)) or (at_start and _may_begin_tpkt(octets)):
        return HERE
    if on_102 and _holds_tpkt(octets):
        return WITHIN
    enough: i64 = _PROBES_102 if on_102 else (1 if at_start else PROBES)
    return OTHER if probed + 1 >= enough else UNDECIDED


def is_connect_request(octets: bytes) -> bool:
    """Return whether ``octets`` begin with a TPKT that contains a CR."""
    return len(octets) > 6 and octets[5] >> 4 == CR and plausible(octets, 0, len(octets))


def raw_protocol(octets: bytes) -> i64:
    """Return the protocol of octets outside TPKTs, as a number of `iso.upper`: TLS or UNKNOWN."""
    return TLS if classify(octets, 0, len(octets)) == TLS else UNKNOWN


def _may_begin_tpkt(octets: bytes) -> bool:
    """Return whether the first octets of a connection, too few for `plausible`, may be the beginning of a TPKT."""
    if len(octets) >= 6:
        return False
    pattern = (0x03, 0x00)
    return all([octets[index] == pattern[index] for index in range(min(2, len(octets)))])


def _holds_tpkt(octets: bytes) -> bool:
    """Return whether a TPKT certainly begins somewhere in ``octets``."""
    end: i64 = len(octets)
    here: i64 = octets.find(b"\x03\x00")
    while here >= 0:
        if judge_beginning(octets, here, end) == YES:
            return True
        here = octets.find(b"\x03\x00", here + 1)
    return False
