"""Reads one table of a source: keys by type, each read once; errors for keys that are missing, wrong or unknown."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from dissect.scd.bounds import HIGHEST, LOWEST
from dissect.scd.errors import DictionaryError, Error, Troubles, shown
from dissect.scd.plain import as_plain
from dissect.scd.ranges import MAX_SUB
from dissect.scd.records import Access, Counts, CrcRecord, EnvelopeField, EnvelopeRecord, FieldRecord, Plain, Traits
from dissect.scd.types import STANDARD, STANDARD_NAMES, Kind, SimpleType
from dissect.wire.config.hints import SURELY, close_names, close_to
from dissect.wire.config.lines import Place

_MISSING: Final = object()
#: Longer keys are cut in errors.
_LONGEST_KEY: Final = 100
_ROLE_NAMES: Final = (
    "protocol", "kind", "response", "abort", "tid", "seq", "err", "index", "sub", "pdo", "port", "src", "dst", "size", "data",
    "crc", "reserved", "const",
)  # fmt: skip
_ONE_BIT: Final = ("response", "abort")


def whole_number(text: str) -> int | None:
    """Return the whole number in ``text``, written as in TOML ("0x6000", "-5"); None if it is not one of 64 bits."""
    try:
        number = int(text, 0)
    except ValueError:  # also if there are too many digits for Python
        return None
    return number if LOWEST <= number <= HIGHEST else None


class Table:
    """The keys of one table; ``where`` names it in errors. ``line`` is its line (0: unknown), or ``place`` finds it."""

    def __init__(self, content: object, where: str, line: int = 0, place: Place | None = None) -> None:
        self.where = where
        self.place = place
        self._line = line
        if not isinstance(content, Mapping):
            raise DictionaryError(where, f"{shown(content)} is not a table", line=self.line)
        self.content: Mapping[str, Any] = content
        self._asked: set[str] = set()

    @property
    def line(self) -> int:
        """The line of the table, 0 if it is not known."""
        return self._line or (0 if self.place is None else self.place.line())

    def line_of(self, key: str) -> int:
        """Return the line of a key, or that of the table if the key has none."""
        return self.line if self.place is None else self.place.line(key) or self.line

    def inside(self, content: object, where: str, key: str, number: int | None = None) -> Table:
        """Return a table that is the value of a key, or an element of that value; raises `DictionaryError`."""
        more: tuple[str | int, ...] = (key,) if number is None else (key, number)
        place = None if self.place is None else self.place.inside(*more)
        return Table(content, f"{self.where}, {where}", 0 if place else self.line, place)

    def fail(self, key: str, detail: str, rule: str = "", *, consequence: bool = False) -> DictionaryError:
        """Return an error about a key."""
        name = key if key.isprintable() and len(key) <= _LONGEST_KEY else shown(key)
        where = f"{self.where}, {name}"
        return DictionaryError(where, detail, rule=rule, line=self.line_of(key), consequence=consequence)

    def has(self, key: str) -> bool:
        """Return whether the key exists."""
        return key in self.content

    def mark(self, key: str) -> None:
        """Note that the key is read elsewhere."""
        self._asked.add(key)

    def done(self) -> None:
        """Raise an error for all keys that were not read."""
        troubles = Troubles()
        for key in self.content:
            if key not in self._asked:
                free = [name for name in sorted(self._asked) if name not in self.content]
                hint = close_to(str(key), free) or "; these are: " + ", ".join(sorted(self._asked))
                with troubles:
                    raise self.fail(str(key), f"no such key here{hint}")
        troubles.done()

    def _get(self, key: str, default: object) -> object:
        self._asked.add(key)
        found = self.content.get(key, default)
        if found is _MISSING:
            written = close_names(key, [name for name in self.content if name not in self._asked], SURELY)
            meant = f"; {shown(written[0])} is there: a slip of the pen?" if written else ""
            raise self.fail(written[0] if written else key, f"{key} is missing{meant}" if written else "is missing")
        return found

    def text(self, key: str, default: object = _MISSING) -> str:
        """Return a text."""
        found = self._get(key, default)
        if isinstance(found, str):
            try:
                found.encode()
            except UnicodeEncodeError:
                raise self.fail(key, f"{shown(found)} has no UTF-8 form", "R42") from None
            return found
        raise self.fail(key, f"{shown(found)} is not a string")

    def number(self, key: str, default: object = _MISSING) -> int:
        """Return a whole number of at most 64 bits; JSON may write it as a text such as "0x6000"."""
        found = self._get(key, default)
        number = whole_number(found) if isinstance(found, str) else found
        if isinstance(number, int) and not isinstance(number, bool) and LOWEST <= number <= HIGHEST:
            return number
        raise self.fail(key, f"{shown(found)} is not a whole number of at most 64 bits")

    def name_or_number(self, key: str) -> str | int:
        """Return a name, or an index written as a number."""
        found = self._get(key, _MISSING)
        if isinstance(found, str) or (isinstance(found, int) and not isinstance(found, bool)):
            return found
        raise self.fail(key, f"{shown(found)} is neither a name nor an index")

    def flag(self, key: str, default: bool) -> bool:
        """Return true or false."""
        found = self._get(key, default)
        if isinstance(found, bool):
            return found
        raise self.fail(key, f"{shown(found)} is neither true nor false")

    def choice(self, key: str, choices: Sequence[str], default: object = _MISSING) -> Any:
        """Return one of the texts of ``choices``."""
        found = self._get(key, default)
        if isinstance(found, str) and found in choices:
            return found
        hint = close_to(found, choices) if isinstance(found, str) else ""
        raise self.fail(key, f"{shown(found)} is not one of {', '.join(choices)}{hint}")

    def items(self, key: str) -> list[Any]:
        """Return an array, empty if the key is missing."""
        found = self._get(key, [])
        if isinstance(found, list):
            return found
        raise self.fail(key, f"{shown(found)} is not an array")

    def real(self, key: str) -> float | int | None:
        """Return a finite number, None if the key is missing."""
        found = self._get(key, None)
        if found is None or (isinstance(found, (int, float)) and not isinstance(found, bool) and math.isfinite(found)):
            return found
        raise self.fail(key, f"{shown(found)} is not a finite number")

    def value(self, key: str, kind: SimpleType, bits: int) -> Plain:
        """Return a default value of a type in the form of records, None if the key is missing."""
        found = self._get(key, None)
        return None if found is None else self._plain(key, found, kind, bits)

    def values(self, key: str, kind: SimpleType, bits: int) -> list[Plain]:
        """Return the default values of an array's elements: a list from the first on, or a table by sub-index."""
        found = self._get(key, [])
        if isinstance(found, Mapping):
            return self._values_by_sub(key, found, kind, bits)
        return [self._plain(f"{key} {number}", item, kind, bits) for number, item in enumerate(self.items(key), 1)]

    def _values_by_sub(self, key: str, found: Mapping[str, Any], kind: SimpleType, bits: int) -> list[Plain]:
        values: dict[int, Plain] = {}
        for written, item in found.items():
            sub = whole_number(written)
            if sub is None or not 1 <= sub <= MAX_SUB or sub in values:
                raise self.fail(key, f"{shown(written)} is not a sub-index 1 to {MAX_SUB}, or occurs twice", "R62")
            values[sub] = self._plain(f"{key} {sub}", item, kind, bits)
        return [values.get(sub) for sub in range(1, max(values, default=0) + 1)]

    def field_values(self, key: str, fields: Sequence[FieldRecord], kinds: Sequence[SimpleType]) -> list[Plain]:
        """Return the default values of a record's fields, given by name."""
        found = self._get(key, {})
        if not isinstance(found, Mapping):
            raise self.fail(key, "the values of a record are a table by the names of its fields")
        numbers = {field.name: number for number, field in enumerate(fields) if field.type}
        values: list[Plain] = [None] * len(fields)
        for name, value in found.items():
            if name not in numbers:
                raise self.fail(key, f"no field {shown(name)}{close_to(name, numbers)}", "R70")
            number = numbers[name]
            kind = kinds[number]
            values[number] = self._plain(f"{key} {name}", value, kind, kind.bits or fields[number].bits)
        return values

    def _plain(self, key: str, found: object, kind: SimpleType, bits: int) -> Plain:
        if kind.kind is Kind.BLOCK and isinstance(found, str):
            try:
                found = bytes.fromhex(found)
            except ValueError:
                raise self.fail(key, f"{shown(found)} is not hexadecimal text", "R53") from None
        if kind.kind is Kind.REAL and found == "nan":
            found = math.nan
        try:
            value = kind.check(found, bits)
        except Error as error:
            raise DictionaryError(
                f"{self.where}, {key}",
                error.detail,
                rule="R72",
                code=error.code,
                line=self.line_of(key.partition(" ")[0]),
            ) from None
        return as_plain(value)


