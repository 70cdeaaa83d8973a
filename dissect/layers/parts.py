"""Parts of message bodies as Scapy packets: one class for each structure, lists of them separated by the engine's own parsers.

A job other than Read Var, Write Var and Setup communication, its answer, and the payload of userdata are lists of parts: a
structure of fixed size, or one whose last field takes the rest. Only `dissect.protocols.s7.bodies` knows their order; here its
parts become packets, and packets become octets again. So a list of parts may contain any packets in any order.

Counting fields are filled in when left out: they count the octets after them in the same part, the octets of the following
parts, or how many parts of one kind follow (`dissect.wire.layout.Field.counts`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import takewhile
from typing import Any, ClassVar, Final

from scapy.packet import Packet, Raw

from dissect.layers.fields import Piece, PiecesField, WireLayer, scapy_name
from dissect.protocols.s7.items import item_fill
from dissect.wire.layout import COUNTS_BUT_LAST, COUNTS_PARTS, COUNTS_REST, REST, Field, Layout
from dissect.wire.part import OCTETS, Part
from dissect.wire.varint import build_varint

#: The class of each layout, and the layouts of parts that belong to it when they follow it directly.
CLASSES: Final[dict[Layout, type[Packet]]] = {}
JOINED: Final[dict[Layout, tuple[Layout, ...]]] = {}
#: The layouts among these that may follow several times.
REPEATED: Final[set[Layout]] = set()


class S7_Part(WireLayer):
    """A part of a body; ``packet[S7_Part]`` finds any. `S7_Part` itself makes an `S7_Octets`, because the kind is unknown.

    ``layout`` is the layout of a part; the classes of parts set it. ``counted`` names fields that count parts of certain
    classes; ``counting`` computes counts of anything else that no layout defines; ``computed`` values from the part itself.
    """

    name = "S7 part"
    match_subclass = True
    show_summary = False
    layout: ClassVar[Layout] = OCTETS
    counted: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    counting: ClassVar[Callable[[Field, list[Packet], list[int]], int] | None] = None
    computed: ClassVar[Mapping[str, Callable[[Packet], int]]] = {}

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Register the class for its layout."""
        super().__init_subclass__(**kwargs)
        cls.least = cls.layout.size
        CLASSES[cls.layout] = cls

    @classmethod
    def cut_short(cls, octets: bytes) -> bool:
        """Return whether ``octets`` are too few for the part's fields."""
        return len(octets) < cls.least or len(cls.layout.read(octets)) < len(cls.layout.fields)

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> type[Packet]:
        """Return the class for octets of unknown meaning (Scapy's interface)."""
        return CLASSES[OCTETS]

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the fields that count the rest of the part (Scapy's interface)."""
        for field in self._unset():
            computing = self.computed.get(field.name)
            if computing is not None:
                pkt = self._filled(pkt, field, computing(self))
            elif field.counts == COUNTS_REST:
                pkt = self._filled(pkt, field, len(pkt) - self._place(pkt, field)[1])
        return pkt + pay

    def completed(self, octets: bytes, behind: list[Packet], sizes: list[int]) -> bytes:
        """Return ``octets``, this part's own, with the fields filled in that count the parts ``behind`` it, of ``sizes``."""
        for field in self._unset():
            count = -1 if field.name in self.computed else self.count_of(field, behind, sizes)
            if count >= 0:
                octets = self._filled(octets, field, count)
        return octets

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return the number of a field that was left out; -1 for one that does not depend on the parts ``behind``.

        Parts are counted up to the next one like this one, which has its own count.
        """
        counting = type(self).counting
        if counting is not None:
            return counting(field, behind, sizes)
        if field.counts == COUNTS_PARTS:
            return sum(sizes)
        if field.counts == COUNTS_BUT_LAST:
            return sum(sizes[:-1])
        names = self.counted.get(field.name, ())
        if not names and field.counts in {"", COUNTS_REST}:
            return -1
        own = list(takewhile(lambda part: type(part) is not type(self), behind))
        if names:
            return sum(1 for part in own if any(cls.__name__ in names for cls in type(part).__mro__))
        return sum(1 for part in own if (layout := layout_of(part)) is not None and layout.name == field.counts)

    @property
    def incomplete(self) -> bool:
        """True where a field was left out."""
        return bool(self._unset())

    def _unset(self) -> list[Field]:
        """Return the fields left out."""
        return [field for field in self.layout.fields if self.getfieldval(scapy_name(field.name)) is None]

    def _place(self, octets: bytes, field: Field) -> tuple[int, int]:
        """Return where the octets of a field begin and end."""
        value = next(value for value in self.layout.read(octets) if value.field is field)
        return value.offset, value.end

    def _filled(self, octets: bytes, field: Field, value: int) -> bytes:
        start, end = self._place(octets, field)
        if field.size < REST:
            return octets[:start] + build_varint(value, field.size) + octets[end:]
        mask, low = field.bits if field.bits is not None else ((1 << 8 * field.size) - 1, 0)
        if value > mask >> low:
            message = (
                f"{field.name} of {self.name} would be {value}, more than it can say: "
                f"give fewer parts, or set the field yourself"
            )
            raise ValueError(message)
        before = int.from_bytes(octets[start:end], "big") & ~mask
        return octets[:start] + (before | value << low).to_bytes(field.size, "big") + octets[end:]

    def line(self) -> str:
        """Return one line: the name."""
        return str(self.name)


def layout_of(packet: Packet) -> Layout | None:
    """Return the layout whose class a packet is, None when it has none."""
    return next((layout for layout, cls in CLASSES.items() if type(packet) is cls), None)


def pieces_of(parts: list[Part], octets: bytes) -> list[Piece]:
    """Return the class and the octets of each part of ``octets``; parts that belong to an item are joined to it.

    A part that was cut is too short for its class and becomes a `Raw`.
    """
    pieces: list[Piece] = []
    joins: tuple[Layout, ...] = ()
    for part in parts:
        if part.layout in joins:
            cls, before = pieces[-1]
            pieces[-1] = cls, before + octets[part.offset : part.end]
            joins = joins[joins.index(part.layout) + (part.layout not in REPEATED) :]
            continue
        pieces.append((CLASSES.get(part.layout, Raw), octets[part.offset : part.end]))
        joins = JOINED.get(part.layout, ())
    return pieces


class PartsField(PiecesField):
    """A list of parts; ``carve(packet, octets left)`` cuts them apart."""

    def addfield(self, pkt: Packet, s: bytes, val: Any) -> bytes:
        """Append the parts, with fill octets between items and the counts filled in (Scapy's interface)."""
        built = [bytes(self.i2m(pkt, one)) for one in val]
        later_item = False
        for number in reversed(range(len(val))):
            if _is_item(val[number]):
                if val[number].getfieldval("fill") is None:
                    built[number] += bytes(item_fill(len(built[number]), not later_item))
                later_item = True
        sizes = [len(octets) for octets in built]
        for number, one in enumerate(val):
            if isinstance(one, S7_Part) and one.incomplete:
                built[number] = one.completed(built[number], val[number + 1 :], sizes[number + 1 :])
        return s + b"".join(built)


def _is_item(one: Any) -> bool:
    return isinstance(one, WireLayer) and not isinstance(one, S7_Part) and "fill" in one.default_fields
