"""Which protocol does a TCP connection speak? The first octets say, on any port (docs/decisions/0005)."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.connections import Connections
from dissect.engine.foreign import on_102
from dissect.iso.foreign import identify
from dissect.iso.recognition import HERE, OTHER, PROBES, WITHIN, raw_protocol, recognise
from dissect.iso.upper import UPPER_NAMES
from dissect.tcp.stream import MASK
from dissect.transactions.connection import PROBING
from dissect.transactions.protocol import Protocol
from dissect.transactions.table import Side


class Recognition(Protocol):
    """What every connection begins with: looks at octets until one of ``streams``, ISO-on-TCP or nobody takes it.

    ``streams`` are asked in order; ISO-on-TCP is looked for last and over several segments, because a capture may begin in
    the middle of anything.
    """

    def __init__(self, connections: Connections, iso: Protocol, streams: list[Protocol]) -> None:
        super().__init__(PROBING)
        self._connections: Connections = connections
        self._iso: Protocol = iso
        self._streams: list[Protocol] = streams

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Look at octets of a connection not known yet, and give it and them to what speaks so."""
        octets = buf[at : at + size]
        known_start: bool = side.tcp.known_start
        at_start: bool = known_start and (side.end_seq - size) & MASK == side.stream.start_seq
        for stream in self._streams:
            if stream.probe(side, octets, at_start):
                self._connections.open(side, stream, at_start)
                side.protocol.feed(side, octets, 0, size, frame, time_ns)
                return
        connection = side.connection
        found: i64 = recognise(octets, at_start, on_102(side), connection.probed)
        if found == HERE or found == WITHIN:
            # Garbage before the first TPKT is reported only when it is certain that nothing was missed.
            self._connections.open(side, self._iso, found == HERE or at_start)
            side.protocol.feed(side, octets, 0, size, frame, time_ns)
            return
        connection.probed += 1
        if connection.protocol == "":
            raw: i64 = raw_protocol(octets)
            connection.protocol = UPPER_NAMES[raw]
            connection.identified_by = identify(raw, octets, 0, size)
        if found == OTHER:
            self._connections.foreign.take(side, connection.protocol, frame, time_ns)
        side.framer.skipped += size

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """A connection was never recognised: on port 102 that is worth saying, unless little of it was seen."""
        if side.tcp.known_start or side.connection.probed >= PROBES:
            self._connections.foreign.take(side, side.connection.protocol, frame, time_ns)
