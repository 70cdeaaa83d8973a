"""The whole path of a byte: packet, segment, octets in order, TPKT, TPDU, TSDU, S7 PDU, transaction, finding.

Read this file first. `Pipeline.frame` takes one packet, and everything it makes complete happens before it returns; there is
no clock, file or thread in here, time comes in with each packet. In the order in which a byte passes:

    Pipeline      frame → _packet → _segment → _chunks       packets to octets in order, holes told as holes
    Conversation  octets → _tpkt → _tsdu → _pdu → _ask / _answered → done     octets to transactions and findings

The common case goes straight down: a segment that is the next one and holds whole TPKTs, each a DT with a whole S7 PDU.
Whatever is irregular leaves that road for `_slow_frame`, `_lifecycle` and `_irregular`, and meets it again as soon as it
can, at `_chunks` in `dissect.engine.timers`, where all that needs time to pass is. What an IBH-NetLink gateway carries joins it at
`_tsdu` (`dissect.engine.ibh`). An `Observer` is told what happens.
"""

from __future__ import annotations

import struct
from typing import Final

from mypy_extensions import i64

from dissect.engine.conversation import Observer, Options
from dissect.engine.observer import LOOK_OCTETS
from dissect.engine.timers import FAR_FUTURE, TICK_NS, Waiting
from dissect.iso.recognition import is_connect_request
from dissect.iso.tpkt import MIN_LENGTH, sound_length
from dissect.tcp import stream
from dissect.tcp.connection import ACK, FIN, RST, SYN
from dissect.tcp.ip import UDP
from dissect.transactions import accounts
from dissect.transactions.connection import FOREIGN, ISO, PROBING
from dissect.transactions.memory_limit import Room
from dissect.transactions.table import Side
from dissect.transactions.transaction import CONNECTION_CLOSED, CONNECTION_EVICTED
from dissect.wire.build import COMPILED
from dissect.wire.octets import u16, u32

__all__ = ["Observer", "Options", "Pipeline"]

#: Ethernet, IPv4 without options, TCP, read at once when interpreted.
_FUSED: Final = struct.Struct(">12xHBxHxxHxB2x12sIIH")
_FUSED_SIZE: Final = 54

#: Steps back of the clock up to this are what two capture queues do.
_DISORDER_NS: Final = 1_000_000
#: After a reset a segment this far ahead may have been captured out of order; anything else comes too late.
_AFTER_RESET: Final = 65536


