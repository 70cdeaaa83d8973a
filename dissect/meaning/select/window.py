"""Parses ranges of time: ``12:00:01..12:00:05``, ``14:03`` (that minute), ``2016-02-08T14:51:37+01:00..+5s``, ``..90``."""

from __future__ import annotations

import re
from datetime import UTC, date, datetime, timedelta, timezone
from typing import Final

_NS: Final = 1_000_000_000
_MINUTE_NS: Final = 60 * _NS
_DAY_NS: Final = 86_400 * _NS
_LAST_NS: Final = 2**63 - 1

# Patterns are plain texts, which `re` compiles at their first use: most runs need none.
_DURATION: Final = r"(\+?)([0-9]{1,9})(?:\.([0-9]{1,9}))?(ns|us|ms|s|min|h|d)?"
_ZONE: Final = r"(?:(Z| ?UTC)|([+-][0-9]{2}:?[0-9]{2}))?"
_DATE: Final = r"([0-9]{4})-([0-9]{2})-([0-9]{2})"
_TIME: Final = rf"(?:{_DATE}[T ])?([0-9]{{2}}):([0-9]{{2}})(?::([0-9]{{2}})(?:\.([0-9]{{1,9}}))?)?{_ZONE}"

#: Nanoseconds in each unit; the micro sign has two spellings.
UNITS: Final = {
    "ns": 1,
    "us": 1_000,
    "\u00b5s": 1_000,
    "\u03bcs": 1_000,
    "ms": 1_000_000,
    "s": _NS,
    "min": _MINUTE_NS,
    "h": 60 * _MINUTE_NS,
    "d": _DAY_NS,
}

# The bases from which a moment is counted.
_START: Final = "start"
_MIDNIGHT: Final = "midnight"
_EPOCH: Final = "epoch"
_BEGIN: Final = "begin"


