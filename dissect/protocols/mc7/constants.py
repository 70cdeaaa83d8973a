"""Constants of MC7 as STL text, and back (reference sheet mc7.md, section 5.3).

A constant that is invalid in its own form (a BCD digit above 9, a REAL that is not a number) is written in hexadecimal.
"""

from __future__ import annotations

import re
import struct
from datetime import date
from typing import Final

from dissect.protocols.mc7.operands import CONSTANT, Operand
from dissect.protocols.s7.values import DAYS_TO_1990
from dissect.wire.text import civil

_DATE: Final = re.compile(r"D#(\d{4})-(\d{1,2})-(\d{1,2})")
_TIME: Final = re.compile(r"(?:(\d+)D)?(?:(\d+)H)?(?:(\d+)M(?!S))?(?:(\d+)S)?(?:(\d+)MS)?")
_BASES: Final = (10, 100, 1000, 10_000)
_PRINTED: Final = frozenset(range(0x20, 0x7F)) - {0x27, 0x24}
_MS: Final = (86_400_000, 3_600_000, 60_000, 1000, 1)


def constant_text(operand: Operand) -> str:
    """Return a constant as STL text."""
    number, width, kind = operand.number, operand.width, operand.area
    text = _TEXTS[kind](number, width) if kind in _TEXTS else ""
    return text or f"{'D' if width == 4 else ''}W#16#{number:X}"


def _integer(number: int, width: int) -> str:
    return str(number - (1 << 8 * width) if number >> (8 * width - 1) else number)


def _characters(number: int, width: int) -> str:
    octets = number.to_bytes(width, "big")
    return f"'{octets.decode('ascii')}'" if all(octet in _PRINTED for octet in octets) else ""


def _bcd(number: int) -> int:
    """Return the number of three BCD digits, -1 if one of them is invalid."""
    digits = f"{number & 0xFFF:03x}"
    return int(digits) if digits.isdecimal() else -1


def _s5time(number: int, _: int) -> str:
    count = _bcd(number)
    return f"S5T#{_duration(count * _BASES[number >> 12 & 3])}" if count >= 0 and number < 0x4000 else ""


def _counter(number: int, _: int) -> str:
    count = _bcd(number)
    return f"C#{count}" if count >= 0 and number < 0x1000 else ""


def _duration(ms: int) -> str:
    parts: list[str] = []
    for size, letters in zip(_MS, ("D", "H", "M", "S", "MS"), strict=True):
        count, ms = divmod(ms, size)
        if count:
            parts.append(f"{count}{letters}")
    return "".join(parts) or "0MS"


def _time(number: int, _: int) -> str:
    if number & 0x80000000:
        return f"T#-{_duration(0x100000000 - number)}"
    return f"T#{_duration(number)}"


def _time_of_day(number: int, _: int) -> str:
    if number >= _MS[0]:
        return ""
    seconds, ms = divmod(number, 1000)
    fraction = f".{ms:03d}" if ms else ""
    return f"TOD#{seconds // 3600}:{seconds // 60 % 60}:{seconds % 60}{fraction}"


def _date(number: int, _: int) -> str:
    year, month, day = civil(number + DAYS_TO_1990)
    return f"D#{year}-{month}-{day}"


def _real(number: int, _: int) -> str:
    octets = number.to_bytes(4, "big")
    value: float = struct.unpack(">f", octets)[0]
    if number & 0x7F800000 == 0x7F800000:
        return ""
    for digits in (6, 7, 8):
        mantissa, exponent = f"{value:.{digits}e}".split("e")
        text = f"{mantissa}e{int(exponent):+04d}"
        if struct.pack(">f", float(text)) == octets:
            return text
    return ""


_TEXTS: Final = {
    "": _integer,
    "L#": lambda number, width: f"L#{_integer(number, width)}",
    "B#16#": lambda number, _: f"B#16#{number:X}",
    "2#": lambda number, width: f"2#{number:0{32 if width == 4 else 1}b}",
    "'": _characters,
    "B#(": lambda number, width: f"B#({','.join(str(octet) for octet in number.to_bytes(width, 'big'))})",
    "C#": _counter,
    "S5T#": _s5time,
    "T#": _time,
    "TOD#": _time_of_day,
    "D#": _date,
    "REAL": _real,
}


