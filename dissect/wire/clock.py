"""Nanoseconds since 1970 as text. Integer arithmetic throughout: no rounding, no year in which it fails.

Only the offset of a local time comes from the system's table of time zones.
"""

from __future__ import annotations

import time
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
    """Writes times; remembers the text of the second before, because packets come many to a second.

    With ``local`` `moment` is in the time zone of this machine (``TZ``), else in UTC; `iso` is always in UTC.
    """

    __slots__ = ("_local_second", "_local_text", "_second", "_text", "_zone", "local")

    def __init__(self, local: bool = False) -> None:
        self.local: bool = local
        self._local_second: i64 = 0
        self._local_text: str = ""
        self._zone: str = "UTC"
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

    def moment(self, time_ns: i64) -> str:
        """Return a time for a person, with its zone: ``2016-02-08 14:51:37.916123 UTC``, local ``… +01:00``."""
        if not self.local:
            day, _, of_day = self.iso(time_ns).partition("T")
            return f"{day} {of_day[:15]} UTC"
        self._localise(time_ns)
        digits = str(_NS_PER_S + time_ns % _NS_PER_S)
        return f"{self._local_text}.{digits[1:7]} {self._zone}"

    def time_of_day(self, time_ns: i64) -> str:
        """Return the time of day to the microsecond, without its zone (see `zone`): ``14:51:37.916123``."""
        return self.moment(time_ns).split(" ")[1]

    def zone(self, time_ns: i64) -> str:
        """Return the zone of what `moment` gives for this time: ``UTC``, or an offset such as ``+01:00``."""
        if self.local:
            self._localise(time_ns)
        return self._zone

    def _localise(self, time_ns: i64) -> None:
        second: i64 = time_ns // _NS_PER_S
        if second == self._local_second and self._local_text:
            return
        there = time.localtime(second)
        self._local_text = (
            f"{there.tm_year:04d}-{there.tm_mon:02d}-{there.tm_mday:02d}"
            f" {there.tm_hour:02d}:{there.tm_min:02d}:{there.tm_sec:02d}"
        )
        hours, minutes = divmod(abs(there.tm_gmtoff) // 60, 60)
        self._zone = f"{'-' if there.tm_gmtoff < 0 else '+'}{hours:02d}:{minutes:02d}"
        self._local_second = second