class Pipeline(Waiting):
    """Packets in, transactions and findings out. See the module for the way through."""

    def __init__(self, observer: Observer, options: Options | None = None) -> None:
        chosen = options if options is not None else Options()
        super().__init__(observer, chosen)
        self._room: Room = Room(chosen.memory)
        self._taken: i64 = 0  # octets captured since it was last looked what is kept of them

    # ---- packet → segment -------------------------------------------------------------------------------------------

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        """Take one packet (see `PacketSink.frame`)."""
        self.frames += 1
        self._taken += end - start
        if self._taken >= LOOK_OCTETS:
            self._taken = 0
            self._room.begin(self.table.all_open())
        if self._room.busy:
            self._make_room()
        if time_ns < self.now_ns:
            self._step_back(time_ns)
        elif self.frames == 1:
            self.first_ns = time_ns
        self.now_ns = time_ns
        if time_ns >= self._deadline_ns:
            self._tick()
        if wire_length > end - start:
            self._note_cut(end - start, wire_length)
        category: i64
        try:
            category = self._packet(buf, start, end, link_type)
        except Exception as bug:
            if self._strict:
                raise
            category = accounts.FAILED
            self.conversation.note_bug(bug, self.frames, time_ns)
        # Not `+=`: on an element of a list, mypyc makes that a call of the generic addition.
        self._packets[category] = self._packets[category] + 1
        if self._dialogue.holding:
            for side in self._dialogue.holding:
                self._wait(side)
            self._dialogue.holding = []
        if self._judge.fresh:
            self.conversation.tell_findings()

    def _make_room(self) -> None:
        """Connections that keep too much in sum have to leave, those that hold most first: a few with each packet."""
        for held, side in self._room.step():
            self.table.evicted += 1
            self._evict(side, f"it held {held} octets")

    def _evict(self, side: Side, detail: str) -> None:
        side.tcp.ended = side.tcp.ended or "evicted"
        if side.connection.followed:
            self._note("stream.evicted", detail, side.connection.number)
        self._finish(side, CONNECTION_EVICTED)

    def _step_back(self, time_ns: i64) -> None:
        """The clock of the capture runs backwards: what waits must not wait until it has caught up."""
        if self.now_ns - time_ns > _DISORDER_NS:
            self._note("capture.time_backwards", f"by {int(self.now_ns - time_ns) / 1e9:.6f} s")
        if self._deadline_ns != FAR_FUTURE:
            self._deadline_ns = min(self._deadline_ns, time_ns + TICK_NS)

    def _packet(self, buf: bytes, start: i64, end: i64, link_type: i64) -> i64:
        if link_type != 1 or end - start < _FUSED_SIZE or self._checksums:
            return self._slow_frame(buf, start, end, link_type)
        key: bytes
        seq: i64
        ack: i64
        word: i64
        total: i64
        if COMPILED:
            if (
                u16(buf, start + 12) != 0x0800
                or buf[start + 14] != 0x45
                or buf[start + 23] != 6
                or u16(buf, start + 20) & 0x3FFF
            ):
                return self._slow_frame(buf, start, end, link_type)
            total = u16(buf, start + 16)
            key = buf[start + 26 : start + 38]
            seq = u32(buf, start + 38)
            ack = u32(buf, start + 42)
            word = u16(buf, start + 46)
        else:
            ethertype, version, total, fragment, protocol, key, seq, ack, word = _FUSED.unpack_from(buf, start)
            if ethertype != 0x0800 or version != 0x45 or protocol != 6 or fragment & 0x3FFF:
                return self._slow_frame(buf, start, end, link_type)
        data: i64 = start + 34 + ((word >> 12) << 2)
        stop: i64 = start + 14 + total
        if stop > end or data > stop or word < 0x5000:
            return self._slow_frame(buf, start, end, link_type)
        side = self.table.sides.get(key)
        if side is None or word & 7:  # SYN, FIN, RST
            return self._lifecycle(side, key, 0, seq, ack, word & 0x3F, buf[data:stop], 0)
        return self._segment(side, seq, ack, word, buf[data:stop], 0)

    def _slow_frame(self, buf: bytes, start: i64, end: i64, link_type: i64) -> i64:
        """Any link, any IP: find the TCP segment, or say why there is none."""
        found = self._find_segment(buf, start, end, link_type)
        if found.problem:
            if found.key:
                self._note_damaged(found)
            return accounts.CATEGORIES.index(found.problem)
        if found.protocol == UDP:
            return self.datagram(found)
        side = self.table.sides.get(found.key)
        if side is None or found.word & 7:
            flags: i64 = found.word & 0x3F
            return self._lifecycle(
                side, found.key, found.vlan, found.seq, found.ack, flags, found.octets, found.missing
            )
        return self._segment(side, found.seq, found.ack, found.word, found.octets, found.missing)

    def _lifecycle(
        self, side: Side | None, key: bytes, vlan: i64, seq: i64, ack: i64, flags: i64, octets: bytes, missing: i64
    ) -> i64:
        """The first packet of a connection, and packets with SYN, FIN or RST."""
        if flags & SYN and side is not None and side.tcp.is_new_connection(side.index, seq):
            self._give_way(side)
            side = None
        if side is None:
            if flags & SYN and not flags & ACK and not octets:
                self._note_syn(key, seq)
                return accounts.NO_PAYLOAD
            if flags & RST and self.table.refused(key):
                self._note_refused(key)
            if not (octets or missing or flags & SYN):
                return accounts.NO_PAYLOAD  # only octets, or a handshake, make a connection worth remembering
            side = self._open(key, vlan)
            if flags & SYN and flags & ACK and side.tcp.initiator < 0:
                side.tcp.initiator = 1 - side.index
                side.connection.set_client(1 - side.index)
        if flags & SYN:
            seq = (seq + 1) & stream.MASK
            if side.stream.next_seq < 0:
                side.stream.start(seq)
        category = self._segment(side, seq, ack, flags, octets, missing)
        was_closed = side.tcp.closed
        if flags & RST:
            if not side.tcp.note_reset(side.index, seq, self.frames, self.now_ns):
                self._note_ignored(side, "reset")
                return accounts.RESET_IGNORED
        elif flags & FIN:
            end_seq: i64 = (seq + len(octets) + missing) & stream.MASK
            if not side.tcp.note_fin(side.index, end_seq, self.frames, self.now_ns):
                self._note_ignored(side, "FIN")
        if side.tcp.closed and not was_closed:
            self.table.linger(side)
            self._forget_closed()  # not only when time passes: in some captures it stands still
        if self._deadline_ns == FAR_FUTURE:
            self._deadline_ns = self.now_ns + TICK_NS
        return category

    def _give_way(self, side: Side) -> None:
        """The addresses of a connection are taken by another one, so it is over."""
        if not side.tcp.ended:
            side.tcp.ended = "reused"
            side.tcp.ended_frame = self.frames
            side.tcp.ended_ns = self.now_ns
            if side.connection.followed:
                self._note("stream.reused", "", side.connection.number)
        self._finish(side, CONNECTION_CLOSED)

    def _reopen(self, side: Side, seq: i64, octets: bytes, missing: i64) -> i64:
        """A connect request far from where the stream is, or S7 after something else: another connection."""
        ack: i64 = side.last_ack
        self._give_way(side)
        fresh = self._open(side.key, side.tcp.vlan)
        return self._segment(fresh, seq, ack, ACK if ack >= 0 else 0, octets, missing)

    def _open(self, key: bytes, vlan: i64) -> Side:
        for idle in self.table.overflow():
            self._evict(idle, "")
        return self.table.open(key, vlan, self.frames, self.now_ns)

    # ---- segment → octets in order ----------------------------------------------------------------------------------

    def _segment(self, side: Side, seq: i64, ack: i64, flags: i64, octets: bytes, missing: i64) -> i64:
        tcp = side.tcp
        tcp.packets += 1
        tcp.last_frame = self.frames
        tcp.last_ns = self.now_ns
        peer = side.peer
        assert peer is not None
        if side.waiting or peer.waiting:
            self._note_passing(side, peer, ack, flags)
        side.last_ack = ack if flags & ACK else -1
        size: i64 = len(octets)
        if size == 0 and missing == 0:
            return accounts.NO_PAYLOAD
        half = side.stream
        if seq == half.next_seq and half.held is None and missing == 0 and side.connection.state == ISO:
            half.passed(octets)
            side.end_seq = half.next_seq
            self.conversation.octets(side, octets, self.frames, self.now_ns)
            return accounts.PAYLOAD
        return self._irregular(side, seq, octets, missing)

    def _irregular(self, side: Side, seq: i64, octets: bytes, missing: i64) -> i64:
        """A segment that is not simply the next one, or of a connection that is not known to be ISO-on-TCP yet."""
        connection = side.connection
        half = side.stream
        if connection.state == FOREIGN:
            if len(octets) > MIN_LENGTH and sound_length(octets, 0, len(octets)):
                return self._reopen(side, seq, octets, missing)  # what was there before hides no S7 now
            return accounts.OTHER_PROTOCOL
        if half.next_seq >= 0:
            ahead: i64 = (seq - half.next_seq) & stream.MASK
            if side.tcp.ended == "reset" and half.held is None and ahead > _AFTER_RESET:
                return accounts.AFTER_CLOSE
            if stream.FAR_AHEAD < ahead < stream.MASK - stream.FAR_AHEAD and connection.established:
                if is_connect_request(octets):
                    return self._reopen(side, seq, octets, missing)
        if half.next_seq < 0 and octets == b"\0" and not side.tcp.known_start:
            # The probe of an idle connection: one octet that was sent before (RFC 1122 4.2.3.6), and begins no TPKT.
            half.start(seq + 1)
            side.probes += 1
            return accounts.KEEP_ALIVE
        what: i64 = stream.NEW
        conflicts: i64 = half.conflicts
        peer = side.peer
        if octets:
            if peer is not None and peer.stream.octets:
                half.heard = True
            what = half.accept(seq, octets, self.frames, self.now_ns, side.last_ack)
        elif half.next_seq < 0:
            half.start(seq)
        if half.conflicts > conflicts and connection.followed:
            self._note("stream.conflict", f"{len(octets)} octets at {seq}", connection.number)
        if missing and half.held is None and half.next_seq == (seq + len(octets)) & stream.MASK:
            self._chunks(side)
            half.skip(missing, self.frames, self.now_ns)
            self._chunks(side, True)
        elif half.ready or half.outside:
            self._chunks(side)
        if half.held is not None:
            self._wait(side)
        if what == stream.KEEP_ALIVE and side.probes:
            return accounts.KEEP_ALIVE
        if connection.state == FOREIGN or (connection.state == PROBING and half.held is None):
            return accounts.OTHER_PROTOCOL  # told by now, or still to be told: nothing of it was used
        if what == stream.NEW:
            return accounts.PAYLOAD
        if what == stream.OLD:
            return accounts.RETRANSMISSION
        return accounts.KEEP_ALIVE if what == stream.KEEP_ALIVE else accounts.BEFORE_START

    def _note_passing(self, side: Side, peer: Side, ack: i64, flags: i64) -> None:
        """Something of this connection waits: the packet at hand may be what it waited for."""
        if peer.stream.held is not None and flags & ACK:
            peer.stream.acknowledged(ack, self.now_ns)
        for end in (peer, side):
            if end.stream.held is not None:
                end.stream.passing(self.now_ns)
                if end.stream.ready:
                    self._chunks(end)
        # Only then the answers: the request one of them waits for may just have come out.
        self._expire_answers(peer)
        self._expire_answers(side)
