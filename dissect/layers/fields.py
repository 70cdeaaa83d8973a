"""Makes Scapy's fields from the layouts, and defines the few fields that Scapy lacks.

Two rules hold for every layer here: dissecting never raises, whatever the octets, and a dissected packet builds the same octets
again, also after ``clear_cache()``. So a wrong length field keeps its value, and octets that fit nowhere are kept in a separate
field or in a `Raw` after the layer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from difflib import get_close_matches
from keyword import iskeyword
from types import new_class
from typing import Any, Final

from scapy import fields as scapy_fields
from scapy.fields import (
    BitField,
    ByteField,
    ConditionalField,
    FieldListField,
    IntField,
    PacketListField,
    RawVal,
    ShortField,
    ThreeBytesField,
    X3BytesField,
    XBitField,
    XByteField,
    XIntField,
    XShortField,
    XStrField,
)
from scapy.fields import Field as ScapyFieldBase
from scapy.packet import Packet, Raw
from scapy.volatile import RandBin, RandNum, VolatileValue

from dissect.protocols.s7.items import item_fill
from dissect.wire.codes import CodeTable
from dissect.wire.layout import REST, Field, Layout, Means
from dissect.wire.text import printable
from dissect.wire.varint import build_varint, read_varint

#: Elements of a layer's list of fields: Scapy's fields, generic in two types that differ from field to field.
ScapyField = Any

#: Most octets that ``fuzz()`` puts into one field.
_FUZZED: Final = 64

#: The most names that an error lists: those most similar to the wrong one.
_LISTED: Final = 24


def no_such_name(field: str, name: str, names: Iterable[str]) -> ValueError:
    """Return the error for an unknown name of a value; it lists the known ones."""
    known = list(names)
    close = get_close_matches(name, known)
    listed = known if len(known) <= _LISTED else close
    advice = f"give {', '.join(listed)}, or a number" if listed else "give its number"
    if close and listed is known:
        advice = f"do you mean {close[0]}? Else {advice}"
    return ValueError(f"{field}: no value is called {name!r}: {advice}")


class Named:
    """For a Scapy field with names: an unknown name is a ValueError that lists the known ones."""

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take a number or its name, or a list of these (Scapy's interface). Raises ValueError for an unknown name."""
        field: Any = self
        try:
            return field.taken(pkt, x)
        except KeyError as error:
            raise no_such_name(field.name, str(error.args[0]), sorted(field.s2i, key=field.s2i.get)) from None


class ByteEnumField(Named, scapy_fields.ByteEnumField):
    """One octet with names."""

    taken = scapy_fields.ByteEnumField.any2i


class ShortEnumField(Named, scapy_fields.ShortEnumField):
    """Two octets with names."""

    taken = scapy_fields.ShortEnumField.any2i


class XByteEnumField(Named, scapy_fields.XByteEnumField):
    """One octet with names, in hexadecimal."""

    taken = scapy_fields.XByteEnumField.any2i


class XShortEnumField(Named, scapy_fields.XShortEnumField):
    """Two octets with names, in hexadecimal."""

    taken = scapy_fields.XShortEnumField.any2i


class BitEnumField(Named, scapy_fields.BitEnumField):
    """Bits with names."""

    taken = scapy_fields.BitEnumField.any2i


def no_number(field: str, text: str, meaning: str = "") -> ValueError:
    """Return the error for a text in a field that has no names."""
    return ValueError(f"{field} is a number, not {text!r}{f': {meaning}' if meaning else ''}")


