"""Conversations over UDP: datagrams of the ports that a carrier has bound (`dissect.engine.payload`).

They have no beginning and no end, and nothing is put in order: a datagram is a message as it comes. So a conversation is open
from its first datagram until the capture ends, or until too many are open at once.
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.counters import Books
from dissect.engine.ibh import Gateway
from dissect.engine.observer import Observer
from dissect.tcp.segment import Segment
from dissect.transactions import accounts
from dissect.transactions.table import ConnectionTable, Side, endpoints
from dissect.transactions.transaction import CAPTURE_ENDED, CONNECTION_EVICTED


class Datagrams(Books):
    """Datagrams in, handed to the carrier of the conversation, which is told when a flow begins and ends."""

    def __init__(self, observer: Observer, conversation: Gateway) -> None:
        super().__init__(observer, conversation.judge)
        self.conversation: Gateway = conversation
        self.flows: ConnectionTable = ConnectionTable()
        self.wants_udp = conversation.carrier is not None

    def datagram(self, found: Segment) -> i64:
        """Take a datagram; return the category of its packet."""
        side = self.flows.sides.get(found.key)
        if side is None:
            side = self._open_flow(found.key, found.vlan)
            if side is None:
                return accounts.NOT_TCP
        if side.stream.next_seq < 0:
            side.stream.start(0)  # there is no sequence, but this side was captured
        side.tcp.packets += 1
        side.tcp.last_frame = self.frames
        side.tcp.last_ns = self.now_ns
        carrier = self.conversation.carrier
        assert carrier is not None
        carrier.datagram(side, found.octets, found.missing, self.frames, self.now_ns)
        return accounts.PAYLOAD

    def _open_flow(self, key: bytes, vlan: i64) -> Side | None:
        carrier = self.conversation.carrier
        if carrier is None:
            return None
        sender, receiver = endpoints(key)
        if sender.port not in carrier.udp_ports and receiver.port not in carrier.udp_ports:
            return None
        for idle in self.flows.overflow():
            idle.tcp.ended = "evicted"
            self._note("stream.evicted", "", idle.connection.number)
            self._finish_flow(idle, CONNECTION_EVICTED)
        side = self.flows.open(key, vlan, self.frames, self.now_ns)
        side.connection.udp = True
        if not self.conversation.follow(side, "udp", True):
            self.flows.remove(side)
            return None
        return side

    def restart_clock(self, time_ns: i64) -> None:
        """Another capture begins; the carrier forgets what it knows of devices, too."""
        super().restart_clock(time_ns)
        if self.conversation.carrier is not None:
            self.conversation.carrier.restart()

    def finish_flows(self) -> None:
        """The capture ends: so do all conversations."""
        for side in self.flows.all_open():
            self._finish_flow(side, CAPTURE_ENDED)

    def _finish_flow(self, side: Side, reason: str) -> None:
        self.conversation.end(side, reason, self.frames, self.now_ns)
        self.flows.remove(side)
