"""Dictionaries for tests of the codec, made from records, so that nothing must be read or compiled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import pytest

from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import Error
from dissect.scd.mapping import Entry, pack_entry
from dissect.scd.records import (
    Body,
    CrcRecord,
    EnvelopeField,
    EnvelopeRecord,
    FieldRecord,
    ObjectRecord,
    StructRecord,
    TypeRecord,
)
from dissect.scd.types import STANDARD, Kind

BOOL, INT8, INT16, INT32, UINT8, UINT16, UINT32, FLOAT32, STRING, INTERVAL, BLOCK, FLOAT64, INT64, UINT64 = (
    1, 2, 3, 4, 5, 6, 7, 8, 10, 13, 15, 17, 21, 27,
)  # fmt: skip
MAC_T, IP_T, NETTIME = 1025, 1026, 1027
#: Own types of every dictionary made here, by index.
UINT12, UINT10, INT10, INT12, UINT4 = range(0x60, 0x65)
TYPES: Final = [
    TypeRecord(UINT12, "uint12", Kind.UINT, 12),
    TypeRecord(UINT10, "uint10", Kind.UINT, 10),
    TypeRecord(INT10, "int10", Kind.INT, 10),
    TypeRecord(INT12, "int12", Kind.INT, 12),
    TypeRecord(UINT4, "uint4", Kind.UINT, 4),
]
_WIDTHS: Final = {**{code: row.bits for code, row in STANDARD.items()}, **{row.index: row.bits for row in TYPES}}

#: A variable of a PDO: its type and, for strings and blocks, its bits; type 0 is a gap of this many bits.
Part = int | tuple[int, int]


def variable(index: int, kind: int, bits: int = 0, *, name: str = "", access: str = "rw") -> ObjectRecord:
    """A VAR."""
    return ObjectRecord(index, 7, name or f"v{index:04x}", kind, bits, access, False, True)  # type: ignore[arg-type]


def mapping(index: int, name: str, parts: Sequence[Entry]) -> ObjectRecord:
    """A mapping object with entries of UNSIGNED64."""
    values = [pack_entry(part, True) for part in parts]
    count = max(len(values), 1)
    filled: list[object] = [*values, *[0] * (count - len(values))]
    return ObjectRecord(index, 8, name, UINT64, 0, "rw", False, False, count, len(values), filled)  # type: ignore[arg-type]


def entries(parts: Sequence[Part], first: int = 0x6000) -> tuple[list[ObjectRecord], list[Entry]]:
    """Return a VAR for each part that is not a gap, and the entries that map them one after the other."""
    objects: list[ObjectRecord] = []
    mapped: list[Entry] = []
    at = 0
    for part in parts:
        kind, bits = part if isinstance(part, tuple) else (part, 0)
        width = bits or _WIDTHS[kind]
        if kind:
            index = first + len(objects)
            objects.append(variable(index, kind, 0 if _WIDTHS[kind] else bits))
            mapped.append(Entry(index, 0, at, width))
        at += width
    return objects, mapped


def dictionary(
    objects: Sequence[ObjectRecord] = (),
    structs: Sequence[StructRecord] = (),
    types: Sequence[TypeRecord] = TYPES,
    envelope: EnvelopeRecord | None = None,
) -> Dictionary:
    """A dictionary of these records."""
    ordered = sorted(objects, key=lambda row: row.index)
    return Dictionary(Body("test", "1", "utc", list(types), list(structs), ordered, envelope))


def pdo(*parts: Part, strict_pad: bool = False, types: Sequence[TypeRecord] = TYPES) -> Codec:
    """A codec with one PDO, T1, of these parts at 6000h:00, 6001h:00 and so on."""
    objects, mapped = entries(parts)
    return Codec(dictionary([mapping(0x1A00, "T1 map", mapped), *objects], types=types), strict_pad=strict_pad)


def field(name: str, kind: int, bits: int = 0, fixed: int | None = None) -> FieldRecord:
    """A field of a struct; type 0 is reserved."""
    return FieldRecord(name, kind, bits or _WIDTHS[kind], fixed) if not kind else FieldRecord(name, kind, bits)


def keyed(values: Sequence[object]) -> dict[tuple[int, int], object]:
    """Values of `pdo` by address."""
    return {(0x6000 + at, 0): value for at, value in enumerate(values)}


def code(error: pytest.ExceptionInfo[Error]) -> str:
    return error.value.code


def pump() -> StructRecord:
    fields = [
        field("run", BOOL),
        field("", 0, 3, fixed=0b101),
        field("", 0, 4),
        field("level", UINT16),
        field("flow", FLOAT32),
    ]
    return StructRecord(0x40, "pump_t", fields)


def array() -> ObjectRecord:
    return ObjectRecord(0x2000, 8, "a", INT16, 0, "rw", False, True, 3, 3)


def plant(envelope: EnvelopeRecord | None = None, *, access: str = "rw") -> Codec:
    """6000h:00 Boolean, 6041h:00 uint16, a constant, and T1 of the reference's §2: u16, i32, i8."""
    objects = [
        variable(0x6000, BOOL, access=access),
        variable(0x6041, UINT16, access=access),
        variable(0x6042, INT32),
        variable(0x6043, INT8),
        variable(0x6044, STRING, 64),
        variable(0x6045, UINT8, access="const"),
        variable(0x6046, UINT8, access="wo"),
        mapping(0x1A00, "T1 map", [Entry(0x6041, 0, 0, 16), Entry(0x6042, 0, 16, 32), Entry(0x6043, 0, 48, 8)]),
        mapping(0x1641, "R66 map", [Entry(0x6000, 0, 0, 1)] if access == "rw" else []),
    ]
    return Codec(dictionary(objects, envelope=envelope))