class _Number:
    """For Scapy fields that are numbers: a text raises ValueError when it is assigned, not struct.error when it is built."""

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take a number (Scapy's interface). Raises ValueError for a text."""
        field: Any = self
        if isinstance(x, str):
            raise no_number(field.name, x)
        return field.taken(pkt, x)


def _number(base: type[ScapyField]) -> type[ScapyField]:
    """Return a field class of Scapy as a `_Number` with the same name, which ``ls()`` shows."""
    body = {"__doc__": base.__doc__, "taken": base.any2i}
    return new_class(base.__name__, (_Number, base), exec_body=lambda names: names.update(body))


_DECIMAL_FIELDS: Final[dict[int, type[ScapyField]]] = {
    size: _number(base) for size, base in enumerate((ByteField, ShortField, ThreeBytesField, IntField), 1)
}
_HEXADECIMAL_FIELDS: Final[dict[int, type[ScapyField]]] = {
    size: _number(base) for size, base in enumerate((XByteField, XShortField, X3BytesField, XIntField), 1)
}
_NumberOfBits: Final = _number(BitField)
_NumberOfXBits: Final = _number(XBitField)
_NAMED_FIELDS: Final = {
    (1, True): ByteEnumField,
    (2, True): ShortEnumField,
    (1, False): XByteEnumField,
    (2, False): XShortEnumField,
}


def header_fields(
    layout: Layout,
    defaults: Mapping[str, Any] | None = None,
    replace: Mapping[str, ScapyField] | None = None,
) -> list[ScapyField]:
    """Return the Scapy fields of a layout, in wire order.

    ``defaults`` are the values of a new packet (0 or no octets by default, None for a field that building fills in).
    ``replace`` replaces fields of the layout by other Scapy fields. Bits without a field get one called ``spare``. Raises
    ValueError for a name that the layout does not have.
    """
    defaults = dict(defaults or {})
    replace = dict(replace or {})
    fields: list[ScapyField] = []
    unnamed = 0  # the bits of shared octets that no field has named yet
    for field in layout.fields:
        default = defaults.pop(field.name, None if field.counts else b"" if field.means is not None else 0)
        other = replace.pop(field.name, None)
        if unnamed and not field.shares:
            fields.append(_spare(fields, unnamed))
            unnamed = 0
        if field.bits is not None:
            unnamed = _spared(field, fields, unnamed)
        fields.append(other if other is not None else _scapy_field(field, default))
    if unnamed:
        fields.append(_spare(fields, unnamed))
    if defaults or replace:
        message = (
            f"{layout.name} has no field {', '.join([*defaults, *replace])}; it has {[f.name for f in layout.fields]}"
        )
        raise ValueError(message)
    return fields


def scapy_name(name: str) -> str:
    """Return the name of a layout's field in Scapy: with ``_`` appended if packets or Python use the name."""
    taken = hasattr(WireLayer, name) or name in Packet.__slots__ or name == "layout" or iskeyword(name)
    return f"{name}_" if taken else name


def _spare(fields: list[ScapyField], bits: int) -> ScapyField:
    """Return a field for bits that have no meaning, with a unique name."""
    count = sum(field.name.startswith("spare") for field in fields)
    return XBitField(f"spare{count + 1 if count else ''}", 0, bits)


def _spared(field: Field, fields: list[ScapyField], unnamed: int) -> int:
    """Put the bits above ``field`` that no field names before it; return how many bits of its octets are below it.

    Raises ValueError for bits that Scapy cannot hold: out of wire order, or named twice.
    """
    assert field.bits is not None
    mask, low = field.bits
    size = mask.bit_count()
    above = (unnamed if field.shares else field.size * 8) - size - low
    if mask != ((1 << size) - 1) << low or above < 0:
        message = f"the bits of {field.name} are out of order: give the highest first, each once and without gaps"
        raise ValueError(message)
    if above:
        fields.append(_spare(fields, above))
    return low


def _names(codes: CodeTable) -> dict[int, str]:
    """Return names by number, the lowest number last: Scapy takes the last number of a name that several have."""
    return dict(sorted(codes.names().items(), reverse=True))


def _scapy_field(field: Field, default: Any) -> ScapyField:
    name = scapy_name(field.name)
    if field.size < REST:
        return VarintField(name, default, field.size, field.codes, field.text)
    if field.means is not None:
        return MeaningField(name, default, field.size, field.means)
    if field.bits is not None or field.size not in _DECIMAL_FIELDS:
        size = field.bits[0].bit_count() if field.bits is not None else 8 * field.size
        if field.codes is not None:
            return BitEnumField(name, default, size, _names(field.codes))
        return (_NumberOfBits if field.decimal else _NumberOfXBits)(name, default, size)
    if field.codes is not None:
        named = _NAMED_FIELDS.get((field.size, field.decimal))
        if named is None:
            return BitEnumField(name, default, 8 * field.size, _names(field.codes))
        return named(name, default, _names(field.codes))
    return (_DECIMAL_FIELDS if field.decimal else _HEXADECIMAL_FIELDS)[field.size](name, default)


def consumed(pkt: Packet, rest: bytes) -> int:
    """Return how many of the layer's octets the fields before this one took, while dissecting."""
    return len(pkt.original) - len(rest)


def no_octets(field: str, value: Any) -> Any:
    """Return ``value``, unless it is a number: Scapy makes that many zeros of it. Raises ValueError then."""
    if isinstance(value, (int, float)):
        raise ValueError(f"{field} takes bytes or a text, not the number {value!r}")  # noqa: TRY004 - as other fields do
    return value


class OctetsField(XStrField):
    """Octets shown in hexadecimal: as many as ``size(packet, octets left)`` says, or as there are."""

    __slots__ = ["size"]

    def __init__(self, name: str, size: Callable[[Packet, bytes], int]) -> None:
        super().__init__(name, b"")
        self.size = size

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take octets or a text, which becomes UTF-8 (Scapy's interface). Raises ValueError for a number."""
        return super().any2i(pkt, no_octets(self.name, x))

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, bytes]:
        """Take the octets (Scapy's interface)."""
        size = max(0, self.size(pkt, s))
        return s[size:], s[:size]

    def randval(self) -> RandBin:
        """Return the value that ``fuzz()`` puts here: few enough octets for any length field."""
        return RandBin(RandNum(0, _FUZZED))


class MeaningField(XStrField):
    """Octets with a meaning, which is shown with them; ``size`` octets, or all that are left (`REST`).

    Takes octets, or a text, which becomes Latin-1. Too few octets for ``size`` are zero-padded when building; too many raise
    ValueError.
    """

    __slots__ = ["means", "size"]

    def __init__(self, name: str, default: bytes, size: int, means: Means) -> None:
        self.size = size
        self.means = means
        super().__init__(name, default)

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take octets or a text (Scapy's interface). Raises ValueError for a number, and for a text that is not Latin-1."""
        if not isinstance(x, str):
            return super().any2i(pkt, no_octets(self.name, x))
        try:
            return x.encode("latin-1")
        except UnicodeEncodeError as error:
            message = f"{self.name}: {x[error.start]!r} is not in Latin-1: give the bytes"
            raise ValueError(message) from None

    def i2m(self, pkt: Packet | None, x: Any) -> bytes:
        """Return the octets to send (Scapy's interface)."""
        octets: bytes = super().i2m(pkt, x)
        if self.size == REST:
            return octets
        if len(octets) > self.size:
            message = f"{self.name} is {self.size} byte(s), not {len(octets)}: give fewer"
            raise ValueError(message)
        return octets.ljust(self.size, b"\0")

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return the form for ``show()``: a text as it is, anything else with its octets (Scapy's interface)."""
        if not isinstance(x, bytes):
            return repr(x)
        meaning = self.means(self.i2m(pkt, x)) if self.size == REST or len(x) <= self.size else None
        if meaning is None:
            return x.hex()
        text = printable(meaning)
        if not text or text.encode("latin-1", "replace") == x.rstrip(b" \0"):
            return text or x.hex()
        return f"{text} ({x.hex()})"

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, bytes]:
        """Take the octets (Scapy's interface)."""
        size = len(s) if self.size == REST else self.size
        return s[size:], s[:size]

    def randval(self) -> RandBin:
        """Return the value that ``fuzz()`` puts here (Scapy's interface)."""
        return RandBin(RandNum(0, _FUZZED) if self.size == REST else self.size)


class Overlong(int):
    """A variable-size number in a longer encoding than necessary: the octets are kept, so that they are built again."""

    octets: bytes

    @classmethod
    def of(cls, number: int, octets: bytes) -> Overlong:
        """Return ``number`` as ``octets``."""
        made = cls(number)
        made.octets = octets
        return made

    def __reduce__(self) -> tuple[Any, ...]:
        """Keep the octets in copies."""
        return Overlong.of, (int(self), self.octets)


class VarintField(ScapyFieldBase[Any, Any]):
    """A variable-size number (`dissect.wire.varint`), or the name of one in ``codes``.

    Invalid octets, and a longer encoding than necessary, are an `Overlong`. ``text`` is the meaning of the number.
    """

    __slots__ = ["codes", "kind", "text"]

    def __init__(self, name: str, default: Any, kind: int, codes: CodeTable | None = None, text: str = "") -> None:
        self.kind = kind
        self.codes = codes
        self.text = text
        super().__init__(name, default, "B")

    def any2i(self, pkt: Packet | None, x: Any) -> Any:
        """Take a number or its name (Scapy's interface). Raises ValueError for an unknown name."""
        if isinstance(x, str) and self.codes is not None:
            number = next((row.number for row in self.codes if row.name == x), None)
            if number is None:
                raise no_such_name(self.name, x, [row.name for row in self.codes])
            return number
        if isinstance(x, str):
            raise no_number(self.name, x, self.text)
        return x

    def addfield(self, pkt: Packet | None, s: bytes, val: Any) -> bytes:
        """Append the number (Scapy's interface). Raises ValueError for one that its kind cannot hold."""
        if isinstance(val, Overlong):
            return s + val.octets
        try:
            return s + build_varint(int(val or 0), self.kind)
        except ValueError as error:
            message = f"{self.name}: {error}"
            raise ValueError(message) from None

    def getfield(self, pkt: Packet | None, s: bytes) -> tuple[bytes, Any]:
        """Take a number (Scapy's interface)."""
        number, end = read_varint(s, 0, len(s), self.kind)
        if end < 0:
            return b"", Overlong.of(0, s)
        exact = build_varint(number, self.kind) == s[:end]
        return s[end:], number if exact else Overlong.of(number, s[:end])

    def i2repr(self, pkt: Packet | None, x: Any) -> str:
        """Return the text that ``show()`` prints (Scapy's interface)."""
        row = self.codes.get(x) if self.codes is not None and isinstance(x, int) else None
        return f"{x} {row.name}" if row is not None else str(x)

    def randval(self) -> RandNum:
        """Return the value that ``fuzz()`` puts here (Scapy's interface)."""
        return RandNum(0, 0x7FFFFFFF)


class Leftover(ConditionalField):
    """Octets where none are expected. Shown and built only if there are any."""

    def __init__(self, name: str, size: Callable[[Packet, bytes], int]) -> None:
        super().__init__(OctetsField(name, size), lambda pkt: bool(pkt.getfieldval(name)))

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, bytes | None]:
        """Take the octets; None tells Scapy that there is no such field."""
        rest, octets = self.fld.getfield(pkt, s)
        return rest, octets or None

    def i2h(self, pkt: Packet | None, val: Any) -> Any:
        """Return the octets, empty rather than None when there are none."""
        return val


class FillField(ConditionalField):
    """The fill octet after an odd item: the remaining octets of the item.

    None, the default, lets the list that contains the item decide. Shown only if there is one.
    """

    def __init__(self) -> None:
        super().__init__(XStrField("fill", None), lambda pkt: bool(pkt.getfieldval("fill")))

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, bytes]:
        """Take the remaining octets (Scapy's interface)."""
        return b"", s

    def i2h(self, pkt: Packet | None, val: Any) -> Any:
        """Return the octet; empty if there was none, None if the list decides."""
        return val


