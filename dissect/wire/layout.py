"""`Layout` and `Field`: one description of each header, used by all code that shows or builds it.

A `Layout` is a list of `Field`s without conditions and without loops. The Scapy layers, the field tree, the hex view, the
documentation and the comparison with Wireshark are made from it. The order of headers and parts is plain Python in the parsers;
a test compares the parsers' octet arithmetic with these layouts.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.wire.codes import CodeTable
from dissect.wire.copies import leaves, leaves_by_name
from dissect.wire.text import printable
from dissect.wire.varint import read_varint

#: The representation of a field shows so many octets without a meaning.
_SHOWN: Final = 16
#: Size of a field that takes the rest of its part: a text or octets whose length is stated elsewhere.
REST: Final = -1

# What a length or count field counts (`Field.counts`), so that a builder can fill it in.
COUNTS_REST: Final = "rest"  # the octets that follow it within its own part
COUNTS_PARTS: Final = "parts"  # the octets of all parts that follow it in its block
COUNTS_BUT_LAST: Final = "but last"  # the same without the last part

# What a field holds (`Field.holds`), for code that hides, masks, replaces or compares contents.
HOLDS_SECRET: Final = "secret"  # noqa: S105 - a kind of content: a password, or what can be turned back into one
HOLDS_ADDRESS: Final = "address"  # an IPv4 address
HOLDS_MAC: Final = "MAC address"
HOLDS_NAME: Final = "name"  # name that somebody gave a device, a module or a plant
HOLDS_SERIAL: Final = "serial number"
HOLDS_BLOCK_TEXT: Final = "block text"  # author, family or name of a block, or the user that makes a request
HOLDS_PATH: Final = "path"  # path of a file
HOLDS_ARGUMENT: Final = "argument"  # text argument of a service
HOLDS_SERVICE: Final = "service"  # name of a PI service
HOLDS_VALUE: Final = "value"  # value of the process or its program
HOLDS_CODE: Final = "code"  # code of a block, or the content of a file
HOLDS_TIME: Final = "time"  # date or time of day
HOLDS_REFERENCE: Final = "reference"  # a counter, different in each recording of the same session
HOLDS_NUMBER: Final = "number"  # a number, kind or length written as text or in bits; the same in every plant
HOLDS_PRODUCT: Final = "product"  # text of the protocol or the product
HOLDS_FLAGS: Final = "flags"  # bits without a text of their own

#: Names of fields that are counts or sizes in any layout, and so are shown in decimal.
_DECIMAL: Final = frozenset((
    "class_", "count", "credit", "credit_extended", "data_length", "data_unit_ref", "db", "eot", "item_count",
    "last_data_unit", "length", "li", "max_amq_called", "max_amq_calling", "next_nr", "param_length", "pdu_length",
    "sequence", "tpdu_nr", "version",
))  # fmt: skip

#: Returns the meaning of octets as text, for example a time; None when they have none.
Means = Callable[[bytes], "str | None"]
#: Returns the meaning of a number as text, for example a version; empty when it has none.
Says = Callable[[int], str]


def plain(_: bytes) -> str | None:
    """Return None: these octets have no meaning beside themselves."""
    return None


def latin(octets: bytes) -> str | None:
    """Return octets as Latin-1 text, without blanks and zeros at the end."""
    return octets.decode("latin-1").rstrip(" \0")


class Field:
    """One field of a header or of another part of a message.

    ``size`` is in octets, `REST` for all that is left of the part, or a kind of number of variable size (dissect.wire.varint).
    ``bits`` is (mask, shift) when the field is only a part of its octets. Fields that share octets follow each other; all but
    the first have ``shares=True``. ``wireshark`` is Wireshark's field name, empty where it has none.

    ``codes`` is the table of its numbers; ``says`` gives the meaning of a number that has no table. A field with ``means``
    holds octets (a text, a time), not a number. ``decimal``: the number is a count or a size, and shown in decimal. ``counts``
    is what a length field counts: one of the constants above, the name of a layout whose parts after it are counted, or empty.
    ``holds`` is one of the kinds above; empty for a plain number, and for octets of unknown meaning. ``label`` is the name for
    people: ``name`` without the underscore that Python's keywords need.
    """

    __slots__ = (
        "bits",
        "codes",
        "counts",
        "decimal",
        "holds",
        "label",
        "means",
        "name",
        "says",
        "shares",
        "size",
        "text",
        "wireshark",
    )

    def __init__(
        self,
        name: str,
        size: int,
        text: str,
        wireshark: str = "",
        codes: CodeTable | None = None,
        bits: tuple[int, int] | None = None,
        shares: bool = False,
        means: Means | None = None,
        decimal: bool = False,
        counts: str = "",
        says: Says | None = None,
        holds: str = "",
    ) -> None:
        self.name = name
        self.label = name.rstrip("_")
        self.size = size
        self.text = text
        self.wireshark = wireshark
        self.codes = codes
        self.bits = bits
        self.shares = shares
        self.means: Means | None = plain if means is None and size == REST else means
        self.decimal = decimal or counts != "" or name in _DECIMAL
        self.counts = counts
        self.holds = holds
        self.says: Says | None = says

    def __repr__(self) -> str:
        return f"Field({self.label}: {self.text})"

    def read(self, octets: bytes, offset: int) -> int:
        """Return the field's number; its octets begin at ``offset`` of ``octets`` (big-endian)."""
        size = self.size
        if size == 1:
            value = octets[offset]
        elif size == 2:
            value = (octets[offset] << 8) | octets[offset + 1]
        else:
            value = int.from_bytes(octets[offset : offset + size], "big")
        if self.bits is not None:
            mask, shift = self.bits
            return (value & mask) >> shift
        return value

    def number_meaning(self, value: int) -> str:
        """Return the meaning of a number as text; empty for none."""
        if self.says is not None:
            return self.says(value)
        row = self.codes.get(value) if self.codes is not None else None
        return row.name if row is not None else ""

    def octets_meaning(self, octets: bytes) -> str:
        """Return the meaning of octets as text; empty for none."""
        told = self.means(octets) if self.means is not None else None
        return told if told is not None else ""


