"""One description of each fixed header, read by every face of the package.

A `Layout` is a list of `Field`s without conditions and without loops. The Scapy layers, the field tree, the hex view, the
documentation and the comparison with Wireshark are made from it. What follows what is plain Python in the parsers; a test
holds the parsers' octet arithmetic to these layouts.
"""

from __future__ import annotations

from dissect.wire.codes import CodeTable


class Field:
    """One field of a fixed header.

    ``size`` is in octets. ``bits`` is (mask, shift) when the field is only a part of its octets; fields sharing octets follow
    each other and all but the first have ``shares=True``. ``wireshark`` is Wireshark's field name, empty where it has none.
    """

    __slots__ = ("bits", "codes", "name", "shares", "size", "text", "wireshark")

    def __init__(
        self,
        name: str,
        size: int,
        text: str,
        wireshark: str = "",
        codes: CodeTable | None = None,
        bits: tuple[int, int] | None = None,
        shares: bool = False,
    ) -> None:
        self.name = name
        self.size = size
        self.text = text
        self.wireshark = wireshark
        self.codes = codes
        self.bits = bits
        self.shares = shares

    def read(self, octets: bytes, offset: int) -> int:
        """Return the field's value in ``octets``, its octets starting at ``offset`` (big-endian)."""
        value = int.from_bytes(octets[offset : offset + self.size], "big")
        if self.bits is not None:
            mask, shift = self.bits
            return (value & mask) >> shift
        return value


class FieldValue:
    """A field read from octets: where it stands and what it says."""

    __slots__ = ("end", "field", "offset", "value")

    def __init__(self, field: Field, offset: int, end: int, value: int) -> None:
        self.field = field
        self.offset = offset
        self.end = end
        self.value = value


class Layout:
    """A fixed header: its name, its source, and its fields in wire order."""

    __slots__ = ("fields", "name", "size", "source")

    def __init__(self, name: str, source: str, fields: list[Field]) -> None:
        self.name = name
        self.source = source
        self.fields = fields
        self.size = sum(field.size for field in fields if not field.shares)

    def read(self, octets: bytes, offset: int = 0) -> list[FieldValue]:
        """Return the fields that lie whole in ``octets`` from ``offset`` on; a header cut short gives its first fields."""
        values: list[FieldValue] = []
        at = offset
        start = offset
        for field in self.fields:
            if not field.shares:
                start = at
                at += field.size
            if start + field.size > len(octets):
                break
            values.append(FieldValue(field, start, start + field.size, field.read(octets, start)))
        return values