def traits_of(table: Table) -> Traits | None:
    """Return unit, scale, shift, limits and texts in a variable's table, None if there are none."""
    texts: list[tuple[int, str]] = []
    found = table.inside(table.content.get("texts", {}), "texts", "texts")
    for key in found.content:
        number = whole_number(key)
        if number is None:
            raise found.fail(key, "texts are given by whole numbers", "C36")
        texts.append((number, found.text(key)))
    table.mark("texts")
    scale = table.real("scale")
    traits = Traits(
        table.text("unit", ""),
        1.0 if scale is None else float(scale),
        float(table.real("shift") or 0.0),
        table.real("low"),
        table.real("high"),
        sorted(texts),
    )
    return None if traits == Traits() else traits


def fields_of(table: Table, type_of: Callable[[Table], SimpleType]) -> list[FieldRecord]:
    """Return the fields in a struct's or record's table; ``{reserved=6}`` is a gap, with ``fixed`` if its bits are defined."""
    fields = []
    troubles = Troubles()
    for number, item in enumerate(table.items("fields")):
        with troubles:
            fields.append(_field_of(table.inside(item, f"field {number + 1}", "fields", number), type_of))
    troubles.done()
    return fields


def _field_of(row: Table, type_of: Callable[[Table], SimpleType]) -> FieldRecord:
    if row.has("reserved"):
        fixed = row.number("fixed") if row.has("fixed") else None
        field = FieldRecord("", 0, row.number("reserved"), fixed)
    else:
        name = row.text("name")
        kind = type_of(row)
        bits = 8 * row.number("size", 0)
        mappable = row.flag("mappable", False) if row.has("mappable") else None
        access: Access = row.choice("access", ("rw", "wo", "ro", "const")) if row.has("access") else ""
        default = row.value("default", kind, kind.bits or bits)
        field = FieldRecord(name, kind.index, bits, None, access, mappable, default, traits_of(row))
    row.done()
    return field


