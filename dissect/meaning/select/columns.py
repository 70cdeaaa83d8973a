"""``-T fields``: the values of fields, one line for each result, separated by tabs, as in `tshark -T fields -e …`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.writer import COTP, NETLINK, Writer
from dissect.meaning.select.fields import NAMES, Field
from dissect.meaning.select.getters import OfItem, items
from dissect.meaning.select.things import MESSAGE, OPERATION, TRANSACTION, Context, Message
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES
from dissect.wire.text import Clock, printable

#: Separates several values of a field, as in tshark.
SEPARATOR = ","
#: Separates several values of one item.
WITHIN = ";"


class FieldsWriter(Writer):
    """Writes the fields that were given to `write_fields`; a field that a result does not have is empty."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._fields: list[Field] = []
        self._context = Context()

    def write_fields(self, names: Sequence[str], context: Context) -> None:
        """Choose the fields to write, in this order."""
        self._fields = [NAMES[name.lower()] for name in names]
        self._context = context

    def transaction(self, transaction: Transaction) -> None:
        """Add the line of a transaction."""
        self._add(TRANSACTION, transaction)

    def operation(self, operation: Operation) -> None:
        """Add the line of an operation."""
        self._add(OPERATION, operation)

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7 PDU."""
        self._message(UPPER_NAMES[S7COMM], frame, time_ns, side, octets, cut)

    def plus_pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """Add the line of an S7comm-plus PDU."""
        self._message(UPPER_NAMES[S7COMM_PLUS], frame, time_ns, side, octets, cut)

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of a TPDU that carries no PDU."""
        self._message(COTP, frame, time_ns, side, octets)

    def ibh_packet(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """Add the line of an IBH-NetLink packet that carries no PDU."""
        self._message(NETLINK, frame, time_ns, side, octets)

    def scd_message(self, found: ScdMessage, connection: Connection) -> None:
        """Add the line of an SCD message."""
        message = Message(
            UPPER_NAMES[SCD], int(found.frame), int(found.time_ns), connection, int(found.side), found.octets, scd=found
        )
        self._add(MESSAGE, message)

    def _message(self, protocol: str, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool = False) -> None:
        header = self.header_of(side, octets) if protocol != COTP else None
        behind = header is not None and header.behind
        self._add(
            MESSAGE,
            Message(protocol, int(frame), int(time_ns), side.connection, int(side.index), octets, cut, behind=behind),
        )

    def _add(self, kind: str, thing: object) -> None:
        cells = []
        for field in self._fields:
            of_item = field.of_item
            if of_item is not None and kind in field.with_items:
                cells.append(printable(SEPARATOR.join(self._places(field, of_item, thing))))
                continue
            get = field.getters.get(kind)
            found = get(thing, self._context) if get is not None else None
            if found is None:
                cells.append("")
                continue
            values = found if type(found) is list or type(found) is tuple else [found]
            cells.append(printable(SEPARATOR.join([field.kind.shown(value) for value in values])))
        self.lines.append("\t".join(cells))

    def _places(self, field: Field, of_item: OfItem, thing: Any) -> list[str]:
        """Return a place for each item, empty if it has no value, so that the lists of all fields match."""
        places = []
        for item in items(thing, self._context):
            found = of_item(item, self._context)
            values = found if type(found) is list or type(found) is tuple else [] if found is None else [found]
            places.append(WITHIN.join([field.kind.shown(value) for value in values]))
        return places
