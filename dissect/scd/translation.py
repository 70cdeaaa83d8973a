"""Translates a CANopen or POWERLINK device description, from any file format, to a dictionary (profile 3.1).

Each model has features that the other one lacks. Features are kept as far as possible, and every loss is a `Note`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final

import msgspec

from dissect.scd import ranges
from dissect.scd.check import MAX_NAME
from dissect.scd.dictionary import Dictionary
from dissect.scd.errors import Error
from dissect.scd.foreign import Description, ForeignEntry, ForeignSub, Imported, Notes
from dissect.scd.foreign_types import ForeignTypes, Translated, parse_limit, parse_value
from dissect.scd.model import ARRAY, DEFSTRUCT, DEFTYPE, DOMAIN, NULL, RECORD, VAR
from dissect.scd.records import Access, Body, FieldRecord, ObjectRecord, Plain, StructRecord, Traits
from dissect.scd.types import NUMERIC, SIZED, STANDARD, STANDARD_NAMES, Kind, SimpleType
from dissect.scd.written import whole_octal

#: Octets of a text in a record or array, whose length device descriptions never state.
TEXT_OCTETS: Final = 255
_ACCESS: Final[dict[str, Access]] = {"rw": "rw", "wo": "wo", "ro": "ro", "const": "const", "rwr": "rw", "rww": "rw"}
_WIDE: Final = 0x1B
_NARROW: Final = 0x07


def translate(description: Description, notes: Notes) -> Imported:
    """Return the dictionary of a device description; raises `DictionaryError` if SCD cannot hold it."""
    body = _Translator(description, notes).body()
    return Imported(Dictionary(_with_mappings(body, notes)), notes.told())


def _with_mappings(body: Body, notes: Notes) -> Body:
    """Return the body, with PDOs switched off whose mapping breaks a rule (E_MAP)."""
    off = [
        msgspec.structs.replace(row, used=0) if ranges.is_mapping(row.index) and row.used else row
        for row in body.objects
    ]
    plain = Dictionary(msgspec.structs.replace(body, objects=off))
    objects = []
    for row, without in zip(body.objects, off, strict=True):
        if row is not without:
            values = [value if isinstance(value, int) else 0 for value in row.values[: row.used]]
            try:
                plain.with_mapping(row.index, values)
            except Error as error:
                notes.add(f"the PDO is switched off: {error.detail}", row.index)
                objects.append(without)
                continue
        objects.append(row)
    return msgspec.structs.replace(body, objects=objects)


class _Translator:
    """Makes the records of one description."""

    def __init__(self, description: Description, notes: Notes) -> None:
        self._description = description
        self._notes = notes
        self._entries = [description.entries[index] for index in sorted(description.entries)]
        self._types = ForeignTypes(self._own_types())
        self._names: set[str] = set()

    def body(self) -> Body:
        structs = [row for row in map(self._struct, self._entries) if row is not None]
        objects = [row for row in map(self._object, self._entries) if row is not None]
        name, version = self._description.name, self._description.version
        return Body(_printable(name) or "?", _printable(version), "utc", self._types.records(), structs, objects)

    # Types

    def _own_types(self) -> dict[int, SimpleType]:
        """Return the DEFTYPEs of the file at indices that SCD allows for them."""
        basic = ForeignTypes({})
        own: dict[int, SimpleType] = {}
        for entry in self._entries:
            if entry.object_class == DEFTYPE and ranges.own_static_type(entry.index):
                code = entry.subs[0].code if 0 in entry.subs else -1
                found = basic.translate(code)
                if found is None:
                    self._notes.add("omitted: a type made of one that SCD does not have", entry.index)
                    continue
                name = _printable(entry.name)
                if not name or name in STANDARD_NAMES or any(row.name == name for row in own.values()):
                    name = f"type_{entry.index:04x}"
                own[entry.index] = SimpleType(entry.index, name, found.type.kind, found.type.bits or found.bits)
        return own

    def _struct(self, entry: ForeignEntry) -> StructRecord | None:
        """Return a DEFSTRUCT: the values of its sub-indices are codes of types (R59)."""
        if entry.object_class != DEFSTRUCT or not ranges.own_complex_type(entry.index):
            return None
        fields: list[FieldRecord] = []
        try:
            for sub in range(1, max(entry.subs, default=0) + 1):
                row = entry.subs[sub]
                found = self._types.translate(whole_octal(row.value or ""))
                if found is None or (found.type.kind in SIZED and not (found.type.bits or found.bits)):
                    fields = []
                    break
                fields.append(FieldRecord(self._field_name(entry, row, fields), found.type.index, found.bits))
        except (ValueError, KeyError):
            fields = []
        if not fields:
            self._notes.add("omitted: a structure whose fields are not all described by types of SCD", entry.index)
            return None
        return StructRecord(entry.index, _printable(entry.name) or f"type_{entry.index:04x}", fields)

    # Objects

    def _object(self, entry: ForeignEntry) -> ObjectRecord | None:
        if entry.object_class in (DEFTYPE, DEFSTRUCT):
            if ranges.section_of(entry.index).holds not in {"static", "complex"}:
                self._notes.add("omitted: a definition of a type where SCD has none", entry.index)
            return None
        section = ranges.section_of(entry.index)
        if section.holds != "object":
            self._notes.add(f"omitted: SCD has no objects there ({section.name})", entry.index)
            return None
        entry.name = self._object_name(entry)
        if entry.object_class == NULL:
            return ObjectRecord(entry.index, NULL, entry.name, 0, 0, "", entry.mandatory, False)
        if ranges.is_mapping(entry.index):
            return self._mapping(entry)
        if entry.object_class in (ARRAY, RECORD):
            return self._parts(entry)
        if ranges.is_communication(entry.index):
            self._notes.add("omitted: the communication parameter of a PDO is a RECORD", entry.index)
            return None
        return self._single(entry)

    def _single(self, entry: ForeignEntry) -> ObjectRecord | None:
        sub = entry.subs[0]
        found = self._type(entry, sub)
        if found is None:
            return None
        open_ended = found.type.kind in SIZED and not found.bits and not found.type.bits
        domain = entry.object_class == DOMAIN and open_ended
        if entry.object_class == DOMAIN and not domain:
            self._notes.add("a DOMAIN of a type of fixed length is a VAR", entry.index)
        value = self._value(entry, sub, found)
        return ObjectRecord(
            entry.index, DOMAIN if domain else VAR, entry.name, found.type.index, found.bits, self._access(entry, sub),
            entry.mandatory, sub.mappable and not domain, values=[] if value is None else [value],
            traits=self._traits(entry, sub, found),
        )  # fmt: skip

    def _parts(self, entry: ForeignEntry) -> ObjectRecord | None:
        last = max(entry.subs, default=0)
        fields: list[FieldRecord] = []
        for sub in range(1, last + 1):
            row = entry.subs.get(sub)
            fields.append(FieldRecord("", 0, 0) if row is None else self._field(entry, row, fields))
        if not any(field.type for field in fields):
            self._notes.add("omitted: it has no variables", entry.index)
            return None
        if entry.object_class == ARRAY and not ranges.is_communication(entry.index):
            if len({_form(field) for field in fields}) == 1 and fields[0].type:
                return self._array(entry, fields)
            self._notes.add("an ARRAY whose elements differ is a RECORD", entry.index)
        accesses = {field.access for field in fields if field.type}
        access: Access = accesses.pop() if len(accesses) == 1 else "rw"
        mappable = any(field.mappable for field in fields)
        own = [
            field if not field.type else msgspec.structs.replace(
                field, access="" if field.access == access else field.access,
                mappable=None if field.mappable == mappable else False,
            )
            for field in fields
        ]  # fmt: skip
        return ObjectRecord(entry.index, RECORD, entry.name, 0, 0, access, entry.mandatory, mappable, fields=own)

    def _array(self, entry: ForeignEntry, fields: Sequence[FieldRecord]) -> ObjectRecord:
        if len({entry.subs[sub].name.rstrip("0123456789 _") for sub in range(1, len(fields) + 1)}) > 1:
            self._notes.add("the names of the elements are not kept: an ARRAY numbers them", entry.index)
        first = fields[0]
        values = [field.default for field in fields]
        return ObjectRecord(
            entry.index, ARRAY, entry.name, first.type, first.bits, first.access or "rw", entry.mandatory,
            bool(first.mappable), len(fields), len(fields), _trimmed(values), [], first.traits,
        )  # fmt: skip

    def _mapping(self, entry: ForeignEntry) -> ObjectRecord | None:
        """Return the mapping parameter of a PDO as an ARRAY, even if CANopen calls it a RECORD (C49)."""
        rows = {sub: row for sub, row in entry.subs.items() if sub}
        codes = {row.code for row in rows.values()}
        if entry.object_class not in (ARRAY, RECORD) or codes not in ({_NARROW}, {_WIDE}):
            self._notes.add(
                "omitted: no mapping of UNSIGNED32 (CANopen) or UNSIGNED64 (POWERLINK) elements", entry.index
            )
            return None
        kind = STANDARD[codes.pop()]
        found = Translated(kind, 0, "")
        values = [
            self._value(entry, rows[sub], found) if sub in rows else None for sub in range(1, max(rows) + 1)
        ]  # fmt: skip
        head = entry.subs.get(0)
        used = self._value(entry, head, Translated(STANDARD[5], 0, "")) if head is not None else None
        count = int(used) if isinstance(used, int) else 0
        if count > len(values) or None in values[:count]:
            self._notes.add(f"the PDO is switched off: {count} entries, not all of them have a value", entry.index)
            count = 0
        access = self._access(entry, rows[max(rows)])
        return ObjectRecord(
            entry.index, ARRAY, entry.name, kind.index, 0, access, entry.mandatory, False, len(values), count,
            _trimmed(values),
        )  # fmt: skip

    # Variables

    def _field(self, entry: ForeignEntry, sub: ForeignSub, before: Sequence[FieldRecord]) -> FieldRecord:
        """Return a field with access, mapping and value; a gap without bits if SCD cannot have it."""
        found = self._type(entry, sub)
        if found is None:
            return FieldRecord("", 0, 0)
        value = self._value(entry, sub, found)
        bits = found.bits
        if found.type.kind in SIZED and not found.type.bits and not bits:
            if found.type.kind is Kind.BLOCK and not value:
                text = "omitted: a block in an object of several needs a length, which the file does not give"
                self._notes.add(text, entry.index, sub.sub)
                return FieldRecord("", 0, 0)
            octets = len(value) if isinstance(value, bytes) else 0
            bits = 8 * (octets if found.type.kind is Kind.BLOCK else max(octets, TEXT_OCTETS))
            text = "the value's own length" if found.type.kind is Kind.BLOCK else f"{TEXT_OCTETS} bytes"
            self._notes.add(f"the file does not give its length; assumed: {text}", entry.index, sub.sub)
        return FieldRecord(
            self._field_name(entry, sub, before), found.type.index, bits, None, self._access(entry, sub), sub.mappable, value,
            self._traits(entry, sub, found),
        )  # fmt: skip

    def _type(self, entry: ForeignEntry, sub: ForeignSub) -> Translated | None:
        found = self._types.translate(sub.code)
        place = sub.sub if entry.object_class in (ARRAY, RECORD) else -1
        if found is None:
            what = "no type is given" if sub.code < 0 else f"SCD has no simple type for type 0x{sub.code:04x}"
            self._notes.add(f"omitted: {what}", entry.index, place)
        elif found.loss:
            self._notes.add(found.loss, entry.index, place)
        return found

    def _access(self, entry: ForeignEntry, sub: ForeignSub) -> Access:
        written = sub.access.lower()
        if written in {"rwr", "rww"}:
            self._notes.add("rwr and rww are rw: which PDOs may carry the variable is not kept", entry.index, sub.sub)
        elif written not in _ACCESS:
            what = f"access {written!r} is not one of SCD's" if written else "no access is given"
            self._notes.add(f"{what}; assumed: rw", entry.index, sub.sub)
        return _ACCESS.get(written, "rw")

    def _value(self, entry: ForeignEntry, sub: ForeignSub, found: Translated) -> Plain:
        if sub.value is None or (not sub.value.strip() and found.type.kind is not Kind.STRING):
            return None
        try:
            value = parse_value(sub.value, sub.code, found.type, found.bits, self._description.node_id)
        except (ValueError, OverflowError) as error:
            self._notes.add(f"its value {sub.value[:40]!r} is omitted: {error}", entry.index, sub.sub)
            return None
        return value or None if isinstance(value, bytes) else value

    def _traits(self, entry: ForeignEntry, sub: ForeignSub, found: Translated) -> Traits | None:
        if found.type.kind not in NUMERIC or found.type.kind is Kind.BOOL:
            return None
        limits: list[float | int | None] = []
        for text in (sub.low, sub.high):
            try:
                limits.append(parse_limit(text, found.type) if text is not None and text.strip() else None)
            except (ValueError, OverflowError) as error:
                self._notes.add(f"its limit {(text or '')[:40]!r} is omitted: {error}", entry.index, sub.sub)
                limits.append(None)
        low, high = limits
        if low is not None and high is not None and low > high:
            self._notes.add("its limits are omitted: the lower one is above the upper", entry.index, sub.sub)
            low = high = None
        traits = Traits(_printable(sub.unit), sub.scale, 0.0, low, high)
        return None if traits == Traits() else traits

    # Names

    def _object_name(self, entry: ForeignEntry) -> str:
        name = _printable(entry.name) or f"0x{entry.index:04x}"
        if name in self._names:
            name = f"{name[: MAX_NAME - 9]} (0x{entry.index:04x})"
            self._notes.add("a name already used by a different object was extended by its index", entry.index)
        self._names.add(name)
        return name

    def _field_name(self, entry: ForeignEntry, sub: ForeignSub, before: Iterable[FieldRecord]) -> str:
        name = (_printable(sub.name) or str(sub.sub)).replace(".", "_")
        taken = {"count", *(field.name for field in before)}
        if name in taken and entry.object_class != ARRAY:
            self._notes.add("a name already used by a different field was extended by its number", entry.index, sub.sub)
        while name in taken:
            name = f"{name[: MAX_NAME - 5]} {sub.sub}"
        return name


def _form(field: FieldRecord) -> tuple[object, ...]:
    """Return the properties that all elements of an ARRAY must have in common."""
    return (
        field.type,
        field.bits,
        field.access,
        field.mappable,
        field.traits and msgspec.structs.astuple(field.traits)[:5],
    )


def _printable(text: str) -> str:
    """Return a text that is valid as a name: spaces for unprintable characters, none at the ends, and not too long."""
    return " ".join("".join([char if char.isprintable() else " " for char in text]).split())[:MAX_NAME].strip()


def _trimmed(values: list[Plain]) -> list[Plain]:
    while values and values[-1] is None:
        values = values[:-1]
    return values
