"""Writes numbers and octets as ASCII into a buffer, for compiled code that puts together a line.

Two decimal digits are looked up and stored at once, eight hexadecimal digits are made by one calculation; no string is made on
the way. This is for compiled callers: interpreted, the calls cost more than strings.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter, read_i16_le, read_i32_be, read_i32_le, write_i16_le, write_i32_le, write_i64_be
from mypy_extensions import i32, i64, u8

from dissect.wire.text import Clock

_TWO: Final = "".join([f"{number:02d}" for number in range(100)]).encode("ascii")
_TWO_HEX: Final = bytes(range(256)).hex().encode("ascii")
#: Four characters for each octet: its decimal number, a comma, blanks.
_WITH_COMMA: Final = "".join([f"{octet},".ljust(4) for octet in range(256)]).encode("ascii")
_COMMA: Final = 0x2C
_ZERO: Final = 0x30
_BLANK: Final = 0x20
MINUS: Final = 0x2D
#: Factors and shifts that replace a division, because Python's rounding of negative numbers costs more than the division
#: itself: by 100 for numbers below 10,000, and by 10,000 for numbers below `_QUICK`.
_BY_100: Final = 5243
_BY_100_BITS: Final = 19
_BY_10_000: Final = 3_518_437_209
_BY_10_000_BITS: Final = 45
_QUICK: Final = 0x80000000
_NS_PER_S: Final = 1_000_000_000
_NS_DIGITS: Final = 9
_NS_PER_US: Final = 1000
_US_DIGITS: Final = 6
_Z: Final = 0x5A


def write_decimal(out: BytesWriter, number: i64) -> None:
    """Write ``str(number)``; ``number`` must be greater than -2**63."""
    if number < 0:
        out.append(MINUS)
        number = -number
    if number >= 10_000:
        above: i64 = number // 10_000 if number >= _QUICK else number * _BY_10_000 >> _BY_10_000_BITS
        write_decimal(out, above)
        _write_four(out, number - 10_000 * above)
    elif number >= 1000:
        _write_four(out, number)
    elif number >= 100:
        hundreds: i64 = number * _BY_100 >> _BY_100_BITS
        out.append(u8(_ZERO + hundreds))
        write_i16_le(out, read_i16_le(_TWO, 2 * (number - 100 * hundreds)))
    elif number >= 10:
        write_i16_le(out, read_i16_le(_TWO, 2 * number))
    else:
        out.append(u8(_ZERO + number))


def write_aligned(out: BytesWriter, number: i64, width: i64) -> None:
    """Write a number that is not negative, with blanks before it up to ``width`` characters, at most 18."""
    least: i64 = 1
    while width > 1:
        least *= 10
        width -= 1
    while number < least and least > 1:
        out.append(_BLANK)
        least //= 10
    write_decimal(out, number)


def write_digits(out: BytesWriter, number: i64, count: i64) -> None:
    """Write a number that is not negative with ``count`` digits, padded with zeros."""
    if count > 4:
        above: i64 = number // 10_000 if number >= _QUICK else number * _BY_10_000 >> _BY_10_000_BITS
        write_digits(out, above, count - 4)
        number -= 10_000 * above
        count = 4
    if count == 4:
        _write_four(out, number)
    elif count == 3:
        out.append(u8(_ZERO + number // 100))
        write_i16_le(out, read_i16_le(_TWO, number % 100 * 2))
    elif count == 2:
        write_i16_le(out, read_i16_le(_TWO, 2 * number))
    elif count == 1:
        out.append(u8(_ZERO + number))


def _write_four(out: BytesWriter, number: i64) -> None:
    """Write four digits: two pairs are divided by ten at once (times 103, shifted by 10), in two halves of one number."""
    hundreds: i64 = number * _BY_100 >> _BY_100_BITS
    pairs: i64 = hundreds | number - 100 * hundreds << 16
    tens: i64 = pairs * 103 >> 10 & 0x000F000F
    write_i32_le(out, i32(0x30303030 + (tens | pairs - 10 * tens << 8)))


def write_octets(out: BytesWriter, octets: bytes, at: i64, end: i64) -> None:
    """Write each of ``octets[at:end]`` as a decimal number and a comma; IndexError when they are not there."""
    while at < end:
        octet: i64 = octets[at]
        if octet >= 100:
            write_i32_le(out, read_i32_le(_WITH_COMMA, 4 * octet))
        elif octet >= 10:
            write_i16_le(out, read_i16_le(_WITH_COMMA, 4 * octet))
            out.append(_COMMA)
        else:
            write_i16_le(out, read_i16_le(_WITH_COMMA, 4 * octet))
        at += 1


def write_hexadecimal(out: BytesWriter, octets: bytes, at: i64, end: i64) -> None:
    """Write ``octets[at:end].hex()``; IndexError when they are not there."""
    while at + 4 <= end:
        # Spread the eight half octets over eight octets, then add "0", and for those above nine the distance to "a".
        spread: i64 = i64(read_i32_be(octets, at)) & 0xFFFFFFFF
        spread = (spread << 16 | spread) & 0x0000FFFF0000FFFF
        spread = (spread << 8 | spread) & 0x00FF00FF00FF00FF
        spread = (spread << 4 | spread) & 0x0F0F0F0F0F0F0F0F
        letters: i64 = (spread + 0x0606060606060606) >> 4 & 0x0101010101010101
        write_i64_be(out, spread + 0x3030303030303030 + letters * 0x27)
        at += 4
    while at < end:
        octet: i64 = octets[at]
        write_i16_le(out, read_i16_le(_TWO_HEX, 2 * octet))
        at += 1


def write_escape(out: BytesWriter, unit: i64) -> None:
    r"""Write a UTF-16 code unit as a JSON escape, for example ``\u00e4``."""
    out.write(b"\\u")
    write_i16_le(out, read_i16_le(_TWO_HEX, unit >> 8 << 1))
    write_i16_le(out, read_i16_le(_TWO_HEX, (unit & 0xFF) << 1))


class Times:
    """Writes times as `Clock.iso` does; keeps the octets of the last second, because many packets come in each second."""

    __slots__ = ("_clock", "_octets", "_second")

    def __init__(self) -> None:
        self._clock: Clock = Clock()
        self._second: str = ""
        self._octets: bytes = b""

    def write(self, out: BytesWriter, time_ns: i64) -> None:
        """Write a time."""
        second = self._clock.iso_second(time_ns)
        if second is not self._second:
            self._second = second
            self._octets = second.encode("ascii")
        out.write(self._octets)
        write_digits(out, time_ns % _NS_PER_S, _NS_DIGITS)
        out.append(_Z)


class Moments:
    """Writes times as `Clock.moment` of ``clock`` does; keeps the octets of the last second, as `Times` does."""

    __slots__ = ("_clock", "_octets", "_second")

    def __init__(self, clock: Clock) -> None:
        self._clock: Clock = clock
        self._second: str = ""
        self._octets: bytes = b""

    def write(self, out: BytesWriter, time_ns: i64) -> None:
        """Write a time."""
        if self._clock.local:
            out.write(self._clock.moment(time_ns).encode("ascii"))
            return
        second = self._clock.iso_second(time_ns)
        if second is not self._second:
            self._second = second
            self._octets = second.replace("T", " ").encode("ascii")
        out.write(self._octets)
        write_digits(out, time_ns % _NS_PER_S // _NS_PER_US, _US_DIGITS)
        out.write(b" UTC")
