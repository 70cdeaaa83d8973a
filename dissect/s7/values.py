"""Values of data items, decoded by the transport size the request asked with (reference 3.5, 3.6).

A value is a Python number, text or bool; several elements give a list. What cannot be decoded (wrong size, a code that is not
BCD, a transport size without a known type) gives None: the octets stand beside it, nothing is invented.
"""

from __future__ import annotations

import math
import struct
from typing import Final

from mypy_extensions import i64

from dissect.s7.tables import BIT, BYTE, CHAR, ELEMENT_OCTETS, WCHAR
from dissect.wire.octets import u16, u32
from dissect.wire.text import civil

#: Decoded value of one item.
Value = bool | int | float | str | list["bool | int | float | str | None"] | None

_FLOAT: Final = struct.Struct(">f")
_DOUBLE: Final = struct.Struct(">d")
#: Half the distance of neighbouring singles, by exponent field (the smallest two share theirs).
_HALF_STEP: Final = [2.0 ** (max(exponent, 1) - 127 - 24) for exponent in range(256)]
#: Digits to begin with, by exponent field. Seven print what people write, except where the steps are wider than the seventh
#: digit (just above a power of two that begins with nine, such as 2**-10 = 0.000976…) and among the subnormal numbers.
_FIRST_DIGITS: Final = bytes(
    [
        1 if exponent == 0 else 6 if 2 * step > 10.0 ** (math.floor(math.log10(2.0 ** (exponent - 127))) - 6) else 7
        for exponent, step in enumerate(_HALF_STEP)
    ]
)
#: Powers of ten with which the product of a single is exact in a double (24 bits and 2.33 for each power, of 53).
_TENS: Final = [10.0**power for power in range(13)]
#: Added to a double below 2**51 and taken away again, it leaves the nearest whole number, ties to even.
_TO_WHOLE: Final = 6755399441055744.0  # 1.5 * 2**52
#: By exponent field, the power of ten that leaves the smallest single of it seven digits before the point.
_SHIFT: Final = bytes(
    [
        min(max(6 - math.floor(math.log10(2.0 ** (exponent - 127))), 0), 255) if exponent < 255 else 255
        for exponent in range(256)
    ]
)
#: Singles whose digits `_shortest` finds: all that seven to nine digits show with powers of `_TENS`.
_LEAST_SCALED: Final = 1e-4
_MOST_SCALED: Final = 1e7
_MS_PER_DAY: Final = 86_400_000
#: Fewer characters than these may be a chance.
LEAST_TEXT: Final = 4
_S5_BASE_MS: Final = (10, 100, 1000, 10000)


def decode_value(transport_size: i64, octets: bytes) -> Value:
    """Return the value of ``octets`` read or written with request transport size ``transport_size``."""
    if transport_size == CHAR:
        return octets.decode("latin-1")
    if transport_size == WCHAR:
        return octets.decode("utf-16-be", "replace") if len(octets) % 2 == 0 else None
    size: i64 = _ELEMENT[transport_size] if 0 <= transport_size < 256 else 0
    total: i64 = len(octets)
    if size == 0 or total == 0 or total % size:
        return None
    if total == size:
        return _element(transport_size, octets)
    if transport_size == BYTE:
        return list(octets)
    values: list[bool | int | float | str | None] = []
    at: i64 = 0
    while at < total:
        values.append(_element(transport_size, octets[at : at + size]))
        at += size
    return values


#: Octets of one element by transport size, 0 where the octets have no known meaning.
_ELEMENT: Final = bytes([ELEMENT_OCTETS.get(code, 0) if code != 0x30 else 8 for code in range(256)])


def _element(transport_size: i64, octets: bytes) -> bool | int | float | str | None:
    if transport_size == BIT:
        return octets[0] & 1 == 1
    if transport_size == 0x02:
        return octets[0]
    if transport_size == 0x04:
        return u16(octets, 0)
    if transport_size == 0x06:
        return u32(octets, 0)
    if transport_size == 0x08:
        return real(octets)
    if transport_size == 0x05:
        word: i64 = u16(octets, 0)
        return word - 0x10000 if word >= 0x8000 else word
    if transport_size == 0x07:
        double: i64 = u32(octets, 0)
        return double - 0x100000000 if double >= 0x80000000 else double
    if transport_size == 0x30:
        wide: float = _DOUBLE.unpack(octets)[0]
        return wide
    if transport_size == 0x1C:
        return bcd(octets[0] & 0x0F, octets[1])
    if transport_size == 0x0C or transport_size == 0x1D:
        return s5time(octets)
    number = int.from_bytes(octets, "big", signed=transport_size == 0x0B)
    if transport_size == 0x09:
        return date_text(number)
    if transport_size == 0x0A:
        return time_of_day(number)
    if transport_size == 0x0B:
        return duration(number)
    return date_and_time(octets)


def spelled(octets: bytes) -> str:
    """Return the text that octets spell, empty where they do not: ASCII that can be printed, NULs or blanks behind it.

    An S7 STRING begins with its greatest and its present length.
    """
    size: i64 = len(octets)
    if size < LEAST_TEXT:
        return ""
    present: i64 = octets[1]
    said: bool = present <= octets[0] and LEAST_TEXT <= present <= size - 2
    content = octets[2 : 2 + present] if said else octets.rstrip(b"\0 ")
    if len(content) < LEAST_TEXT:
        return ""
    for octet in content:
        if octet < 0x20 or octet >= 0x7F:
            return ""
    return content.decode("ascii")


