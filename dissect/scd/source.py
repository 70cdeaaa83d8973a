"""A dictionary as people write it: TOML (or JSON of the same shape) into records (profile 3.1).

Tables: [dictionary], [[type]], [[object]], [[pdo]], [[instance]], [envelope], [errors]. docs/scd.md lists their keys.

An [[instance]] puts a device that is described once into a dictionary for several of the eight devices (R93-R95). Types,
objects and PDOs with ``device = "pump"`` are a template for device 0. An instance adds 40h to its types, 800h to its objects at
6000h-67FFh and 64 to its PDO numbers for each device, and puts numbers into its texts: ``{device}`` 0..7, ``{segment}`` 1..8.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, Literal, TypeVar

import msgspec

from dissect.scd import ranges
from dissect.scd.bounds import check_bounds
from dissect.scd.check import find_troubles
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import DictionaryError, Error, Troubles, shown
from dissect.scd.map_reading import MapReader, kind_of
from dissect.scd.mapping import pack_entry
from dissect.scd.model import ARRAY, DOMAIN, NULL, RECORD
from dissect.scd.reading import Table, envelope_of, errors_of, fields_of, traits_of
from dissect.scd.records import Body, FieldRecord, ObjectClass, ObjectRecord, Plain, StructRecord, TypeRecord
from dissect.scd.toml_tables import parse_tables
from dissect.scd.types import ENCODINGS, STANDARD, STANDARD_NAMES, Kind, SimpleType, formed, width_trouble
from dissect.wire.config.hints import close_to
from dissect.wire.config.hostile import ContentError, read_json
from dissect.wire.config.lines import Lines, Place

_DEVICE_OBJECT: Final = re.compile(r"0[xX]6([0-7][0-9a-fA-F]{2})(?=[:.]|$)")


def expand(lists: Mapping[str, list[Table]]) -> dict[str, list[Table]]:
    """Return the tables of types, objects and PDOs, with all templates expanded."""
    kept: dict[str, list[Table]] = {"type": [], "object": [], "pdo": []}
    templates: dict[str, dict[str, list[Table]]] = {}
    for kind, rows in kept.items():
        for table in lists[kind]:
            if table.has("device"):
                template = templates.setdefault(table.text("device"), {"type": [], "object": [], "pdo": []})
                template[kind].append(table)
            else:
                rows.append(table)
    used: set[str] = set()
    placed: set[tuple[str, int]] = set()
    for order in lists["instance"]:
        name = order.text("of")
        devices = order.items("devices")
        order.done()
        if name not in templates:
            raise order.fail("of", f"no type, object or pdo has device = {shown(name)}", "R93")
        used.add(name)
        for device in devices:
            if not isinstance(device, int) or isinstance(device, bool) or not 0 <= device < ranges.DEVICES:
                raise order.fail("devices", f"{shown(device)} is not a device 0 to 7", "R93")
            if (name, device) in placed:
                raise order.fail("devices", f"{shown(name)} is device {device} already", "R93")
            placed.add((name, device))
            for kind, tables in templates[name].items():
                kept[kind].extend(_shifted(kind, table, device) for table in tables)
    for name, template in templates.items():
        if name not in used:
            first = next(table for tables in template.values() for table in tables)
            raise first.fail("device", f"no [[instance]] is of {shown(name)}", "R93")
    return kept


def _shifted(kind: str, table: Table, device: int) -> Table:
    content = {key: _filled(value, device) for key, value in table.content.items() if key != "device"}
    moved = Table(content, f"{table.where} for device {device}", table.line, table.place)
    try:
        if kind == "type":
            content["index"] = ranges.type_of_device(moved.number("index"), device)
        elif kind == "object":
            content["index"] = ranges.object_of_device(moved.number("index"), device)
        else:
            content["number"] = ranges.pdo_of_device(device, moved.number("number"))
            content["map"] = [_target(item, device) for item in moved.items("map")]
    except Error as error:
        raise moved.fail("index" if kind != "pdo" else "number", error.detail, "R93, R94, R95") from None
    return moved


def _filled(value: Any, device: int) -> Any:
    """Return a value with the numbers of the device in its texts, also inside tables and arrays."""
    if isinstance(value, str):
        return value.replace("{device}", str(device)).replace("{segment}", str(device + 1))
    if isinstance(value, list):
        return [_filled(item, device) for item in value]
    if isinstance(value, dict):
        return {key: _filled(item, device) for key, item in value.items()}
    return value


def _target(item: Any, device: int) -> Any:
    """Return an entry of a map; an index 6000h-67FFh is moved to the device."""
    if isinstance(item, dict):
        return {**item, "var": _target(item["var"], device)} if "var" in item else item
    if not isinstance(item, str):
        return item
    return (
        _DEVICE_OBJECT.sub(
            lambda match: f"0x{ranges.object_of_device(0x6000 + int(match[1], 16), device):04x}", item, count=1
        )
        if _DEVICE_OBJECT.match(item)
        else item
    )


_LISTS: Final = ("type", "object", "pdo", "instance")
_TABLES: Final = ("dictionary", "envelope", "errors")
_CLASSES: Final[dict[str, ObjectClass]] = {"NULL": 0, "DOMAIN": 2, "VAR": 7, "ARRAY": 8, "RECORD": 9}
_KINDS: Final = {kind.name.lower(): kind for kind in Kind if kind is not Kind.RESERVED}
TimeScale = Literal["utc", "tai"]
Row = TypeVar("Row", TypeRecord, StructRecord, ObjectRecord)
_UINT32_MAP: Final = 7
_UINT64_MAP: Final = 27


def parse_toml(text: str, path: str = "") -> Dictionary:
    """Return the dictionary of a TOML source; raises `DictionaryError` with ``path``, line, table and rule."""
    tables = parse_tables(text, path)
    return _build(tables, path, Lines(text))


def parse_json(text: str, path: str = "") -> Dictionary:
    """Return the dictionary of a JSON source with the tables of a TOML one; raises `DictionaryError` as `parse_toml` does."""
    try:
        tables = read_json(text, _no_key_twice)
    except ContentError as error:
        raise DictionaryError("JSON", str(error), path=path, line=error.line) from None
    if not isinstance(tables, dict):
        raise DictionaryError("JSON", "a dictionary is an object with the tables of a TOML source", path=path)
    return _build(tables, path, Lines(""))


def _no_key_twice(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        raise ContentError("a key occurs twice in one object")
    return found


def _build(tables: Mapping[str, Any], path: str, lines: Lines) -> Dictionary:
    """Return the dictionary; raises the first `DictionaryError`, with all others that were found."""
    reader = _Reader(tables, lines)
    troubles = Troubles()
    with troubles:
        body = reader.body()
        broken = find_troubles(body)
        for error in (*reader.troubles.found, *broken):
            with troubles:
                raise error
        if not broken:  # the tables that could be read keep the rules, so PDOs can be placed
            made = Dictionary(body)
            if not troubles.found:
                return made
    for error in troubles.found:
        error.path = path
        error.line = error.line or reader.line_of(error)
    troubles.found.sort(key=lambda error: error.line)
    troubles.done()
    raise DictionaryError("source", "cannot be read", path=path)


class _Reader:
    """Reads the tables of one source. It remembers how each index was written, to find the line of a broken rule.

    ``troubles`` collects the faults of tables, fields and entries. References to the missing definition of such a table are not
    reported again.
    """

    def __init__(self, tables: Mapping[str, Any], lines: Lines) -> None:
        self.troubles = Troubles()
        self._tables = tables
        self._lines = lines
        self._homes: dict[int, Table] = {}
        self._simple: dict[str, SimpleType] = {}
        self._structs: dict[str, StructRecord] = {}
        self._struct_tables: set[str | int] = set()
        self._by_index: dict[int, SimpleType | StructRecord] = {}
        self._objects: dict[int, ObjectRecord] = {}
        self._names: dict[str, ObjectRecord] = {}
        self._broken: set[str | int] = set()
        self._map = MapReader(self._objects, self._names, self._by_index, self._broken)

    def line_of(self, error: DictionaryError) -> int:
        """Return the line of the table with the entry that an error is about, 0 if unknown."""
        for name in _TABLES:
            if error.where.startswith(name):
                return self._lines.at(name)
        home = self._homes.get(error.index)
        return 0 if home is None else home.line

    def body(self) -> Body:
        """Return the records of all readable tables, sorted; faults are in ``troubles``."""
        self._top_level()
        for name in _TABLES:
            check_bounds(self._tables.get(name), f"[{name}]", self._lines.at(name))
        for name in _LISTS:
            for number, row in enumerate(self._tables.get(name, ())):
                check_bounds(row, f"[[{name}]] {number + 1}", self._lines.at(name, number))
        name = version = ""
        scale: TimeScale = "utc"
        encoding = ENCODINGS[0]
        with self.troubles:
            head = Table(self._tables.get("dictionary", {}), "[dictionary]", place=Place(self._lines, ("dictionary",)))
            version, encoding = head.text("version", ""), head.choice("encoding", ENCODINGS, ENCODINGS[0])
            scale = head.choice("time_scale", ("utc", "tai"), "utc")
            name = head.text("name")
            head.done()
        for kind in STANDARD.values():
            self._by_index[kind.index] = formed(kind, scale, encoding)
        self._simple.update({known: self._standard(index) for known, index in STANDARD_NAMES.items()})
        lists = self._expanded()
        types, structs = self._types(lists["type"], scale, encoding)
        self._each(lists["object"], lambda table: self._add(table, self._object(table)))
        self._each(lists["pdo"], self._pdo)
        envelope, errors = None, []
        with self.troubles:
            envelope = envelope_of(self._tables.get("envelope"), Place(self._lines, ("envelope",)))
        with self.troubles:
            errors = errors_of(self._tables.get("errors"), Place(self._lines, ("errors",)))
        return Body(
            name, version, scale, _ascending(types), _ascending(structs), _ascending(self._objects), envelope, errors,
            encoding,
        )  # fmt: skip

    def _standard(self, index: int) -> SimpleType:
        found = self._by_index[index]
        assert isinstance(found, SimpleType)
        return found

    def _expanded(self) -> dict[str, list[Table]]:
        with self.troubles:
            return expand({name: self._list(name) for name in _LISTS})
        return {"type": [], "object": [], "pdo": []}

    def _types(
        self, tables: Sequence[Table], scale: TimeScale, encoding: str
    ) -> tuple[dict[int, TypeRecord], dict[int, StructRecord]]:
        types: dict[int, TypeRecord] = {}
        structs: dict[int, StructRecord] = {}
        composed = [table for table in tables if table.has("fields")]
        for table in composed:
            self._struct_tables.update(_called(table))
        simple = [table for table in tables if not table.has("fields")]
        self._each(simple, lambda table: self._place(table, types, self._type(table, scale, encoding)))
        self._each(composed, lambda table: self._place(table, structs, self._struct(table), types))
        return types, structs

    def _each(self, tables: Sequence[Table], read: Callable[[Table], None]) -> None:
        """Read all tables; remember name and index of those that are wrong."""
        for table in tables:
            with self.troubles:
                read(table)
                continue
            self._broken.update(_called(table))

    def _top_level(self) -> None:
        for name, content in self._tables.items():
            if name not in (*_LISTS, *_TABLES):
                there = (*_TABLES, *_LISTS)
                detail = f"no table of a dictionary: {', '.join(there)}{close_to(name, there)}"
                raise DictionaryError(f"[{name}]", detail, line=self._lines.at(name))
            if not isinstance(content, list if name in _LISTS else dict):
                detail = f"is written [[{name}]]" if name in _LISTS else f"is written [{name}]"
                raise DictionaryError(f"[{name}]", detail, line=self._lines.at(name))

    def _list(self, name: str) -> list[Table]:
        rows = self._tables.get(name, [])
        return [
            Table(row, f"[[{name}]] {number + 1}", place=Place(self._lines, (name, number)))
            for number, row in enumerate(rows)
        ]

    def _place(self, table: Table, rows: dict[int, Row], row: Row, others: Mapping[int, object] | None = None) -> None:
        table.done()
        if row.index in rows or (others is not None and row.index in others):
            home = self._homes.get(row.index)
            first = f", line {home.line}" if home is not None and home.line else ""
            raise table.fail("index", f"0x{row.index:04x} is there already{first}", "R57")
        rows[row.index] = row
        self._homes[row.index] = table

    def _add(self, table: Table, row: ObjectRecord) -> None:
        if row.name in self._names:
            raise table.fail("name", f"{shown(row.name)} is already 0x{self._names[row.name].index:04x}", "R71")
        self._place(table, self._objects, row)
        self._names[row.name] = row

    def _type(self, table: Table, scale: TimeScale, encoding: str) -> TypeRecord:
        index, name = table.number("index"), table.text("name")
        written = table.text("base")
        own = self._simple.get(written) if written in STANDARD_NAMES else None
        kind = own.kind if own is not None else _KINDS.get(written)
        if kind is None:
            hint = close_to(written, self._simple)
            detail = f"{shown(written)} is not a kind: {', '.join(_KINDS)}, or a type of the text{hint}"
            raise table.fail("base", detail, "R66")
        bits = table.number("bits", -1) if not table.has("size") else 8 * table.number("size")
        if bits < 0:
            bits = own.bits if own is not None else _only_width(kind)
        trouble = width_trouble(kind, bits)  # checked at once, as values of the type are checked while they are read
        if trouble:
            raise table.fail("size" if table.has("size") else "bits", trouble, "R34, R37")
        row = TypeRecord(index, name, int(kind), bits)
        self._simple.setdefault(name, formed(SimpleType(index, name, kind, bits), scale, encoding))
        self._by_index.setdefault(index, self._simple[name])
        return row

    def _struct(self, table: Table) -> StructRecord:
        index, name = table.number("index"), table.text("name")
        row = StructRecord(index, name, fields_of(table, self._field_type))
        self._structs.setdefault(name, row)
        self._by_index.setdefault(index, row)
        return row

    def _field_type(self, table: Table) -> SimpleType:
        written = table.name_or_number("type")
        # wherever it is defined, even if it is this table
        if written in self._struct_tables and written not in self._simple:
            name = written if isinstance(written, str) else f"0x{written:04x}"
            raise table.fail("type", f"{name} is not a simple type: no records of records", "R73")
        found = self._any_type(table)
        assert isinstance(found, SimpleType)
        return found

    def _any_type(self, table: Table) -> SimpleType | StructRecord:
        written = table.name_or_number("type")
        if isinstance(written, str):
            found = self._simple.get(written) or self._structs.get(written)
        else:
            found = self._by_index.get(written)
        if found is None:
            hint = close_to(written, [*self._simple, *self._structs]) if isinstance(written, str) else ""
            detail = f"no type {shown(written)}{hint or '; [[type]] defines one'}"
            raise table.fail("type", detail, "R72", consequence=written in self._broken)
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
            raise table.fail("type", f"{found.name} is not a simple type: {what}", "R73, C34")
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
                raise table.fail("type", "give either a type or fields", "R70")
            row = msgspec.structs.replace(row, fields=fields)
        else:
            found = self._any_type(table)
            if not isinstance(found, StructRecord):
                raise table.fail("type", f"{found.name} is simple; a RECORD is of a DEFSTRUCT", "R70, C34")
            row = msgspec.structs.replace(row, type=found.index)
            fields = found.fields
        kinds = [kind_of(field, self._by_index) for field in fields]
        return msgspec.structs.replace(row, values=_trimmed(table.field_values("values", fields, kinds)))

    def _pdo(self, table: Table) -> None:
        direction = table.choice("dir", ("T", "R"))
        number = table.number("number")
        name = table.text("name", f"{direction}PDO {number}")
        wide = table.choice("entries", ("uint64", "uint32"), "uint64") == "uint64"
        entries = self._map.entries(table, wide)
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


def _only_width(kind: Kind) -> int:
    """Return the bits of a kind that has only one width; 0 for other kinds, which then break a rule or have an open width."""
    widths = {row.bits for row in STANDARD.values() if row.kind is kind}
    return widths.pop() if len(widths) == 1 else 0


def _ascending(rows: Mapping[int, Row]) -> list[Row]:
    return [rows[index] for index in sorted(rows)]


def _trimmed(values: list[Plain]) -> list[Plain]:
    """Drop the missing values at the end: they are not written."""
    size = len(values)
    while size and values[size - 1] is None:
        size -= 1
    return values[:size]


def _called(table: Table) -> list[str | int]:
    """Return the name and the index that a table gives to its definition, as far as it has them."""
    return [found for key in ("name", "index") if isinstance(found := table.content.get(key), (str, int))]
