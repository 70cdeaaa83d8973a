"""The kinds of things that can be selected, and classes for some of them: findings, messages, packets.

`Context` holds the facts that fields need in addition to the thing itself.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from functools import cached_property
from typing import TYPE_CHECKING, Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.payloads import ScdMessage
from dissect.meaning.select.items import ItemFacts, ItemReader
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7.message import Pdu, parse_pdu
from dissect.protocols.s7plus.hiding import shown_half
from dissect.protocols.s7plus.items import join_items
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.tables import REQUEST

if TYPE_CHECKING:
    from dissect.engine.pipeline import Pipeline

# Kinds of things that can be selected; `dissect.meaning.select.fields` says which fields each has.
TRANSACTION: Final = "transaction"
OPERATION: Final = "operation"
FINDING: Final = "finding"
CONNECTION: Final = "connection"
MESSAGE: Final = "message"
PACKET: Final = "packet"
KINDS: Final = (TRANSACTION, OPERATION, FINDING, CONNECTION, MESSAGE, PACKET)

#: Maximum number of finished connections that are still remembered, for findings that come later.
_REMEMBERED: Final = 4096


class Context:
    """The facts that fields need in addition to a thing: the start of the capture, numbers of packets, connections by number.

    ``start`` returns the time of the first packet, nanoseconds since 1970. ``number`` returns the number of a packet within its
    file. ``local``: times in an expression without a zone are in the zone of this machine, not in UTC.
    """

    def __init__(self, local: bool = False) -> None:
        self.local = local
        self.start: Callable[[], int] = lambda: 0
        self.number: Callable[[int], int] = int
        self.reader = ItemReader()
        self._connections: dict[int, Connection] = {}
        self._over: OrderedDict[int, Connection] = OrderedDict()

    def begin(self, pipeline: Pipeline, number: Callable[[int], int] | None = None) -> None:
        """Take the pipeline of a run that begins; ``number`` is for several files, whose packets are numbered in each."""
        self.start = lambda: int(pipeline.first_ns)
        if number is not None:
            self.number = number

    def opened(self, connection: Connection) -> None:
        """Remember a connection by its number."""
        self._connections[int(connection.number)] = connection

    def closed(self, connection: Connection) -> None:
        """Remember a finished connection, until `_REMEMBERED` others are finished."""
        number = int(connection.number)
        self._connections.pop(number, None)
        self._over[number] = connection
        if len(self._over) > _REMEMBERED:
            self._over.popitem(last=False)

    def connection(self, number: int) -> Connection | None:
        """Return the connection with this number; None for 0, which means the capture as a whole."""
        return self._connections.get(number) or self._over.get(number)


class Found:
    """A finding, and the connection that it concerns; None for the capture as a whole."""

    __slots__ = ("connection", "finding")

    def __init__(self, finding: Finding, connection: Connection | None) -> None:
        self.finding = finding
        self.connection = connection


class Message:
    """A message of `show`: ``octets`` of a PDU of ``protocol``, or of a TPDU or packet that carries no PDU.

    ``scd`` is the message if it is one of SCD, ``behind`` tells whether it is behind a malformed header. A PDU is decoded only
    when a field needs it.
    """

    def __init__(
        self,
        protocol: str,
        frame: int,
        time_ns: int,
        connection: Connection,
        side: int,
        octets: bytes = b"",
        cut: bool = False,
        scd: ScdMessage | None = None,
        behind: bool = False,
    ) -> None:
        self.protocol = protocol
        self.frame = frame
        self.time_ns = time_ns
        self.connection = connection
        self.side = side
        self.octets = octets
        self.cut = cut
        self.scd = scd
        self.is_behind = behind

    @property
    def ends(self) -> tuple[Endpoint, Endpoint]:
        """Sender and receiver."""
        ends = self.connection.tcp.ends
        return ends[self.side], ends[1 - self.side]

    @cached_property
    def pdu(self) -> Pdu | None:
        """The S7 PDU, None for other protocols."""
        if self.protocol != "s7comm":
            return None
        return parse_pdu(self.octets, self.frame, self.time_ns, int(self.connection.number), self.side, self.cut)

    @cached_property
    def plus(self) -> PlusPdu | None:
        """The S7comm-plus PDU, None for other protocols."""
        if self.protocol != "s7comm_plus":
            return None
        return parse_plus(self.octets, self.frame, self.time_ns, int(self.connection.number), self.side, self.cut)

    def items(self, reader: ItemReader) -> list[ItemFacts]:
        """Return the items of a request or of an S7comm-plus notification, or the values of an SCD message."""
        if self.scd is not None:
            from dissect.meaning.select.items import scd_facts

            return [scd_facts(row) for row in self.scd.values]
        plus = self.plus
        if plus is not None:
            from dissect.meaning.select.items import plus_facts

            half = shown_half(plus)
            asked, told = (half, None) if plus.opcode == REQUEST else (None, half)
            return [plus_facts(item) for item in join_items(asked, told, self.connection.plus)]
        pdu = self.pdu
        return reader.requested(pdu.parameters.items, self.connection.naming) if pdu is not None else []


class Packet:
    """A packet of a capture: its number and time, sender and receiver if known, and its connection.

    ``connection`` may be any object with the attributes that the fields of a packet need.
    """

    __slots__ = ("connection", "ends", "frame", "time_ns")

    def __init__(
        self, frame: int, time_ns: int, ends: tuple[Endpoint, Endpoint] | None, connection: object | None
    ) -> None:
        self.frame = frame
        self.time_ns = time_ns
        self.ends = ends
        self.connection = connection
