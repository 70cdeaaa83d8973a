"""`Stray`: consecutive octets that belong to no TPKT, until decoding resumes or the connection is over."""

from __future__ import annotations

from mypy_extensions import i64


class Stray:
    """Stray octets: where they begin, and the last packet that contains some of them.

    ``first`` is the first octet. ``skipped`` and ``framed`` are the framer's counts before it, ``seen`` what the framer had
    skipped when `follow_stray` last checked. ``garbage``: there is a wrong octet where a TPKT should begin, not just a header
    with a wrong length. ``told``: they were reported before their end, because there are so many.
    """

    __slots__ = ("first", "first_frame", "framed", "garbage", "last_frame", "last_ns", "seen", "skipped", "told")

    def __init__(self, first: i64, skipped: i64, framed: i64, frame: i64, time_ns: i64) -> None:
        self.first: i64 = first
        self.first_frame: i64 = frame
        self.last_frame: i64 = frame
        self.last_ns: i64 = time_ns
        self.skipped: i64 = skipped
        self.framed: i64 = framed
        self.seen: i64 = skipped
        self.garbage: bool = False
        self.told: bool = False

    @property
    def frames(self) -> list[int]:
        """The first and the last packet."""
        first, last = int(self.first_frame), int(self.last_frame)
        return [first] if first == last else [first, last]
