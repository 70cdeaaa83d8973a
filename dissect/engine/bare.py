"""TCP connections that were opened and closed without an octet, as port scanners and connection tests make them.

They speak no protocol, so that nothing else reports them. Only at the end is it known which of their ports matter: port 102,
and ports on which another connection of this capture spoke ISO-on-TCP or another protocol that is followed.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.tcp.stream import MASK
from dissect.transactions.connection import ISO_TSAP_PORT
from dissect.transactions.side import Side

#: How many ports they are counted on, besides 102.
MAX_PORTS: Final = 1024


class BareConnections:
    """Counts connections without octets by server port: ``counts``; ``first`` has the first packet of each port.

    ``spoken`` counts the connections that were followed on other ports than 102. All three have at most `MAX_PORTS` ports
    beside 102.
    """

    def __init__(self) -> None:
        self.counts: dict[int, int] = {}
        self.first: dict[int, int] = {}
        self.spoken: dict[int, int] = {}

    def speaks(self, port: i64) -> None:
        """A connection to ``port`` is followed."""
        if port != ISO_TSAP_PORT:
            _count(self.spoken, port)

    def take(self, side: Side, peer: Side) -> None:
        """Count a connection that is over, if both SYNs were captured and its sequence numbers show that no octet was sent."""
        tcp = side.tcp
        if tcp.initiator < 0 or not tcp.closed or not _is_bare(side, peer) or not _is_bare(peer, side):
            return
        port: i64 = tcp.ends[1 - tcp.initiator].port
        if _count(self.counts, port) == 1:
            self.first[port] = tcp.first_frame

    def found(self) -> tuple[int, int]:
        """Return how many such connections went to ports that matter, and the first packet of the first one (0 for none)."""
        ports = [port for port in self.counts if port == ISO_TSAP_PORT or port in self.spoken]
        return sum([self.counts[port] for port in ports]), min([self.first[port] for port in ports], default=0)

    def add_first(self, later: dict[int, int], packets: int) -> None:
        """Add the first packets of another file, before which ``packets`` packets came."""
        for port, frame in later.items():
            self.first.setdefault(port, frame + packets)


def _is_bare(side: Side, peer: Side) -> bool:
    """Return whether ``side`` sent its SYN and no octet: the peer acknowledged only the SYN, and perhaps a FIN."""
    start: i64 = side.stream.start_seq
    return start >= 0 and side.stream.octets == 0 and (peer.last_ack < 0 or (peer.last_ack - start) & MASK <= 1)


def _count(counts: dict[int, int], port: i64) -> int:
    """Count once more and return the new count; 0 if there is no room for another port."""
    known = counts.get(port, 0)
    if not known and len(counts) > MAX_PORTS and port != ISO_TSAP_PORT:
        return 0
    counts[port] = known + 1
    return known + 1
