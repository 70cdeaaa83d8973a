"""Conversations over UDP: datagrams on the ports that a payload decoder has bound.

They have neither beginning nor end, and nothing is reordered: each datagram is a message. So a conversation is open from its
first datagram until the capture ends, or until too many are open at once.
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.connections import Connections
from dissect.engine.counters import Counters
from dissect.engine.exchange import PayloadDecoder
from dissect.engine.transactions import accounts
from dissect.engine.transactions.connection import LEFT_OUT
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import ConnectionTable, endpoints
from dissect.engine.transactions.transaction import CAPTURE_ENDED, CONNECTION_EVICTED
from dissect.packets.tcp.segment import Segment


class Datagrams:
    """Passes datagrams to the decoder of the conversation, and informs it when a flow begins and ends."""

    def __init__(
        self, counters: Counters, connections: Connections, decoder: PayloadDecoder, protocol: Protocol
    ) -> None:
        self._counters: Counters = counters
        self._connections: Connections = connections
        self._decoder: PayloadDecoder = decoder
        self._protocol: Protocol = protocol
        self.flows: ConnectionTable = ConnectionTable()

    def take(self, found: Segment) -> i64:
        """Take a datagram; return the category of its packet."""
        side = self.flows.sides.get(found.key)
        if side is None:
            side = self._open_flow(found.key, found.vlan)
            if side is None:
                return accounts.NOT_TCP
        if side.stream.next_seq < 0:
            side.begin(0)  # there are no sequence numbers, but this side was captured
        counters = self._counters
        side.tcp.packets += 1
        side.tcp.last_frame = counters.frames
        side.tcp.last_ns = counters.now_ns
        if side.connection._state == LEFT_OUT:
            return accounts.LEFT_OUT
        self._decoder.datagram(side, found.octets, found.missing, counters.frames, counters.now_ns)
        return accounts.PAYLOAD

    def _open_flow(self, key: bytes, vlan: i64) -> Side | None:
        decoder = self._decoder
        sender, receiver = endpoints(key)
        if sender.port not in decoder.udp_ports and receiver.port not in decoder.udp_ports:
            return None
        for idle in self.flows.overflow():
            idle.tcp.ended = "evicted"
            self._counters.note("stream.evicted", "", idle.connection.number)
            self._finish_flow(idle, CONNECTION_EVICTED)
        side = self.flows.open(key, vlan, self._counters.frames, self._counters.now_ns)
        side.connection.udp = True
        if not decoder.claims_port("udp", side.connection):
            self.flows.remove(side)
            return None
        self._connections.open(side, self._protocol, True)
        return side

    def restart(self) -> None:
        """Another capture begins; the decoder also forgets what it knows of devices."""
        self._decoder.restart()

    def finish(self) -> None:
        """The capture ends, and with it all conversations."""
        for side in self.flows.all_open():
            self._finish_flow(side, CAPTURE_ENDED)

    def _finish_flow(self, side: Side, reason: str) -> None:
        self._connections.end(side, reason, self._counters.frames, self._counters.now_ns)
        self.flows.remove(side)
