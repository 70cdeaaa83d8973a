"""Scapy fields that only S7comm-plus needs: contents of values, lists of numbers, names (docs/s7plus.md)."""

from __future__ import annotations

import struct
from typing import Any, Final

from scapy.fields import FieldListField, XLEIntField, XStrField
from scapy.packet import Packet
from scapy.volatile import RandBin, RandNum

from dissect.layers.fields import VarintField
from dissect.protocols.s7plus.ids import id_name
from dissect.protocols.s7plus.value_reading import parse_content
from dissect.protocols.s7plus.value_showing import value_with_type
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, ARRAY, SPARSE_ARRAY, STRUCT, VALUE_TYPES
from dissect.protocols.s7plus.values import Value, build_value
from dissect.wire.text import printable
from dissect.wire.varint import VLQ, build_varint, read_varint

#: Octets of a value before its content, and of the id of a structure.
_FLAGS_AND_TYPE: Final = 2
_ID: Final = 4
#: Most octets that ``fuzz()`` puts into one field.
_FUZZED: Final = 64


class ContentField(XStrField):
    """The content of a value, by its ``flags`` and ``type``: a number, a text, a list.

    See `dissect.protocols.s7plus.values.Value`.

    For a structure it is the id, for an array of structures a list of id and count; the members are separate parts. Octets are
    written unchanged; unreadable values, and those that would be built differently, are kept as octets.
    """

    islist = 1  # else Scapy takes a list for several packets

    def __init__(self) -> None:
        super().__init__("content", b"")

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take anything (Scapy's interface); a text stays one."""
        return x

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, Any]:
        """Take all remaining octets of the part (Scapy's interface)."""
        flags, type_ = pkt.getfieldval("flags"), pkt.getfieldval("type")
        content = _struct_head(flags, s) if type_ == STRUCT else _content(flags, type_, s)
        kept = content is None or isinstance(content, bytes) or _built(flags, type_, content) != s
        return b"", s if kept else content

    def i2m(self, pkt: Packet | None, x: Any) -> bytes:
        """Return the octets to send (Scapy's interface). Raises ValueError for content that does not fit flags and type."""
        if x is None or isinstance(x, bytes) or pkt is None:
            return x or b""
        flags, type_ = pkt.getfieldval("flags"), pkt.getfieldval("type")
        built = _built(flags, type_, x)
        if built is None:
            message = (
                f"content of a {VALUE_TYPES.name(type_)} with flags 0x{flags:02x} cannot be {x!r}: see docs/layers.md"
            )
            raise ValueError(message)
        return built

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return the text that ``show()`` prints (Scapy's interface)."""
        if isinstance(x, bytes) or pkt is None:
            return x.hex() if isinstance(x, bytes) else repr(x)
        flags, type_ = pkt.getfieldval("flags"), pkt.getfieldval("type")
        if not isinstance(flags, int) or not isinstance(type_, int):
            return repr(x)  # a fuzzed packet with a value still to be drawn
        if type_ == STRUCT:
            return id_name(x) if isinstance(x, int) else repr(x)
        return printable(value_with_type(Value(flags, type_, x)))

    def randval(self) -> RandBin:
        """Return the value that ``fuzz()`` puts here (Scapy's interface)."""
        return RandBin(RandNum(0, _FUZZED))


def _content(flags: int, type_: int, octets: bytes) -> Any:
    value = parse_content(flags, type_, octets)
    return value.content if value is not None else None


def _struct_head(flags: int, octets: bytes) -> Any:
    """Return the head of a structure before its members, None for any other value."""
    if flags & SPARSE_ARRAY or len(octets) < _ID:
        return None
    id_ = int.from_bytes(octets[:_ID], "big")
    if len(octets) == _ID:
        return id_
    count, end = read_varint(octets, _ID, len(octets), VLQ)
    return [id_, count] if end == len(octets) and flags & (ARRAY | ADDRESS_ARRAY) else None


def _built(flags: int, type_: int, content: Any) -> bytes | None:
    """Return the octets of a content, None if it does not fit flags and type."""
    try:
        if type_ == STRUCT and isinstance(content, int):
            return content.to_bytes(_ID, "big")
        if type_ == STRUCT and isinstance(content, list):
            id_, count = content
            return bytes(id_.to_bytes(_ID, "big") + build_varint(count, VLQ))
        return build_value(Value(flags, type_, content))[_FLAGS_AND_TYPE:]
    except (ValueError, TypeError, KeyError, OverflowError, AttributeError, struct.error):
        return None


class TextField(XStrField):
    """A text in UTF-8 that takes the rest of its part, followed by ``end``; octets if it is invalid."""

    __slots__ = ["end"]

    def __init__(self, name: str, end: bytes = b"") -> None:
        self.end = end
        super().__init__(name, b"")

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take a text or octets (Scapy's interface)."""
        return x

    def i2m(self, pkt: Packet | None, x: Any) -> bytes:
        """Return the octets to send (Scapy's interface)."""
        return x.encode() + self.end if isinstance(x, str) else bytes(x or b"")

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, Any]:
        """Take all remaining octets of the part (Scapy's interface)."""
        if not s.endswith(self.end):
            return b"", s
        try:
            return b"", s[: len(s) - len(self.end)].decode()
        except UnicodeDecodeError:
            return b"", s

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return the text that ``show()`` prints (Scapy's interface)."""
        return printable(repr(x)) if isinstance(x, str) else bytes(x or b"").hex()

    def randval(self) -> RandBin:
        """Return the value that ``fuzz()`` puts here (Scapy's interface)."""
        return RandBin(RandNum(0, _FUZZED))


class _LittleField(XLEIntField):
    """Four octets, the lowest first; fewer stay octets."""

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, Any]:
        """Take the number (Scapy's interface)."""
        if len(s) < _ID:
            return b"", s
        rest, number = super().getfield(pkt, s)
        return rest, number

    def addfield(self, pkt: Packet, s: bytes, val: Any) -> bytes:
        """Append the number (Scapy's interface)."""
        octets: bytes = s + val if isinstance(val, bytes) else super().addfield(pkt, s, val)
        return octets


def numbers_field(name: str) -> FieldListField:
    """Return a field for numbers of variable size that take the rest of their part."""
    return FieldListField(name, [], VarintField(name, 0, VLQ))


def little_numbers_field(name: str) -> FieldListField:
    """Return a field for numbers of four octets, the lowest first, that take the rest of their part."""
    return FieldListField(name, [], _LittleField("", 0))
