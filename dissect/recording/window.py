"""Parses ranges of time: ``12:00:01..12:00:05``, ``2016-02-08T14:51:37.5..``, ``..90`` (seconds)."""

from __future__ import annotations

import re
from datetime import date
from typing import Final

_NS: Final = 1_000_000_000
_DAY_NS: Final = 86_400 * _NS
_EPOCH: Final = date(1970, 1, 1).toordinal()
_LAST_NS: Final = 2**63 - 1

# Patterns are plain texts, which `re` compiles when they are first used: most runs need none.
_SECONDS: Final = r"([0-9]{1,9})(?:\.([0-9]{1,9}))?s?"
_TIME: Final = (
    r"(?:([0-9]{4})-([0-9]{2})-([0-9]{2})[T ])?([0-9]{2}):([0-9]{2}):([0-9]{2})(?:\.([0-9]{1,9}))?(?:Z| ?UTC)?"
)

# The bases from which a moment is counted.
_START: Final = "start"
_MIDNIGHT: Final = "midnight"
_EPOCH_BASE: Final = "epoch"


class Moment:
    """One end of a window, ``ns`` nanoseconds after ``base``: the start of the capture, the midnight before it, or 1970."""

    __slots__ = ("base", "ns")

    def __init__(self, base: str, ns: int) -> None:
        self.base = base
        self.ns = ns

    @staticmethod
    def after(ns: int) -> Moment:
        """Return the moment ``ns`` after the start of the capture."""
        return Moment(_START, ns)

    def resolve(self, first_ns: int, last_ns: int) -> int:
        """Return nanoseconds since 1970, for a capture from ``first_ns`` to ``last_ns``.

        A time of day is on the day of the first packet, or on the next day if only that one is in the capture.
        """
        if self.base == _EPOCH_BASE:
            return self.ns
        if self.base == _START:
            return first_ns + self.ns
        at = first_ns - first_ns % _DAY_NS + self.ns
        return at + _DAY_NS if at < first_ns and at + _DAY_NS <= last_ns else at


class Window:
    """A range from one moment to another, both included; None is the beginning, or the end, of the capture."""

    __slots__ = ("begin", "end")

    def __init__(self, begin: Moment | None, end: Moment | None) -> None:
        self.begin = begin
        self.end = end

    def resolve(self, first_ns: int, last_ns: int) -> tuple[int, int]:
        """Return its (first, last) nanosecond since 1970, for a capture from ``first_ns`` to ``last_ns``."""
        begin = self.begin.resolve(first_ns, last_ns) if self.begin is not None else 0
        end = self.end.resolve(first_ns, last_ns) if self.end is not None else _LAST_NS
        if end < begin and self.end is not None and self.end.base == _MIDNIGHT:
            end += _DAY_NS  # 23:59:50..00:00:10
        return begin, end

    def resolve_ahead(self, first_ns: int) -> tuple[int, int]:
        """Return the same as `resolve`, for a capture whose end is not known yet.

        Times of day are on its first day, or on the next day if the window would end before the capture begins.
        """
        begin, end = self.resolve(first_ns, first_ns)
        if end < first_ns and (self.begin or self.end or _NOTHING).base == _MIDNIGHT:
            return self.resolve(first_ns + _DAY_NS - first_ns % _DAY_NS, first_ns + _DAY_NS - first_ns % _DAY_NS)
        return begin, end


_NOTHING: Final = Moment(_START, 0)


def parse_window(text: str) -> Window:
    """Parse ``BEGIN..END``; one of them may be left out. Raises ValueError with a message for users.

    Each is a time of day or a date with a time of day (both UTC), or seconds from the start of the capture.
    """
    begin, dots, end = text.partition("..")
    if not dots or not (begin or end):
        raise ValueError(f"{text!r} is not of the form BEGIN..END")
    window = Window(parse_moment(begin) if begin else None, parse_moment(end) if end else None)
    first, last = window.begin, window.end
    if first is not None and last is not None and first.base == last.base != _MIDNIGHT and last.ns < first.ns:
        raise ValueError(f"{text!r} ends before it begins")
    return window


def parse_moment(text: str) -> Moment:
    """Parse one end of a window. Raises ValueError with a message for users."""
    found = re.fullmatch(_SECONDS, text)
    if found:
        return Moment(_START, int(found[1]) * _NS + _fraction(found[2]))
    found = re.fullmatch(_TIME, text)
    if not found:
        raise ValueError(f"{text!r} is not a time: expected HH:MM:SS, YYYY-MM-DDTHH:MM:SS (both UTC), or seconds")
    hour, minute, second = int(found[4]), int(found[5]), int(found[6])
    if hour > 23 or minute > 59 or second > 60:
        raise ValueError(f"{text!r}: there is no such time of day")
    ns = ((hour * 60 + minute) * 60 + second) * _NS + _fraction(found[7])
    if found[1] is None:
        return Moment(_MIDNIGHT, ns)
    try:
        day = date(int(found[1]), int(found[2]), int(found[3])).toordinal() - _EPOCH
    except ValueError:
        raise ValueError(f"{text!r}: there is no such day") from None
    return Moment(_EPOCH_BASE, day * _DAY_NS + ns)


def _fraction(digits: str | None) -> int:
    return int(digits.ljust(9, "0")) if digits else 0
