"""Values as texts of people and device descriptions: "0xABC", "true", "192.168.100.1", "2015-10-18T00:00:00Z"."""

from __future__ import annotations

import math
import re
import struct
from fractions import Fraction
from ipaddress import AddressValueError, IPv4Address
from typing import Final

from dissect.scd.errors import E_RANGE, E_VALUE, Error
from dissect.scd.model import Variable
from dissect.scd.types import Kind, SimpleType, Value
from dissect.wire.config.hints import close_to

_WHOLE: Final = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|[0-9]+)")
#: Prefixes of a number: the raw one, as on the wire, or the physical one, with scale and shift.
RAW: Final = "raw:"
PHYSICAL: Final = "phys:"
_NUMBER: Final = re.compile(r"[+-]?[0-9]{1,40}(?:\.[0-9]{1,40})?(?:[eE][+-]?[0-9]{1,3})?")
_BETWEEN_DIGITS: Final = re.compile(r"(?<=[0-9])\s+(?=[0-9])")
_OCTAL: Final = re.compile(r"[+-]?0[0-9]{1,39}")
_PAIR: Final = re.compile(r"\[?\s*([+-]?[0-9]{1,10})\s*[,;]\s*([+-]?[0-9]{1,10})\s*\]?")
#: Most digits of a number; everything here fits.
_MOST_DIGITS: Final = 40
#: How many texts of values an error names.
_MOST_TEXTS: Final = 8


def whole(text: str) -> int:
    """Return a whole number, decimal or 0x…. Raises ValueError."""
    written = "".join(text.split())
    if len(written) > _MOST_DIGITS or not _WHOLE.fullmatch(written):
        raise ValueError("is not a whole number")
    return int(written, 16) if "x" in written.lower() else int(written)


def is_octal(text: str) -> bool:
    """Return whether a number begins with a 0, as octal ones do in device descriptions."""
    return _OCTAL.fullmatch("".join(text.split())) is not None


def whole_octal(text: str) -> int:
    """Return a whole number as in device descriptions: decimal, 0x…, or octal with a leading 0 (CiA 306).

    Raises ValueError for anything else.
    """
    written = "".join(text.split())
    if _OCTAL.fullmatch(written):
        if "8" in written or "9" in written:
            raise ValueError("begins with 0 like an octal number, and has an 8 or 9 in it")
        return int(written, 8)
    return whole(text)


