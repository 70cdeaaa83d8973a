"""The beginning and the end of connections, whatever they speak: numbers, what is closed with them, who is told."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.exchange import Exchange
from dissect.engine.foreign import Foreign
from dissect.findings.scan_rules import ScanWatch
from dissect.findings.session_rules import judge_cut, judge_end
from dissect.transactions.connection import Connection
from dissect.transactions.ending import Ending
from dissect.transactions.protocol import Protocol
from dissect.transactions.table import Side
from dissect.transactions.transaction import CONNECTION_CLOSED


class Connections:
    """Gives connections to protocols and takes them back. ``count`` is the number of those that were opened so far."""

    def __init__(self, exchange: Exchange) -> None:
        self._exchange: Exchange = exchange
        self.count: i64 = 0
        self.foreign: Foreign = Foreign(exchange)
        self.scans: ScanWatch = ScanWatch(exchange.reporter)

    def open(self, side: Side, protocol: Protocol, at_start: bool) -> None:
        """The protocol of a connection is known; ``at_start``: what comes next of ``side`` begins a message."""
        connection = side.connection
        side.speak(protocol)
        self.count += 1
        connection.number = self.count
        if self._exchange.naming is not None:
            connection.naming = self._exchange.naming.of(connection)
        protocol.begin(side, at_start)
        self._exchange.observer.connection_opened(connection)

    def replace(self, side: Side, frame: i64, now_ns: i64) -> None:
        """Another transport connection begins on the same TCP connection: what was between them was not captured."""
        peer = side.peer
        assert peer is not None
        old = side.connection
        old.closed_reason = "replaced"
        self.end(side, CONNECTION_CLOSED, frame, now_ns)
        self.count += 1
        connection = Connection(self.count, side.tcp)
        connection.state = old.state
        connection.told = old.told  # of the octets that are still on their way
        connection.naming = old.naming
        for end in (side, peer):
            end.connection = connection
            end.requests = 0
        self._exchange.observer.connection_opened(connection)

    def end(self, side: Side, reason: str, frame: i64, now_ns: i64) -> None:
        """A connection is over (``reason`` is why its open requests stay unanswered): close what is open on both sides."""
        exchange = self._exchange
        peer = side.peer
        assert peer is not None
        for end in (side, peer):
            end.protocol.finish(end, frame, now_ns)
        first, second = (side, peer) if side.index == 0 else (peer, side)
        ending = Ending(side.connection, [second.hole_frame, first.hole_frame], frame, now_ns)
        side.connection.ending = ending
        judge_end(exchange.reporter, side, frame, now_ns)
        judge_cut(exchange.reporter, side, ending)
        if ending.connecting:
            self.scans.refused(side.connection, ending.time_ns)
        for end in (side, peer):
            end.protocol.end(end, frame, now_ns)
            exchange.dialogue.end(end, reason)
        if exchange.dialogue.also:
            exchange.beside(frame, now_ns)
        if exchange.decoder is not None:
            exchange.decoder.end(side, frame, now_ns)
        self.foreign.forget(side.connection)
        exchange.watch.end(side.connection, reason)
        exchange.observer.connection_closed(side.connection)