def real(octets: bytes) -> float:
    """Return an IEEE 754 single as the shortest decimal that reads back to the same four octets.

    A double less than half a step of single precision from the exact value reads back to it, however ties are rounded.
    """
    exact: float = _FLOAT.unpack(octets)[0]
    if not _LEAST_SCALED <= abs(exact) < _MOST_SCALED:
        return float(_text(exact, octets))
    # What %g and float() would say of so many digits, by arithmetic that is exact: a single times a small power of ten has
    # no more bits than a double, and the quotient of two whole numbers that doubles hold is rounded once.
    exponent: i64 = (u16(octets, 0) >> 7) & 0xFF
    half_step: float = _half_step(octets, exponent)
    power: i64 = _SHIFT[exponent]
    if abs(exact) * _TENS[power] >= _MOST_SCALED:
        power -= 1
    power -= 7 - _FIRST_DIGITS[exponent]
    last: i64 = power + 3
    while power < last:
        if power >= 0:
            scale: float = _TENS[power]
            number: float = (exact * scale + _TO_WHOLE - _TO_WHOLE) / scale
            if abs(number - exact) < half_step:
                return number
        power += 1
    return float(_text(exact, octets))


def real_text(octets: bytes) -> str:
    """Return an IEEE 754 single as the text of `real`, for example ``123.456``, ``1e+20``, ``inf`` or ``nan``."""
    return _text(_FLOAT.unpack(octets)[0], octets)


def _half_step(octets: bytes, exponent: i64) -> float:
    """Return half the distance from a single to its nearest neighbour."""
    half_step: float = _HALF_STEP[exponent]
    if exponent > 1 and octets[1] & 0x7F == 0 and octets[2] == 0 and octets[3] == 0:
        half_step *= 0.5  # below a power of two the steps are half as wide
    return half_step


def _text(exact: float, octets: bytes) -> str:
    """Return `real_text`: %g drops the zeros of numbers with fewer digits than asked for, and nine digits always do."""
    exponent: i64 = (u16(octets, 0) >> 7) & 0xFF
    if exponent == 255:
        return repr(exact)
    half_step: float = _half_step(octets, exponent)
    digits: i64 = _FIRST_DIGITS[exponent]
    while digits < 9:
        text = f"{exact:.{digits}g}"
        if abs(float(text) - exact) < half_step:
            return text
        digits += 1
    return f"{exact:.9g}"


def bcd(*octets: int) -> int | None:
    """Return the number of BCD octets, most significant first; None when a digit is above 9."""
    number = 0
    for octet in octets:
        high, low = octet >> 4, octet & 0x0F
        if high > 9 or low > 9:
            return None
        number = number * 100 + high * 10 + low
    return number


def s5time(octets: bytes) -> str | None:
    """Return an S5TIME (time base in bits 13-12, three BCD digits) as text, for example ``S5T#1s500ms``."""
    digits = bcd(octets[0] & 0x0F, octets[1])
    if digits is None:
        return None
    return "S5" + duration(digits * _S5_BASE_MS[(octets[0] >> 4) & 3])


def duration(ms: int) -> str:
    """Return milliseconds as IEC 61131-3 text, for example ``T#-1d2h3m4s5ms``."""
    sign = "-" if ms < 0 else ""
    left = abs(ms)
    parts = ""
    for unit, size in (("d", _MS_PER_DAY), ("h", 3_600_000), ("m", 60_000), ("s", 1000), ("ms", 1)):
        count, left = divmod(left, size)
        if count:
            parts += f"{count}{unit}"
    return f"T#{sign}{parts or '0ms'}"


def time_of_day(ms: int) -> str | None:
    """Return milliseconds since midnight as ``TOD#hh:mm:ss.mmm``; None for a day or more."""
    if ms >= _MS_PER_DAY:
        return None
    seconds, rest = divmod(ms, 1000)
    return f"TOD#{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{rest:03d}"


_DAYS_TO_1990: Final = 7305


def date_text(days: int) -> str:
    """Return days since 1990-01-01 as ``D#yyyy-mm-dd``."""
    year, month, day = civil(days + _DAYS_TO_1990)
    return f"D#{year:04d}-{month:02d}-{day:02d}"


def date_and_time(octets: bytes) -> str | None:
    """Return the 8-octet BCD form (year, month, day, hour, minute, second, ms, weekday) as ``DT#…``, None if no time."""
    fields = [bcd(octet) for octet in octets[:7]]
    year, month, day, hour, minute, second, centi = fields
    if (
        year is None
        or month is None
        or day is None
        or hour is None
        or minute is None
        or second is None
        or centi is None
    ):
        return None
    units = octets[7] >> 4
    full = year + (2000 if year < 90 else 1900)
    if not (
        1 <= month <= 12 and 1 <= day <= _days(full, month) and hour < 24 and minute < 60 and second < 60 and units < 10
    ):
        return None
    return f"DT#{full:04d}-{month:02d}-{day:02d}-{hour:02d}:{minute:02d}:{second:02d}.{centi * 10 + units:03d}"


def _days(year: int, month: int) -> int:
    """Return the days of a month; the four-year rule holds from 1990 to 2089."""
    if month == 2:
        return 29 if year % 4 == 0 else 28
    return 30 if month in (4, 6, 9, 11) else 31
