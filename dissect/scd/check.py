"""The rules of a dictionary (R57-R96), checked on its records, whatever their source.

The mappings of PDOs are checked where they are placed (`mapping`), because their targets must exist before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Final, Protocol

from dissect.scd import ranges
from dissect.scd.assembly import assemble_types
from dissect.scd.envelope_rules import check_envelope
from dissect.scd.errors import DictionaryError, Error, Troubles, shown
from dissect.scd.model import ARRAY, CLASSES, DOMAIN, NULL, RECORD, VAR
from dissect.scd.plain import from_plain
from dissect.scd.records import Body, FieldRecord, ObjectRecord, Plain, StructRecord, Traits, TypeRecord
from dissect.scd.types import ENCODINGS, MAX_OCTETS, SIZED, STANDARD, STANDARD_NAMES, Kind, SimpleType, width_trouble
from dissect.wire.text import count

MAX_NAME: Final = 255
MAX_TEXTS: Final = 4096


class _Entry(Protocol):
    @property
    def index(self) -> int: ...
    @property
    def name(self) -> str: ...


def check_body(body: Body) -> None:
    """Raise `DictionaryError` for the first broken rule, with place and rule; it contains the other errors."""
    troubles = Troubles()
    for error in find_troubles(body):
        with troubles:
            raise error
    troubles.done()


def find_troubles(body: Body) -> list[DictionaryError]:
    """Return all broken rules of a body, except those that only follow from others."""
    troubles = Troubles()
    if body.encoding not in ENCODINGS:
        with troubles:
            raise DictionaryError("dictionary", f"encoding {shown(body.encoding)} is not one of {', '.join(ENCODINGS)}")
    for rows, what in ((body.types, "type"), (body.structs, "type"), (body.objects, "object")):
        with troubles:
            _ascend(rows, what)
    _unique([*body.types, *body.structs], "type", troubles)
    _unique(body.objects, "object", troubles)
    sound = []
    for row in body.types:
        with troubles:
            _check_type(row)
            sound.append(row)
    if len(sound) < len(body.types) or troubles.found:  # fields of such a type cannot be checked
        return troubles.found
    simple = assemble_types(sound, body.time_scale, body.encoding)
    structs: dict[int, list[FieldRecord]] = {}
    for struct in body.structs:
        structs[struct.index] = struct.fields
        with troubles:
            _check_struct(struct, simple)
    broken = {error.index for error in troubles.found}
    for obj in body.objects:
        if obj.type not in broken:
            with troubles:
                _Objects(obj, simple, structs).check()
    if body.envelope is not None:
        with troubles:
            check_envelope(body.envelope)
    with troubles:
        _check_errors(body.errors)
    return troubles.found


def _check_struct(struct: StructRecord, simple: dict[int, SimpleType]) -> None:
    where = _where("type", struct.index, struct.name)
    if not ranges.own_complex_type(struct.index):
        raise DictionaryError(
            where, "a DEFSTRUCT must be at 0x20 to 0x5f or 0x80 to 0x9f, or there plus 0x40 for each device",
            rule="R88, R89, R81", index=struct.index,
        )  # fmt: skip
    _check_fields(struct.fields, simple, where, struct.index)


def _where(what: str, index: int, name: str) -> str:
    return f"{what} 0x{index:04x} {shown(name)}" if 0 <= index <= 0xFFFF else f"{what} {index} {shown(name)}"


def _ascend(rows: Iterable[_Entry], what: str) -> None:
    last = -1
    for row in rows:
        where = _where(what, row.index, row.name)
        if not 0 <= row.index <= 0xFFFF:
            raise DictionaryError(where, "an index has 16 bits", rule="R57", index=row.index)
        if row.index == last:
            raise DictionaryError(where, "the index occurs twice", rule="R57", index=row.index)
        if row.index < last:
            raise DictionaryError(
                where, f"must come before 0x{last:04x}: indices must ascend", rule="R57", index=row.index
            )
        last = row.index


def _unique(rows: Sequence[_Entry], what: str, troubles: Troubles) -> None:
    first: dict[str, int] = {}
    for row in rows:
        where = _where(what, row.index, row.name)
        trouble = _name_trouble(row.name)
        rule = "R71"
        if not trouble and first.setdefault(row.name, row.index) != row.index:
            trouble = f"0x{first[row.name]:04x} is called the same; names have to differ"
        if not trouble and what == "type" and row.name in STANDARD_NAMES:
            trouble, rule = f"{row.name} is a type of the text", "R55"
        if trouble:
            with troubles:
                raise DictionaryError(where, trouble, rule=rule, index=row.index)


def _name_trouble(name: str) -> str:
    if not name or name != name.strip():
        return "a name is not empty and neither begins nor ends with a space"
    if len(name) > MAX_NAME:
        return f"a name of {len(name)} characters, at most {MAX_NAME} are allowed"
    return "" if name.isprintable() else "a name consists of characters that can be printed"


def _check_type(row: TypeRecord) -> None:
    where = _where("type", row.index, row.name)
    if not ranges.own_static_type(row.index):
        raise DictionaryError(
            where,
            "a DEFTYPE must be at 0x60 to 0x7f, or there plus 0x40 for each device",
            rule="R90, R81",
            index=row.index,
        )
    if row.kind not in Kind.__members__.values() or row.kind == Kind.RESERVED:
        raise DictionaryError(where, f"no kind {row.kind}", rule="R66", index=row.index)
    trouble = width_trouble(Kind(row.kind), row.bits)
    if trouble:
        raise DictionaryError(where, trouble, rule="R34, R37", index=row.index)


def _check_fields(fields: Sequence[FieldRecord], simple: dict[int, SimpleType], owner: str, index: int) -> None:
    if not 1 <= len(fields) <= ranges.MAX_SUB:
        raise DictionaryError(
            owner, f"{len(fields)} fields, 1 to {ranges.MAX_SUB} are possible", rule="R60, R62", index=index
        )
    names: set[str] = set()
    total = 0
    troubles = Troubles()
    for number, field in enumerate(fields, 1):
        where = f"{owner}, field {number} {shown(field.name)}"
        with troubles:
            total += _check_field(field, simple, where, index)
        if field.type:
            trouble = _name_trouble(field.name)
            if not trouble and "." in field.name:
                trouble = "a dot separates the names of object and field and cannot be part of one"
            if not trouble and (field.name in names or field.name == "count"):
                trouble = "the name is there twice, or is that of sub-index 0"
            if trouble:
                with troubles:
                    raise DictionaryError(where, trouble, rule="R71", index=index)
            names.add(field.name)
    troubles.done()
    if total > 8 * MAX_OCTETS:
        raise DictionaryError(owner, f"{total} bits, a message has {8 * MAX_OCTETS}", rule="R50", index=index)


def _check_field(field: FieldRecord, simple: dict[int, SimpleType], where: str, index: int) -> int:
    """Check one field and return its bits."""
    if not field.type:
        trouble = width_trouble(Kind.RESERVED, field.bits)
        if not trouble and field.fixed is not None and not 0 <= field.fixed < 1 << min(field.bits, 64):
            trouble = f"{field.fixed} does not fit {min(field.bits, 64)} bits"
        if field.name or field.access or (field.default, field.mappable, field.traits) != (None, None, None):
            trouble = "reserved bits have neither name nor value"
        if trouble:
            raise DictionaryError(where, trouble, rule="R31", index=index)
        return field.bits
    kind = _simple(field.type, simple, where, index)
    if field.fixed is not None:
        raise DictionaryError(where, "only reserved bits are fixed", rule="R32", index=index)
    bits = _width(kind, field.bits, where, index)
    if not bits:
        raise DictionaryError(where, f"a {kind.name} in a record needs its size", rule="R42, R53", index=index)
    _check_traits(field.traits, kind, where, index)
    _check_default(field.default, kind, bits, where, index)
    return bits


def _simple(code: int, simple: dict[int, SimpleType], where: str, index: int) -> SimpleType:
    kind = simple.get(code)
    if kind is not None:
        return kind
    if 0 <= code <= 0xFFFF and ranges.section_of(code).holds == "complex":
        raise DictionaryError(where, f"type 0x{code:04x} is not simple: no records of records", rule="R73", index=index)
    raise DictionaryError(where, f"no type {code:#06x}", rule="R72", index=index)


def _width(kind: SimpleType, bits: int, where: str, index: int) -> int:
    """Return the bits of a variable of the type; ``bits`` are used if the type leaves them open."""
    if not kind.variable:
        if bits:
            raise DictionaryError(
                where, f"a {kind.name} has {count(kind.bits, 'bit')}, no size of its own", rule="R72", index=index
            )
        return kind.bits
    trouble = width_trouble(kind.kind, bits)
    if trouble:
        raise DictionaryError(where, trouble, rule="R42, R53", index=index)
    return bits


def _check_default(value: Plain, kind: SimpleType, bits: int, where: str, index: int) -> None:
    if value is None:
        return
    try:
        from_plain(value, kind, bits, where)
    except Error as error:
        raise DictionaryError(where, f"default: {error.detail}", rule="R72", code=error.code, index=index) from None


def _check_traits(traits: Traits | None, kind: SimpleType, where: str, index: int) -> None:
    if traits is None:
        return
    numbers = [number for number, _ in traits.texts]
    limits = [limit for limit in (traits.low, traits.high) if limit is not None]
    trouble = ""
    if not (math.isfinite(traits.scale) and math.isfinite(traits.shift) and traits.scale):
        trouble = "scale and shift are finite, and scale is not 0"
    elif not traits.shift and math.copysign(1, traits.shift) < 0:
        trouble = "a shift of 0 has no sign"
    elif any(isinstance(limit, float) and not math.isfinite(limit) for limit in limits):
        trouble = "limits are finite"
    elif traits.low is not None and traits.high is not None and traits.low > traits.high:
        trouble = f"the lower limit {traits.low} is above the upper {traits.high}"
    elif len(numbers) > MAX_TEXTS or numbers != sorted(set(numbers)):
        trouble = f"texts ascend by their numbers, each once, at most {MAX_TEXTS}"
    elif traits == Traits():
        trouble = "unit, scale, limits and texts without effect"
    elif kind.kind not in (Kind.INT, Kind.UINT, Kind.REAL, Kind.BOOL):
        trouble = f"a {kind.name} has neither unit nor scale, limits or texts"
    else:
        trouble = _unreachable(traits, kind)
    if trouble:
        raise DictionaryError(where, trouble, rule="C36", index=index)


def _unreachable(traits: Traits, kind: SimpleType) -> str:
    """Return what is wrong with limits or texts for raw values that the type cannot have; empty if nothing is."""
    span = raw_span(kind)
    if span is None:
        return ""
    low, high = span
    for name, limit in (("low", traits.low), ("high", traits.high)):
        if limit is not None and not low <= limit <= high:
            return f"{name} {limit} is outside {low}..{high}, the raw values of a {kind.name}"
    for number, text in traits.texts:
        if not low <= number <= high:
            return f"the text {shown(text)} is for {number}, outside {low}..{high}, the values of a {kind.name}"
    return ""


def raw_span(kind: SimpleType) -> tuple[int, int] | None:
    """Return the lowest and highest number of an integer or Boolean type; None for other types."""
    if kind.kind is Kind.INT:
        return -(1 << kind.bits - 1), (1 << kind.bits - 1) - 1
    return (0, (1 << kind.bits) - 1) if kind.kind in (Kind.UINT, Kind.BOOL) else None


class _Objects:
    """Checks the rules of one object."""

    def __init__(self, row: ObjectRecord, simple: dict[int, SimpleType], structs: dict[int, list[FieldRecord]]) -> None:
        self.row = row
        self.simple = simple
        self.structs = structs
        self.where = _where("object", row.index, row.name)

    def fail(self, detail: str, rule: str) -> DictionaryError:
        return DictionaryError(self.where, detail, rule=rule, index=self.row.index)

    def check(self) -> None:
        row = self.row
        section = ranges.section_of(row.index)
        if section.holds != "object":
            raise self.fail(f"0x{section.first:04x} to 0x{section.last:04x} ({section.name}) has no objects", "R77")
        if row.values and row.values[-1] is None:
            raise self.fail("the last default value has no effect", "C36")
        if row.object_class == NULL:
            plain = ObjectRecord(row.index, NULL, row.name, 0, 0, "", row.mandatory, False)
            if row != plain:
                raise self.fail("a NULL object has no data: no type, access, size, values", "R64")
            return
        if not row.access:
            raise self.fail("the access attribute is missing: rw, wo, ro or const", "R74")
        {VAR: self.check_single, DOMAIN: self.check_single, ARRAY: self.check_array, RECORD: self.check_record}[
            row.object_class
        ]()
        if ranges.is_mapping(row.index):
            self.check_mapping()
        elif ranges.is_communication(row.index) and row.object_class != RECORD:
            raise self.fail("the communication parameter of a PDO is a RECORD", "R106")

    def check_single(self) -> None:
        row = self.row
        self.no_parts(fields=True)
        kind = self.type()
        if row.object_class == DOMAIN and kind.kind not in SIZED:
            raise self.fail(f"a DOMAIN has variable length: it must be a block or string, not {kind.name}", "R65")
        bits = _width(kind, row.bits, self.where, row.index)
        if row.object_class == DOMAIN and (kind.bits or bits or row.mappable):
            raise self.fail("a DOMAIN is of variable length: no size, and it cannot be mapped", "R65")
        if len(row.values) > 1:
            raise self.fail(f"{len(row.values)} default values for one variable", "R68")
        _check_traits(row.traits, kind, self.where, row.index)
        for value in row.values:
            _check_default(value, kind, bits, self.where, row.index)

    def check_array(self) -> None:
        row = self.row
        self.no_parts(fields=True, count=False)
        kind = self.type()
        bits = _width(kind, row.bits, self.where, row.index)
        if not bits:
            raise self.fail(f"an element of type {kind.name} needs its size", "R42, R53")
        if not 1 <= row.count <= ranges.MAX_SUB:
            raise self.fail(f"{row.count} elements, 1 to {ranges.MAX_SUB} are possible", "R62, R69")
        if bits * row.count > 8 * MAX_OCTETS:
            raise self.fail(f"{bits * row.count} bits, a message has {8 * MAX_OCTETS}", "R50")
        if not 0 <= row.used <= row.count or (row.used != row.count and not ranges.is_mapping(row.index)):
            raise self.fail(f"sub-index 0 is {row.used}, but there are {row.count} elements", "R60")
        if len(row.values) > row.count:
            raise self.fail(f"{len(row.values)} default values for {row.count} elements", "R69")
        _check_traits(row.traits, kind, self.where, row.index)
        for sub, value in enumerate(row.values, 1):
            _check_default(value, kind, bits, f"{self.where}, element {sub}", row.index)

    def check_record(self) -> None:
        row = self.row
        self.no_parts(fields=False)
        if row.bits or row.traits is not None:
            raise self.fail("a RECORD has no size, unit or limits: set them in its fields", "R70")
        if not row.type:
            fields = row.fields
            _check_fields(fields, self.simple, self.where, row.index)
        elif row.type in self.structs:
            if row.fields:
                raise self.fail("give either a type or fields", "R70")
            fields = self.structs[row.type]
        elif row.type in self.simple:
            raise self.fail(f"{self.simple[row.type].name} is simple; a RECORD is of a DEFSTRUCT", "R70, C34")
        else:
            raise self.fail(f"no type 0x{row.type:04x}", "R72")
        if len(row.values) > len(fields):
            raise self.fail(f"{len(row.values)} default values for {len(fields)} fields", "R70")
        for field, value in zip(fields, row.values, strict=False):
            where = f"{self.where}, field {shown(field.name)}"
            if field.type:
                kind = self.simple[field.type]
                _check_default(value, kind, kind.bits or field.bits, where, row.index)
            elif value is not None:
                raise DictionaryError(where, "reserved bits have no value", rule="R31", index=row.index)

    def check_mapping(self) -> None:
        row = self.row
        if row.object_class != ARRAY or row.type not in (STANDARD[7].index, STANDARD[27].index):
            raise self.fail("the mapping parameter of a PDO is an ARRAY of uint64 or uint32", "R106, C49")
        values = row.values[: row.used]
        if len(values) < row.used or None in values:
            raise self.fail(f"sub-index 0 gives {row.used} entries, but some have no value", "R103")

    def no_parts(self, *, fields: bool, count: bool = True) -> None:
        row = self.row
        if (fields and row.fields) or (count and (row.count or row.used)):
            raise self.fail(f"a {CLASSES[row.object_class]} has no {'fields' if fields else 'elements'}", "R68")

    def type(self) -> SimpleType:
        row = self.row
        if row.type in self.structs:
            what = "an array of records" if row.object_class == ARRAY else "a DEFSTRUCT is the type of a RECORD"
            raise self.fail(f"type 0x{row.type:04x} is not simple: {what}", "R73, C34")
        return _simple(row.type, self.simple, self.where, row.index)


def _check_errors(errors: Sequence[tuple[int, str]]) -> None:
    last = -129
    for number, text in errors:
        where = f"errors {number}"
        if not -128 <= number <= 127 or number == 0:
            raise DictionaryError(where, "scd_err_t has 8 bits, and 0 is good", rule="R52")
        if number <= last:
            raise DictionaryError(where, "numbers must ascend and be unique", rule="R52")
        if _name_trouble(text):
            raise DictionaryError(where, _name_trouble(text), rule="R52")
        last = number
