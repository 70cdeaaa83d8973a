"""Parts of message bodies as Scapy packets: one class for each structure, lists of them cut by the engine's own parsers.

A job other than Read Var, Write Var and Setup communication, its answer, and the payload of userdata are lists of parts: a
structure of fixed size, or one whose last field takes what is left. Which follows which is known to `dissect.s7.bodies` alone;
here its parts become packets, and packets become octets again. So any packets may be put into such a list in any order.

Fields that count something are filled in when left out: the octets behind them in the same part, the octets of the parts
behind, or how many parts of one kind follow (`dissect.wire.layout.Field.counts`).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from itertools import takewhile
from typing import Any, ClassVar, Final

from scapy.packet import Packet, Raw

from dissect.layers.fields import Piece, PiecesField, WireLayer, scapy_name
from dissect.s7.items import item_fill
from dissect.wire.layout import COUNTS_BUT_LAST, COUNTS_PARTS, COUNTS_REST, Field, Layout
from dissect.wire.part import OCTETS, Part

#: The class of each layout, and the layouts of parts that belong to it when they follow it directly.
CLASSES: Final[dict[Layout, type[Packet]]] = {}
JOINED: Final[dict[Layout, tuple[Layout, ...]]] = {}
#: Those of the latter that may follow several times.
REPEATED: Final[set[Layout]] = set()


class S7_Part(WireLayer):
    """A part of a body; ``packet[S7_Part]`` finds any. Called itself it is an `S7_Octets`, as nothing says which part is meant.

    ``layout`` is what a part is made of; the classes of parts set it. ``counted`` names fields that count parts of the classes
    named, and ``counting`` is what counts anything else, where no layout says so.
    """

    name = "S7 part"
    match_subclass = True
    show_summary = False
    layout: ClassVar[Layout] = OCTETS
    counted: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    counting: ClassVar[Callable[[Field, list[Packet], list[int]], int] | None] = None

    def __init_subclass__(cls, **kwargs: Any) -> None:
        """Enter the class as that of its layout."""
        super().__init_subclass__(**kwargs)
        cls.least = cls.layout.size
        CLASSES[cls.layout] = cls

    @classmethod
    def dispatch_hook(cls, _pkt: bytes | None = None, *_args: Any, **_kwargs: Any) -> type[Packet]:
        """Return the class of octets that nothing is known of (Scapy's interface)."""
        return CLASSES[OCTETS]

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in what counts the rest of the part (Scapy's interface)."""
        for field, end in self._unset():
            if field.counts == COUNTS_REST:
                pkt = self._filled(pkt, field, end, len(pkt) - end)
        return pkt + pay

    def completed(self, octets: bytes, behind: list[Packet], sizes: list[int]) -> bytes:
        """Return ``octets``, this part's own, with what counts the parts ``behind`` it filled in; ``sizes`` are theirs."""
        for field, end in self._unset():
            count = self.count_of(field, behind, sizes)
            if count >= 0:
                octets = self._filled(octets, field, end, count)
        return octets

    def count_of(self, field: Field, behind: list[Packet], sizes: list[int]) -> int:
        """Return the number of a field that was left out; -1 for one that does not depend on the parts ``behind``.

        Parts are counted up to the next one like this one, which counts for itself.
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

    def _unset(self) -> list[tuple[Field, int]]:
        """Return the fields left out, each with where its octets end."""
        found = []
        end = 0
        for field in self.layout.fields:
            end += 0 if field.shares else field.size
            if self.getfieldval(scapy_name(field.name)) is None:
                found.append((field, end))
        return found

    def _filled(self, octets: bytes, field: Field, end: int, value: int) -> bytes:
        start = end - field.size
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
    """Return the class and the octets of each part of ``octets``; what belongs to an item is joined to it.

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
            if isinstance(one, S7_Part):
                built[number] = one.completed(built[number], val[number + 1 :], sizes[number + 1 :])
        return s + b"".join(built)


def _is_item(one: Any) -> bool:
    return isinstance(one, WireLayer) and not isinstance(one, S7_Part) and "fill" in one.default_fields