#: Possible elements of a list: `RawVal` and random values are Scapy's.
_PIECES: Final = (Packet, bytes, bytearray, RawVal, VolatileValue)
#: One element of a list: its class and its octets.
Piece = tuple[type[Packet], bytes]


class PiecesField(PacketListField):
    """A list of packets that ``carve(packet, octets left)`` separates; the remaining octets go to the next field."""

    __slots__ = ["carve"]

    def __init__(self, name: str, carve: Callable[[Packet, bytes], list[Piece]]) -> None:
        super().__init__(name, [], Raw)
        self.carve = carve

    def any2i(self, pkt: Packet | None, x: Any) -> list[Any]:
        """Take packets, or octets instead of one; None is no packet. Raises ValueError for anything else."""
        if x is None:
            return []
        if isinstance(x, Iterable) and not isinstance(x, (*_PIECES, str)):
            x = list(x)  # also converts a tuple, which Scapy would take for one packet
        taken: list[Any] = super().any2i(pkt, x)
        for one in taken:
            if not isinstance(one, _PIECES):
                message = f"{self.name} takes packets, or bytes, not {one!r}{self.hint(one)}"
                raise ValueError(message)  # noqa: TRY004 - as other fields do
        return taken

    def hint(self, wrong: Any) -> str:
        """Return a suggestion for a value that is not a packet."""
        return ""

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, list[Any]]:
        """Take the pieces (Scapy's interface)."""
        pieces = self.carve(pkt, s)
        packets = [cls(octets, _internal=1, _parent=pkt) for cls, octets in pieces]
        return s[sum([len(octets) for _, octets in pieces]) :], packets


