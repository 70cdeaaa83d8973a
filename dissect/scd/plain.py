"""Default values in the form of records: texts and addresses as octets, times as two numbers, one NaN."""

from __future__ import annotations

import math
from ipaddress import IPv4Address

from dissect.scd.errors import E_UTF8, E_VALUE, Error, shown
from dissect.scd.records import Plain
from dissect.scd.types import Kind, SimpleType, Value


def as_plain(value: Value) -> Plain:
    """Return a checked value in the form of records."""
    if isinstance(value, str):
        return value.encode()
    if isinstance(value, IPv4Address):
        return value.packed
    if isinstance(value, bytes):
        return bytes(value)
    if isinstance(value, tuple):
        return [int(part) for part in value]
    if isinstance(value, float) and math.isnan(value):
        return math.nan
    return value


def from_plain(plain: Plain, kind: SimpleType, bits: int, where: str = "") -> Value:
    """Return the value for ``plain`` in the form of records; raises `Error` if it is not a value of the type in that form."""
    value: object = plain
    if kind.kind is Kind.STRING and isinstance(plain, bytes):
        try:
            value = plain.decode()
        except UnicodeDecodeError as error:
            raise Error(E_UTF8, where, f"not UTF-8: {error.reason}") from None
    found = kind.check(value, bits, where)
    kept = as_plain(found)
    same = kept == plain or (isinstance(plain, float) and math.isnan(plain) and math.copysign(1, plain) > 0)
    if not same or type(kept) is not type(plain):
        raise Error(E_VALUE, where, f"{shown(plain)} is not the form in which a {kind.name} is kept")
    return found
