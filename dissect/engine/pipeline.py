"""The whole path of a byte: from the packet to the TCP segment, to octets in order, to the protocol of the connection.

Read this file first. `Pipeline.frame` takes one packet, and reports everything that this packet completes before it returns.
There is no clock, file or thread here: the time comes with each packet. A byte passes these stages in this order:

    Pipeline     frame → _packet → _segment           packets to octets in order, gaps reported as gaps
    IsoOnTcp     feed → _tpkt → _tsdu, or usual       octets to messages (`dissect.engine.iso`)
    S7           take                                  messages to requests and responses (`dissect.engine.s7`)
    Exchange     completed                             transactions and findings, to the `Observer` (`dissect.engine.exchange`)

The fast path goes from `_packet` (`_packet6` for IPv6), for all link types, through `_known` straight to `IsoOnTcp.usual`. It
takes a segment that is the next in order and contains TPKTs with one DT each, each with a whole S7 PDU. Everything else takes a
slower path, through `_slow_frame`, `_lifecycle` or `_irregular`. Sides on which something waits are in `Timers`;
`Timers.chunks` passes on what is in order again. Every connection begins with the protocol `Recognition`, which gives it to its
real protocol; a new protocol is one more entry of ``streams``.
"""

from __future__ import annotations

from typing import Final

from librt.strings import read_i16_be, read_i32_be, read_i64_be
from mypy_extensions import i64

from dissect.engine import attempts, disorder, ends, vlans
from dissect.engine.connections import Connections, Recognition, on_102
from dissect.engine.counters import Counters
from dissect.engine.exchange import Exchange
from dissect.engine.findings.reporter import Reporter
from dissect.engine.ibh import IbhNetLink
from dissect.engine.iso import LEAST, IsoOnTcp
from dissect.engine.observer import Observer
from dissect.engine.options import Options
from dissect.engine.payload import PayloadStream
from dissect.engine.plus import S7Plus
from dissect.engine.s7 import S7
from dissect.engine.silent import NO_PROBE, SilentConnections, judge_silent, may_be_probe
from dissect.engine.sums import counts_of
from dissect.engine.timers import FAR_FUTURE, Timers, next_tick
from dissect.engine.tls import Tls
from dissect.engine.transactions import accounts
from dissect.engine.transactions.accounts import NO_PAYLOAD, PAYLOAD
from dissect.engine.transactions.connection import FOREIGN, ISO, LEFT_OUT, PROBING
from dissect.engine.transactions.memory_limit import Room
from dissect.engine.transactions.pairing import Dialogue
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import ConnectionTable
from dissect.engine.transactions.transaction import CAPTURE_ENDED, CONNECTION_CLOSED, CONNECTION_EVICTED
from dissect.engine.udp import Datagrams
from dissect.packets.source.packet import PacketSink
from dissect.packets.tcp import stream
from dissect.packets.tcp.ip import TCP, UDP
from dissect.packets.tcp.link import ETHERNET
from dissect.packets.tcp.stream import ACK, FIN, RST, SYN
from dissect.packets.tcp.usual import usual_ip
from dissect.protocols.iso.recognition import is_connect_request
from dissect.protocols.iso.tpkt import MIN_LENGTH, sound_length
from dissect.wire.copies import leaves_as
from dissect.wire.octets import u32

__all__ = ["Observer", "Options", "Pipeline"]

#: Size of the headers of Ethernet, IPv4 without options, and TCP.
_HEADERS: Final = 54

#: After this many captured octets the contents of all buffers are added up; they cannot grow by more in between.
LOOK_OCTETS: Final = 32 * 1024 * 1024


