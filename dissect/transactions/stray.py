"""A stretch of octets that belong to no TPKT, until decoding resumes or the connection is over."""

from __future__ import annotations

from mypy_extensions import i64


class Stray:
    """Where a stretch began, and up to which packet it goes.

    ``first`` is its first octet; ``skipped`` and ``framed`` are what the framer had counted before it, ``seen`` what it had
    skipped when that was last looked at. ``garbage``: an octet stands where a TPKT ought to begin, not only a header with a
    wrong length. ``told``: it is that long that it was told before its end.
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
        """Its first and its last packet."""
        first, last = int(self.first_frame), int(self.last_frame)
        return [first] if first == last else [first, last]
