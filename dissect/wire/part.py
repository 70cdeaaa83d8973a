"""`Part`: a piece of a message that a `Layout` describes. A message is cut into parts without gaps.

The parsers of message bodies go over a block of octets with a `Cursor` and take one part after another; the order of the parts
is plain Python there. Everything that shows a body (field tree, JSON, Scapy layers, the comparison with Wireshark) goes over
the parts and needs nothing else.
"""

from __future__ import annotations

from typing import Final

from dissect.wire.copies import leaves
from dissect.wire.layout import REST, Field, FieldValue, Layout
from dissect.wire.malformed import Malformed
from dissect.wire.text import printable

#: Octets whose meaning is not known, or depends on more than this message.
OCTETS: Final = Layout("octets", "content of unknown structure", [Field("octets", REST, "As on the wire.")])
#: Octets where nothing may follow.
SURPLUS: Final = Layout("surplus bytes", "nothing is expected here", [Field("octets", REST, "As on the wire.")])
#: The octet that makes the size of an odd item even.
FILL: Final = Layout(
    "fill", "reference section 3.5", [Field("fill", 1, "Makes an odd item even.", "s7comm.data.fillbyte")]
)


class Part:
    """A part of a message: ``octets[offset:end]``, read by ``layout``.

    ``values`` are the fields that are completely inside the part. ``note`` says in a few words what the part is about (``SZL
    0x0011``), if its parser knows; it may hold text from the wire, which is not escaped. ``depth`` is how many parts enclose
    it.
    """

    __slots__ = ("_octets", "_values", "depth", "end", "layout", "note", "offset")

    def __init__(self, layout: Layout, octets: bytes, offset: int, end: int) -> None:
        self.layout = layout
        self.offset = offset
        self.end = end
        self.note = ""
        self.depth = 0
        self._octets = octets
        self._values: list[FieldValue] | None = None

    def __repr__(self) -> str:
        return printable(
            f"Part({self.layout.name}{f': {self.note}' if self.note else ''}, bytes {self.offset} to {self.end})"
        )

    @property
    def values(self) -> list[FieldValue]:
        """The fields, read on demand."""
        values = self._values
        if values is None:
            values = self.read()
            self._values = values
        return values

    def read(self) -> list[FieldValue]:
        """Return the fields without keeping them, for callers that go over many parts once."""
        return self._values if self._values is not None else self.layout.read(self._octets, self.offset, self.end)

    def find(self, name: str) -> FieldValue | None:
        """Return the field called ``name``, None when the part was cut before it or has none."""
        if self._values is None and name in self.layout.numbers:
            return self.layout.find(name, self._octets, self.offset, self.end)  # reads only this field
        for value in self.values:
            if value.field.name == name:
                return value
        return None

    def holding(self, holds: str) -> FieldValue | None:
        """Return the first field whose `Field.holds` is ``holds``, None when the part was cut before it or has none."""
        for value in self.values:
            if value.field.holds == holds:
                return value
        return None

    def number(self, name: str) -> int:
        """Return the number in a field, -1 when it is not there."""
        if self._values is None and name in self.layout.numbers:
            return self.layout.number(name, self._octets, self.offset, self.end)
        found = self.find(name)
        return -1 if found is None else found.value

    def leading(self, size: int) -> int:
        """Return the number in the first ``size`` octets, whatever their fields, -1 when the part is shorter."""
        if self.end - self.offset < size:
            return -1
        number = 0
        for octet in self._octets[self.offset : self.offset + size]:
            number = number << 8 | octet
        return number

    def octets(self, name: str) -> bytes:
        """Return the octets in a field, empty when it is not there."""
        found = self.find(name)
        return b"" if found is None or found.octets is None else found.octets

    def text(self, name: str) -> str:
        """Return the meaning of a field as text, empty when it is not there."""
        if self._values is None and name in self.layout.numbers:
            return self.layout.text(name, self._octets, self.offset, self.end)
        found = self.find(name)
        return "" if found is None else found.meaning


class Cursor:
    """Goes over ``octets[at:end]`` and cuts parts from it; what does not fit is reported in ``malformed``.

    ``limit`` names the length field that set the end (`dissect.wire.malformed.LIMITS`). After the first part that does not fit,
    each further `take` returns None. So a parser needs to check a part only where it depends on a value in it.
    """

    __slots__ = ("at", "end", "limit", "malformed", "octets", "parts")

    def __init__(self, octets: bytes, at: int, end: int, limit: str, malformed: list[Malformed]) -> None:
        self.octets = octets
        self.at = at
        self.end = min(end, len(octets))
        self.limit = limit
        self.malformed = malformed
        self.parts: list[Part] = []

    @property
    def left(self) -> int:
        """How many octets are left."""
        return self.end - self.at

    def take(self, layout: Layout, size: int = REST, note: str = "") -> Part | None:
        """Cut and return the next part; None when it does not fit.

        ``size`` is the size of the part if its layout is `Layout.open`; by default all octets that are left. If a part does not
        fit, the octets that are left become a part all the same, and it is reported as too short.
        """
        wanted = layout.size
        if layout.open:
            wanted = max(self.left, layout.size) if size == REST else size
        if wanted < layout.size or wanted > self.left:
            self._too_short(layout, max(wanted, layout.size))
            return None
        part = Part(layout, self.octets, self.at, self.at + wanted)
        part.note = note
        self.parts.append(part)
        self.at += wanted
        return part

    def _too_short(self, layout: Layout, wanted: int) -> None:
        if self.at < self.end or not self.malformed:
            self.tell("too_short", layout.name, wanted, self.left)
        if self.at < self.end:
            self.parts.append(Part(layout, self.octets, self.at, self.end))
            self.at = self.end

    def tell(self, reason: str, field: str, needed: int, available: int) -> None:
        """Report that something does not fit here (`Malformed`)."""
        self.malformed.append(Malformed("s7", reason, field, self.at, needed, available, self.limit))

    def take_fill(self, size: int) -> None:
        """Cut the fill octet after an item of ``size`` octets, if it is odd and something follows."""
        if size & 1 and self.left > 0:
            self.take(FILL)

    def rest(self, note: str = "") -> None:
        """Cut the octets that are left as a part of unknown meaning."""
        if self.left:
            self.take(OCTETS, self.left, note)

    def finish(self) -> None:
        """Report octets that are left over where nothing may follow, and cut them."""
        if self.left:
            self.tell("trailing_octets", "end", 0, self.left)
            self.take(SURPLUS, self.left)


leaves(Part, without=("_values",))
