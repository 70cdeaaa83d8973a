"""The body of an S7 PDU: the parts behind its header. `dissect.s7.bodies` cuts it."""

from __future__ import annotations

from dissect.s7.layouts import DATA_ITEM
from dissect.wire.layout import Layout
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part


class Body:
    """The parts of a PDU behind its header; offsets are within the PDU.

    ``malformed`` tells what the parts have against themselves; the facts of `Pdu.malformed` are not repeated in it.
    """

    __slots__ = ("data", "malformed", "parameters")

    def __init__(self) -> None:
        self.parameters: list[Part] = []
        self.data: list[Part] = []
        self.malformed: list[Malformed] = []

    @property
    def parts(self) -> list[Part]:
        """All parts in wire order."""
        return self.parameters + self.data

    def find(self, layout: Layout) -> Part | None:
        """Return the first part of this layout, None when there is none."""
        for part in self.parts:
            if part.layout is layout:
                return part
        return None

    def number(self, name: str) -> int:
        """Return the number in the first field called ``name``, -1 when there is none."""
        for part in self.parts:
            found = part.find(name)
            if found is not None:
                return found.value
        return -1

    def text(self, name: str) -> str:
        """Return what the first field called ``name`` says, empty when there is none."""
        for part in self.parts:
            found = part.find(name)
            if found is not None:
                return found.meaning
        return ""

    @property
    def notes(self) -> list[str]:
        """What the parts are about, in wire order; text from the wire, not escaped.

        Values that follow their addresses repeat those only where a person looks at the parts, not here.
        """
        return [part.note for part in self.parts if part.note and part.layout is not DATA_ITEM]