class ItemsField(PiecesField):
    """Items, each with a `FillField`, and fill octets between them: if ``fill`` is None, the engine's rule decides."""

    def hint(self, wrong: Any) -> str:
        """Return how an address becomes an item."""
        return f": at({wrong!r}) makes an item of an address" if self.name == "items" and isinstance(wrong, str) else ""

    def addfield(self, pkt: Packet, s: bytes, val: Any) -> bytes:
        """Append the items (Scapy's interface)."""
        last = len(val) - 1
        for number, item in enumerate(val):
            octets = bytes(self.i2m(pkt, item))
            s += octets
            if isinstance(item, WireLayer) and "fill" in item.default_fields and item.getfieldval("fill") is None:
                s += bytes(item_fill(len(octets), number == last))
        return s


class CodesField(FieldListField):
    """One octet per element, each with its name: as many as ``size(packet, octets left)`` says, or as there are."""

    __slots__ = ["size"]

    def __init__(self, name: str, names: dict[int, str], size: Callable[[Packet, bytes], int]) -> None:
        super().__init__(name, [], XByteEnumField(name, 0, names))
        self.size = size

    def getfield(self, pkt: Packet, s: bytes) -> tuple[bytes, list[Any]]:
        """Take the octets (Scapy's interface)."""
        size = max(0, self.size(pkt, s))
        return s[size:], list(s[:size])


