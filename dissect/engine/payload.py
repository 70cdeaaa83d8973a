"""Passes octets of TCP connections and UDP conversations on bound ports to the payload decoder (SCD, docs/scd-traffic.md)."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.exchange import Exchange, PayloadDecoder
from dissect.engine.transactions.connection import FOLLOWED
from dissect.engine.transactions.payloads import Backlog
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side


class PayloadStream(Protocol):
    """Passes octets in order to the decoder, which does its own framing and pairing."""

    def __init__(self, exchange: Exchange, decoder: PayloadDecoder) -> None:
        super().__init__(FOLLOWED)
        self._exchange: Exchange = exchange
        self._decoder: PayloadDecoder = decoder

    def probe(self, side: Side, octets: bytes, at_start: bool) -> bool:
        """Return whether the decoder claims the port of a TCP connection."""
        return self._decoder.claims_port("tcp", side.connection)

    def begin(self, side: Side, at_start: bool) -> None:
        """A connection, or a conversation over UDP, belongs to the decoder."""
        peer = side.peer
        assert peer is not None
        side.kept = Backlog()
        peer.kept = Backlog()
        side.framer.synced = at_start
        peer.framer.synced = side.tcp.known_start and peer.stream.octets == 0

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a TCP connection."""
        try:
            self._decoder.stream(side, buf[at : at + size], frame, time_ns)
        except Exception as bug:
            self._exchange.note_bug(bug, frame, time_ns)

    def gap(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """Take note of ``size`` octets missing here; ``cut``: the capture cut them off a packet."""
        if not cut:
            detail = f"{size} bytes from {side.tcp.ends[side.index]}"
            self._exchange.reporter.note("stream.hole", side.connection.number, [frame], time_ns, detail)
        self._decoder.hole(side, size, frame, time_ns)

    def describe(self) -> dict[str, object]:
        """Return the section ``scd``."""
        return {"scd": self._decoder.as_dict()}

    def counted(self) -> list[tuple[int, str]]:
        """Return the number of messages, even if it is zero."""
        return [(self._decoder.message_count(), "SCD message")]
