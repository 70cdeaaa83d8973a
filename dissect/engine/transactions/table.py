"""`ConnectionTable`: finds the side of a connection by the addresses and ports of a packet that it sent.

Each packet costs at most one dictionary lookup, and all sizes are limited. Connection attempts without a response wait in a
separate small table, so that a port scan cannot displace connections with traffic. When too many connections are open, those
that were idle longest are evicted. `IdleSearch` finds them in advance, a few with each connection that opens, because a live
capture must not stall during a search through thousands of connections.
"""

from __future__ import annotations

from collections import OrderedDict, deque
from typing import Final

from librt.strings import read_i32_be, read_i64_be
from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import MASK, Endpoint
from dissect.wire.octets import u16

#: Number of connections that `IdleSearch.step` examines.
LOOK_AT_ONCE: Final = 64
#: Number of longest-idle connections that a round finds; the next round begins when fewer than `_FEW_LEFT` are left.
MAX_FOUND: Final = 512
_FEW_LEFT: Final = 160
#: Maximum number of candidates that are examined to find one that is still idle.
_TRIED: Final = 16


class _Idle:
    """How idle a connection was when it was examined."""

    __slots__ = ("first_frame", "last_ns", "side")

    def __init__(self, side: Side) -> None:
        self.side: Side = side
        self.last_ns: i64 = side.tcp.last_ns
        self.first_frame: i64 = side.tcp.first_frame

    def look(self, side: Side) -> None:
        """Replace the connection by another one."""
        self.side = side
        self.last_ns = side.tcp.last_ns
        self.first_frame = side.tcp.first_frame

    def less(self, other: _Idle) -> bool:
        """Return whether it is less idle than ``other``; if both have the same time, the one that began later is less idle."""
        if self.last_ns == other.last_ns:
            return self.first_frame > other.first_frame
        return self.last_ns > other.last_ns


def _sink(heap: list[_Idle], at: i64, size: i64) -> None:
    """Move the entry at ``at`` down to its place among the first ``size`` entries of a heap whose root is the least idle one.

    Written by hand, because `heapq` would compare tuples of int objects, which took longer than everything else when a
    connection opens.
    """
    entry = heap[at]
    below: i64 = 2 * at + 1
    while below < size:
        if below + 1 < size and heap[below + 1].less(heap[below]):
            below += 1
        child = heap[below]
        if not child.less(entry):
            break
        heap[at] = child
        at = below
        below = 2 * at + 1
    heap[at] = entry


