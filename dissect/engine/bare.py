"""TCP connections that were opened and closed without any data, as port scanners and connection tests make them.

They speak no protocol, so nothing else reports them. Only at the end is it known which of their ports matter: port 102, and the
ports on which other connections of the capture spoke a supported protocol.

A connection to port 102 that was open before the capture began may show only its FINs; these are counted separately, by the
side that closed first, because nothing else is known of them.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import ISO_TSAP_PORT
from dissect.engine.transactions.side import Side
from dissect.packets.tcp.stream import FIN, MASK
from dissect.wire.octets import u16

#: Maximum number of ports, besides 102, with a counter.
MAX_PORTS: Final = 1024
#: The side that closed a connection of which only FINs were captured: the keys of `BareConnections.ends`.
BY_SERVER: Final = 0
BY_CLIENT: Final = 1
#: The key in `BareConnections.first` of the first of these.
_ENDS: Final = -1
#: Maximum number of such connections that are told apart; each one has a FIN from either side.
MAX_ENDS: Final = 4096
#: Octets of the key of a connection: both addresses, then both ports.
_IPV4: Final = 4
_IPV6: Final = 16
_PORTS: Final = 4


class BareConnections:
    """Counts connections without data by server port in ``counts``; ``first`` has the first packet of each port.

    ``spoken`` counts the connections of supported protocols on ports other than 102. Each of the three has at most `MAX_PORTS`
    ports besides 102. ``ends`` counts connections to port 102 of which only FINs were captured, by the side that closed first.
    """

    def __init__(self) -> None:
        self.counts: dict[int, int] = {}
        self.first: dict[int, int] = {}
        self.spoken: dict[int, int] = {}
        self.ends: dict[int, int] = {}
        self._ended: set[bytes] = set()

    def speaks(self, port: i64) -> None:
        """A connection to ``port`` is followed."""
        if port != ISO_TSAP_PORT:
            _count(self.spoken, port)

    def take(self, side: Side, peer: Side) -> None:
        """Count a finished connection if both SYNs were captured and its sequence numbers show that no data were sent."""
        tcp = side.tcp
        if tcp.initiator < 0 or not tcp.closed or not _is_bare(side, peer) or not _is_bare(peer, side):
            return
        port: i64 = tcp.ends[1 - tcp.initiator].port
        if _count(self.counts, port) == 1:
            self.first[port] = tcp.first_frame

    def take_end(self, key: bytes, flags: i64, frame: i64) -> None:
        """Take a FIN or RST of a connection without earlier packets; ``key`` has the addresses and ports of its packet.

        A RST may also answer a packet to a closed port, so only a FIN proves that there was a connection.
        """
        if not flags & FIN:
            return
        size: i64 = _IPV6 if len(key) >= 2 * _IPV6 + _PORTS else _IPV4
        source, target = u16(key, 2 * size), u16(key, 2 * size + 2)
        if (source != ISO_TSAP_PORT and target != ISO_TSAP_PORT) or key in self._ended or len(self._ended) >= MAX_ENDS:
            return
        ports = key[2 * size + 2 : 2 * size + _PORTS] + key[2 * size : 2 * size + 2]
        answer = key[size : 2 * size] + key[:size] + ports + key[2 * size + _PORTS :]  # the VLAN follows them
        if answer in self._ended:
            return
        self._ended.add(key)
        who = BY_SERVER if source == ISO_TSAP_PORT else BY_CLIENT
        self.ends[who] = self.ends.get(who, 0) + 1
        self.first.setdefault(_ENDS, int(frame))

    def first_end(self) -> int:
        """Return the packet that closed the first connection of which only FINs were captured, 0 for none."""
        return self.first.get(_ENDS, 0)

    def found(self) -> tuple[int, int]:
        """Return how many such connections went to ports that matter, and the first packet of the first one (0 for none)."""
        ports = [port for port in self.counts if port == ISO_TSAP_PORT or port in self.spoken]
        return sum([self.counts[port] for port in ports]), min([self.first[port] for port in ports], default=0)

    def add_first(self, later: dict[int, int], packets: int) -> None:
        """Add the first packets of a further file, after ``packets`` earlier packets."""
        for port, frame in later.items():
            self.first.setdefault(port, frame + packets)


def _is_bare(side: Side, peer: Side) -> bool:
    """Return whether ``side`` sent its SYN and no octet: the peer acknowledged only the SYN, and perhaps a FIN."""
    start: i64 = side.stream.start_seq
    return start >= 0 and side.stream.octets == 0 and (peer.last_ack < 0 or (peer.last_ack - start) & MASK <= 1)


def _count(counts: dict[int, int], port: i64) -> int:
    """Increase a count and return it; return 0 if there is no room for another port."""
    known = counts.get(port, 0)
    if not known and len(counts) > MAX_PORTS and port != ISO_TSAP_PORT:
        return 0
    counts[port] = known + 1
    return known + 1
