"""Keeps the places of objects that were noted while a PDU was skimmed, for the next look at the same PDU."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64


class Noted:
    """A sound PDU with objects, and what was noted while it was skimmed.

    ``octets`` are its frames; ``data`` has its data from ``at`` to ``end``. ``places`` is `Skipper.noted` for ``marks``; the
    other fields are as in `dissect.s7plus.skimming.Body`.
    """

    __slots__ = ("at", "data", "end", "ids", "integrity_id", "marks", "object_id", "octets", "places")

    def __init__(self, octets: bytes, data: bytes, at: i64, end: i64, marks: bytes) -> None:
        self.octets = octets
        self.marks = marks
        self.data = data
        self.at: i64 = at
        self.end: i64 = end
        self.places: list[int] = []
        self.ids: list[int] = []
        self.integrity_id: i64 = -1
        self.object_id: i64 = -1


class _Latest:
    """What was noted of the response skimmed last, unless it is very large: it is judged right after that."""

    __slots__ = ("noted",)

    def __init__(self) -> None:
        self.noted: Noted | None = None


_LATEST: Final = _Latest()


def keep_noted(noted: Noted | None) -> None:
    """Keep what was noted of a response (None for nothing) until the next one is skimmed."""
    _LATEST.noted = noted


def latest_noted(octets: bytes, marks: bytes) -> Noted | None:
    """Return what was noted of this response; None unless it was the last one that may have objects."""
    noted = _LATEST.noted
    return noted if noted is not None and noted.marks is marks and noted.octets == octets else None
