"""Reads the ``map`` of a [[pdo]] in a source: which variables it names, and where they are (profile 3.2)."""

from __future__ import annotations

import re
from collections.abc import Container, Mapping
from typing import Final

from dissect.scd.errors import Troubles, shown
from dissect.scd.mapping import Entry
from dissect.scd.model import ARRAY
from dissect.scd.reading import Table
from dissect.scd.records import FieldRecord, ObjectRecord, StructRecord
from dissect.scd.types import SimpleType, reserved
from dissect.wire.config.hints import close_to
from dissect.wire.text import count

#: Target of an entry that is a gap: the index of a static type (uint8), which is not a variable.
GAP: Final = (5, 0)
#: Most digits of a sub-index; leading zeros are allowed.
_MOST_DIGITS: Final = 9

Types = Mapping[int, SimpleType | StructRecord]


class MapReader:
    """Reads maps with the objects and types of the source; an error about a name of a ``broken`` table is a consequence."""

    def __init__(
        self,
        objects: Mapping[int, ObjectRecord],
        names: Mapping[str, ObjectRecord],
        by_index: Types,
        broken: Container[str | int],
    ) -> None:
        self._objects = objects
        self._names = names
        self._by_index = by_index
        self._broken = broken

    def entries(self, table: Table, wide: bool) -> list[Entry]:
        """Return the entries of a [[pdo]]'s map; raises `DictionaryError` with all faults."""
        entries: list[Entry] = []
        troubles = Troubles()
        offset = 0
        for number, item in enumerate(table.items("map")):
            content = item if isinstance(item, dict) else {"var": item}
            with troubles:
                row = table.inside(content, f"map {number + 1}", "map", number)
                entry = self._entry(row, wide, offset)
                entries.append(entry)
                offset = entry.offset + entry.bits
        troubles.done()
        if wide:  # a gap needs no entry before another entry
            last = len(entries) - 1
            entries = [entry for at, entry in enumerate(entries) if at == last or entry[:2] != GAP]
        return entries

    def _entry(self, row: Table, wide: bool, offset: int) -> Entry:
        if row.has("reserved"):
            bits = row.number("reserved")
            if not 1 <= bits <= 0xFFFF or (not wide and bits > 0xFF):
                raise row.fail("reserved", f"a gap of {count(bits, 'bit')}", "R103")
            entry = Entry(*GAP, offset, bits)
        else:
            target, sub, bits = self._target(row)
            offset = row.number("offset", offset)
            bits = 8 * row.number("size") if row.has("size") else bits
            entry = Entry(target, sub, offset, bits)
        if not (0 <= offset <= 0xFFFF and 0 <= bits <= (0xFFFF if wide else 0xFF)):
            raise row.fail("var", f"{count(bits, 'bit')} at bit {offset} do not fit an entry", "R103")
        row.done()
        return entry

    def _target(self, row: Table) -> tuple[int, int, int]:
        """Return index, sub-index and bits of the variable that an entry names."""
        written = row.text("var")
        match = re.fullmatch(r"(0[xX][0-9a-fA-F]{1,4})(?:[:.](\w+))?", written)
        if match is not None and written not in self._names:
            obj, field = self._objects.get(int(match[1], 16)), match[2] or "0"
        elif written in self._names:
            obj, field = self._names[written], "0"
        else:
            title, _, field = written.rpartition(".")
            obj = self._names.get(title)
        if obj is None:
            whole = int(match[1], 16) if match is not None else written.rpartition(".")[0]
            broken = whole in self._broken or written in self._broken
            hint = close_to(written.partition(".")[0], self._names) if match is None else ""
            raise row.fail("var", f"no object {shown(written)}{hint}", "R103", consequence=broken)
        sub, bits = self._sub(obj, field)
        if sub < 0:
            raise row.fail("var", f"{shown(obj.name)} has no sub-index {shown(field)}", "R103")
        return obj.index, sub, bits

    def _sub(self, obj: ObjectRecord, field: str) -> tuple[int, int]:
        """Return number and bits of the sub-index of an object's field, -1 if there is none."""
        struct = self._by_index.get(obj.type)
        fields = obj.fields or (struct.fields if isinstance(struct, StructRecord) else [])
        for position, row in enumerate(fields, 1):
            if field in (str(position), row.name):
                return position, kind_of(row, self._by_index).bits or row.bits
        if isinstance(struct, SimpleType) and field.isdecimal() and len(field) <= _MOST_DIGITS:
            last = obj.count if obj.object_class == ARRAY else 0
            first = 1 if obj.object_class == ARRAY else 0
            if first <= int(field) <= last:
                return int(field), struct.bits or obj.bits
        return -1, 0


def kind_of(field: FieldRecord, by_index: Types) -> SimpleType:
    """Return the type of a field."""
    found = by_index[field.type] if field.type else reserved(field.bits)
    assert isinstance(found, SimpleType)
    return found
