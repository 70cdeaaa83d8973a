"""Facts: one field of one TPDU or S7 PDU, its position and its value, from either side.

The layouts (`dissect.protocols.iso.layouts`, `dissect.protocols.s7.layouts`) define the fields, their Wireshark names and their
positions. Names for contents outside fixed headers are defined here.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from typing import Final, NamedTuple

from dissect.protocols.iso import layouts as iso
from dissect.protocols.s7 import bodies
from dissect.protocols.s7 import layouts as s7
from dissect.wire import part
from dissect.wire.layout import Layout

#: The compared protocols: COTP and S7comm.
TPDU: Final = "TPDU"
PDU: Final = "PDU"

#: Size of a TPKT header.
TPKT_SIZE: Final = iso.TPKT.size

#: Sections of a TPDU or PDU that contain fields.
IN_TPKT: Final = "TPKT"
IN_TPDU: Final = "TPDU"
IN_PARAMETER: Final = "parameter"
IN_HEADER: Final = "header"
IN_PARAMETERS: Final = "parameters"
IN_ITEM: Final = "item"
IN_DATA: Final = "data"
IN_DATA_ITEM: Final = "data item"
#: Everything else in the parameters and the data of a PDU, numbered by its position.
IN_BODY: Final = "byte"
#: The same in an answer that consists of several PDUs, where Wireshark shows it: in the last of them.
IN_JOINED: Final = "joined byte"

#: Names of values outside fixed headers.
CALLING_TSAP: Final = "cotp.src-tsap-bytes"
CALLED_TSAP: Final = "cotp.dst-tsap-bytes"
TPDU_SIZE: Final = "cotp.tpdu_size"
PREFERRED_SIZE: Final = "cotp.preferred_maximum_tpdu_size"
CONTENT: Final = "s7comm.resp.data"
FILL: Final = "s7comm.data.fillbyte"
#: Fields that contain octets; all others contain a number.
OCTETS: Final = frozenset((CALLING_TSAP, CALLED_TSAP, CONTENT))


def _names(*layouts: Layout) -> frozenset[str]:
    return frozenset(field.wireshark for layout in layouts for field in layout.fields if field.wireshark)


_TPDUS: Final = [
    layout for layout in vars(iso).values() if isinstance(layout, Layout) and layout not in {iso.TPKT, iso.PARAMETER}
]

#: Wireshark's names of the compared fields, by section.
NAMES: Final[dict[str, frozenset[str]]] = {
    IN_TPKT: _names(iso.TPKT),
    IN_TPDU: _names(*_TPDUS) | {CALLING_TSAP, CALLED_TSAP, TPDU_SIZE, PREFERRED_SIZE},
    IN_PARAMETER: _names(iso.PARAMETER),
    IN_HEADER: _names(s7.HEADER, s7.ACK_HEADER),
    IN_PARAMETERS: _names(s7.SETUP, s7.VARIABLES_HEAD, s7.USERDATA_SHORT, s7.USERDATA_EXTENDED, s7.MODE_TRANSITION),
    IN_ITEM: _names(s7.ITEM_HEAD, s7.S7ANY_ITEM),
    IN_DATA: _names(s7.DATA_ITEM),
    IN_DATA_ITEM: _names(s7.DATA_ITEM) | {CONTENT, FILL},
}


def layouts() -> list[Layout]:
    """Return every layout of S7comm.

    Each that a module imported by `dissect.protocols.s7.bodies` has in a variable or in a table.
    """
    by_id: dict[int, Layout] = {}
    modules = [sys.modules[name] for name in sorted(sys.modules) if name.startswith("dissect.protocols.s7.")]
    for module in (part, bodies, *modules):
        for value in vars(module).values():
            for layout in _layouts_in(value):
                by_id[id(layout)] = layout
    return list(by_id.values())


def _layouts_in(value: object) -> Iterator[Layout]:
    if isinstance(value, Layout):
        yield value
    elif isinstance(value, list | tuple | set | frozenset):
        for one in value:
            yield from _layouts_in(one)
    elif isinstance(value, dict):
        for one in value.values():
            yield from _layouts_in(one)


#: Wireshark's names of all fields that a body may have.
BODY_NAMES: Final = _names(*layouts()) | {CONTENT, FILL}

Value = int | bytes


class FieldPlace(NamedTuple):
    """Identifies a field: its section, the number of its item or parameter (from 1; 0 if there is only one), its name.

    In a body, ``number`` is its position in the PDU or in the joined answer.
    """

    part: str
    number: int
    name: str

    def __str__(self) -> str:
        if self.part in {IN_BODY, IN_JOINED}:
            return f"{self.name} at {self.part} {self.number}"
        return f"{self.name} of {self.part} {self.number}" if self.number else self.name


class LocatedValue(NamedTuple):
    """The value of a field and its position in its TPDU (from the LI) or PDU (from 0x32); for TPKT fields from the TPKT."""

    value: Value
    offset: int


class Record:
    """One TPDU or S7 PDU: the packet that completed it, its octets, and its facts.

    ``octets`` of a TPDU are its TPKT header and its own header, without user data; those of a PDU are all. ``number`` counts
    our records of a capture in order; it is -1 in a record of Wireshark's. ``joined`` are the octets that Wireshark joined from
    this PDU and those before it, empty if it did not. ``other`` counts the names of fields that it shows in the body and that
    no layout of ours has; ``again`` those of them whose octets are in a compared field.
    """

    __slots__ = ("again", "facts", "frame", "joined", "kind", "number", "octets", "other")

    def __init__(
        self, kind: str, frame: int, octets: bytes, facts: dict[FieldPlace, LocatedValue], number: int = -1
    ) -> None:
        self.kind = kind
        self.frame = frame
        self.octets = octets
        self.facts = facts
        self.number = number
        self.joined = b""
        self.other: Counter[str] = Counter()
        self.again: Counter[str] = Counter()

    def value(self, part: str, name: str, number: int = 0) -> Value | None:
        """Return the value of a field, None if the record has none of that name."""
        fact = self.facts.get(FieldPlace(part, number, name))
        return fact.value if fact is not None else None
