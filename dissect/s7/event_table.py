"""The table of the events of the diagnostic buffer, apart from its rows, because they are looked up by the thousand."""

from __future__ import annotations

from typing import Final

from dissect.wire.codes import Code, CodeTable

#: Classes in which bits 11-8 do not belong to what an event is, but say how it came.
_BY_NUMBER: Final = frozenset((0x8, 0x9))


class EventTable(CodeTable):
    """Events by id. In classes 8 and 9 the event is the class and the number alone, whatever the bits between say."""

    __slots__ = ()

    def get(self, number: int) -> Code | None:
        """Return the row of the event ``number``, None when nobody knows it."""
        if number >> 12 in _BY_NUMBER:
            return super().get(number & 0xF0FF)
        return super().get(number)

    def name(self, number: int) -> str:
        """Return what the event ``number`` is; an unknown one names itself."""
        row = self.get(number)
        return row.name if row is not None else self.hex(number)

    def text(self, number: int) -> str:
        """Return the sentence of the event ``number``, empty when there is none."""
        row = self.get(number)
        return row.text if row is not None else ""
