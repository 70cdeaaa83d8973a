"""Compares two dictionaries, and finds out whether differences change the meaning of octets (R18, profile 3.4)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, Literal, NamedTuple

import msgspec

from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import Error
from dissect.scd.mapping import entries_of
from dissect.scd.model import CLASSES
from dissect.scd.ranges import is_mapping
from dissect.scd.records import EnvelopeRecord, FieldRecord, ObjectRecord, Plain, StructRecord, Traits, TypeRecord
from dissect.scd.types import STANDARD, UINT64, Kind
from dissect.wire.text import count

#: Keys that decoding does not depend on; they are not in the wire id.
_NAMES: Final = frozenset(("name", "version", "unit", "low", "high", "text"))
Level = Literal["same", "names", "wire"]
_Flat = dict[str, object]


class Change(NamedTuple):
    """One difference: its place, such as "object 0x6001" or "dictionary", its ``key``, and both values (None: missing).

    ``wire``: the difference changes the meaning of octets.
    """

    place: str
    key: str
    before: str | None
    after: str | None
    wire: bool


class Comparison(NamedTuple):
    """``level``: "same" octets, different "names" (texts, units, limits) or different octets on the "wire"; and differences."""

    level: Level
    changes: tuple[Change, ...]


def compare(first: Dictionary, second: Dictionary) -> Comparison:
    """Return the differences. The level comes from the two identities, file id and wire id."""
    level: Level = "wire"
    if first.wire_id == second.wire_id:
        level = "same" if first.file_id == second.file_id else "names"
    return Comparison(level, tuple(_changes(_entries(first), _entries(second))))


def _changes(first: Mapping[str, _Flat], second: Mapping[str, _Flat]) -> Iterator[Change]:
    for place in [*first, *(place for place in second if place not in first)]:
        wire = not place.startswith("error")
        if place not in second:
            yield Change(place, "", _label(first[place]), None, wire)
        elif place not in first:
            yield Change(place, "", None, _label(second[place]), wire)
        else:
            yield from _keys(place, first[place], second[place])


def _keys(place: str, first: _Flat, second: _Flat) -> Iterator[Change]:
    for key in [*first, *(key for key in second if key not in first)]:
        before, after = first.get(key), second.get(key)
        # Compared by text: NaN is equal to itself then, and 1 differs from 1.0, which has other octets in a file.
        if repr(before) != repr(after):
            wire = _NAMES.isdisjoint(key.split()) and not place.startswith("error")
            yield Change(place, key, _text(before), _text(after), wire)


def _label(flat: _Flat) -> str:
    return str(flat.get("name") or flat.get("text") or "there")


def _text(value: object) -> str | None:
    return None if value is None else str(value)


def _entries(od: Dictionary) -> dict[str, _Flat]:
    """Return the whole content of a dictionary by place and key, in its order."""
    body = od.body
    entries: dict[str, _Flat] = {
        "dictionary": {
            "name": body.name,
            "version": body.version,
            "time_scale": body.time_scale,
            "encoding": body.encoding,
        }
    }
    if body.envelope is not None:
        entries["envelope"] = _envelope(body.envelope)
    entries |= {f"error {number}": {"text": text} for number, text in body.errors}
    entries |= {f"type 0x{row.index:04x}": _type(row) for row in body.types}
    entries |= {f"type 0x{row.index:04x}": _struct(row) for row in body.structs}
    entries |= {f"object 0x{row.index:04x}": _object(row) for row in body.objects}
    return entries


def _type(row: TypeRecord) -> _Flat:
    return {"name": row.name, "kind": Kind(row.kind).name.lower(), "bits": row.bits}


def _struct(row: StructRecord) -> _Flat:
    return {"name": row.name, **_fields(row.fields)}


def _object(row: ObjectRecord) -> _Flat:
    flat: _Flat = {
        "name": row.name, "class": CLASSES[row.object_class], "type": _type_text(row.type), "bits": row.bits or None,
        "access": row.access, "mandatory": row.mandatory, "mappable": row.mappable, "count": row.count or None,
        "used": row.used or None,
    }  # fmt: skip
    mapping = is_mapping(row.index)
    for number, value in enumerate(row.values, 1):
        flat[f"{'entry' if mapping else 'value'} {number}"] = _entry_text(value, row.type) if mapping else value
    return {**flat, **_fields(row.fields), **_traits(row.traits)}


def _entry_text(value: Plain, kind: int) -> object:
    """Return an entry of a PDO's mapping as text; in hexadecimal if it is not a valid entry."""
    if not isinstance(value, int):
        return value
    wide = kind == UINT64.index
    try:
        (entry,) = entries_of([value], wide, "")
    except Error:
        return f"0x{value:x}"
    what = f"0x{entry.target:04x}:{entry.sub}" if entry.target else f"a gap (0x{value:x})"
    return f"{what}, {count(entry.bits, 'bit')}" + (f" at {entry.offset}" if wide else "")


def _fields(fields: Sequence[FieldRecord]) -> _Flat:
    flat: _Flat = {}
    for number, row in enumerate(fields, 1):
        parts: _Flat = {
            "name": row.name, "type": _type_text(row.type) if row.type else "reserved", "bits": row.bits or None,
            "fixed": row.fixed, "access": row.access or None, "mappable": row.mappable, "default": row.default,
            **_traits(row.traits),
        }  # fmt: skip
        flat |= {f"field {number} {key}": value for key, value in parts.items()}
    return flat


def _traits(traits: Traits | None) -> _Flat:
    row = traits or Traits()
    flat: _Flat = {"unit": row.unit, "scale": row.scale, "shift": row.shift, "low": row.low, "high": row.high}
    return flat | {f"text {number}": text for number, text in row.texts}


def _type_text(code: int) -> str | None:
    """Return a type by its code and its standard name; the name of an own type is in the entry of that type."""
    if not code:
        return None
    return f"{STANDARD[code].name} (0x{code:04x})" if code in STANDARD else f"0x{code:04x}"


def _envelope(record: EnvelopeRecord) -> _Flat:
    flat: _Flat = {}
    for number, row in enumerate(record.fields, 1):
        flat |= {f"field {number} {key}": value for key, value in msgspec.structs.asdict(row).items()}
    flat |= {f"kind {number}": service for number, service in record.kinds}
    if record.crc is not None:
        flat |= {f"crc {key}": value for key, value in msgspec.structs.asdict(record.crc).items()}
    return flat