def envelope_of(content: object, place: Place) -> EnvelopeRecord | None:
    """Return the described envelope, None if the source has none."""
    if content is None:
        return None
    table = Table(content, "envelope", place=place)
    crc = None
    if table.has("crc"):
        row = table.inside(table.content["crc"], "crc", "crc")
        crc = CrcRecord(
            row.number("poly", 0x1021), row.number("init", 0), row.flag("refin", False), row.flag("refout", False),
            row.number("xorout", 0), row.choice("covers", ("before", "data"), "before"),
        )  # fmt: skip
        row.done()
        table.mark("crc")
    fields = []
    kinds = []
    troubles = Troubles()
    for number, item in enumerate(table.items("fields")):
        with troubles:
            fields.append(_envelope_field(table.inside(item, f"field {number + 1}", "fields", number)))
    for number, item in enumerate(table.items("kinds")):
        with troubles:
            row = table.inside(item, f"kind {number + 1}", "kinds", number)
            kinds.append((row.number("value"), row.choice("service", ("read", "write", "pdo"))))
            row.done()
    with troubles:
        table.done()
    troubles.done()
    return EnvelopeRecord(fields, sorted(kinds), crc)


def _envelope_field(row: Table) -> EnvelopeField:
    role = row.choice("role", _ROLE_NAMES)
    bits, signed = (1 if role in _ONE_BIT else 0), False
    if row.has("type"):
        written = row.text("type")
        kind = STANDARD[STANDARD_NAMES[written]] if written in STANDARD_NAMES else None
        if kind is None or kind.kind not in (Kind.BOOL, Kind.INT, Kind.UINT):
            raise row.fail("type", f"{shown(written)} is not a whole number of the text's types", "profile 3.3")
        bits, signed = kind.bits, kind.kind is Kind.INT
    if row.has("bits"):
        if row.has("type"):
            raise row.fail("bits", "either type or bits", "profile 3.3")
        bits, signed = row.number("bits"), row.flag("signed", False)
    value = row.number("value") if row.has("value") else None
    counts: Counts = row.choice("counts", ("data", "data+crc", "rest", "total")) if row.has("counts") else ""
    field = EnvelopeField(role, bits, signed, row.flag("big", False), value, counts)
    row.done()
    return field


def errors_of(content: object, place: Place) -> list[tuple[int, str]]:
    """Return the texts of scd_err_t that replace the usual ones: {"-5" = "no such object"}."""
    if content is None:
        return []
    table = Table(content, "errors", place=place)
    texts = []
    for key in table.content:
        number = whole_number(key)
        if number is None:
            raise table.fail(key, "texts are given by whole numbers", "R52")
        texts.append((number, table.text(key)))
    return sorted(texts)
