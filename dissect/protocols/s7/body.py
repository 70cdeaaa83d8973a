"""`Body`: the parts of an S7 PDU after its header, which `dissect.protocols.s7.bodies` parses."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7.layouts import DATA_ITEM
from dissect.wire.copies import leaves
from dissect.wire.layout import Layout
from dissect.wire.malformed import Malformed
from dissect.wire.part import Part

#: So many parts are in the representation of a body.
_SHOWN: Final = 4


class Body:
    """The parts of a PDU after its header; offsets are within the PDU.

    ``malformed`` has the faults of the parts, except those that are already in `Pdu.malformed`.
    """

    __slots__ = ("data", "malformed", "parameters")

    def __init__(self) -> None:
        self.parameters: list[Part] = []
        self.data: list[Part] = []
        self.malformed: list[Malformed] = []

    def __repr__(self) -> str:
        named = [part.layout.name for part in self.parts[:_SHOWN]]
        return f"Body({', '.join(named)}{', …' if len(self.parts) > _SHOWN else ''})"

    @property
    def parts(self) -> list[Part]:
        """All parts in wire order."""
        return self.parameters + self.data

    def find(self, layout: Layout) -> Part | None:
        """Return the first part with this layout; None if there is none."""
        for part in self.parts:
            if part.layout is layout:
                return part
        return None

    def number(self, name: str) -> int:
        """Return the number in the first field called ``name``; -1 if there is none."""
        for part in self.parts:
            found = part.find(name)
            if found is not None:
                return found.value
        return -1

    def text(self, name: str) -> str:
        """Return the meaning of the first field called ``name``; empty if there is none."""
        for part in self.parts:
            found = part.find(name)
            if found is not None:
                return found.meaning
        return ""

    @property
    def notes(self) -> list[str]:
        """The notes of the parts in wire order; text from the wire is not escaped.

        Notes of data items are omitted: they only repeat the addresses, next to the values.
        """
        return [part.note for part in self.parts if part.note and part.layout is not DATA_ITEM]


leaves(Body)
