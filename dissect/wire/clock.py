"""Nanoseconds since 1970 as text. Integer arithmetic throughout: no rounding, no year in which it fails."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

_NS_PER_S: Final = 1_000_000_000
_S_PER_DAY: Final = 86400


def civil(days: int) -> tuple[int, int, int]:
    """Return (year, month, day) of a day counted from 1970-01-01, Gregorian calendar, any year."""
    shifted = days + 719468
    era, of_era = divmod(shifted, 146097)
    year_of_era = (of_era - of_era // 1460 + of_era // 36524 - of_era // 146096) // 365
    day_of_year = of_era - (365 * year_of_era + year_of_era // 4 - year_of_era // 100)
    shifted_month = (5 * day_of_year + 2) // 153
    day = day_of_year - (153 * shifted_month + 2) // 5 + 1
    month = shifted_month + 3 if shifted_month < 10 else shifted_month - 9
    return year_of_era + era * 400 + (1 if month <= 2 else 0), month, day


class Clock:
    """Writes times; remembers the text of the second before, because packets come many to a second."""

    __slots__ = ("_second", "_text")

    def __init__(self) -> None:
        self._second: i64 = 0
        self._text: str = "1970-01-01T00:00:00."

    def iso(self, time_ns: i64) -> str:
        """Return ISO 8601 in UTC with nanoseconds, for example ``2016-02-08T14:51:37.916123000Z``."""
        second: i64 = time_ns // _NS_PER_S
        if second != self._second:
            day: i64 = second // _S_PER_DAY
            rest: i64 = second % _S_PER_DAY
            year, month, of_month = civil(day)
            self._text = (
                f"{year:04d}-{month:02d}-{of_month:02d}T{rest // 3600:02d}:{rest // 60 % 60:02d}:{rest % 60:02d}."
            )
            self._second = second
        digits = str(_NS_PER_S + time_ns % _NS_PER_S)  # a leading 1 keeps the zeros
        return f"{self._text}{digits[1:]}Z"
