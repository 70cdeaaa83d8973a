"""`EventTable`, for the events of the diagnostic buffer; its rows are in `dissect.protocols.s7.diagnostic_tables`."""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import Code, CodeTable

#: Classes in which bits 11-8 are not part of the event's identity, but say how the event came.
_BY_NUMBER: Final = frozenset((0x8, 0x9))


class EventTable(CodeTable):
    """Events by id. In classes 8 and 9, only the class and the lower octet identify an event; bits 11-8 are ignored."""

    __slots__ = ()

    def get(self, number: int) -> Code | None:
        """Return the row of the event ``number``; None if it is unknown."""
        if number >> 12 in _BY_NUMBER:
            return super().get(number & 0xF0FF)
        return super().get(number)

    def name(self, number: int) -> str:
        """Return the name of the event ``number``; its number if it is unknown."""
        row = self.get(number)
        return row.name if row is not None else self.hex(number)

    def text(self, number: int) -> str:
        """Return the sentence of the event ``number``; empty if there is none."""
        row = self.get(number)
        return row.text if row is not None else ""
