"""Writes a dictionary as a source that compiles to the same octets: TOML for people, JSON for programs."""

from __future__ import annotations

import json
import math
from typing import Any, Final

import msgspec

from dissect.scd.dictionary import Dictionary
from dissect.scd.map_reading import GAP
from dissect.scd.mapping import Entry, entries_of, pack_entry
from dissect.scd.model import ARRAY, CLASSES, DOMAIN, NULL, RECORD
from dissect.scd.ranges import is_mapping
from dissect.scd.records import EnvelopeRecord, FieldRecord, ObjectRecord, Plain, Traits
from dissect.scd.types import UINT64, Kind, SimpleType
from dissect.scd.values import MAC

_TRAITS: Final = Traits()
#: Replaces the key of a mapping object's values while they are written.
_ENTRIES: Final = "entries of a mapping"
#: Keys whose numbers are written in hexadecimal.
_HEX: Final = frozenset(("index", "poly", "init", "xorout", _ENTRIES))


def dump_tables(od: Dictionary) -> dict[str, Any]:
    """Return the tables of a source as plain Python: what `dump_toml` and `dump_json` write."""
    body = od.body
    head: dict[str, Any] = {"name": body.name, "version": body.version}
    if body.time_scale != "utc":
        head["time_scale"] = body.time_scale
    if body.encoding != "utf-8":
        head["encoding"] = body.encoding
    tables: dict[str, Any] = {"dictionary": head}
    if body.envelope is not None:
        tables["envelope"] = _envelope(body.envelope)
    if body.errors:
        tables["errors"] = {str(number): text for number, text in body.errors}
    types: list[dict[str, Any]] = [
        {"index": row.index, "name": row.name, "base": Kind(row.kind).name.lower(), "bits": row.bits}
        for row in body.types
    ]
    for struct in body.structs:
        fields = [_field(row, od) for row in struct.fields]
        types.append({"index": struct.index, "name": struct.name, "fields": fields})
    if types:
        tables["type"] = types
    pdos = {row.index: table for row in body.objects if (table := _pdo(row, od)) is not None}
    objects = [_object(row, od) for row in body.objects if row.index not in pdos]
    if objects:
        tables["object"] = objects
    if pdos:
        tables["pdo"] = list(pdos.values())
    return tables


def dump_json(od: Dictionary) -> str:
    """Return the dictionary as JSON; values that JSON does not have (NaN) become texts."""
    return _shown(json.dumps(dump_tables(od), ensure_ascii=False, indent=1, allow_nan=False), toml=False) + "\n"


def dump_toml(od: Dictionary) -> str:
    """Return the dictionary as TOML."""
    lines = []
    for name, content in dump_tables(od).items():
        for table in content if isinstance(content, list) else [content]:
            lines.append(f"[[{name}]]" if isinstance(content, list) else f"[{name}]")
            mapping = name == "object" and is_mapping(table["index"])
            lines.extend(
                f"{_key(key)} = {_toml(value, _ENTRIES if mapping and key == 'values' else key)}"
                for key, value in table.items()
            )
            lines.append("")
    return "\n".join(lines)


def _simple(od: Dictionary, code: int) -> SimpleType:
    found = od.types[code]
    assert isinstance(found, SimpleType)
    return found


def _object(row: ObjectRecord, od: Dictionary) -> dict[str, Any]:
    table: dict[str, Any] = {"index": row.index, "name": row.name, "class": CLASSES[row.object_class]}
    if row.mandatory:
        table["mandatory"] = True
    if row.object_class == NULL:
        return table
    table["access"] = row.access
    if row.mappable != (row.index >= 0x2000 and row.object_class != DOMAIN):
        table["mappable"] = row.mappable
    if row.object_class == RECORD:
        return {**table, **_record(row, od)}
    kind = _simple(od, row.type)
    table["type"] = kind.name
    if row.bits:
        table["size"] = row.bits // 8
    if row.object_class == ARRAY:
        table["count"] = row.count
        if row.used != row.count:
            table["used"] = row.used
        if row.values:
            table["values"] = _elements(row.values, kind)
    elif row.values:
        table["default"] = _value(row.values[0], kind)
    return {**table, **_traits(row.traits)}


def _pdo(row: ObjectRecord, od: Dictionary) -> dict[str, Any] | None:
    """Return a mapping object as a [[pdo]] that names the mapped variables; None if its entries have no such form."""
    if not is_mapping(row.index) or row.object_class != ARRAY or row.used != len(row.values) or row.traits is not None:
        return None
    wide = row.type == UINT64.index
    values = [value for value in row.values if isinstance(value, int)]
    pdo = od.pdo_at(row.index)
    if pdo is None or row.mappable or row.count != max(len(values), 1):
        return None
    entries = entries_of(values, wide, "")
    made: list[Any] = []
    end = 0
    for number, entry in enumerate(entries):
        if entry.offset > end:
            made.append({"reserved": entry.offset - end})
        item = _map_item(entry, od)
        again = Entry(*GAP, entry.offset, entry.bits) if isinstance(item, dict) and "reserved" in item else entry
        last = number == len(entries) - 1
        if item is None or pack_entry(again, wide) != values[number] or (wide and again is not entry and not last):
            return None
        made.append(item)
        end = entry.offset + entry.bits
    table: dict[str, Any] = {"dir": pdo.direction, "number": pdo.number, "name": row.name}
    if not wide:
        table["entries"] = "uint32"
    if row.access != "rw":
        table["access"] = row.access
    if row.mandatory:
        table["mandatory"] = True
    return {**table, "map": made}


