"""Dictionaries for tests of the codec, made from records: nothing has to be read or compiled for them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.scd.codec import Codec
from dissect.scd.dictionary import Dictionary
from dissect.scd.mapping import Entry, pack_entry
from dissect.scd.records import Body, EnvelopeRecord, FieldRecord, ObjectRecord, StructRecord, TypeRecord
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

#: A variable of a PDO: its type and, for strings and blocks, its bits; type 0 is a gap of so many bits.
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
    """A VAR for each part that is no gap, and the entries that map them one after the other."""
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