class Pipeline(PacketSink):
    """Takes packets; reports transactions and findings to ``observer``. The module's docstring describes the path between.

    Callers may read its parts: ``exchange`` (pairing, findings), ``counters``, ``table`` (TCP connections), ``connections`` and
    ``protocols``, of which ``iso``, ``s7``, ``plus`` and ``ibh`` are attributes as well.
    """

    def __init__(self, observer: Observer, options: Options | None = None) -> None:
        chosen = options if options is not None else Options()
        self.observer: Observer = observer
        self.exchange: Exchange = Exchange(observer, chosen.decoder, chosen.strict, chosen.slow_ns)
        self.exchange.naming = chosen.naming
        self.counters: Counters = Counters(self.exchange.reporter)
        self.silent: SilentConnections = SilentConnections(self.counters)
        self.timers: Timers = Timers(self.counters, self.exchange, chosen.overdue_ns)
        self.connections: Connections = Connections(self.exchange, chosen.only)
        self.s7: S7 = S7(self.exchange)
        self.plus: S7Plus = S7Plus(self.exchange)
        self.tls: Tls = Tls(self.exchange, self.connections.foreign, self.s7, self.plus, chosen.tls_keys)
        self.iso: IsoOnTcp = IsoOnTcp(self.exchange, self.connections, self.s7, self.plus, self.tls)
        self.connections.iso = self.iso
        self.ibh: IbhNetLink = IbhNetLink(self.exchange, self.iso)
        #: The protocols besides ISO-on-TCP that frame a stream; `Recognition` tries them in this order. Add a new one here.
        streams: list[Protocol] = [self.ibh]
        #: The protocols with sections in reports, in the order of the sections.
        self.protocols: list[Protocol] = [self.iso, *streams, self.s7, self.plus, self.tls]
        self.datagrams: Datagrams | None = None
        if chosen.decoder is not None:
            payloads = PayloadStream(self.exchange, chosen.decoder)
            self.protocols.append(payloads)
            streams.insert(0, payloads)
            self.datagrams = Datagrams(self.counters, self.connections, chosen.decoder, payloads)
        self._recognition: Protocol = Recognition(self.connections, self.iso, streams)
        self.table: ConnectionTable = ConnectionTable(self._recognition)
        self.connections.table = self.table
        self._dialogue: Dialogue = self.exchange.dialogue
        self._reporter: Reporter = self.exchange.reporter
        self._checksums: bool = chosen.checksums
        self._room: Room = Room(chosen.memory)
        self._taken: i64 = 0  # octets captured since the buffers were last added up
        self._look_at: i64 = LOOK_OCTETS  # `_make_room` is called when `_taken` reaches this; 0 while it has work left
        self._link: bytes = b""  # the Ethernet addresses of a packet that may open a connection

    @property
    def frames(self) -> int:
        """Number of packets taken so far, which is also the number of the latest one."""
        return self.counters.frames

    @property
    def first_ns(self) -> int:
        """Time of the first packet, nanoseconds since 1970; 0 before there is one."""
        return self.counters.first_ns

    @property
    def now_ns(self) -> int:
        """Time of the latest packet, nanoseconds since 1970; 0 before the first."""
        return self.counters.now_ns

    @property
    def finding_counts(self) -> dict[str, int]:
        """How often each finding was made, by slug; findings whose details were not kept count as well."""
        return self.exchange.reporter.counts

    def comment(self, text: str) -> None:
        """Take a comment that the capture holds about the next packet."""
        self.observer.comment(self.counters.frames + 1, text)

    def secrets(self, text: bytes) -> None:
        """Take the TLS key log of a Decryption Secrets Block."""
        self.tls.secrets(text)

    def note_damage(self, detail: str) -> None:
        """Report that the source found its capture damaged."""
        self.counters.note("capture.damaged", detail)

    def note_dropped(self, detail: str) -> None:
        """Report that the source lost packets since the last report."""
        self.counters.note("capture.dropped", detail)
        self.exchange.reporter.lost_ns = self.counters.now_ns

    def restart_clock(self, time_ns: i64) -> None:
        """Another capture begins at ``time_ns``; it may be older than the previous one, and is independent of it.

        The caller has closed every connection. Waiting connection attempts and IP fragments are forgotten, but stay counted.
        """
        self.counters.restart(time_ns)
        self.table = self.table.anew()
        self.connections.table = self.table
        if self.datagrams is not None:
            self.datagrams.restart()

    # ---- packet → segment -------------------------------------------------------------------------------------------

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Take one packet (see `PacketSink.frame`)."""
        counters = self.counters
        counters.frames += 1
        size: i64 = end - start
        self._taken += size
        if self._taken >= self._look_at:
            self._make_room()
        if counters.now_ns <= time_ns < self.timers.deadline_ns and counters.first_ns:
            counters.now_ns = time_ns
        else:
            self._turn(time_ns)
        if wire_length > size:
            counters.note_cut(size, wire_length)
        category: i64
        try:
            category = self._packet(buf, start, end, link_type)
        except Exception as bug:
            category = accounts.FAILED
            self.exchange.note_bug(bug, counters.frames, time_ns)
        if category == PAYLOAD:
            counters.packets.often_count += 1
        elif category == NO_PAYLOAD:
            counters.packets.also_count += 1
        else:
            counters.packets.add(category)
        dialogue = self._dialogue
        if dialogue.holding:
            for side in dialogue.holding:
                self.timers.wait(side)
            dialogue.holding = []
        if self._reporter.fresh:
            self.exchange.report_findings()

    def _make_room(self) -> None:
        """While the connections together keep too much, evict those that keep most, a few with each packet."""
        if self._taken >= LOOK_OCTETS:
            self._taken = 0
            self._room.begin(self.table.all_open())
        for held, side in self._room.step():
            self.table.evicted += 1
            self._evict(side, f"it held {held} bytes")
        self._look_at = 0 if self._room.busy else LOOK_OCTETS

    def _turn(self, time_ns: i64) -> None:
        """Set the clock: by the first packet, by a packet older than the one before it, or when something is due."""
        counters = self.counters
        if time_ns < counters.now_ns:
            self.timers.step_back(time_ns)
        elif counters.frames == 1:
            counters.first_ns = time_ns
        counters.now_ns = time_ns
        if time_ns >= self.timers.deadline_ns:
            self._tick()

    def _evict(self, side: Side, detail: str) -> None:
        side.tcp.ended = side.tcp.ended or "evicted"
        self.connections.note_evicted(self.counters, side, detail)
        self._finish(side, CONNECTION_EVICTED)

    def _packet(self, buf: bytes, start: i64, end: i64, link_type: i64) -> i64:
        # A few wide reads: from EtherType to IP identification, from fragment offset to IP protocol, TCP sequence and ACK
        # numbers.
        at: i64 = start + 14
        vlan: i64 = 0
        length: i64 = -1
        head: i64
        side: Side | None
        if link_type == ETHERNET and end - start >= _HEADERS:
            head = read_i64_be(buf, start + 12)
            if head >> 40 == 0x080045:
                length = head >> 16 & 0xFFFF
        if length < 0:  # in a VLAN, of another link type, or not IPv4 without options
            at, vlan = usual_ip(buf, start, end, link_type)
            if at < 0:
                return self._slow_frame(buf, start, end, link_type)
            head = read_i64_be(buf, at)
            if head >> 56 == 0x45:
                length = head >> 32 & 0xFFFF
            elif head >> 60 == 6 and head >> 8 & 0xFF == TCP:
                return self._packet6(buf, start, at, at + 40 + (head >> 16 & 0xFFFF), end, vlan, link_type)
        if length < 0 or i64(read_i32_be(buf, at + 6)) & 0x3FFF00FF != TCP or self._checksums:
            return self._slow_frame(buf, start, end, link_type)
        stop: i64 = at + length
        side = self.table.find(buf, at + 12, vlan)
        word: i64 = i64(read_i16_be(buf, at + 32)) & 0xFFFF
        data: i64 = at + 20 + ((word >> 12) << 2)
        if stop > end or data > stop or word < 0x5000:
            return self._slow_frame(buf, start, end, link_type)
        if side is None or word & 7:  # SYN, FIN, RST
            self._link = buf[start : start + 12] if link_type == ETHERNET else b""
            return self._at_ends(side, buf, at + 12, at + 20, vlan, word, data, stop)
        return self._known(side, buf, at + 20, word, data, stop)

    def _packet6(self, buf: bytes, start: i64, at: i64, stop: i64, end: i64, vlan: i64, link_type: i64) -> i64:
        """Take a packet with IPv6 at ``at`` and TCP after it, as `_packet` does for IPv4."""
        if stop > end or at + 60 > stop or self._checksums:
            return self._slow_frame(buf, start, end, link_type)
        side = self.table.find6(buf, at + 8, vlan)
        word: i64 = i64(read_i16_be(buf, at + 52)) & 0xFFFF
        data: i64 = at + 40 + ((word >> 12) << 2)
        if data > stop or word < 0x5000:
            return self._slow_frame(buf, start, end, link_type)
        if side is None or word & 7:
            self._link = buf[start : start + 12] if link_type == ETHERNET else b""
            return self._at_ends(side, buf, at + 8, at + 40, vlan, word, data, stop)
        return self._known(side, buf, at + 40, word, data, stop)

    def _at_ends(
        self, side: Side | None, buf: bytes, first: i64, tcp: i64, vlan: i64, word: i64, data: i64, stop: i64
    ) -> i64:
        """Take the first packet of a connection, or one with SYN, FIN or RST; its key is at ``first``, TCP at ``tcp``."""
        key = buf[first : tcp + 4] + self.table.tag_of(vlan)
        seq, ack = u32(buf, tcp + 4), u32(buf, tcp + 8)
        return self._lifecycle(side, key, vlan, seq, ack, word & 0x3F, buf[data:stop], 0)

    def _known(self, side: Side, buf: bytes, at: i64, word: i64, data: i64, stop: i64) -> i64:
        """Take a packet of a known connection without SYN, FIN or RST; TCP is at ``at``, the payload is ``buf[data:stop]``."""
        head: i64 = read_i64_be(buf, at + 4)
        seq: i64 = head >> 32 & 0xFFFFFFFF
        ack: i64 = head & 0xFFFFFFFF
        if side.longest and word & ACK:
            size: i64 = stop - data
            half = side.stream
            if size == 0 or seq == half.next_seq:
                # `_segment`, inlined: while `longest` is not 0, none of its checks would find anything.
                counters = self.counters
                tcp = side.tcp
                tcp.packets += 1
                tcp.last_frame = counters.frames
                tcp.last_ns = counters.now_ns
                side.last_ack = ack
                if seq == half.next_seq and 0 <= (ack - side.acked) < stream.HALF_SPACE and side.acked >= 0:
                    side.acked = ack  # as `note_ack` would do
                else:
                    side.note_ack(seq, ack)
                    if size == 0:
                        side.note_end(seq)
                if size == 0:
                    return NO_PAYLOAD
                octets = buf[data:stop]
                half.passed(octets, size)
                side.end_seq = half.next_seq
                side.size = size
                taken: i64 = 0
                if size >= LEAST:
                    most: i64 = size
                    most = min(most, side.longest)
                    taken = self.iso.usual(side, octets, 0, most, counters.frames, counters.now_ns)
                if taken != size:
                    self._feed(side, octets, taken, size)
                return PAYLOAD
        return self._segment(side, seq, ack, word, buf[data:stop], 0)

    def _slow_frame(self, buf: bytes, start: i64, end: i64, link_type: i64) -> i64:
        """Take any packet: find its TCP segment, or return why there is none."""
        datagrams = self.datagrams
        found = self.counters.find_segment(buf, start, end, link_type, datagrams is not None, self._checksums)
        if found.problem:
            if found.key:
                self.counters.note_damaged(self.table.sides.get(found.key), found)
            return accounts.CATEGORIES.index(found.problem)
        if datagrams is not None and found.protocol == UDP:
            return datagrams.take(found)
        side = self.table.sides.get(found.key)
        if side is None or found.word & 7:
            macs = found.macs
            self._link = macs if macs is not None else buf[start : start + 12] if link_type == 1 else b""
            return self._lifecycle(
                side, found.key, found.vlan, found.seq, found.ack, found.word & 0x3F, found.octets, found.missing
            )
        return self._segment(side, found.seq, found.ack, found.word, found.octets, found.missing)

    def _lifecycle(
        self, side: Side | None, key: bytes, vlan: i64, seq: i64, ack: i64, flags: i64, octets: bytes, missing: i64
    ) -> i64:
        """Take the first packet of a connection, or a packet with SYN, FIN or RST."""
        if side is not None and flags & (SYN | RST):
            what = ends.judge(self.counters, self.table, side, seq, ack, flags, bool(octets), self._link)
            if what == ends.HELD_BACK:
                return NO_PAYLOAD
            if what == ends.ANOTHER:
                self._give_way(side)
                side = None
        own = key
        if side is None and (vlan or self.table.tags):
            side, key, vlan = vlans.elsewhere(self.table, key, vlan, seq, ack, flags, octets, missing)
        if side is None:
            if flags & SYN and not flags & ACK and not octets:
                self.silent.end(key)
                attempts.note_syn(self.counters, self.table, key, seq, self._link)
                return NO_PAYLOAD
            if flags & RST:
                attempts.note_reset(self.counters, self.table, key)
            # A connection enters the table only with data or a handshake.
            if not (octets or missing or flags & SYN):
                if flags & (FIN | RST):
                    self.silent.end(key)
                    self.counters.bare.take_end(key, flags, self.counters.frames)
                elif flags & ACK:
                    self.silent.take(key, seq, ack)
                return NO_PAYLOAD
            if key != own and (before := self.table.sides.get(key)) is not None:
                # `judge` would have found this if `side` had been looked up in the VLAN of the SYN
                self._give_way(before)
            side = self._open(key, vlan)
            if key != own:
                self.table.add(side, own)
            self.silent.begin(side)
            if flags & SYN and flags & ACK and side.tcp.initiator < 0:
                side.tcp.initiator = 1 - side.index
                side.connection._set_client(1 - side.index)
        if flags & SYN:
            seq = (seq + 1) & stream.MASK
            if side.stream.next_seq < 0:
                side.begin(seq)
        ends.note_quiet(side, flags)
        category = self._segment(side, seq, ack, flags, octets, missing)
        was_closed = side.tcp.closed
        if flags & (RST | FIN):
            if not ends.take(self.counters, side, seq, flags, len(octets) + missing, self._link):
                return accounts.RESET_IGNORED
            self.timers.doubt(side)
        if side.tcp.closed and not was_closed:
            self.table.linger(side)
            self._forget_closed()  # here as well as in `_tick`, because in some captures the time never changes
        self.timers.wake()
        return category

    def _give_way(self, side: Side) -> None:
        """Another connection replaces this one, which is over."""
        ends.give_way(self.counters, side)
        self._finish(side, CONNECTION_CLOSED)

    def _reopen(self, side: Side, seq: i64, octets: bytes, missing: i64) -> i64:
        """Open a new connection that replaces this one, and take a segment of ``side`` that showed that it began."""
        ack: i64 = side.last_ack
        self._give_way(side)
        macs: bytes = side.tcp.macs
        self._link = macs[6:] + macs[:6] if side.index == 0 else macs
        return self._segment(self._open(side.key, side.tcp.vlan), seq, ack, ACK if ack >= 0 else 0, octets, missing)

    def _open(self, key: bytes, vlan: i64) -> Side:
        for idle in self.table.overflow():
            self._evict(idle, "")
        side = self.table.open(key, vlan, self.counters.frames, self.counters.now_ns)
        side.tcp.note_link(side.index, self._link)
        return side

    # ---- segment → octets in order ----------------------------------------------------------------------------------

    def _segment(self, side: Side, seq: i64, ack: i64, flags: i64, octets: bytes, missing: i64) -> i64:
        counters = self.counters
        tcp = side.tcp
        tcp.packets += 1
        tcp.last_frame = counters.frames
        tcp.last_ns = counters.now_ns
        peer = side.peer
        assert peer is not None
        side.longest = 0
        peer.longest = 0
        if side.waiting or peer.waiting or tcp.doubt is not None:
            self.timers.passing(side, peer, ack, flags & ACK != 0)
        if flags & ACK:
            side.last_ack = ack
            if not flags & RST or seq == side.end_seq:  # any other reset may belong to another connection
                side.note_ack(seq, ack)
        else:
            side.last_ack = -1  # if/else, because mypyc creates int objects for a conditional expression
        size: i64 = len(octets)
        if size == 0 and missing == 0:
            side.note_bare(seq, flags & NO_PROBE != 0)
            if side.connection._state == PROBING and peer.last_ack == (seq + 1) & stream.MASK and not flags & NO_PROBE:
                side.note_probe(counters.frames, counters.now_ns, False)
            return NO_PAYLOAD
        half = side.stream
        if seq == half.next_seq and half.held is None and missing == 0 and side.connection._state == ISO:
            half.passed(octets, size)
            side.end_seq = half.next_seq
            side.size = size
            self._feed(side, octets, 0, size)
            return PAYLOAD
        return self._irregular(side, seq, octets, missing)

    def _feed(self, side: Side, octets: bytes, at: i64, size: i64) -> None:
        """Pass ``octets[at:size]`` to ISO-on-TCP, then set `Side.longest`, the limit for what the fast path may take next."""
        frame: i64 = self.counters.frames
        time_ns: i64 = self.counters.now_ns
        if not side.longest:
            self.iso.feed(side, octets, 0, size, frame, time_ns)
        elif self.iso.rest(side, octets, at, size, frame, time_ns):
            return
        peer = side.peer
        if peer is None or side.waiting or peer.waiting or side.tcp.doubt or side.connection.plus is not None:
            if side.unfinished:
                side.longest = 0
            return
        side.longest = self.iso.longest(side)
        if peer.stream.held is None:
            peer.longest = self.iso.longest(peer)

    def _irregular(self, side: Side, seq: i64, octets: bytes, missing: i64) -> i64:
        """Take a segment that is not the next in order, or whose connection was not recognised as ISO-on-TCP."""
        connection = side.connection
        half = side.stream
        peer = side.peer
        assert peer is not None
        if (side.rival is not None or peer.rival is not None) and ends.follows(side, peer, seq):
            return self._reopen(side, seq, octets, missing)
        if connection._state == FOREIGN:
            if len(octets) > MIN_LENGTH and sound_length(octets, 0, len(octets)):
                return self._reopen(side, seq, octets, missing)  # a TPKT: the earlier data must not hide S7
            return accounts.OTHER_PROTOCOL
        if half.next_seq >= 0:
            ahead: i64 = (seq - half.next_seq) & stream.MASK
            if stream.FAR_AHEAD < ahead < stream.MASK - stream.FAR_AHEAD and connection.established:
                if is_connect_request(octets):
                    return self._reopen(side, seq, octets, missing)
            if side.tcp.reset_frame and half.held is None and ahead > ends.AFTER_RESET:
                return accounts.AFTER_CLOSE
        if connection._state == LEFT_OUT:
            size: i64 = len(octets)
            end_seq: i64 = (seq + size + missing) & stream.MASK
            if half.next_seq < 0 or 0 < (end_seq - half.next_seq) & stream.MASK < stream.HALF_SPACE:
                half.next_seq = end_seq  # needed to check the sequence numbers of its FIN and RST
                side.end_seq = end_seq
                side.protocol.feed(side, octets, 0, size, self.counters.frames, self.counters.now_ns)
            if side.connection._state == LEFT_OUT:
                return accounts.LEFT_OUT
            return PAYLOAD
        if half.next_seq < 0 and missing == 0 and may_be_probe(side, octets):
            # The keep-alive probe of an idle connection: one octet that was already sent (RFC 1122 4.2.3.6).
            side.begin(seq + 1)
            side.note_probe(self.counters.frames, self.counters.now_ns, True)
            return accounts.KEEP_ALIVE
        if half.next_seq < 0:
            side.begin_late(seq)
        return disorder.take(self.counters, self.timers, side, seq, octets, missing)

    # ---- what waits for time to pass --------------------------------------------------------------------------------

    def tick(self, now_ns: i64) -> None:
        """Time passed without a packet; the clock of the capture now shows ``now_ns``.

        Everything that has waited too long is dropped, as after a packet. The next packet may be a little older than
        ``now_ns``, because it was still on its way. If ``now_ns`` is not later than the last packet, nothing happens.
        """
        counters = self.counters
        packet_ns: i64 = counters.now_ns
        if counters.frames == 0 or now_ns <= packet_ns:
            return
        counters.now_ns = now_ns
        self._tick()
        counters.now_ns = packet_ns
        if self.timers.deadline_ns != FAR_FUTURE:
            self.timers.deadline_ns = next_tick(packet_ns)
        if self.exchange.reporter.fresh:
            self.exchange.report_findings()

    def _tick(self) -> None:
        """Time has passed: drop what waited too long, and finish connections that are over."""
        timers = self.timers
        timers.deadline_ns = next_tick(self.counters.now_ns)
        try:
            timers.give_up_waiting()
            self._forget_closed()
            timers.look_overdue()
            self.exchange.tick(self.counters.now_ns)
        except Exception as bug:
            self.exchange.note_bug(bug, self.counters.frames, self.counters.now_ns)
        timers.settle(self.table.lingering)

    def _forget_closed(self) -> None:
        for side in self.table.closed(self.counters.now_ns):
            self._finish(side, CONNECTION_CLOSED)

    def _finish(self, side: Side, reason: str) -> None:
        """Finish a connection: pass on the octets held back, close its open requests, add up its octets, forget it."""
        peer = side.peer
        if peer is None:
            return  # finished before
        try:
            self._end(side, peer, reason)
        except Exception as bug:
            self.exchange.note_bug(bug, self.counters.frames, self.counters.now_ns)
        # A connection that was never recognised counts only on port 102, where ISO-on-TCP is expected.
        if side.connection._state != LEFT_OUT and (side.connection.number or on_102(side)):
            self.counters.add_up(side)
            self.counters.add_up(peer)
        self.table.remove(side)
        side.tcp.let_go()

    def _end(self, side: Side, peer: Side, reason: str) -> None:
        for end in (side, peer):
            end.stream.finish()
            end.waiting = False
        if side.stream.ready or peer.stream.ready or side.stream.outside or peer.stream.outside:
            self.timers.both(side)
        if ends.note_unseen(self.counters, side, peer):
            self.timers.both(side)
        ends.finish(self.counters, self.table, side, peer)
        connection = side.connection
        if connection.number:
            if connection.followed:
                self.counters.bare.speaks(connection.server.port)
            if side.tcp.ended and reason == CAPTURE_ENDED:
                reason = CONNECTION_CLOSED
            self.connections.end(side, reason, self.counters.frames, self.counters.now_ns)
        elif connection._state == PROBING and connection._probed:
            side.protocol.end(side, side.tcp.last_frame, side.tcp.last_ns)
        elif connection._state == PROBING:
            judge_silent(self.counters, side, peer)

    def forget(self) -> None:
        """No more packets come: free what only further packets would need, so that the report has memory."""
        self.s7.forget()
        self.exchange.watch.forget()
        self.exchange.reporter.forget()

    def finish(self) -> None:
        """The capture ends: close every open connection, and report everything that was held back."""
        self.timers.look_at_ends()
        for side in self.table.closed(self.counters.now_ns, True):
            self._finish(side, CONNECTION_CLOSED)
        for side in self.table.all_open():
            self._finish(side, CAPTURE_ENDED)
        self.silent.finish()
        attempts.finish(self.counters, self.table)
        if self.datagrams is not None:
            self.datagrams.finish()
        self.timers.finish()
        self.exchange.finish()


leaves_as(Pipeline, counts_of)