def parse_constants(text: str) -> list[Operand]:
    """Return the possible meanings of a constant, the usual one first; empty if it is not a constant.

    Upper and lower case differ.
    """
    for prefix, widths in (("B#16#", (1,)), ("DW#16#", (4,)), ("W#16#", (2,))):
        if text.startswith(prefix):
            return _numbers(prefix, text[len(prefix) :], 16, widths)
    if text.startswith("2#"):
        return _numbers("2#", text[2:], 2, (4,) if len(text) > 18 else (2,))
    if text.startswith("L#"):
        return _signed("L#", text[2:], 4)
    if text.startswith("C#"):
        return _digits("C#", text[2:])
    if text.startswith("S5T#"):
        return _parse_s5time(text[4:])
    if text.startswith("TOD#"):
        return _parse_time_of_day(text[4:])
    if text.startswith("T#"):
        return _parse_time(text[2:])
    if text.startswith("D#"):
        return _parse_date(text)
    if text.startswith("B#("):
        numbers = [int(part) for part in text[3:].rstrip(")").split(",") if part.strip().isdecimal()]
        if len(numbers) in {2, 4} and max(numbers) <= 0xFF:
            return [Operand(CONSTANT, "B#(", len(numbers), int.from_bytes(bytes(numbers), "big"))]
        return []
    if text.startswith("'") and text.endswith("'") and len(text) in {4, 6} and text.isascii():
        return [Operand(CONSTANT, "'", len(text) - 2, int.from_bytes(text[1:-1].encode("ascii"), "big"))]
    if "e" in text or "." in text:
        return _parse_real(text)
    return _signed("", text, 2)


def _numbers(kind: str, digits: str, base: int, widths: tuple[int, ...]) -> list[Operand]:
    try:
        number = int(digits, base)
    except ValueError:
        return []
    return [Operand(CONSTANT, kind, width, number) for width in widths if 0 <= number < 1 << 8 * width]


def _signed(kind: str, digits: str, width: int) -> list[Operand]:
    try:
        number = int(digits)
    except ValueError:
        return []
    half = 1 << (8 * width - 1)
    return [Operand(CONSTANT, kind, width, number & (2 * half - 1))] if -half <= number < half else []


def _digits(kind: str, digits: str, high: int = 0) -> list[Operand]:
    if not digits.isascii() or not digits.isdecimal() or int(digits) > 999:
        return []
    return [Operand(CONSTANT, kind, 2, high | int(digits, 16))]


def _ms(text: str) -> int:
    """Return the milliseconds of ``1H2M3S4MS``, -1 if the text is not valid."""
    found = _TIME.fullmatch(text)
    if found is None or not text or len(text) > 40:
        return -1
    return sum(int(part or 0) * size for part, size in zip(found.groups(), _MS, strict=True))


def _parse_s5time(text: str) -> list[Operand]:
    ms = _ms(text)
    for number, base in enumerate(_BASES):
        if ms >= 0 and ms % base == 0 and ms // base <= 999:
            return _digits("S5T#", str(ms // base), number << 12)
    return []


def _parse_time(text: str) -> list[Operand]:
    ms = _ms(text.removeprefix("-"))
    if ms < 0 or ms > 0x80000000:
        return []
    return [Operand(CONSTANT, "T#", 4, (-ms if text.startswith("-") else ms) & 0xFFFFFFFF)]


def _parse_time_of_day(text: str) -> list[Operand]:
    found = re.fullmatch(r"(\d{1,2}):(\d{1,2}):(\d{1,2})(?:\.(\d{3}))?", text)
    if found is None:
        return []
    hours, minutes, seconds, ms = (int(part or 0) for part in found.groups())
    return [Operand(CONSTANT, "TOD#", 4, ((hours * 60 + minutes) * 60 + seconds) * 1000 + ms)]


def _parse_date(text: str) -> list[Operand]:
    found = _DATE.fullmatch(text)
    if found is None:
        return []
    try:
        number = (date(*(int(part) for part in found.groups())) - date(1990, 1, 1)).days
    except ValueError:
        return []
    return [Operand(CONSTANT, "D#", 2, number)] if 0 <= number < 0x10000 else []


def _parse_real(text: str) -> list[Operand]:
    try:
        octets = struct.pack(">f", float(text))
    except (ValueError, OverflowError):
        return []
    return [Operand(CONSTANT, "REAL", 4, int.from_bytes(octets, "big"))]