def _map_item(entry: Entry, od: Dictionary) -> Any:
    """Return an entry of a map: an address, a table if it has its own size, or a gap; None if it has no such form."""
    if not entry.target:
        return {"reserved": entry.bits} if entry.bits else None
    address = f"0x{entry.target:04x}:{entry.sub}"
    variable = od.variable((entry.target, entry.sub))
    if address in od.names or (entry.sub == 0 and not od.objects[entry.target].single):
        return None
    if variable.bits == entry.bits:
        return address
    return {"var": address, "size": entry.bits // 8} if entry.bits % 8 == 0 else None


def _elements(values: list[Plain], kind: SimpleType) -> Any:
    """Return the defaults of an array's elements: a list, or a table by sub-index if some have none."""
    if None not in values:
        return [_value(value, kind) for value in values]
    return {str(sub): _value(value, kind) for sub, value in enumerate(values, 1) if value is not None}


def _record(row: ObjectRecord, od: Dictionary) -> dict[str, Any]:
    table: dict[str, Any] = {}
    if row.type:
        table["type"] = next(struct.name for struct in od.body.structs if struct.index == row.type)
        fields = next(struct.fields for struct in od.body.structs if struct.index == row.type)
    else:
        fields = row.fields
        table["fields"] = [_field(field, od) for field in fields]
    values = {
        field.name: _value(value, _simple(od, field.type))
        for field, value in zip(fields, row.values, strict=False)
        if value is not None
    }
    if values:
        table["values"] = values
    return table


def _field(row: FieldRecord, od: Dictionary) -> dict[str, Any]:
    if not row.type:
        return {"reserved": row.bits} if row.fixed is None else {"reserved": row.bits, "fixed": row.fixed}
    kind = _simple(od, row.type)
    table: dict[str, Any] = {"name": row.name, "type": kind.name}
    if row.bits:
        table["size"] = row.bits // 8
    if row.access:
        table["access"] = row.access
    if row.mappable is not None:
        table["mappable"] = row.mappable
    if row.default is not None:
        table["default"] = _value(row.default, kind)
    return {**table, **_traits(row.traits)}


def _traits(traits: Traits | None) -> dict[str, Any]:
    if traits is None:
        return {}
    table = {key: getattr(traits, key) for key in ("unit", "scale", "shift", "low", "high")}
    table = {key: value for key, value in table.items() if value != getattr(_TRAITS, key)}
    if traits.texts:
        table["texts"] = {str(number): text for number, text in traits.texts}
    return table


def _value(value: Plain, kind: SimpleType) -> Any:
    if isinstance(value, bytes):
        if kind.kind is Kind.STRING:
            return value.decode()
        if kind.kind is Kind.MAC:
            return str(MAC(value))
        return ".".join(map(str, value)) if kind.kind is Kind.IP else value.hex(" ")
    return "nan" if isinstance(value, float) and math.isnan(value) else value


def _envelope(record: EnvelopeRecord) -> dict[str, Any]:
    table: dict[str, Any] = {}
    if record.crc is not None:
        table["crc"] = msgspec.structs.asdict(record.crc)
    fields = []
    for row in record.fields:
        field: dict[str, Any] = {"role": row.role}
        if row.bits:
            field["bits"] = row.bits
        field.update({key: True for key in ("signed", "big") if getattr(row, key)})
        field.update({key: getattr(row, key) for key in ("value", "counts") if getattr(row, key) not in (None, "")})
        fields.append(field)
    table["fields"] = fields
    table["kinds"] = [{"value": value, "service": service} for value, service in record.kinds]
    return table


def _key(key: str) -> str:
    return key if key.isascii() and key.replace("_", "").isalpha() else _toml(key)


def _toml(value: Any, key: str = "") -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int):
        digits = 16 if key == _ENTRIES and value >> 32 else 8 if key == _ENTRIES else 4
        return f"0x{value:0{digits}x}" if key in _HEX and value >= 0 else str(value)
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, str):
        return _shown(json.dumps(value, ensure_ascii=False), toml=True)
    if isinstance(value, list):
        parts = [_toml(item, key if key == _ENTRIES else "") for item in value]
        if value and isinstance(value[0], dict):
            return "[\n" + "".join(f"  {part},\n" for part in parts) + "]"
        return f"[{', '.join(parts)}]"
    return (
        "{"
        + ", ".join(f"{_key(name)} = {_toml(item, key if key == _ENTRIES else name)}" for name, item in value.items())
        + "}"
    )


def _shown(text: str, *, toml: bool) -> str:
    """Return JSON or TOML with unprintable characters escaped, so that no text in a dictionary can control a terminal."""
    if text.replace("\n", "").isprintable():
        return text
    return "".join([char if char.isprintable() or char == "\n" else _escape(ord(char), toml) for char in text])


def _escape(code: int, toml: bool) -> str:
    if code < 0x10000:
        return f"\\u{code:04x}"
    return f"\\U{code:08x}" if toml else json.dumps(chr(code)).strip('"')
