"""Times of S7-1200 and S7-1500 as IEC 61131-3 text: LTime, LTOD, LDT, DTL (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.value_showing import iso_time
from dissect.wire.octets import u16, u32

_DAY: Final = 86_400_000_000_000
_SECOND: Final = 1_000_000_000
_UNITS: Final = (
    (_DAY, "d"),
    (3600 * _SECOND, "h"),
    (60 * _SECOND, "m"),
    (_SECOND, "s"),
    (1_000_000, "ms"),
    (1000, "us"),
    (1, "ns"),
)
#: Days of the months of a leap year.
_DAYS: Final = (31, 29, 31, 30, 31, 30, 31, 31, 30, 31, 30, 31)


def long_duration(ns: int) -> str:
    """Return nanoseconds as ``LT#-1d2h3m4s5ms6us7ns``, without the units that are 0."""
    sign = "-" if ns < 0 else ""
    left = abs(ns)
    text = ""
    for size, unit in _UNITS:
        number, left = divmod(left, size)
        text += f"{number}{unit}" if number else ""
    return f"LT#{sign}{text or '0ns'}"


def long_time_of_day(ns: int) -> str | None:
    """Return nanoseconds since midnight as ``LTOD#hh:mm:ss.nnnnnnnnn``; None for a day or more."""
    if not 0 <= ns < _DAY:
        return None
    seconds, rest = divmod(ns, _SECOND)
    return f"LTOD#{_clock(seconds // 3600, seconds // 60 % 60, seconds % 60)}.{rest:09d}"


def long_date_text(ns: int) -> str | None:
    """Return nanoseconds since 1970 as ``LDT#`` and ISO 8601; None if the number is not a valid time."""
    text = iso_time(ns)
    return f"LDT#{text}" if "T" in text else None


def dtl_text(octets: bytes) -> str | None:
    """Return the 12 octets of a DTL (year, month, day, weekday, hour, minute, second, nanosecond) as text; None if invalid."""
    year, month, day, hour, minute, second = u16(octets, 0), octets[2], octets[3], octets[5], octets[6], octets[7]
    rest = u32(octets, 8)
    if not 1 <= month <= 12 or not 1 <= day <= _DAYS[month - 1] or hour > 23 or minute > 59 or second > 59:
        return None
    if rest >= _SECOND:
        return None
    return f"DTL#{year:04d}-{month:02d}-{day:02d}-{_clock(hour, minute, second)}.{rest:09d}"


def _clock(hours: int, minutes: int, seconds: int) -> str:
    return f"{hours:02d}:{minutes:02d}:{seconds:02d}"
