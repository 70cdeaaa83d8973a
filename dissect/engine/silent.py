"""Silent connections: open on port 102, but only keep-alive probes of them were captured.

A probe (RFC 1122, 4.2.3.6) has the sequence number just before the next one, with one octet or none; the other side repeats its
last acknowledgement. An empty probe looks like a normal acknowledgement, as long as the acknowledgements of the other side are
unknown: its sequence number is one below them. A single such segment may also belong to a FIN that was not captured. Two of
them with a pause in between are probes, if no number of the connection ever changes.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.engine.connections import on_102
from dissect.engine.counters import Counters
from dissect.engine.transactions.connection import ISO_TSAP_PORT, PROBING
from dissect.engine.transactions.probes import Probes
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import endpoints, reverse_key
from dissect.packets.tcp.stream import FIN, MASK, RST, SYN, Endpoint
from dissect.wire.octets import u16
from dissect.wire.text import count

#: A segment with one of these flags is not a keep-alive probe.
NO_PROBE: Final = SYN | FIN | RST
#: Maximum number of connections that are watched at once; beyond that the one with the oldest last packet is forgotten.
MAX_SILENT: Final = 4096
#: Probes of one side are at least one second apart, minus some tolerance; an earlier one was captured twice.
_PAUSE_NS: Final = 900_000_000


class _Way:
    """One direction of a silent connection: its acknowledgements and its probes."""

    __slots__ = ("ack", "probes", "seq")

    def __init__(self) -> None:
        self.seq: i64 = -1  # sequence number of its packets before the other direction was seen; -1 for none
        self.ack: i64 = -1
        self.probes: Probes = Probes()


class Silent:
    """A connection that has carried no octet so far; ``key`` is the key of its first packet."""

    __slots__ = ("_ways", "key", "moved")

    def __init__(self, key: bytes) -> None:
        self.key: bytes = key
        self._ways: list[_Way] = [_Way(), _Way()]
        self.moved: bool = False  # its numbers changed: something was sent that was not captured, or is not a probe

    def take(self, way: i64, seq: i64, ack: i64, frame: i64, now_ns: i64) -> None:
        """Take an empty segment, packet ``frame``; ``way`` is 0 for the direction of the first packet, otherwise 1."""
        mine, other = self._ways[way], self._ways[1 - way]
        if mine.ack < 0:
            mine.ack = ack
            if other.seq == ack:
                other.probes = Probes()  # the packets counted as probes are acknowledgements
            elif other.seq >= 0 and (other.seq + 1) & MASK != ack:
                self.moved = True
        elif mine.ack != ack:
            self.moved = True
        if other.ack < 0:
            self.moved = self.moved or (mine.seq >= 0 and mine.seq != seq)
            mine.seq = seq
        elif seq == other.ack:
            return
        elif (seq + 1) & MASK != other.ack:
            self.moved = True
        if mine.probes.count == 0 or now_ns - mine.probes.last_ns >= _PAUSE_NS:
            mine.probes.add(frame, now_ns, False)

    @property
    def likely(self) -> Probes:
        """The packets of both sides that look like probes."""
        first, second = self._ways
        found = Probes()
        if self.moved or first.ack < 0 or second.ack < 0:
            return found
        return found.join(first.probes).join(second.probes)

    @property
    def probes(self) -> Probes:
        """The probes of both sides; empty while it is not certain that they are probes."""
        first, second = self._ways
        return self.likely if max(first.probes.count, second.probes.count) > 1 else Probes()


class SilentConnections:
    """Watches at most `MAX_SILENT` connections to port 102 without octets, and reports those that only sent probes."""

    def __init__(self, counters: Counters) -> None:
        self._counters: Counters = counters
        self._known: OrderedDict[bytes, Silent] = OrderedDict()

    def take(self, key: bytes, seq: i64, ack: i64) -> None:
        """Take an empty segment with ``key`` of a connection that is not in the `ConnectionTable`."""
        ports: i64 = 8 if len(key) == 12 or len(key) == 20 else 32  # IPv4 or IPv6, each with a VLAN or without
        if u16(key, ports) != ISO_TSAP_PORT and u16(key, ports + 2) != ISO_TSAP_PORT:
            return
        known = self._known
        way: i64 = 0
        entry = known.get(key)
        if entry is None:
            entry = known.get(reverse_key(key))
            way = 1
        if entry is None:
            way = 0
            entry = Silent(key)
            known[key] = entry
        else:
            known.move_to_end(entry.key)
        if not entry.moved:
            entry.take(way, seq, ack, self._counters.frames, self._counters.now_ns)
        if len(known) > MAX_SILENT:
            _, longest = known.popitem(last=False)
            if longest.probes:
                self._report(longest)
            elif not longest.moved:
                self._counters.note_once("stream.evicted", "connections without data, first here")

    def begin(self, side: Side) -> None:
        """The connection of ``side`` carries octets now. They may belong to a probe, so ``side`` gets the probes so far."""
        entry = self._leave(side.key)
        if entry is not None:
            likely = entry.likely
            if likely:
                side.probes = likely.join(side.probes)

    def end(self, key: bytes) -> None:
        """The connection with ``key`` is over, or a new one takes its addresses."""
        entry = self._leave(key)
        if entry is not None and entry.probes:
            self._report(entry)

    def finish(self) -> None:
        """The capture ends: report the silent connections."""
        known = self._known
        self._known = OrderedDict()
        for entry in known.values():
            if entry.probes:
                self._report(entry)

    def _leave(self, key: bytes) -> Silent | None:
        known = self._known
        if not known:
            return None
        entry = known.pop(key, None)
        return entry if entry is not None else known.pop(reverse_key(key), None)

    def _report(self, entry: Silent) -> None:
        first, second = endpoints(entry.key)
        note_idle(self._counters, first, second, entry.probes)


def judge_silent(counters: Counters, side: Side, peer: Side) -> None:
    """Report a finished connection of which no octet was examined: it was idle, or was opened and never used."""
    if not side.probes and not peer.probes:
        counters.bare.take(side, peer)
    elif on_102(side):
        first, second = side.tcp.ends
        note_idle(counters, first, second, Probes().join(side.probes).join(peer.probes))


def note_idle(counters: Counters, first: Endpoint, second: Endpoint, probes: Probes) -> None:
    """Report a connection of which only keep-alive probes were captured; the first and last probe are its packets."""
    client, server = (first, second) if second.port == ISO_TSAP_PORT else (second, first)
    detail = f"{client} and {server}: {count(int(probes.count), 'probe')}"
    # The report's section Completeness counts packets whose bytes came before, but an empty probe has no byte.
    every = "all " if probes.count > 1 else ""
    filled = every if probes.filled == probes.count else f"{probes.filled} of them " if probes.filled else "none "
    said = f"{detail}, {filled}with a byte"
    counters.note_between("session.idle", client.host, server.host, probes.frames, probes.last_ns, said)


def untold(side: Side) -> bool:
    """Return whether ``side`` belongs to a connection to port 102 of which no octet was examined."""
    return side.connection._state == PROBING and side.connection._probed == 0 and on_102(side)


def may_be_probe(side: Side, octets: bytes) -> bool:
    """Return whether the first captured octets of ``side`` may be those of a keep-alive probe.

    The octet of a probe is arbitrary. On a connection with examined octets, only a zero octet counts as a probe.
    """
    return len(octets) == 1 and not side.tcp.known_start and (octets == b"\0" or untold(side))
