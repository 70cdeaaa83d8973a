"""A dictionary as people write it: TOML (or JSON of the same shape) into records (profile 3.1).

Tables: [dictionary], [[type]], [[object]], [[pdo]], [[instance]], [envelope], [errors]. docs/scd.md lists their keys.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any, Final, TypeVar

import msgspec

from dissect.scd import ranges
from dissect.scd.bounds import check_bounds
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import DictionaryError, Error, shown
from dissect.scd.instances import expand
from dissect.scd.mapping import Entry, pack_entry
from dissect.scd.model import ARRAY, DOMAIN, NULL, RECORD
from dissect.scd.reading import Table, envelope_of, errors_of, fields_of, traits_of
from dissect.scd.records import Body, FieldRecord, ObjectClass, ObjectRecord, Plain, StructRecord, TypeRecord
from dissect.scd.toml_tables import header_lines, parse_tables
from dissect.scd.types import STANDARD, STANDARD_NAMES, Kind, SimpleType, reserved, width_trouble

_LISTS: Final = ("type", "object", "pdo", "instance")
_TABLES: Final = ("dictionary", "envelope", "errors")
_CLASSES: Final[dict[str, ObjectClass]] = {"NULL": 0, "DOMAIN": 2, "VAR": 7, "ARRAY": 8, "RECORD": 9}
_KINDS: Final = {kind.name.lower(): kind for kind in Kind if kind is not Kind.RESERVED}
Row = TypeVar("Row", TypeRecord, StructRecord, ObjectRecord)
#: Of a sub-index, zeros in front allowed.
_MOST_DIGITS: Final = 9
_UINT32_MAP: Final = 7
_UINT64_MAP: Final = 27


def parse_toml(text: str, path: str = "") -> Dictionary:
    """Return the dictionary of a TOML source; raises `DictionaryError` with ``path``, line, table and rule."""
    tables = parse_tables(text, path)
    return _build(tables, path, header_lines(text, tables, _LISTS, _TABLES))


def parse_json(text: str, path: str = "") -> Dictionary:
    """Return the dictionary of a JSON source of the same shape."""
    try:
        tables = json.loads(text, object_pairs_hook=_no_key_twice)
    except json.JSONDecodeError as error:
        raise DictionaryError("JSON", error.msg, path=path, line=error.lineno) from None
    except (RecursionError, ValueError) as error:
        raise DictionaryError("JSON", str(error), path=path) from None
    if not isinstance(tables, dict):
        raise DictionaryError("JSON", "a dictionary is an object with the tables of a TOML source", path=path)
    return _build(tables, path, {})


def _no_key_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ValueError("a key is there twice in one object")
    return found


def _build(tables: Mapping[str, Any], path: str, lines: Mapping[tuple[str, int], int]) -> Dictionary:
    reader = _Reader(tables, lines)
    try:
        body = reader.body()
        return Dictionary(body)
    except DictionaryError as error:
        error.path = path
        error.line = error.line or reader.line_of(error)
        raise


class _Reader:
    """Reads the tables of one source. What an index was written as is kept, so that a broken rule finds its line."""

    def __init__(self, tables: Mapping[str, Any], lines: Mapping[tuple[str, int], int]) -> None:
        self._tables = tables
        self._lines = lines
        self._homes: dict[int, int] = {}
        self._simple: dict[str, SimpleType] = {name: STANDARD[index] for name, index in STANDARD_NAMES.items()}
        self._structs: dict[str, StructRecord] = {}
        self._by_index: dict[int, SimpleType | StructRecord] = dict(STANDARD)
        self._objects: dict[int, ObjectRecord] = {}
        self._names: dict[str, ObjectRecord] = {}

    def line_of(self, error: DictionaryError) -> int:
        """Return the line of the table that wrote the entry an error is about, 0 where that is not known."""
        for name in _TABLES:
            if error.where.startswith(name):
                return self._lines.get((name, 0), 0)
        return self._homes.get(error.index, 0)

    def body(self) -> Body:
        """Return the records, in their order."""
        self._top_level()
        for name in _TABLES:
            check_bounds(self._tables.get(name), f"[{name}]", self._lines.get((name, 0), 0))
        for name in _LISTS:
            for number, row in enumerate(self._tables.get(name, ())):
                check_bounds(row, f"[[{name}]] {number + 1}", self._lines.get((name, number), 0))
        head = Table(self._tables.get("dictionary", {}), "[dictionary]", self._lines.get(("dictionary", 0), 0))
        name, version = head.text("name"), head.text("version", "")
        scale = head.choice("time_scale", ("utc", "tai"), "utc")
        head.done()
        lists = expand({name: self._list(name) for name in _LISTS})
        types: dict[int, TypeRecord] = {}
        structs: dict[int, StructRecord] = {}
        for table in lists["type"]:
            if not table.has("fields"):
                self._place(table, types, self._type(table))
        for table in lists["type"]:
            if table.has("fields"):
                self._place(table, structs, self._struct(table), types)
        for table in lists["object"]:
            self._add(table, self._object(table))
        for table in lists["pdo"]:
            self._pdo(table)
        return Body(
            name, version, scale, _ascending(types), _ascending(structs), _ascending(self._objects),
            envelope_of(self._tables.get("envelope"), self._lines.get(("envelope", 0), 0)),
            errors_of(self._tables.get("errors"), self._lines.get(("errors", 0), 0)),
        )  # fmt: skip

    def _top_level(self) -> None:
        for name, content in self._tables.items():
            if name not in (*_LISTS, *_TABLES):
                raise DictionaryError(f"[{name}]", "no table of a dictionary: " + ", ".join((*_TABLES, *_LISTS)))
            if not isinstance(content, list if name in _LISTS else dict):
                raise DictionaryError(
                    f"[{name}]", f"is written [[{name}]]" if name in _LISTS else f"is written [{name}]"
                )

    def _list(self, name: str) -> list[Table]:
        rows = self._tables.get(name, [])
        return [
            Table(row, f"[[{name}]] {number + 1}", self._lines.get((name, number), 0))
            for number, row in enumerate(rows)
        ]

    def _place(self, table: Table, rows: dict[int, Row], row: Row, others: Mapping[int, object] | None = None) -> None:
        table.done()
        if row.index in rows or (others is not None and row.index in others):
            first = self._homes.get(row.index, 0)
            raise table.fail(
                "index", f"0x{row.index:04x} is there already" + (f", line {first}" if first else ""), "R57"
            )
        rows[row.index] = row
        self._homes[row.index] = table.line

    def _add(self, table: Table, row: ObjectRecord) -> None:
        if row.name in self._names:
            raise table.fail("name", f"{shown(row.name)} is already 0x{self._names[row.name].index:04x}", "R71")
        self._place(table, self._objects, row)
        self._names[row.name] = row

    def _type(self, table: Table) -> TypeRecord:
        index, name = table.number("index"), table.text("name")
        written = table.text("base")
        own = self._simple.get(written) if written in STANDARD_NAMES else None
        kind = own.kind if own is not None else _KINDS.get(written)
        if kind is None:
            raise table.fail("base", f"{shown(written)} is no kind: {', '.join(_KINDS)}, or a type of the text", "R66")
        bits = table.number("bits", -1) if not table.has("size") else 8 * table.number("size")
        if bits < 0:
            bits = own.bits if own is not None else _only_width(kind)
        trouble = width_trouble(kind, bits)  # checked at once, as values of the type are checked while they are read
        if trouble:
            raise table.fail("size" if table.has("size") else "bits", trouble, "R34, R37")
        row = TypeRecord(index, name, int(kind), bits)
        self._simple.setdefault(name, SimpleType(index, name, kind, bits))
        self._by_index.setdefault(index, self._simple[name])
        return row

    def _struct(self, table: Table) -> StructRecord:
        index, name = table.number("index"), table.text("name")
        row = StructRecord(index, name, fields_of(table, self._field_type))
        self._structs.setdefault(name, row)
        self._by_index.setdefault(index, row)
        return row

    def _field_type(self, table: Table) -> SimpleType:
        found = self._any_type(table)
        if isinstance(found, StructRecord):
            raise table.fail("type", f"{found.name} is no simple type: no records of records", "R73")
        return found

    def _any_type(self, table: Table) -> SimpleType | StructRecord:
        written = table.name_or_number("type")
        if isinstance(written, str):
            found = self._simple.get(written) or self._structs.get(written)
        else:
            found = self._by_index.get(written)
        if found is None:
            raise table.fail("type", f"no type {shown(written)}; [[type]] defines one", "R72")
        return found

    def _object(self, table: Table) -> ObjectRecord:
        index, name = table.number("index"), table.text("name")
        written = table.choice("class", tuple(_CLASSES), "VAR")
        object_class = _CLASSES[written]
        mandatory = table.flag("mandatory", False)
        if object_class == NULL:
            return ObjectRecord(index, NULL, name, 0, 0, "", mandatory, False)
        access = table.choice("access", ("rw", "wo", "ro", "const"), "rw")
        mappable = table.flag("mappable", index >= 0x2000 and object_class != DOMAIN)
        if object_class == RECORD:
            return self._record(table, ObjectRecord(index, RECORD, name, 0, 0, access, mandatory, mappable))
        found = self._any_type(table) if table.has("type") or object_class != DOMAIN else STANDARD[15]
        if isinstance(found, StructRecord):
            what = "no arrays of records" if object_class == ARRAY else "its objects are RECORDs"
            raise table.fail("type", f"{found.name} is no simple type: {what}", "R73, C34")
        bits = 8 * table.number("size", 0)
        row = ObjectRecord(
            index, object_class, name, found.index, bits, access, mandatory, mappable, traits=traits_of(table)
        )  # fmt: skip
        if object_class != ARRAY:
            value = table.value("default", found, found.bits or bits)
            return row if value is None else msgspec.structs.replace(row, values=[value])
        values = table.values("values", found, found.bits or bits)
        count = table.number("count", len(values))
        return msgspec.structs.replace(row, count=count, used=table.number("used", count), values=_trimmed(values))

    def _record(self, table: Table, row: ObjectRecord) -> ObjectRecord:
        if table.has("fields"):
            fields = fields_of(table, self._field_type)
            if table.has("type"):
                raise table.fail("type", "either a type or fields of its own", "R70")
            row = msgspec.structs.replace(row, fields=fields)
        else:
            found = self._any_type(table)
            if not isinstance(found, StructRecord):
                raise table.fail("type", f"{found.name} is simple; a RECORD is of a DEFSTRUCT", "R70, C34")
            row = msgspec.structs.replace(row, type=found.index)
            fields = found.fields
        kinds = [self._kind_of(field) for field in fields]
        return msgspec.structs.replace(row, values=_trimmed(table.field_values("values", fields, kinds)))

    def _kind_of(self, field: FieldRecord) -> SimpleType:
        found = self._by_index[field.type] if field.type else reserved(field.bits)
        assert isinstance(found, SimpleType)
        return found

    def _pdo(self, table: Table) -> None:
        direction = table.choice("dir", ("T", "R"))
        number = table.number("number")
        name = table.text("name", f"{direction}PDO {number}")
        wide = table.choice("entries", ("uint64", "uint32"), "uint64") == "uint64"
        entries = self._entries(table, wide)
        access = table.choice("access", ("rw", "wo", "ro", "const"), "rw")
        mandatory = table.flag("mandatory", False)
        count = table.number("count", max(len(entries), 1))
        node, version = table.number("node", -1), table.number("version", -1)
        try:
            index = ranges.pdo_index(direction, "map", number)
            comm = ranges.pdo_index(direction, "comm", number)
        except Error as error:
            raise table.fail("number", error.detail, "R95, C47") from None
        values: list[Plain] = [pack_entry(entry, wide) for entry in entries]
        kind = _UINT64_MAP if wide else _UINT32_MAP
        row = ObjectRecord(
            index, ARRAY, name, kind, 0, access, mandatory, False, count=count, used=len(entries), values=values
        )  # fmt: skip
        self._add(table, row)
        if node >= 0 or version >= 0:
            fields = [FieldRecord("node", 5, 0), FieldRecord("version", 5, 0)]
            settings: list[Plain] = [max(node, 0), max(version, 0)]
            label = table.text("comm_name", f"{name}: communication")
            self._add(
                table,
                ObjectRecord(comm, RECORD, label, 0, 0, access, mandatory, False, values=settings, fields=fields),
            )

    def _entries(self, table: Table, wide: bool) -> list[Entry]:
        entries = []
        offset = 0
        for number, item in enumerate(table.items("map"), 1):
            row = Table(item if isinstance(item, dict) else {"var": item}, f"{table.where}, map {number}", table.line)
            if row.has("reserved"):
                bits = row.number("reserved")
                if not 1 <= bits <= 0xFFFF or (not wide and bits > 0xFF):
                    raise row.fail("reserved", f"a gap of {bits} bits", "R103")
                if not wide:
                    entries.append(Entry(5, 0, offset, bits))
            else:
                target, sub, bits = self._target(row)
                offset = row.number("offset", offset)
                bits = 8 * row.number("size") if row.has("size") else bits
                if not (0 <= offset <= 0xFFFF and 0 <= bits <= (0xFFFF if wide else 0xFF)):
                    raise row.fail("var", f"{bits} bits at bit {offset} do not fit an entry", "R103")
                entries.append(Entry(target, sub, offset, bits))
            row.done()
            offset += bits
        return entries

    def _target(self, row: Table) -> tuple[int, int, int]:
        """Return index, sub-index and bits of the variable that an entry names."""
        written = row.text("var")
        match = re.fullmatch(r"(0[xX][0-9a-fA-F]{1,4})(?:[:.](\w+))?", written)
        if match is not None and written not in self._names:
            obj, field = self._objects.get(int(match[1], 16)), match[2] or "0"
        elif written in self._names:
            obj, field = self._names[written], "0"
        else:
            whole, _, field = written.rpartition(".")
            obj = self._names.get(whole)
        if obj is None:
            raise row.fail("var", f"no object {shown(written)}", "R103")
        sub, bits = self._sub(obj, field)
        if sub < 0:
            raise row.fail("var", f"{shown(obj.name)} has no sub-index {shown(field)}", "R103")
        return obj.index, sub, bits

    def _sub(self, obj: ObjectRecord, field: str) -> tuple[int, int]:
        """Return the number and the bits of an object's sub-index, -1 where it has none such."""
        struct = self._by_index.get(obj.type)
        fields = obj.fields or (struct.fields if isinstance(struct, StructRecord) else [])
        for position, row in enumerate(fields, 1):
            if field in (str(position), row.name):
                return position, self._kind_of(row).bits or row.bits
        if isinstance(struct, SimpleType) and field.isdecimal() and len(field) <= _MOST_DIGITS:
            last = obj.count if obj.object_class == ARRAY else 0
            first = 1 if obj.object_class == ARRAY else 0
            if first <= int(field) <= last:
                return int(field), struct.bits or obj.bits
        return -1, 0


def _only_width(kind: Kind) -> int:
    """Return the bits of a kind that has one width, 0 for the others, which then break a rule or are open."""
    widths = {row.bits for row in STANDARD.values() if row.kind is kind}
    return widths.pop() if len(widths) == 1 else 0


def _ascending(rows: Mapping[int, Row]) -> list[Row]:
    return [rows[index] for index in sorted(rows)]


def _trimmed(values: list[Plain]) -> list[Plain]:
    """Drop the missing values at the end: what says nothing is not written."""
    size = len(values)
    while size and values[size - 1] is None:
        size -= 1
    return values[:size]