class Moment:
    """One end of a window, ``ns`` nanoseconds after ``base``.

    That is the start of the capture, the midnight before it in a ``zone`` (None is that of this machine), 1970, or the begin of
    the window. ``span`` is the duration of the time in the text: a day, a minute, a second or a fraction of one.
    """

    __slots__ = ("base", "ns", "span", "zone")

    def __init__(self, base: str, ns: int, span: int = 1, zone: timezone | None = UTC) -> None:
        self.base = base
        self.ns = ns
        self.span = span
        self.zone = zone

    @staticmethod
    def after(ns: int) -> Moment:
        """Return the moment ``ns`` after the start of the capture."""
        return Moment(_START, ns)

    def resolve(self, first_ns: int, last_ns: int) -> int:
        """Return nanoseconds since 1970, for a capture from ``first_ns`` to ``last_ns``.

        A time of day is on the day of the first packet, or on the next day if only that one is in the capture.
        """
        if self.base == _EPOCH:
            return self.ns
        if self.base == _START:
            return first_ns + self.ns
        at = self._of_day(first_ns, 0)
        if at < first_ns:
            later = self._of_day(first_ns, 1)
            if later <= last_ns:
                return later
        return at

    def next_midnight(self, first_ns: int) -> int:
        """Return the first midnight after ``first_ns`` in the zone of this time."""
        return Moment(_MIDNIGHT, 0, zone=self.zone)._of_day(first_ns, 1)  # noqa: SLF001 - of this class

    def next_day(self, at_ns: int) -> int:
        """Return this time of day, on the day after that of ``at_ns``."""
        return self._of_day(at_ns, 1)

    def _of_day(self, at_ns: int, days: int) -> int:
        """Return this time of day on the day of ``at_ns``, or so many ``days`` later."""
        if self.zone is UTC:
            return at_ns - at_ns % _DAY_NS + self.ns + days * _DAY_NS
        try:
            day = datetime.fromtimestamp(at_ns // _NS, UTC).astimezone(self.zone).date() + timedelta(days)
            return _since_1970(day, self.ns, self.zone)
        except (OverflowError, OSError, ValueError):  # a year that the calendar does not have
            return at_ns - at_ns % _DAY_NS + self.ns + days * _DAY_NS


class Window:
    """A range from one moment to another, both included; None is the beginning, or the end, of the capture."""

    __slots__ = ("begin", "end")

    def __init__(self, begin: Moment | None, end: Moment | None) -> None:
        self.begin = begin
        self.end = end

    def resolve(self, first_ns: int, last_ns: int) -> tuple[int, int]:
        """Return its (first, last) nanosecond since 1970, for a capture from ``first_ns`` to ``last_ns``."""
        begin = self.begin.resolve(first_ns, last_ns) if self.begin is not None else 0
        if self.end is None:
            return begin, _LAST_NS
        if self.end.base == _BEGIN:
            return begin, begin + self.end.ns
        end = self.end.resolve(first_ns, last_ns)
        if end < begin and self.end.base == _MIDNIGHT:
            end = self.end.next_day(end)  # 23:59:50..00:00:10
        return begin, end

    def resolve_ahead(self, first_ns: int) -> tuple[int, int]:
        """Return the same as `resolve`, for a capture whose end is unknown so far.

        Times of day are on its first day, or on the next day if the window would end before the capture begins.
        """
        begin, end = self.resolve(first_ns, first_ns)
        named = self.begin if self.end is not None and self.end.base == _BEGIN else self.end
        if named is not None and end < first_ns and named.base == _MIDNIGHT:
            midnight = named.next_midnight(first_ns)
            return self.resolve(midnight, midnight)
        return begin, end


def zone_name(local: bool) -> str:
    """Return the name, for messages, of the zone of times without a zone."""
    return "local time" if local else "UTC"


def parse_window(text: str, local: bool = False) -> Window:
    """Parse ``BEGIN..END``, of which one may be missing, or a single time. Raises ValueError with a message for users.

    Each is a time of day, a date, or both, in the zone that it names, else in UTC or, with ``local``, in that of this machine;
    or a duration from the start of the capture. An END such as ``+5s`` is counted from BEGIN. A date as END means that whole
    day; a single day, minute or second means all of it.
    """
    begin, dots, end = text.partition("..")
    if not dots:
        return _alone(text, local)
    if not begin and not end:
        raise ValueError(f"{text!r} is not of the form BEGIN..END")
    first = parse_moment(begin, local) if begin else None
    last = parse_moment(end, local) if end else None
    if last is not None and first is not None and end.startswith("+"):
        last = Moment(_BEGIN, last.ns)
    elif last is not None and last.span >= _DAY_NS:
        last = Moment(_EPOCH, last.ns + last.span - 1)
    if first is not None and last is not None and first.base == last.base != _MIDNIGHT and last.ns < first.ns:
        raise ValueError(f"{text!r} ends before it begins")
    return Window(first, last)


def _alone(text: str, local: bool) -> Window:
    """Return the window of a single time: the day, minute or second that it names."""
    moment = parse_moment(text, local) if text else None
    if moment is None or moment.base == _START:
        ahead = f": the first {text} are ..{text}" if text else ""
        raise ValueError(f"{text!r} is not of the form BEGIN..END{ahead}")
    return Window(moment, Moment(_BEGIN, moment.span - 1))


def parse_moment(text: str, local: bool = False) -> Moment:
    """Parse one end of a window. Raises ValueError with a message for users."""
    found = re.fullmatch(_DURATION, text)
    if found:
        return Moment(_START, _counted(found[2], found[3], UNITS[found[4] or "s"]))
    found = re.fullmatch(_TIME, text)
    if found:
        return _of_time(found, text, local)
    found = re.fullmatch(_DATE + _ZONE, text)
    if found:
        zone = _zone(found[4], found[5], text, local)
        day = _day(found[1], found[2], found[3], text)
        begin = _instant(day, 0, zone, text)
        end = _instant(day + timedelta(1), 0, zone, text) if day < date.max else begin + _DAY_NS
        return Moment(_EPOCH, begin, end - begin)
    raise ValueError(
        f"{text!r} is not a time: expected HH:MM, HH:MM:SS, YYYY-MM-DD, YYYY-MM-DDTHH:MM:SS ({zone_name(local)} without a zone "
        "such as Z or +01:00), or seconds from the first packet"
    )


def _of_time(found: re.Match[str], text: str, local: bool) -> Moment:
    hour, minute, second = int(found[4]), int(found[5]), int(found[6] or 0)
    if hour > 23 or minute > 59 or second > 60:
        raise ValueError(f"{text!r}: there is no such time of day")
    ns = ((hour * 60 + minute) * 60 + second) * _NS + _counted("0", found[7], _NS)
    span = _MINUTE_NS if found[6] is None else 10 ** (9 - len(found[7] or ""))
    zone = _zone(found[8], found[9], text, local)
    if found[1] is None:
        return Moment(_MIDNIGHT, ns, span, zone)
    return Moment(_EPOCH, _instant(_day(found[1], found[2], found[3], text), ns, zone, text), span)


def _zone(utc: str | None, offset: str | None, text: str, local: bool) -> timezone | None:
    """Return the zone that a time names, such as ``+01:00``, else UTC, or None for that of this machine."""
    if not offset:
        return UTC if utc or not local else None
    minutes = int(offset[-2:])
    ahead = timedelta(hours=int(offset[1:3]), minutes=minutes)
    if minutes > 59 or ahead >= timedelta(days=1):
        raise ValueError(f"{text!r}: there is no such time zone")
    return timezone(-ahead if offset[0] == "-" else ahead)


def _day(year: str, month: str, of_month: str, text: str) -> date:
    try:
        return date(int(year), int(month), int(of_month))
    except ValueError:
        raise ValueError(f"{text!r}: there is no such day") from None


def _instant(day: date, ns: int, zone: timezone | None, text: str) -> int:
    try:
        return _since_1970(day, ns, zone)
    except (OverflowError, OSError, ValueError):
        raise ValueError(f"{text!r}: there is no such day") from None


def _since_1970(day: date, ns: int, zone: timezone | None) -> int:
    """Return nanoseconds since 1970 of a time of day, ``ns`` after midnight as clocks show it, on a day of the calendar."""
    hours = min(ns // (60 * _MINUTE_NS), 23)  # a leap second belongs to its hour
    rest = ns - hours * 60 * _MINUTE_NS
    there = datetime(day.year, day.month, day.day, hours, tzinfo=zone)
    if zone is None:
        there = there.astimezone()
    since = there - datetime(1970, 1, 1, tzinfo=UTC)
    return (since.days * 86_400 + since.seconds) * _NS + rest


def _counted(whole: str, fraction: str | None, unit: int) -> int:
    part = int(fraction) * unit // 10 ** len(fraction) if fraction else 0
    return int(whole) * unit + part
