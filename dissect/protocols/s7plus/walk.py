"""`Walk`: reads the contents of a PDU, one number, text or part after another, and reports faults in a uniform way."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7plus.blobs import MAX_INFLATED
from dissect.wire.layout import Layout
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16, u32
from dissect.wire.part import OCTETS, SURPLUS, Part
from dissect.wire.varint import VLQ64, read_varint

#: Maximum depth of nested objects and values that are read; the deepest in captures have seven levels.
MAX_DEPTH: Final = 40
#: Maximum number of parts of one PDU that are kept; later ones are read and counted, and shown as octets.
MAX_PARTS: Final = 100_000
#: Work for a value, an object, a variable, an address or a refusal; an element of an array and an id cost 1.
STEP: Final = 5
#: Maximum work that the judgement of a PDU may cost. The largest PDU in the captures at hand takes a fiftieth.
MAX_WORK: Final = 500_000
#: The reason when the budget of a limited walk is used up, which is not a fault of the PDU.
EXHAUSTED: Final = "exhausted"


class FormatError(Exception):
    """Something does not fit; this never leaves the package. The arguments are those of `Malformed`."""

    def __init__(self, reason: str, field: str, at: int, needed: int, available: int) -> None:
        super().__init__(reason)
        self.reason = reason
        self.field = field
        self.at = at
        self.needed = needed
        self.available = available


def big_endian(octets: bytes, at: int, size: int) -> int:
    """Return the ``size`` octets at ``at``, which must be present, as a number."""
    if size == 1:
        return octets[at]
    if size == 2:
        return int(u16(octets, at))
    if size == 4:
        return int(u32(octets, at))
    return int.from_bytes(octets[at : at + size], "big")


@mypyc_attr(acyclic=True, free_list_len=1)
class Wanted:
    """The needed parts of a PDU, so that the rest may be skipped.

    ``attributes``: a table of the attributes of objects (`dissect.protocols.s7plus.cursor.table`), which also applies to
    written values, unless ``written`` states that all of these are needed. ``items``: the numbers of the values in a response,
    None for all.
    """

    __slots__ = ("attributes", "items", "written")

    def __init__(self, attributes: bytes, items: frozenset[int] | None = None, written: bool = False) -> None:
        self.attributes = attributes
        self.items = items
        self.written = written


@mypyc_attr(acyclic=True, free_list_len=1)  # as `dissect.protocols.s7plus.cursor.Cursor`
class Walk:
    """Reads ``octets[at:end]`` and raises `FormatError` if they end too soon.

    ``parts`` are made only if ``shown``. Values, objects and elements of arrays count against a ``budget``. By default it is
    more than the octets can contain, so it only stops elements without octets. With ``most``, the walk ends when that is used
    up, which is not a fault of the sender. Such a walk is ``hurried``: it inflates only compressed blobs that may swell
    (`may_swell`), and none after the first one that is not sound. ``wanted``: the parts that are needed, None for everything.
    ``blobs``: (offset, end) of compressed blobs. ``faults``: faults that do not stop the walk. ``uncut`` counts the parts after
    `MAX_PARTS`.
    """

    __slots__ = (
        "at",
        "blobs",
        "bounded",
        "budget",
        "depth",
        "end",
        "faults",
        "hurried",
        "inflating",
        "octets",
        "parts",
        "parts_end",
        "shown",
        "uncut",
        "wanted",
    )

    def __init__(
        self, octets: bytes, at: int, end: int, shown: bool, most: int = 0, wanted: Wanted | None = None
    ) -> None:
        self.octets = octets
        self.wanted = wanted
        self.at = at
        self.end = min(end, len(octets))
        self.shown = shown
        self.parts: list[Part] = []
        self.parts_end = at  # where the last part ends
        self.uncut = 0
        self.depth = 0
        self.blobs: list[tuple[int, int]] = []
        self.faults: list[FormatError] = []
        self.inflating = MAX_INFLATED  # octets that further blobs may grow to
        self.budget = 3 * len(octets) + 1024
        self.hurried = most > 0
        self.bounded = 0 < most < self.budget
        if self.bounded:
            self.budget = most

    @property
    def left(self) -> int:
        """Number of remaining octets."""
        return self.end - self.at

    @property
    def full(self) -> bool:
        """True if no more parts are kept, so values for display need not be kept either."""
        return self.shown and len(self.parts) >= MAX_PARTS

    def need(self, size: int, field: str) -> None:
        """Raise `FormatError` unless ``size`` octets are left."""
        if size > self.end - self.at:
            raise FormatError("too_short", field, self.at, size, max(0, self.end - self.at))

    def u8(self, field: str) -> int:
        """Read one octet."""
        self.need(1, field)
        self.at += 1
        return self.octets[self.at - 1]

    def fixed(self, size: int, field: str) -> int:
        """Read a number of ``size`` octets."""
        at = self.at
        self.need(size, field)
        self.at = at + size
        return big_endian(self.octets, at, size)

    def step(self, size: int, field: str) -> int:
        """Skip ``size`` octets; return where they begin."""
        at = self.at
        self.need(size, field)
        self.at = at + size
        return at

    def take(self, size: int, field: str) -> bytes:
        """Read ``size`` octets."""
        self.need(size, field)
        at = self.at
        self.at = at + size
        return self.octets[at : at + size]

    def number(self, kind: int, field: str) -> int:
        """Read a number of variable size (`dissect.wire.varint`). Raises `FormatError` if it is cut off."""
        at = self.at
        octets = self.octets
        if kind >= VLQ64 and at + 1 < self.end:  # unsigned; most have one octet or two
            first: i64 = octets[at]
            if first < 0x80:
                self.at = at + 1
                return int(first)
            second: i64 = octets[at + 1]
            if second < 0x80:
                self.at = at + 2
                return int((first & 0x7F) << 7 | second)
        value, end = read_varint(self.octets, at, self.end, kind)
        if end < 0:
            raise FormatError("too_short", field, self.at, max(1, self.left + 1), self.left)
        self.at = end
        return value

    def counted(self, kind: int, field: str) -> int:
        """Read a count of elements of at least one octet each. Raises `FormatError` if there cannot be so many."""
        at = self.at
        count = self.number(kind, field)
        if count > self.left:
            raise FormatError("length_beyond", field, at, count, self.left)
        return count

    def peek(self) -> int:
        """Return the next octet, -1 at the end."""
        return self.octets[self.at] if self.at < self.end else -1

    def spend(self, cost: int, field: str) -> None:
        """Count work against the budget. Raises `FormatError` if it is used up."""
        self.budget -= cost
        if self.budget < 0:
            raise FormatError(EXHAUSTED if self.bounded else "count_mismatch", field, self.at, cost, 0)

    def enter(self, field: str) -> None:
        """Go one level down; the caller goes up again. Raises `FormatError` at `MAX_DEPTH`."""
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise FormatError("bad_value", f"depth of {field}", self.at, MAX_DEPTH, self.depth)

    def part(self, layout: Layout, start: int, note: str = "", deeper: int = 0) -> None:
        """Make a part from ``start`` up to the current offset."""
        if not self.shown:
            return
        if self.full:
            self.uncut += 1
            return
        part = Part(layout, self.octets, start, self.at)
        part.note = note
        part.depth = self.depth + deeper
        self.parts.append(part)
        self.parts_end = self.at

    def rest(self, malformed: list[Malformed], fault: FormatError | None = None, limit: str = "tsdu") -> None:
        """Make a part of the remaining octets, and report the fault that ended the walk."""
        faults = self.faults
        if fault is not None and fault.reason != EXHAUSTED:
            faults = [*faults, fault]
        if faults:
            malformed.extend(
                [Malformed("s7plus", one.reason, one.field, one.at, one.needed, one.available, limit) for one in faults]
            )
        self.depth = 0
        if self.parts_end < self.end and self.shown:
            surplus = fault is not None and fault.reason == "trailing_octets"
            part = Part(SURPLUS if surplus else OCTETS, self.octets, self.parts_end, self.end)
            if self.uncut:
                part.note = f"{self.uncut} more parts (values, addresses, ids …) left out of this view"
            self.parts.append(part)
        self.at = self.end
