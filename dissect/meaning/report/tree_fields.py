"""The lines of fields in a tree: octet range, name, value and its meaning.

The beginning of a line, up to the value, depends only on the layout and its place, so it is made once and kept (up to `_MOST`).
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.meaning.report import words
from dissect.wire.layout import REST, Field, FieldValue, Layout
from dissect.wire.text import decimal, hex_number, shortened

#: Maximum number of characters of a field's meaning that are shown.
_MEANING: Final = 100
#: Maximum number of pairs of layout and place for which beginnings of lines are kept.
_MOST: Final = 4096
#: Hexadecimal digits of a number of 32 bits.
_SMALL: Final = 8


class _Head:
    """A field of a layout: where it begins and ends in the layout, and its line up to the value."""

    __slots__ = ("begin", "digits", "end", "field", "text")

    def __init__(self, field: Field, begin: int, end: int, text: str) -> None:
        self.field = field
        self.begin: i64 = begin
        self.end: i64 = end
        self.text = text
        self.digits: i64 = _digits(field)


_heads: Final[dict[tuple[Layout, int], list[_Head]]] = {}


def fields_text(layout: Layout, octets: bytes, at: int, end: int, shift: int) -> str:
    """Return the lines of the fields of a layout in ``octets[at:end]``, their offsets moved by ``shift``."""
    heads = _known(layout, at + shift) if end - at == layout.size and end <= len(octets) and not layout.open else []
    if not heads:
        return "\n".join([field_line(value, shift) for value in layout.read(octets, at, end)])
    lines: list[str] = []
    for head in heads:
        field = head.field
        begin = at + int(head.begin)
        if field.means is None:
            lines.append(head.text + _number_said(field, field.read(octets, begin), head.digits))
        else:
            stop = at + int(head.end)
            value = FieldValue(field, begin, stop, 0, octets[begin:stop])
            lines.append(f"{head.text}{meaning(value).rstrip()}")
    return "\n".join(lines)


def _known(layout: Layout, place: int) -> list[_Head]:
    """Return the beginnings of the lines of a layout at ``place``; none if one of its fields has a variable size."""
    key = (layout, place)
    heads = _heads.get(key)
    if heads is None:
        heads = []
        for value in layout.read(bytes(layout.size)) if all([field.size > 0 for field in layout.fields]) else ():
            where = span(value.offset + place, value.end + place)
            heads.append(_Head(value.field, value.offset, value.end, line_head(where, value.field.label)))
        if len(_heads) >= _MOST:
            _heads.clear()
        _heads[key] = heads
    return heads


def field_line(value: FieldValue, shift: int, name: str = "") -> str:
    """Return the line of a field, its offsets moved by ``shift``; ``name`` is a name of the value, if known."""
    said = f"{meaning(value)} {name}" if name else meaning(value)
    return line_of(span(value.offset + shift, value.end + shift), value.field.label, said.rstrip())


def line_head(where: str, name: str) -> str:
    """Return the beginning of a line: the range of octets, and the name."""
    return f"      {where.rjust(9)}  {name.ljust(16)} "


def line_of(where: str, name: str, said: str) -> str:
    """Return a line: the range of octets, the name, and ``said``."""
    return line_head(where, name) + said


def span(start: int, end: int) -> str:
    """Return a range of octets as its first and last one; ``end`` is the octet after the last."""
    return decimal(start) if end == start + 1 else f"{decimal(start)}-{decimal(end - 1)}"


def meaning(value: FieldValue) -> str:
    """Return the value of a field and its meaning."""
    field = value.field
    if value.octets is not None:
        said = value.meaning if field.means is not None else ""
        shown = words.octets(value.octets)
        return f"{shown}  {shortened(said, _MEANING)}" if said else shown
    if field.size < REST:  # a number of variable size, which has no fixed number of digits
        return f"{value.value} {value.meaning}".rstrip()
    return _number_said(field, value.value, _digits(field))


def _digits(field: Field) -> i64:
    """Return the number of hexadecimal digits for a number of fixed size."""
    mask, shift = field.bits if field.bits is not None else ((1 << 8 * max(field.size, 0)) - 1, 0)
    return max(1, ((mask >> shift).bit_length() + 3) // 4)


def _number_said(field: Field, number: int, digits: i64) -> str:
    """Return a number of fixed size and its meaning."""
    codes = field.codes
    says = field.says
    if says is None and codes is None and field.decimal:
        return str(number)
    shown = hex_number(number, digits) if digits <= _SMALL else f"0x{number:0{int(digits)}x}"
    if says is not None:
        said = says(number)
        return shown if said == shown else f"{shown} {said}".rstrip()  # an id without a name: `says` returns its number
    if codes is not None:
        row = codes.get(number)
        return f"{shown} {row.name}" if row is not None and row.name else f"{shown} (not in the tables)"
    return shown