class FieldValue:
    """A field that was read, at ``offset`` to ``end``.

    ``value`` is its number and ``octets`` is None; a field that holds octets has them in ``octets``, and ``value`` is 0.
    """

    __slots__ = ("end", "field", "octets", "offset", "value")

    def __init__(self, field: Field, offset: int, end: int, value: int, octets: bytes | None = None) -> None:
        self.field = field
        self.offset = offset
        self.end = end
        self.value = value
        self.octets = octets

    def __repr__(self) -> str:
        if self.field.holds == HOLDS_SECRET:
            return f"FieldValue({self.field.label}: hidden)"
        shown = self.octets[:_SHOWN].hex() if self.octets is not None else str(self.value)
        return f"FieldValue({self.field.label}: {printable(self.meaning) or shown})"

    @property
    def meaning(self) -> str:
        """The meaning of the number or the octets as text; empty for none."""
        if self.octets is not None:
            return self.field.octets_meaning(self.octets)
        return self.field.number_meaning(self.value)


class Layout:
    """A fixed header, or a part with one field of open size at its end: its name, its source, its fields in wire order.

    ``size`` is that of the fixed fields; with numbers of variable size the part is larger. ``open``: the last field takes the
    rest of the part. ``numbers`` are the fields before the first one without a fixed size, by name, each with its offset.
    """

    __slots__ = ("fields", "name", "numbers", "open", "size", "source")

    def __init__(self, name: str, source: str, fields: list[Field]) -> None:
        self.name = name
        self.source = source
        self.fields = fields
        self.size = sum(field.size for field in fields if not field.shares and field.size > 0)
        self.open = bool(fields) and fields[-1].size == REST
        self.numbers: dict[str, tuple[int, Field]] = {}
        start = end = 0
        for field in fields:
            if field.size < 0:
                break
            if not field.shares:
                start = end
                end += field.size
            self.numbers.setdefault(field.name, (start, field))

    def __repr__(self) -> str:
        return f"Layout({self.name}: {', '.join([field.label for field in self.fields])})"

    def places(self, holds: str) -> list[tuple[int, int]]:
        """Return (begin, end) of the fixed fields whose `Field.holds` is ``holds``, from the beginning of the part."""
        found: list[tuple[int, int]] = []
        at = 0
        for field in self.fields:
            if field.size < 0:
                break
            if field.shares:
                continue
            if field.holds == holds:
                found.append((at, at + field.size))
            at += field.size
        return found

    def read(self, octets: bytes, offset: int = 0, end: int = -1) -> list[FieldValue]:
        """Return the fields that lie whole in ``octets[offset:end]``; of a header cut short these are the first ones."""
        if end < 0 or end > len(octets):
            end = len(octets)
        values: list[FieldValue] = []
        at = offset
        start = offset
        for field in self.fields:
            if field.size < REST:
                number, behind = read_varint(octets, at, end, field.size)
                if behind < 0:
                    break
                values.append(FieldValue(field, at, behind, number))
                at = behind
                continue
            if not field.shares:
                start = at
                at = end if field.size == REST else at + field.size
            if at > end:
                break
            values.append(_value(field, octets, start, at))
        return values

    def find(self, name: str, octets: bytes, offset: int, end: int) -> FieldValue | None:
        """Return the first field with this name, which is in ``numbers``; None if it does not lie whole there."""
        start, field = self.numbers[name]
        start += offset
        behind = start + field.size
        return _value(field, octets, start, behind) if behind <= min(end, len(octets)) else None

    def number(self, name: str, octets: bytes, offset: int, end: int) -> int:
        """Return the value of the field that `find` returns, -1 where that is None, without making a `FieldValue`."""
        start, field = self.numbers[name]
        start += offset
        if start + field.size > min(end, len(octets)):
            return -1
        return field.read(octets, start) if field.means is None else 0

    def text(self, name: str, octets: bytes, offset: int, end: int) -> str:
        """Return the meaning of the field that `find` returns, empty where that is None, without making a `FieldValue`."""
        start, field = self.numbers[name]
        start += offset
        behind = start + field.size
        if behind > min(end, len(octets)):
            return ""
        if field.means is not None:
            return field.octets_meaning(octets[start:behind])
        return field.number_meaning(field.read(octets, start))


def _value(field: Field, octets: bytes, start: int, end: int) -> FieldValue:
    if field.means is None:
        return FieldValue(field, start, end, field.read(octets, start))
    return FieldValue(field, start, end, 0, octets[start:end])


leaves_by_name(Layout)
leaves_by_name(Field, "fields")
leaves(FieldValue)