#: Reference §3.3, to the octet. Parts on 6000h:01 need a RECORD there, which `plant` does not have.
WIRE: list[tuple[str, str, dict[str, Any]]] = [
    ("DC 02 07 00 41 60 00 00 00 00 D5 D2", "read request", {"tid": 7, "index": 0x6041}),
    ("DC 82 07 00 41 60 00 00 02 00 37 02 1F 30", "read response",
     {"tid": 7, "index": 0x6041, "values": {(0x6041, 0): 0x0237}}),
    ("DC C2 07 FB 41 60 00 00 00 00 09 56", "read abort", {"tid": 7, "index": 0x6041, "err": -5}),
    ("DC 81 08 00 00 60 01 00 00 00 E5 C0", "write response", {"tid": 8, "index": 0x6000, "sub": 1}),
    ("DC 10 2A 00 00 1A 00 00 07 00 37 02 18 FC FF FF 08 BB 4D", "pdo push",
     {"tid": 42, "index": 0x1A00, "pdo": "T1", "values": {(0x6041, 0): 0x0237, (0x6042, 0): -1000, (0x6043, 0): 8}}),
    ("DC 01 08 00 00 60 01 00 01 00 01 69 FF", "write request",
     {"tid": 8, "index": 0x6000, "sub": 1, "values": {(0x6000, 1): True}}),
]  # fmt: skip


#: The example of the reference's §3.3.
REFERENCE = EnvelopeRecord(
    fields=[
        EnvelopeField("src", 8), EnvelopeField("dst", 8),
        EnvelopeField("kind", 6), EnvelopeField("response", 1), EnvelopeField("abort", 1),
        EnvelopeField("size", 16, counts="rest"),
        EnvelopeField("index", 16, big=True), EnvelopeField("sub", 8),
        EnvelopeField("err", 8, signed=True), EnvelopeField("data"), EnvelopeField("crc", 16),
    ],
    kinds=[(1, "write"), (2, "read"), (16, "pdo")],
    crc=CrcRecord(init=0xFFFF),
)  # fmt: skip