def fill_number(octets: bytes, offset: int, size: int, value: int, what: str) -> bytes:
    """Return ``octets`` with ``value`` written at ``offset``; ValueError when the field's ``size`` octets cannot hold it."""
    if value >= 1 << 8 * size:
        message = f"{what} would be {value}, more than its {size} byte(s) can say: send less, or set the field yourself"
        raise ValueError(message)
    return octets[:offset] + value.to_bytes(size, "big") + octets[offset + size :]


class WireLayer(Packet):
    """Base of every layer of this package: octets too short for its fixed part become a `Raw`.

    ``least`` is that size; the classes set it. Scapy looks for ``dispatch_hook`` in the class itself, so each gets one.
    """

    least = 0

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Give the class its own ``dispatch_hook``, unless it brings one."""
        super().__init_subclass__(**kwargs)
        if "dispatch_hook" not in cls.__dict__:
            cls.dispatch_hook = classmethod(_raw_when_short)  # type: ignore[attr-defined]  # set, not declared: see above

    @classmethod
    def cut_short(cls, octets: bytes) -> bool:
        """Return whether ``octets`` are too few for the layer's fixed part."""
        return len(octets) < cls.least

    def mysummary(self) -> Any:
        """Return `line`, or nothing while a value is still to be drawn, as in a fuzzed packet (Scapy's interface)."""
        return self.line() if settled(self) and settled(self.payload) else ""

    def line(self) -> Any:
        """Return the layer's content in one line: a text, or the form for Scapy's ``mysummary``."""
        return ""


class Joining:
    """A data packet that may end a message of several packets; goes before `WireLayer`, with a slot ``piece``.

    After `join` its layer is the whole message; as long as the message is not changed, it still builds only its own piece of
    the octets on the wire.
    """

    __slots__ = ()
    piece: tuple[bytes, bytes]

    def join(self, message: Packet) -> None:
        """Take the whole message as the layer."""
        packet: Any = self
        piece = bytes(packet.payload)
        packet.remove_payload()
        packet.add_payload(message)
        packet.piece = (piece, bytes(message))

    def do_build_payload(self) -> bytes:
        """Build the piece that was on the wire, or the message if it was changed (Scapy's interface)."""
        built: bytes = super().do_build_payload()  # type: ignore[misc]
        piece = getattr(self, "piece", None)
        return piece[0] if piece is not None and piece[1] == built else built

    def copy(self) -> Any:
        """Return a copy, with the piece (Scapy's interface)."""
        return self._with_piece(super().copy())  # type: ignore[misc]

    def clone_with(self, *args: Any, **kwargs: Any) -> Any:
        """Return a copy with another payload and the piece (Scapy's interface); Scapy builds a stack of layers from these."""
        return self._with_piece(super().clone_with(*args, **kwargs))  # type: ignore[misc]

    def _with_piece(self, clone: Any) -> Any:
        piece = getattr(self, "piece", None)
        if piece is not None:
            clone.piece = piece
        return clone


def settled(packet: Packet) -> bool:
    """Return whether every field of a layer has a value, also in the packets of its lists: ``fuzz()`` leaves random ones."""
    for values in (packet.fields, packet.overloaded_fields, packet.default_fields) if packet.fields_desc else ():
        for value in values.values():
            listed = value if isinstance(value, list) else [value]
            for one in listed:
                if isinstance(one, VolatileValue) or (isinstance(one, Packet) and not settled(one)):
                    return False
    return True


def _raw_when_short(cls: type[WireLayer], _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> type[Packet]:
    return Raw if _pkt and cls.cut_short(_pkt) else cls
