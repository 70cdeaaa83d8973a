"""Builds the objects in use from checked records: variables with their offsets, structs, objects."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from dissect.scd.model import ARRAY, DEFSTRUCT, NULL, PLAIN_TRAITS, RECORD, Object, StructType, Variable
from dissect.scd.plain import from_plain
from dissect.scd.ranges import is_mapping
from dissect.scd.records import Access, FieldRecord, ObjectRecord, Plain, StructRecord, TypeRecord
from dissect.scd.types import STANDARD, UINT8, UINT16, Kind, SimpleType, Value, formed, reserved

COUNT: Final = "count"


def assemble_types(
    records: Iterable[TypeRecord], time_scale: str = "utc", encoding: str = "utf-8"
) -> dict[int, SimpleType]:
    """Return the simple types by index, including the standard ones, in the form that the dictionary specifies."""
    own = {row.index: SimpleType(row.index, row.name, Kind(row.kind), row.bits) for row in records}
    return {index: formed(kind, time_scale, encoding) for index, kind in {**STANDARD, **own}.items()}


def type_of(code: int, bits: int, simple: Mapping[int, SimpleType]) -> SimpleType:
    """Return the type of a field: code 0 is Reserved or Void (C11)."""
    return simple[code] if code else reserved(bits)


def assemble_struct(record: StructRecord, simple: Mapping[int, SimpleType]) -> StructType:
    """Return a DEFSTRUCT; a field with access "" takes that of the object."""
    fields = _fields(record.fields, simple, record.index, record.name, "", False, True, ())
    return StructType(record.index, record.name, fields, _end(fields))


def assemble_object(
    record: ObjectRecord, simple: Mapping[int, SimpleType], structs: Mapping[int, StructType]
) -> Object:
    """Return an object; properties that its struct leaves open (access, mapping, defaults) come from the object."""
    row = record
    if row.object_class == NULL:
        return Object(row.index, NULL, row.name, None, row.access, row.mandatory, None, (), 0, {})
    if row.object_class == ARRAY:
        return _array(row, simple[row.type])
    if row.object_class == RECORD:
        return _record(row, simple, structs.get(row.type))
    kind = simple[row.type]
    default = _value(row.values[0] if row.values else None, kind, row.bits)
    traits = row.traits or PLAIN_TRAITS
    head = Variable(
        row.index, 0, row.name, row.name, kind, kind.bits or row.bits, 0, row.access, row.mandatory, row.mappable, default,
        None, traits,
    )  # fmt: skip
    return Object(row.index, row.object_class, row.name, kind, row.access, row.mandatory, head, (), head.bits, {})


def _array(row: ObjectRecord, kind: SimpleType) -> Object:
    bits = kind.bits or row.bits
    traits = row.traits or PLAIN_TRAITS
    fields = tuple([
        Variable(
            row.index, sub, str(sub), f"{row.name}.{sub}", kind, bits, (sub - 1) * bits, row.access, row.mandatory,
            row.mappable, _value(row.values[sub - 1] if sub <= len(row.values) else None, kind, bits), None, traits,
        )
        for sub in range(1, row.count + 1)
    ])  # fmt: skip
    names = {field.name: field.sub for field in fields}
    head = _head(row, row.access if is_mapping(row.index) else "const", row.used)
    return Object(
        row.index, ARRAY, row.name, kind, row.access, row.mandatory, head, fields, bits * row.count, {COUNT: 0, **names}
    )


def _record(row: ObjectRecord, simple: Mapping[int, SimpleType], struct: StructType | None) -> Object:
    if struct is not None:
        fields = _inherited(row, struct)
    else:
        fields = _fields(
            row.fields, simple, row.index, row.name, row.access, row.mandatory, row.mappable, tuple(row.values)
        )
    names = {field.name: field.sub for field in fields if not field.reserved}
    head = _head(row, "const", len(fields))
    return Object(
        row.index, RECORD, row.name, struct, row.access, row.mandatory, head, fields, _end(fields), {COUNT: 0, **names}
    )


def _head(row: ObjectRecord, access: Access, count: int) -> Variable:
    """Return sub-index 0: Unsigned 8, not part of the data (R60, R69, R70)."""
    return Variable(row.index, 0, COUNT, f"{row.name}.{COUNT}", UINT8, 8, 0, access, row.mandatory, False, count)


def _inherited(row: ObjectRecord, struct: StructType) -> tuple[Variable, ...]:
    fields = []
    for position, field in enumerate(struct.fields):
        given = row.values[position] if position < len(row.values) else None
        fields.append(
            Variable(
                row.index, field.sub, field.name, f"{row.name}.{field.name}", field.type, field.bits, field.offset,
                field.access or row.access, row.mandatory, field.mappable and row.mappable,
                field.default if given is None else _value(given, field.type, field.bits), field.fixed, field.traits,
            )
        )  # fmt: skip
    return tuple(fields)


def _fields(
    records: Iterable[FieldRecord],
    simple: Mapping[int, SimpleType],
    index: int,
    owner: str,
    access: Access,
    mandatory: bool,
    mappable: bool,
    values: tuple[Plain, ...],
) -> tuple[Variable, ...]:
    fields = []
    offset = 0
    for sub, row in enumerate(records, 1):
        kind = type_of(row.type, row.bits, simple)
        bits = kind.bits or row.bits
        given = values[sub - 1] if sub <= len(values) else None
        can_map = kind.kind is not Kind.RESERVED and mappable and row.mappable is not False
        fields.append(
            Variable(
                index, sub, row.name, f"{owner}.{row.name}", kind, bits, offset, row.access or access, mandatory, can_map,
                _value(row.default if given is None else given, kind, bits), row.fixed, row.traits or PLAIN_TRAITS,
            )
        )  # fmt: skip
        offset += bits
    return tuple(fields)


def _end(fields: tuple[Variable, ...]) -> int:
    return fields[-1].offset + fields[-1].bits if fields else 0


def _value(plain: Plain, kind: SimpleType, bits: int) -> Value | None:
    return None if plain is None else from_plain(plain, kind, bits)


def readout_object(struct: StructType) -> Object:
    """Return what a device may return at the index of a DEFSTRUCT: number of fields, then their type codes (R59)."""
    count, *codes = struct.readout()
    head = Variable(struct.index, 0, COUNT, f"{struct.name}.{COUNT}", UINT8, 8, 0, "const", False, False, count)
    fields = tuple(
        [
            Variable(
                struct.index,
                sub,
                str(sub),
                f"{struct.name}.{sub}",
                UINT16,
                16,
                16 * (sub - 1),
                "const",
                False,
                False,
                code,
            )
            for sub, code in enumerate(codes, 1)
        ]
    )
    names = {field.name: field.sub for field in fields}
    return Object(struct.index, DEFSTRUCT, struct.name, struct, "const", False, head, fields, 16 * len(codes), names)
