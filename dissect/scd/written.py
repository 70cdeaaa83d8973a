"""Values as people and device descriptions write them, as texts: "0xABC", "true", "192.168.100.1", "2015-10-18T00:00:00Z"."""

from __future__ import annotations

import re
import struct
from ipaddress import AddressValueError, IPv4Address
from typing import Final

from dissect.scd.errors import E_VALUE, Error
from dissect.scd.model import Variable
from dissect.scd.types import Kind, SimpleType, Value

_WHOLE: Final = re.compile(r"[+-]?(0[xX][0-9a-fA-F]+|[0-9]+)")
_PAIR: Final = re.compile(r"\[?\s*([+-]?[0-9]{1,10})\s*[,;]\s*([+-]?[0-9]{1,10})\s*\]?")
#: Digits of a number that anything here can hold.
_MOST_DIGITS: Final = 40


def whole(text: str) -> int:
    """Return a whole number, decimal or 0x…; raises ValueError."""
    written = "".join(text.split())
    if len(written) > _MOST_DIGITS or not _WHOLE.fullmatch(written):
        raise ValueError("is no whole number")
    return int(written, 16) if "x" in written.lower() else int(written)


def written_value(text: str, kind: SimpleType) -> object:
    """Return what a text says as something that `SimpleType.check` takes; raises ValueError.

    Of a signed integer 0x… are its bits, of a real those of its IEEE 754 form. A time is ISO 8601 or "seconds, nanoseconds".
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
    """Return a variable's value from a text, which may be what the dictionary calls the value; raises `Error`."""
    for number, name in variable.traits.texts:
        if name == text:
            return variable.check(bool(number) if variable.type.kind is Kind.BOOL else number)
    try:
        return variable.check(written_value(text, variable.type))
    except ValueError as error:
        raise Error(E_VALUE, variable.label, f"{text[:60]!r} {error}") from None


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
        raise ValueError(f"is no IP address: {error}") from None


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
        raise ValueError("is no number") from None


def _octets(written: str) -> bytes:
    try:
        return bytes.fromhex(written.removeprefix("0x").removeprefix("0X"))
    except ValueError:
        raise ValueError("is no hexadecimal text") from None
