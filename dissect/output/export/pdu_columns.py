"""Collects PDUs in columns, as `dissect.output.export.item_columns` does with items. Compiled."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import ScdMessage
from dissect.output.export.transaction_rows import MOST_KNOWN, Packets, Row, Shared, TransactionRows
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import FUNCTIONS as PLUS_FUNCTIONS
from dissect.protocols.s7plus.tables import KEEP_ALIVE, NOTIFICATION, SYSTEM_EVENT
from dissect.wire.text import encodable

#: Messages with a version and without an opcode.
_WITHOUT_OPCODE: Final = frozenset((SYSTEM_EVENT, KEEP_ALIVE))
#: Groups of columns that repeat: those of the connection and the sender, and those of the kind of message.
ROUTE: Final = ("connection", "client_host", "client_port", "server_host", "server_port", "from_client")
KIND: Final = (
    "protocol",
    "kind",
    "function",
    "function_name",
    "userdata_group",
    "subfunction",
    "error_code",
    "item_count",
    "cut",
)


class PduColumns:
    """The columns of PDUs: each has an entry for each PDU; ``…_at`` has an index into a list of shared rows instead.

    ``number`` is the number of PDUs, including those of earlier columns.
    """

    def __init__(self, rows: TransactionRows) -> None:
        self._rows: TransactionRows = rows
        self.number: int = 0
        self.packets: Packets = Packets(rows.files)
        self.routes: Shared = Shared([])
        self.kinds: Shared = Shared([])
        self._route_of: dict[int, int] = {}
        self._begin()

    def _begin(self) -> None:
        self.numbers: list[int] = []
        self.routes_at: list[int] = []
        self.kinds_at: list[int] = []
        self.times: list[int] = []
        self.references: list[int | None] = []
        self.sizes: list[int] = []
        self.malformed: list[list[str]] = []

    def clear(self) -> None:
        """Begin new columns; the old ones belong to the code that took them."""
        self._begin()
        self.packets.clear()
        self.kinds.bounded()
        if self.routes.bounded():
            self._route_of = {}

    def pdu(self, frame: int, time_ns: int, connection: Connection, side: int, octets: bytes, cut: bool) -> int:
        """Add an S7 PDU; return the new number of PDUs."""
        pdu = parse_pdu(octets, frame, time_ns, int(connection.number), side, cut)
        reference = int(pdu.pdu_ref) if pdu.pdu_ref >= 0 else None
        return self._add(frame, time_ns, connection, side, _s7(pdu, cut), reference, len(octets), _malformed(pdu))

    def plus_pdu(self, frame: int, time_ns: int, connection: Connection, side: int, octets: bytes, cut: bool) -> int:
        """Add an S7comm-plus PDU; return the new number of PDUs."""
        pdu = parse_plus(octets, frame, time_ns, int(connection.number), side, cut)
        reference = int(pdu.sequence) if pdu.sequence >= 0 and pdu.opcode != NOTIFICATION else None
        return self._add(frame, time_ns, connection, side, _plus(pdu, cut), reference, len(octets), _malformed(pdu))

    def scd(self, found: ScdMessage, connection: Connection) -> int:
        """Add an SCD message; return the new number of PDUs."""
        message = found.message
        reference = message.tid if "tid" in message.numbers else None
        service = f"SCD {message.service}" if message.service else None
        kind: Row = (UPPER_NAMES[SCD], message.phase or None, None, service, None, None, None, None, False)
        frame, side = int(found.frame), int(found.side)
        return self._add(frame, int(found.time_ns), connection, side, kind, reference, len(found.octets), [])

    def _add(
        self,
        frame: int,
        time_ns: int,
        connection: Connection,
        side: int,
        kind: Row,
        reference: int | None,
        size: int,
        malformed: list[str],
    ) -> int:
        self.number += 1
        self.numbers.append(self.number)
        self.packets.add(frame)
        self.times.append(time_ns)
        self.routes_at.append(self._route(connection, side))
        self.kinds_at.append(self.kinds.at(kind))
        self.references.append(reference)
        self.sizes.append(size)
        self.malformed.append(malformed)
        return len(self.numbers)

    def _route(self, connection: Connection, side: int) -> int:
        """Return the index of the row with connection, ends and sender; the client may become known only later."""
        key: int = (int(connection.number) * 2 + int(connection.client_side)) * 2 + side
        known = self._route_of
        found = known.get(key)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            ends = self._rows.ends(connection)
            sent = side == int(connection.client_side)
            found = known[key] = self.routes.at((int(connection.number), *ends, sent))
        return found


def _s7(pdu: Pdu, cut: bool) -> Row:
    """Return the columns `KIND` of an S7 PDU."""
    parameters = pdu.parameters
    head = parameters.userdata
    code = int(pdu.function)
    error: int | None = None
    if head is not None:
        error = int(head.error_code)
    elif pdu.error_class >= 0:
        error = int(pdu.error_class) << 8 | max(0, int(pdu.error_code))
    return (
        UPPER_NAMES[S7COMM],
        pdu.rosctr_name if pdu.rosctr >= 0 else None,
        code if code >= 0 else None,
        pdu.function_name or None,
        int(head.group) if head is not None else None,
        int(head.subfunction) if head is not None else None,
        error,
        int(parameters.item_count) if parameters.item_count >= 0 else None,
        cut,
    )


def _plus(pdu: PlusPdu, cut: bool) -> Row:
    """Return the columns `KIND` of an S7comm-plus PDU."""
    code = int(pdu.function)
    return (
        UPPER_NAMES[S7COMM_PLUS],
        pdu.kind if pdu.opcode >= 0 or pdu.version in _WITHOUT_OPCODE else None,
        code if code >= 0 else None,
        PLUS_FUNCTIONS.name(code) if code >= 0 else None,
        None,
        None,
        None,
        None,
        cut,
    )


def _malformed(pdu: Pdu | PlusPdu) -> list[str]:
    return [encodable(str(one)) for one in pdu.malformed]