class IdleSearch:
    """Examines the open connections in rounds, `LOOK_AT_ONCE` with each `step`, and keeps the longest-idle ones of a round.

    `take` returns one of those that is still idle. ``looks`` counts the examined connections.
    """

    def __init__(self) -> None:
        self.looks: i64 = 0
        self._sides: list[Side] = []  # the sides that the current round examines; empty between rounds
        self._at: i64 = 0
        self._longest: list[_Idle] = []  # the longest idle so far; a heap with the least idle first once it is full
        self._found: list[_Idle] = []  # the result of the last complete round, the longest idle last

    @property
    def running_out(self) -> bool:
        """True when the next round has to begin."""
        return not self._sides and len(self._found) < _FEW_LEFT

    def begin(self, sides: list[Side]) -> None:
        """Begin a round through ``sides``, both of each open connection."""
        self._sides = sides
        self._at = 0
        self._longest = []

    def step(self) -> None:
        """Examine the next connections of the current round, if there is one."""
        sides = self._sides
        count: i64 = len(sides)
        if count == 0:
            return
        longest = self._longest
        at: i64 = self._at
        looked: i64 = 0
        while at < count and looked < LOOK_AT_ONCE:
            side = sides[at]
            at += 1
            if side.index:
                continue  # side 0 represents the connection
            looked += 1
            if side.peer is None:
                continue  # the connection is over
            if len(longest) < MAX_FOUND:
                longest.append(_Idle(side))
                if len(longest) == MAX_FOUND:
                    self._order()
                continue
            least = longest[0]
            tcp = side.tcp
            if tcp.last_ns > least.last_ns or (tcp.last_ns == least.last_ns and tcp.first_frame > least.first_frame):
                continue  # less idle than all in the heap, as most are
            least.look(side)
            _sink(longest, 0, MAX_FOUND)
        self._at = at
        self.looks += looked
        if at == count:
            self._end_round()

    def _order(self) -> None:
        """Make `_longest` a heap."""
        size: i64 = len(self._longest)
        for place in range(size // 2 - 1, -1, -1):
            _sink(self._longest, place, size)

    def _end_round(self) -> None:
        """All connections were examined: sort the longest idle ones."""
        if len(self._longest) < MAX_FOUND:
            self._order()
        heap = self._longest
        found: list[_Idle] = []
        size: i64 = len(heap)
        while size > 0:
            found.append(heap[0])
            size -= 1
            heap[0] = heap[size]
            _sink(heap, 0, size)
        self._found = found
        self._longest = []
        self._sides = []

    def finish(self) -> None:
        """Look through the rest of the current round."""
        while self._sides:
            self.step()

    def take(self) -> Side | None:
        """Return the longest-idle connection that was found, None if there is none.

        Connections that had packets after the search examined them are skipped. When `_TRIED` in a row have, the longest idle
        of these is returned.
        """
        best: Side | None = None
        tried: i64 = 0
        while self._found and tried < _TRIED:
            entry = self._found.pop()
            side = entry.side
            if side.peer is None:
                continue
            if side.tcp.last_ns == entry.last_ns:
                return side
            tried += 1
            if best is None or side.tcp.last_ns < best.tcp.last_ns:
                best = side
        return best


MAX_CONNECTIONS: Final = 8192
#: The search for idle connections begins this many below `MAX_CONNECTIONS`, and is completed at once this many above it.
RESERVE: Final = 512
#: Maximum number of connections that are evicted when one opens.
LEAVE_AT_ONCE: Final = 2
MAX_HALF_OPEN: Final = 4096
#: Maximum number of keys of forgotten connections that are remembered, two for each connection.
MAX_FORGOTTEN: Final = 32_768
#: A client repeats a SYN after at least one second (RFC 6298), minus some tolerance. At the second repetition the attempt
#: counts as unanswered.
_REPEATED_NS: Final = 900_000_000
_GIVEN_UP: Final = 2
#: A closed connection is kept this long, because captures show packets out of order.
LINGER_NS: Final = 1_000_000_000
MAX_LINGERING: Final = 2048
#: A closed connection whose end is in doubt (`dissect.packets.tcp.doubt`) is kept this long, because its sides may poll slowly.
DOUBT_NS: Final = 10_000_000_000

#: Maximum number of VLANs of a capture that are remembered, and of further keys of a connection in other VLANs.
MAX_TAGS: Final = 64
MAX_ALSO: Final = 4

_PORTS: Final = 4
_VLAN: Final = 8
#: The size of an IPv4 key without VLAN. From this VLAN key on, `Side.ports` cannot tell keys apart: there are more than two
#: tags.
_MANY_TAGS: Final = 1 << 24
#: A bit that tells the ports of a side with IPv6 addresses from those with IPv4, for which it equals the sign.
_SIX: Final = 1 << 62
_KEY4: Final = 8 + _PORTS
_KEY6: Final = 32 + _PORTS
#: The first size of the list with which `find` avoids the dictionary; it grows fourfold whenever more sides are open.
_PLACES: Final = 4096


class Attempt:
    """A SYN without an answer so far: its first and latest packet, and ``repeats``, the number of repetitions."""

    __slots__ = ("frame", "last_frame", "last_ns", "link", "repeats", "seq", "time_ns", "told")

    def __init__(self, seq: i64, frame: i64, time_ns: i64, link: bytes) -> None:
        self.link: bytes = link
        self.seq: i64 = seq
        self.frame: i64 = frame
        self.time_ns: i64 = time_ns
        self.last_frame: i64 = frame
        self.last_ns: i64 = time_ns
        self.repeats: i64 = 0
        self.told: bool = False

    def again(self, frame: i64, time_ns: i64) -> None:
        """The SYN came again; if it came at once, it was captured twice and is not counted."""
        if time_ns - self.last_ns >= _REPEATED_NS:
            self.repeats += 1
            self.last_frame = frame
            self.last_ns = time_ns

    def give_up(self, repeats: i64) -> bool:
        """Return True if the SYN was repeated at least ``repeats`` times, but only once."""
        if self.told or self.repeats < repeats:
            return False
        self.told = True
        return True


def reverse_key(key: bytes) -> bytes:
    """Return the key of the other direction: addresses and ports swapped, the same VLAN."""
    size = 4 if len(key) in (8 + _PORTS, 8 + _PORTS + _VLAN) else 16
    ports = 2 * size
    return b"%b%b%b%b%b" % (
        key[size:ports],
        key[:size],
        key[ports + 2 : ports + 4],
        key[ports : ports + 2],
        key[ports + 4 :],
    )


def base_and_tag(key: bytes) -> tuple[bytes, bytes]:
    """Return the addresses and ports of a key, and its VLAN, which is empty for an untagged packet."""
    size: i64 = len(key)
    if size == _KEY4 + _VLAN or size == 32 + _PORTS + _VLAN:
        return key[: size - _VLAN], key[size - _VLAN :]
    return key, b""


def keys_of(tcp: TcpConnection) -> list[bytes]:
    """Return the keys of the packets that side 0 of a connection sends: first for its own VLAN, then for other VLANs."""
    first, second = tcp.ends
    base = first.address + second.address + first.port.to_bytes(2, "big") + second.port.to_bytes(2, "big")
    return [base + (int(vlan).to_bytes(_VLAN, "big") if vlan else b"") for vlan in (tcp.vlan, *tcp.also)]


def endpoints(key: bytes) -> tuple[Endpoint, Endpoint]:
    """Return (sender, receiver) of the packets that carry ``key``."""
    size = 4 if len(key) in (8 + _PORTS, 8 + _PORTS + _VLAN) else 16
    ports = 2 * size
    return Endpoint(key[:size], u16(key, ports)), Endpoint(key[size:ports], u16(key, ports + 2))


class ConnectionTable:
    """Open connections by the keys of both directions, and by further keys of packets in other VLANs (`add`).

    A key is the addresses and ports of a packet in packet order, followed by the VLAN if it has one. A new connection begins
    with the protocol ``first``. ``evicted`` and ``half_open_evicted`` count connections and attempts dropped because there were
    too many.
    """

    def __init__(self, first: Protocol | None = None) -> None:
        self._first: Protocol = first if first is not None else Protocol()
        self.sides: dict[bytes, Side] = {}
        self.tags: dict[bytes, None] = {}  # the VLANs of keys, empty before the first VLAN
        self._more: i64 = 0  # number of keys in `sides` that are further ones, in other VLANs
        # Ordered, because finding the oldest entry of a plain dict is slow after many deletions before it.
        self._half_open: OrderedDict[bytes, Attempt] = OrderedDict()
        self._lingering: deque[Side] = deque()
        self._doubted: deque[Side] = deque()  # also closed connections, but with a doubtful end
        self._places: list[Side | None] = [None] * _PLACES
        self._mask: i64 = _PLACES - 1
        self._vlan: i64 = 0  # the last argument of `tag_of`, and its result
        self._tag: bytes = b""
        self._idle: IdleSearch = IdleSearch()
        self.evicted: i64 = 0
        self.half_open_evicted: i64 = 0
        self._forgot: set[bytes] = set()  # keys of evicted idle connections that may continue

    def forget(self, side: Side) -> None:
        """Remember a dropped connection that may continue."""
        if len(self._forgot) < MAX_FORGOTTEN:
            self._forgot.add(side.key)
            if side.peer is not None:
                self._forgot.add(side.peer.key)

    def may_be_forgotten(self, side: Side) -> bool:
        """Return whether a connection may be the rest of a forgotten one."""
        if len(self._forgot) >= MAX_FORGOTTEN:
            return True  # not all are remembered
        return len(self._forgot) > 0 and side.key in self._forgot

    def anew(self) -> ConnectionTable:
        """Return an empty table that continues the counts of this one."""
        table = ConnectionTable(self._first)
        table.evicted = self.evicted
        table.half_open_evicted = self.half_open_evicted
        return table

    def find(self, buf: bytes, at: i64, vlan: i64) -> Side | None:
        """Return the side in `sides` for the IPv4 addresses and ports at ``at`` and a VLAN key.

        The latest side for a key with the same hash is tried first, because this needs no bytes object.
        """
        addresses: i64 = read_i64_be(buf, at)
        ports: i64 = i64(read_i32_be(buf, at + 8)) ^ (vlan << 32)
        mixed: i64 = (addresses ^ (addresses >> 29)) + (ports ^ (ports >> 16))
        place: i64 = (mixed ^ (mixed >> 13)) & self._mask
        side = self._places[place]
        if side is not None and side.ports == ports and side.addresses == addresses and vlan < _MANY_TAGS:
            return side
        key = buf[at : at + _KEY4]
        side = self.sides.get(key + self.tag_of(vlan) if vlan else key)
        if side is not None and vlan < _MANY_TAGS:
            self._keep_place(side, place, addresses, ports)
        return side

    def find6(self, buf: bytes, at: i64, vlan: i64) -> Side | None:
        """Return the side in `sides` for the IPv6 addresses and ports at ``at`` and a VLAN key, as `find` does for IPv4."""
        first: i64 = read_i64_be(buf, at)
        second: i64 = read_i64_be(buf, at + 8)
        third: i64 = read_i64_be(buf, at + 16)
        fourth: i64 = read_i64_be(buf, at + 24)
        ports: i64 = i64(read_i32_be(buf, at + 32)) ^ (vlan << 32) ^ _SIX
        mixed: i64 = first ^ second ^ (third >> 2) ^ (fourth >> 1)
        mixed = (mixed ^ (mixed >> 29)) + (ports ^ (ports >> 16))
        place: i64 = (mixed ^ (mixed >> 13)) & self._mask
        side = self._places[place]
        if side is not None and side.ports == ports and side.addresses == first and vlan < _MANY_TAGS:
            if side.second == second and side.third == third and side.fourth == fourth:
                return side
        key = buf[at : at + _KEY6]
        side = self.sides.get(key + self.tag_of(vlan) if vlan else key)
        if side is not None and vlan < _MANY_TAGS:
            side.second = second
            side.third = third
            side.fourth = fourth
            self._keep_place(side, place, first, ports)
        return side

    def _keep_place(self, side: Side, place: i64, addresses: i64, ports: i64) -> None:
        side.addresses = addresses
        side.ports = ports
        side.place = place
        self._places[place] = side

    def tag_of(self, vlan: i64) -> bytes:
        """Return the end of the key of a packet with this VLAN key, empty for none; mostly it is that of the packet before."""
        if vlan != self._vlan:
            self._vlan = vlan
            self._tag = int(vlan).to_bytes(_VLAN, "big") if vlan else b""
        return self._tag

    def _leave_place(self, side: Side) -> None:
        if 0 <= side.place < len(self._places) and self._places[side.place] is side:
            self._places[side.place] = None

    def _take_place(self, key: bytes) -> None:
        """Another connection gets ``key``, so `find` no longer returns its former side."""
        before = self.sides.get(key)
        if before is not None:
            self._leave_place(before)
            if before.key != key:
                self._more -= 1

    def note_tag(self, tag: bytes) -> None:
        """Remember the VLAN of a packet (empty for none); when there are too many, the one seen first is forgotten."""
        tags = self.tags
        if not tags:
            tags[b""] = None  # untagged packets before the first VLAN did not call this
        if tag not in tags:
            if len(tags) > MAX_TAGS:
                del tags[list(tags)[1]]
            tags[tag] = None

    def add(self, side: Side, key: bytes) -> None:
        """Packets of ``side`` were also captured in another VLAN: find it by ``key`` too, which is still free."""
        base, tag = base_and_tag(key)
        for sender, own in ((side, key), (side.peer, reverse_key(base) + tag)):
            attempt = self.attempt(own)
            if sender is not None and attempt is not None and sender.stream.start_seq == (attempt.seq + 1) & MASK:
                self._take_syn(own)  # it is the SYN of this connection
                side.tcp.packets += 1
        if side.also is None:
            side.also = []
        if len(side.also) < MAX_ALSO:
            side.also.append(key)
            self.sides[key] = side
            self._more += 1
            side.tcp.note_vlan(int.from_bytes(tag, "big"))

    def note_syn(self, key: bytes, seq: i64, frame: i64, time_ns: i64, link: bytes = b"") -> Attempt | None:
        """Remember a connection attempt until the other side answers or data follows.

        ``link`` is as in `TcpConnection.note_link`. Return an attempt with this key that now counts as unanswered, else None;
        each attempt is returned only once.
        """
        known = self._half_open.get(key)
        if known is not None and known.seq == seq:
            known.again(frame, time_ns)
            return known if known.give_up(_GIVEN_UP) else None
        # A different sequence number is a different attempt, and the next answer belongs to it.
        self._half_open[key] = Attempt(seq, frame, time_ns, link)
        if len(self._half_open) > MAX_HALF_OPEN:
            self._half_open.popitem(last=False)
            self.half_open_evicted += 1
        return known if known is not None and known.give_up(1) else None

    def unanswered(self) -> list[tuple[bytes, Attempt]]:
        """Return the repeated attempts that are still unanswered, with their keys; each is returned only once."""
        return [(key, attempt) for key, attempt in self._half_open.items() if attempt.give_up(1)]

    def attempt(self, key: bytes) -> Attempt | None:
        """Return the connection attempt with this key, None when there is none."""
        return self._half_open.get(key)

    def _take_syn(self, key: bytes) -> Attempt | None:
        """Forget a connection attempt and return it, None if there is none; `pop` would take three times as long."""
        half_open = self._half_open
        if not half_open or key not in half_open:
            return None
        syn = half_open[key]
        del half_open[key]
        return syn

    def forget_syn(self, key: bytes) -> None:
        """Forget a connection attempt: the earlier connection continues."""
        self._take_syn(key)

    def refused(self, key: bytes) -> bool:
        """Return whether a reset with ``key`` answers a connection attempt, and forget the attempt."""
        return self._take_syn(reverse_key(key)) is not None

    def open(self, key: bytes, vlan: i64, frame: i64, time_ns: i64) -> Side:
        """Make a connection for a packet with ``key``; return the side that sent it."""
        reverse = reverse_key(key)
        mine = self._take_syn(key)
        theirs = self._take_syn(reverse)
        syn = mine if mine is not None else theirs
        first, second = (reverse, key) if mine is None and theirs is not None else (key, reverse)
        a, b = endpoints(first)
        tcp = TcpConnection(
            a, b, vlan, syn.frame if syn is not None else frame, syn.time_ns if syn is not None else time_ns
        )
        if syn is not None:
            tcp.initiator = 0
            tcp.streams[0].start((syn.seq + 1) & MASK)
            tcp.packets += 1
            tcp.note_link(0, syn.link)
        connection = Connection(0, tcp)
        side0 = Side(0, first, tcp, connection, self._first)
        side1 = Side(1, second, tcp, connection, self._first)
        side0.peer = side1
        side1.peer = side0
        if syn is not None:
            side0.end_seq = tcp.streams[0].next_seq
        self._take_place(first)
        self._take_place(second)
        self.sides[side1.key] = side1
        self.sides[side0.key] = side0  # last, so that side 0 is found if both ends have the same address and port
        if len(self.sides) > len(self._places):
            self._places = [None] * (4 * len(self._places))
            self._mask = len(self._places) - 1
        return side0 if first == key else side1

    def remove(self, side: Side) -> None:
        """Forget a connection, but keep a new one that already uses its keys.

        Its sides forget each other. The two sides are the only reference cycle; without it all memory is freed at once, and not
        by the garbage collector, whose pauses grow with the number of open connections.
        """
        peer = side.peer
        self._remove(side)
        if peer is not None:
            self._remove(peer)

    def _remove(self, end: Side) -> None:
        end.peer = None
        self._leave_place(end)
        if self.sides.get(end.key) is end:
            del self.sides[end.key]
        if end.also is not None:
            for key in end.also:
                if self.sides.get(key) is end:
                    del self.sides[key]
                    self._more -= 1

    @property
    def lingering(self) -> bool:
        """True while closed connections are kept."""
        return len(self._lingering) > 0 or len(self._doubted) > 0

    def linger(self, side: Side) -> None:
        """The connection of ``side`` is closed: keep it for `LINGER_NS`, or `DOUBT_NS` if its end is in doubt."""
        (self._lingering if side.tcp.doubt is None else self._doubted).append(side)

    def closed(self, time_ns: i64, everything: bool = False) -> list[Side]:
        """Return one side of each closed connection that was kept long enough (``everything``: of all), and drop it."""
        gone: list[Side] = []
        for lingering, pause_ns in ((self._lingering, LINGER_NS), (self._doubted, DOUBT_NS)):
            while lingering:
                side = lingering[0]
                open_again: bool = pause_ns == DOUBT_NS and not side.tcp.closed  # its end was withdrawn
                early: bool = len(lingering) <= MAX_LINGERING and time_ns - side.tcp.last_ns <= pause_ns
                if early and not open_again and not everything:
                    break
                lingering.popleft()
                if not open_again:
                    gone.append(side)
        return gone

    def overflow(self) -> list[Side]:
        """Return one side of each connection that must be evicted because too many are open; call this before each `open`."""
        held: i64 = len(self.sides) - self._more
        if held <= 2 * (MAX_CONNECTIONS - RESERVE):
            return []
        over: i64 = held - 2 * MAX_CONNECTIONS
        idle = self._idle
        if idle.running_out:
            idle.begin(list(self.sides.values()))
        idle.step()
        if over > 2 * RESERVE:
            idle.finish()
        gone: list[Side] = []
        while over > 0 and len(gone) < LEAVE_AT_ONCE:
            side = idle.take()
            if side is None:
                break
            gone.append(side)
            over -= 2
        self.evicted += len(gone)
        return gone

    def all_open(self) -> list[Side]:
        """Return side 0 of every connection in the table, in the order in which they were opened."""
        return [side for key, side in self.sides.items() if side.index == 0 and side.key == key]
