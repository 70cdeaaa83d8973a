"""How long something took, for a person: one function, so that every text has the same units."""

from __future__ import annotations

from typing import Final

_NS_PER_S: Final = 1_000_000_000


def duration_text(ns: int) -> str:
    """Return nanoseconds in the unit that suits them, for example ``412 µs``, ``3.21 ms``, ``1.54 s``, ``2 h 5 min 0 s``."""
    size = abs(ns)
    if 0 < size < 10_000:
        return f"{ns / 1e3:.1f} µs"
    if size < 999_500:
        return f"{ns / 1e3:.0f} µs"
    if size < 99_995_000:
        return f"{ns / 1e6:.2f} ms"
    if size < 999_500_000:
        return f"{ns / 1e6:.0f} ms"
    if size < 600 * _NS_PER_S:
        return f"{ns / 1e9:.2f} s"
    minutes, seconds = divmod(size // _NS_PER_S, 60)
    hours, minutes = divmod(minutes, 60)
    days, hours = divmod(hours, 24)
    units = [(days, "d"), (hours, "h"), (minutes, "min"), (seconds, "s")]
    first = next(index for index, (number, _) in enumerate(units) if number)
    sign = "-" if ns < 0 else ""
    return sign + " ".join([f"{number} {unit}" for number, unit in units[first:]])


def distance_text(ns: int) -> str:
    """Say how far back something lies, for example ``965 µs earlier``; what came after is ``1.20 s later``."""
    return f"{duration_text(ns)} earlier" if ns >= 0 else f"{duration_text(-ns)} later"
