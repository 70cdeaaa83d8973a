"""Decodes octets by the declared type of a tag (sheet 6). Octets that are not a value of the type give None, never a guess."""

from __future__ import annotations

import struct
from typing import Final

from mypy_extensions import i64

from dissect.meaning.tags.index import TagPart
from dissect.meaning.tags.model import Tag
from dissect.protocols.s7.address import address_text
from dissect.protocols.s7.singles import real
from dissect.protocols.s7.tables import BIT, BYTE, TRANSPORT_SIZES
from dissect.protocols.s7.values import Value, bcd, date_and_time, date_text, duration, s5time, time_of_day
from dissect.wire.octets import u16, u24
from dissect.wire.text import civil

_DOUBLE: Final = struct.Struct(">d")
_UNSIGNED: Final = frozenset(("BYTE", "WORD", "DWORD", "LWORD", "USINT", "UINT", "UDINT", "ULINT"))
_SIGNED: Final = frozenset(("SINT", "INT", "DINT", "LINT"))
_BLOCKS: Final = frozenset(("BLOCK_FB", "BLOCK_FC", "BLOCK_DB", "BLOCK_SDB"))
_STRINGS: Final = frozenset(("STRING", "WSTRING"))
_S5_TIMES: Final = frozenset(("S5TIME", "TIMER"))
_NS_PER_DAY: Final = 86_400_000_000_000
_POINTER: Final = 6
_ANY: Final = 10
_S7_ANY: Final = 0x10
#: Digits of a scaled value: more would show the error of the multiplication.
_DIGITS: Final = ".12g"

Scalar = bool | int | float | str | None


def decode_part(part: TagPart, octets: bytes) -> tuple[Value, Value]:
    """Return (value in its unit, value on the wire) of a part of an item; (None, None) for a piece of an element.

    ``octets`` are those of the item; an item of one bit has one octet.
    """
    tag = part.tag
    if not part.whole:
        return None, None
    if not tag.dims:
        raw = decode_element(tag, octets, part.bit)
        return scaled(tag, raw), raw
    count: i64 = part.count
    found: list[bool | int | float | str | None] = [
        decode_element(tag, octets, part.bit + number * tag.step) for number in range(count)
    ]
    if tag.kind == "CHAR":
        text = "".join([str(each) for each in found])
        return text, text
    if count == 1 and count != tag.count:
        return scaled(tag, found[0]), found[0]
    raws: Value = found
    if not tag.scaled:
        return raws, raws
    return [scaled(tag, each) for each in found], raws


def scaled(tag: Tag, raw: Scalar) -> Scalar:
    """Return a value in the unit of its tag."""
    if not tag.scaled or raw is None or isinstance(raw, (bool, str)):
        return raw
    return float(format(float(raw) * tag.factor + tag.shift, _DIGITS))


def decode_element(tag: Tag, octets: bytes, bit: i64) -> Scalar:
    """Return the value of the element that begins at ``bit`` of ``octets``; None if it has none."""
    at: i64 = bit // 8
    size: i64 = (tag.size + 7) // 8
    if at + size > len(octets):
        return None
    kind = tag.kind
    if kind == "BOOL":
        return (octets[at] >> (bit % 8)) & 1 == 1
    return decode_typed(kind, octets[at : at + size])


def decode_typed(kind: str, octets: bytes) -> Scalar:
    """Return the value of ``octets`` as type ``kind``, whose size they must have."""
    if kind == "REAL":
        return real(octets)
    if kind in _SIGNED:
        return int.from_bytes(octets, "big", signed=True)
    if kind in _UNSIGNED or kind in _BLOCKS:
        return int.from_bytes(octets, "big")
    if kind == "LREAL":
        wide: float = _DOUBLE.unpack(octets)[0]
        return wide
    if kind == "CHAR":
        return octets.decode("latin-1")
    if kind == "FSTRING":
        return octets.decode("latin-1").rstrip("\0")
    if kind == "WCHAR":
        return octets.decode("utf-16-be", "replace")
    if kind in _STRINGS:
        return string(kind, octets)
    if kind == "TIME":
        return duration(int.from_bytes(octets, "big", signed=True))
    if kind in _S5_TIMES:
        return s5time(octets)
    if kind == "COUNTER":
        return bcd(octets[0] & 0x0F, octets[1])
    if kind == "DATE":
        return date_text(u16(octets, 0))
    if kind == "TIME_OF_DAY":
        return time_of_day(int.from_bytes(octets, "big"))
    if kind == "DATE_AND_TIME":
        return date_and_time(octets)
    return _long_time(kind, octets)


def string(kind: str, octets: bytes) -> str | None:
    """Return the text of a STRING or WSTRING; None if its lengths are impossible, as in one that was never written."""
    if kind == "STRING":
        if octets[0] > len(octets) - 2 or octets[1] > octets[0]:
            return None
        return octets[2 : 2 + octets[1]].decode("latin-1")
    most: i64 = u16(octets, 0)
    now: i64 = u16(octets, 2)
    if 4 + 2 * most > len(octets) or now > most:
        return None
    return octets[4 : 4 + 2 * now].decode("utf-16-be", "replace")


def _long_time(kind: str, octets: bytes) -> str | None:
    number = int.from_bytes(octets, "big")
    if kind == "LTIME":
        return long_time(int.from_bytes(octets, "big", signed=True))
    if kind == "LTIME_OF_DAY":
        return f"LTOD#{_clock(number)}" if number < _NS_PER_DAY else None
    if kind == "LDT":
        days, rest = divmod(number, _NS_PER_DAY)
        year, month, day = civil(days)
        return f"LDT#{year:04d}-{month:02d}-{day:02d}-{_clock(rest)}"
    if kind == "DTL":
        return _dtl(octets)
    if kind == "POINTER" and len(octets) == _POINTER:
        return _pointer(octets)
    if kind == "ANY" and len(octets) == _ANY and octets[0] == _S7_ANY:
        name = TRANSPORT_SIZES.name(octets[1])
        return f"{_pointer(octets[4:])} {name} {u16(octets, 2)}"
    return None


def long_time(ns: int) -> str:
    """Return nanoseconds as IEC 61131-3 text: ``LT#-1d2h3m4s5ms6us7ns``."""
    ms, rest = divmod(abs(ns), 1_000_000)
    text = duration(ms).removeprefix("T#")
    if text == "0ms":
        text = ""
    micro, nano = divmod(rest, 1000)
    text += f"{micro}us" if micro else ""
    text += f"{nano}ns" if nano else ""
    return f"LT#{'-' if ns < 0 else ''}{text or '0ns'}"


def _clock(ns: int) -> str:
    seconds, rest = divmod(ns, 1_000_000_000)
    return f"{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{rest:09d}"


def _dtl(octets: bytes) -> str | None:
    year: i64 = u16(octets, 0)
    month, day, hour, minute, second = octets[2], octets[3], octets[5], octets[6], octets[7]
    nano = int.from_bytes(octets[8:12], "big")
    if not (1970 <= year <= 2554 and 1 <= month <= 12 and 1 <= day <= 31 and hour < 24 and minute < 60 and second < 60):
        return None
    if nano >= 1_000_000_000:
        return None
    return f"DTL#{year:04d}-{month:02d}-{day:02d}-{hour:02d}:{minute:02d}:{second:02d}.{nano:09d}"


def _pointer(octets: bytes) -> str:
    """Return a pointer of six octets as text: block number, area, bit address."""
    return f"P#{address_text(octets[2], u16(octets, 0), u24(octets, 3), BIT)}"


__all__ = ["BYTE", "decode_element", "decode_part", "decode_typed", "long_time", "scaled", "string"]