def written_value(text: str, kind: SimpleType) -> object:
    """Return a text as a value that `SimpleType.check` accepts. Raises ValueError.

    For a signed integer 0x… gives its bits, for a real those of its IEEE 754 form. A time is ISO 8601 or "seconds,
    nanoseconds".
    """
    if kind.kind is Kind.STRING:
        return text
    written = text.strip()
    if kind.kind is Kind.BLOCK:
        return _octets(written)
    if kind.kind is Kind.REAL:
        return _real(written, kind.bits)
    if kind.kind in (Kind.BOOL, Kind.INT, Kind.UINT):
        return _number(written, kind)
    if kind.kind in (Kind.NETTIME, Kind.INTERVAL) and (pair := _PAIR.fullmatch(written)):
        return int(pair[1]), int(pair[2])
    if not _WHOLE.fullmatch(written):
        return _ip(written) if kind.kind is Kind.IP else written
    number = whole(written)
    if not 0 <= number < 1 << kind.bits:
        raise ValueError(f"does not fit {kind.bits} bits")
    if kind.kind in (Kind.MAC, Kind.IP):
        return number.to_bytes(kind.bits // 8, "big")
    return struct.unpack("<ii", number.to_bytes(8, "little"))  # seconds are the low half, as on the wire


def parse_written(text: str, variable: Variable) -> Value:
    """Return a variable's raw value for a text; raises `Error`.

    The text may be the dictionary's text for a value; a physical value with its unit or with ``phys:`` before it; or a raw
    value, which ``raw:`` or 0x makes certain. A bare number may be either if the variable has scale or shift, and is refused
    then.
    """
    for number, name in variable.traits.texts:
        if name == text:
            return variable.check(bool(number) if variable.type.kind is Kind.BOOL else number)
    try:
        if variable.type.kind in (Kind.INT, Kind.UINT, Kind.REAL):
            return variable.check(_raw_number(text.strip(), variable))
        return variable.check(written_value(text, variable.type))
    except ValueError as error:
        raise Error(E_VALUE, variable.label, f"{text[:60]!r} {error}{_texts_meant(text, variable)}") from None


def _texts_meant(text: str, variable: Variable) -> str:
    """Return which texts the dictionary has for values of a variable, for the error that a text is not a value."""
    texts = [name for _, name in variable.traits.texts]
    if not texts or text[:1].isdecimal():
        return ""
    more = f" and {len(texts) - _MOST_TEXTS} more" if len(texts) > _MOST_TEXTS else ""
    return close_to(text, texts) or f", nor one of {', '.join(repr(name) for name in texts[:_MOST_TEXTS])}{more}"


def _raw_number(written: str, variable: Variable) -> object:
    """Return the raw value for a number that is written raw or physical; raises ValueError or `Error`."""
    traits, kind = variable.traits, variable.type
    if written.startswith(RAW):
        return written_value(written.removeprefix(RAW), kind)
    marked = written.startswith(PHYSICAL)
    plain = _BETWEEN_DIGITS.sub("", written.removeprefix(PHYSICAL).lstrip())
    number = _NUMBER.match(plain)
    if number is None or plain.lower().lstrip("+-").startswith("0x"):
        return written_value(written, kind)
    unit = plain[number.end() :].strip()
    if marked and unit[:1].isdecimal():
        raise ValueError("is not a number of at most 40 digits")
    if unit[:1].isdecimal() or not (marked or unit):
        if traits.scale != 1 or traits.shift:
            physical = f"'{plain} {traits.unit}'" if traits.unit else f"{PHYSICAL}{plain}"
            detail = f"{written} may be the raw or the physical value: write {RAW}{plain} or {physical}"
            raise Error(E_VALUE, variable.label, detail)
        return written_value(written, kind)
    if unit and unit != traits.unit:
        raise ValueError(
            f"is in {unit[:40]!r}, the unit is {traits.unit!r}" if traits.unit else "has a unit, it has none"
        )
    return _from_physical(Fraction(number.group()), variable)


def _from_physical(physical: Fraction, variable: Variable) -> int | float:
    """Return the raw value for a physical one; raises `Error` E_RANGE if it is between two that can be sent."""
    scale, shift = Fraction(repr(variable.traits.scale)), Fraction(repr(variable.traits.shift))
    raw = (physical - shift) / scale
    if variable.type.kind is Kind.REAL:
        return float(raw)
    if raw.denominator != 1:
        low, high = sorted([float(whole * scale + shift) for whole in (math.floor(raw), math.ceil(raw))])
        detail = f"{float(physical):g} lies between two values that can be sent, {low:g} and {high:g}"
        raise Error(E_RANGE, variable.label, f"{detail} {variable.unit}".rstrip())
    return int(raw)


def _number(written: str, kind: SimpleType) -> object:
    if kind.kind is Kind.BOOL and written.lower() in {"true", "false"}:
        return written.lower() == "true"
    number = whole(written)
    if kind.kind is Kind.BOOL:
        return {0: False, 1: True}.get(number, number)
    if kind.kind is Kind.INT and "x" in written.lower() and 1 << (kind.bits - 1) <= number < 1 << kind.bits:
        return number - (1 << kind.bits)
    return number


def _ip(written: str) -> IPv4Address:
    try:
        return IPv4Address(written)
    except AddressValueError as error:
        raise ValueError(f"is not an IP address: {error}") from None


def _real(written: str, bits: int) -> float:
    if written.lower().startswith("0x"):
        number = whole(written)
        if number >> bits:
            raise ValueError(f"does not fit {bits} bits")
        (value,) = struct.unpack(">f" if bits == 32 else ">d", number.to_bytes(bits // 8, "big"))
        return float(value)
    try:
        return float(written)
    except ValueError:
        raise ValueError("is not a number") from None


def _octets(written: str) -> bytes:
    try:
        return bytes.fromhex(written.removeprefix("0x").removeprefix("0X"))
    except ValueError:
        raise ValueError("is not hexadecimal text") from None
