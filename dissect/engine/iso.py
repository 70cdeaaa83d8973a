"""ISO-on-TCP (RFC 1006, X.224): turns the octets of a stream into TPKTs, TPDUs and TSDUs; passes TSDUs to their protocol.

A byte passes these stages in this order:

    feed → _tpkt → _fragment → _tsdu → message → S7, S7Plus, Tls; other protocols are only named and counted

`usual` is the fast path: it takes a TPKT that contains one DT with one whole S7 PDU, and goes straight to `S7.take`.
"""

from __future__ import annotations

import struct
from typing import Final

from librt.strings import read_i64_be
from mypy_extensions import i64

from dissect.engine.connections import Connections
from dissect.engine.exchange import Exchange
from dissect.engine.findings.session_rules import judge_disconnect, judge_error_tpdu
from dissect.engine.findings.transport_rules import (
    end_stray,
    follow_stray,
    judge_confirm,
    judge_data,
    judge_expedited,
    judge_faults,
    judge_number,
    judge_order,
    note_early,
    note_large,
)
from dissect.engine.findings.ways import Way
from dissect.engine.s7 import S7
from dissect.engine.tls import Tls
from dissect.engine.transactions.connection import ISO
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Place, Side
from dissect.protocols.iso.cotp import MAX_EXPEDITED, Tpdu, parse_tpdu
from dissect.protocols.iso.foreign import identify_connect
from dissect.protocols.iso.irregular import holds_data, is_odd, odd_place, odd_said
from dissect.protocols.iso.tables import CC, CR, DR, DT, ED, ER, TPDU_TYPES
from dissect.protocols.iso.upper import (
    S7COMM,
    S7COMM_PLUS,
    SCD,
    TLS,
    UPPER_NAMES,
    classify,
    is_rdp_connect,
    is_sound,
    stated_size,
)
from dissect.protocols.s7.parameters import PROTOCOL_ID, is_request
from dissect.protocols.s7.tables import ACK, ACK_DATA, JOB, USERDATA
from dissect.wire.build import COMPILED
from dissect.wire.octets import Tally, u16, u32
from dissect.wire.text import count

#: The size of a TPKT with a DT and only the header of an S7 PDU, in octets.
LEAST: Final = 17
#: TPKT, DT and the header of an S7 PDU: the interpreted code reads them with one call.
_FUSED: Final = struct.Struct(">HHIB2xHHH")
#: The first two octets of a TPKT: version and the reserved octet.
_TPKT: Final = 0x0300
#: A DT with EOT, and the first octet of S7comm. The mask leaves out the number of the DT, which class 0 does not use.
_PLAIN: Final = 0x02F08000 | PROTOCOL_ID
_ALL_BUT_NUMBER: Final = 0xFFFF80FF
#: A TPKT with a DT without EOT and data: the frequent acknowledgement of Siemens stacks (reference 2.5). It is read by its
#: first four octets and its last four.
_EMPTY_BEGIN: Final = 0x03000007
_EMPTY_END: Final = 0x0702F000
_EMPTY_SIZE: Final = 7
#: Protocols whose TSDU counts are reported even when they are zero.
_ALWAYS: Final = frozenset(("s7comm", "s7comm_plus", "mms", "tls", "unknown"))


class IsoOnTcp(Protocol):
    """Takes octets in order; counts TPDUs by type and TSDUs by the protocol in them.

    ``s7``, ``plus`` and ``tls`` take the TSDUs of their protocols. The payload decoder, if there is one, gets them first.
    """

    def __init__(self, exchange: Exchange, connections: Connections, s7: S7, plus: Protocol, tls: Tls) -> None:
        super().__init__(ISO)
        self._exchange: Exchange = exchange
        self._connections: Connections = connections
        self._s7: S7 = s7
        self._plus: Protocol = plus
        self._tls: Tls = tls
        self._plain: bool = False  # no observer wants TPDUs and no decoder wants TSDUs; set when a connection begins
        self.tpdus: Tally = Tally(16, DT, CR)  # by type: the smallest TPKT has room for one
        self.tsdus: Tally = Tally(len(UPPER_NAMES), S7COMM, S7COMM_PLUS)

    def begin(self, side: Side, at_start: bool) -> None:
        """A connection speaks ISO-on-TCP. Garbage before its first TPKT is reported only if the capture has its beginning."""
        side.connection.protocol = ""
        self._plain = not self._exchange.observer.wants_tpdus and self._exchange.decoder is None
        peer = side.peer
        assert peer is not None
        side.framer.synced = at_start
        peer.framer.synced = side.tcp.known_start and peer.stream.octets == 0

    # ---- octets → TPKT ----------------------------------------------------------------------------------------------

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a connection: whole TPKTs directly from ``buf``, the others through the framer."""
        self._take(side, buf, at, at, at + size, frame, time_ns)

    def rest(self, side: Side, buf: bytes, at: i64, end: i64, frame: i64, time_ns: i64) -> bool:
        """Take ``buf[at:end]`` of a segment if `longest` allows `usual`; return whether `usual` and `empty` took all of it."""
        while end - at >= _EMPTY_SIZE:
            length: i64 = 0
            if self.empty(side, buf, at, frame, time_ns):
                length = _EMPTY_SIZE
            elif end - at >= LEAST:
                length = self.usual(side, buf, at, min(end - at, side.longest), frame, time_ns)
            if length == 0:
                break
            at += length
        if at == end:
            return True
        self._take(side, buf, 0, at, end, frame, time_ns)
        return False

    def _take(self, side: Side, buf: bytes, start: i64, at: i64, end: i64, frame: i64, time_ns: i64) -> None:
        """Take ``buf[at:end]``, part of the octets that begin at ``start``."""
        framer = side.framer
        if framer.pending is not None and side.stray is None:
            at = self._completed(side, buf, at, end, frame, time_ns)
        if framer.synced and framer.pending is None and framer.skip == 0:
            length: i64
            longest: i64 = -1  # not known yet
            while end - at >= 7:
                if end - at > 16 and buf[at + 7] == PROTOCOL_ID:
                    if longest < 0:
                        longest = self.longest(side)
                    length = 0
                    if longest:
                        length = self.usual(side, buf, at, min(end - at, longest), frame, time_ns)
                    if length > 0:
                        at += length
                        continue
                length = u16(buf, at + 2)
                if buf[at] != 3 or length < 7 or at + length > end:
                    break
                if buf[at + 4] != 2:
                    length = framer.alone(buf, at, end)
                    if length == 0:
                        break
                elif length > 16 and buf[at + 7] == PROTOCOL_ID:
                    if stated_size(buf, at + 7, at + length) != length - 7:
                        break
                    framer.framed += length
                elif length > 7 and not is_sound(buf, at + 7, at + length):
                    break  # not exactly one S7 PDU: the framer checks the rest of the TPKT's length
                else:
                    framer.framed += length
                at += length
                try:
                    self._tpkt(side, buf, at - length, length, frame, time_ns)
                except Exception as bug:
                    self._exchange.note_bug(bug, frame, time_ns)
                longest = -1  # the TPKT may have changed it
            if at == end:
                return
        self._frame(side, buf, at, at == start, frame, time_ns)

    def _completed(self, side: Side, buf: bytes, at: i64, end: i64, frame: i64, time_ns: i64) -> i64:
        """Take a TPKT that earlier octets began, if it is a usual one and ``buf[at:end]`` ends it; return where it ends."""
        framer = side.framer
        begun = framer.pending
        packet = framer.joined(buf, at, end)
        size: i64 = len(packet)
        if begun is None or size < LEAST:
            return at
        had: i64 = len(begun)
        framer.pending = None  # `longest` is 0 while there is one
        if size <= self.longest(side) and self.usual(side, packet, 0, size, frame, time_ns):
            framer.end_pending()
            return at + size - had
        framer.pending = begun
        return at

    def _frame(self, side: Side, buf: bytes, at: i64, at_segment_start: bool, frame: i64, time_ns: i64) -> None:
        """Take ``buf[at:]`` through the framer."""
        framer = side.framer
        begun: i64 = framer.buffered
        given: i64 = framer.framed + framer.skipped + begun
        framer.push(buf, at, at_segment_start)
        if framer.faults:
            judge_faults(self._exchange.reporter, side, frame, time_ns)
        if side.stray is not None:
            follow_stray(self._exchange.reporter, side, side.stray, frame, time_ns)
        if framer.packets:
            packets = framer.packets
            framer.packets = []
            for packet in packets:
                place = side.begun_tpkt
                try:
                    if begun and place is not None and framer.ends[0] <= given:
                        # This TPKT was complete before these octets came; they only show that its length field is wrong.
                        self._take_back(side, packet, len(packet), place, True)
                    else:
                        self._tpkt(side, packet, 0, len(packet), frame, time_ns)
                except Exception as bug:
                    self._exchange.note_bug(bug, frame, time_ns)
                del framer.ends[0]
        if framer.buffered:
            side.begun_tpkt = side.note_place(side.begun_tpkt, frame, time_ns)

    def longest(self, side: Side) -> i64:
        """Return the size in octets of the longest TPKT of ``side`` that `usual` may take next, 0 for none.

        `usual` may be called while the stream is between two TPKTs, no observer wants TPDUs, no decoder wants TSDUs, no TSDU is
        being assembled and nothing is decrypted. A TPKT that `usual` takes changes none of these conditions.
        """
        framer = side.framer
        connection = side.connection
        if (
            not self._plain
            or not framer.synced
            or framer.pending is not None
            or framer.skip
            or not side.assembler.clear
            or connection.tls is not None
            or connection._state != ISO
            or connection._dt_limit < 0
        ):
            return 0
        return connection._dt_limit + 4

    def usual(self, side: Side, buf: bytes, at: i64, most: i64, frame: i64, time_ns: i64) -> i64:
        """Take the TPKT at ``at`` if it is an ordinary one (a DT with EOT and one whole S7 PDU); return its size.

        Return 0, and do nothing, if it is different or has more than ``most`` octets. At least 17 octets must be available.
        This skips `_tpkt`, `_tsdu` and `message`, which would only count if `longest` allows it.
        """
        length: i64
        number: i64
        rosctr: i64
        pdu_ref: i64
        param_length: i64
        stated: i64
        if COMPILED:
            # Two reads: up to the protocol id of the PDU, and from the octet after its ROSCTR to the end of its header.
            head: i64 = read_i64_be(buf, at)
            if head & _ALL_BUT_NUMBER != _PLAIN or head >> 48 != _TPKT:
                return 0
            number = head >> 8 & 0x7F
            length = head >> 32 & 0xFFFF
            rosctr = buf[at + 8]
            head = read_i64_be(buf, at + 9)
            pdu_ref = head >> 32 & 0xFFFF
            param_length = head >> 16 & 0xFFFF
            stated = param_length + (head & 0xFFFF)
        else:
            version, length, tpdu, rosctr, pdu_ref, param_length, stated = _FUSED.unpack_from(buf, at)
            if version != _TPKT or tpdu & _ALL_BUT_NUMBER != _PLAIN:
                return 0
            number = tpdu >> 8 & 0x7F
            stated += param_length
        stated += 17
        if rosctr == ACK_DATA or rosctr == ACK:  # `header_size`, inlined
            stated += 2
        if stated != length or length > most or rosctr < JOB or (rosctr > ACK_DATA and rosctr != USERDATA):
            return 0
        side.framer.framed += length
        self.tpdus.often_count += 1
        self.tsdus.often_count += 1
        try:
            if number and not side.numbers_fine:
                self._numbered(side, number, buf, at + 7, frame, time_ns)
            self._s7.take(side, rosctr, pdu_ref, param_length, buf, at + 7, length - 7, frame, time_ns)
        except Exception as bug:
            self._exchange.note_bug(bug, frame, time_ns)
        return length

    def empty(self, side: Side, buf: bytes, at: i64, frame: i64, time_ns: i64) -> bool:
        """Count the TPKT at ``at`` if it is a DT that has neither EOT nor data; else return False.

        Seven octets must be available. Such a DT neither begins nor ends a TSDU. Call this only where `longest` allows `usual`.
        """
        if u32(buf, at + 3) != _EMPTY_END or u32(buf, at) != _EMPTY_BEGIN:
            return False
        side.framer.framed += _EMPTY_SIZE
        self.tpdus.often_count += 1
        if side.connection.open_requests[1 - side.index].count:
            note_early(self._exchange.reporter, side, frame, time_ns)
        return True

    def _take_back(self, side: Side, buf: bytes, size: i64, place: Place, tpkt: bool) -> None:
        """Take a TPKT (``tpkt``) or a TSDU that an earlier packet completed, with the numbers and time of that packet.

        ``place`` is that packet. Only later octets showed where the TPKT or TSDU ends.
        """
        end_seq: i64 = side.end_seq
        ack: i64 = side.last_ack
        side.end_seq = place.end_seq
        side.last_ack = place.ack
        try:
            if tpkt:
                self._tpkt(side, buf, 0, size, place.frame, place.time_ns)
            else:
                self._tsdu(side, buf, 0, size, place.frame, place.time_ns)
        finally:
            side.end_seq = end_seq
            side.last_ack = ack

    # ---- TPKT → TSDU ------------------------------------------------------------------------------------------------

    def _tpkt(self, side: Side, buf: bytes, at: i64, length: i64, frame: i64, time_ns: i64) -> None:
        exchange = self._exchange
        if exchange.observer.wants_tpdus:
            exchange.observer.tpdu(frame, time_ns, side, buf[at : at + length])
        if buf[at + 1] != 0:
            self._note_reserved(side, buf[at + 1], frame, time_ns)
        if buf[at + 4] == 2 and buf[at + 5] == 0xF0:  # DT of class 0
            self.tpdus.often_count += 1
            if length - 4 > side.connection._dt_limit:
                if judge_data(exchange.reporter, side, length - 4, frame, time_ns) and is_request(
                    buf[at + 7 : at + length]
                ):
                    exchange.causes.blame(side.connection, exchange.dialogue.count + 1, "cotp.size_exceeded")
            if buf[at + 6] & 0x7F and not side.numbers_fine:
                self._numbered(side, buf[at + 6] & 0x7F, buf, at + 7, frame, time_ns)
            if buf[at + 6] >= 0x80 and side.assembler.clear:
                self._tsdu(side, buf, at + 7, length - 7, frame, time_ns)
            else:
                self._fragment(side, buf[at + 7 : at + length], buf[at + 6] >= 0x80, frame, time_ns)
        else:
            octets = buf[at + 4 : at + length]
            self._other_tpdu(side, parse_tpdu(octets), octets, frame, time_ns)

    def _numbered(self, side: Side, number: i64, buf: bytes, at: i64, frame: i64, time_ns: i64) -> None:
        """Take note of a numbered DT; its data begin at ``at``."""
        exchange = self._exchange
        judge_number(exchange.reporter, side, number, frame, time_ns)
        if side.numbers_fine or (len(buf) > at + 1 and buf[at + 1] == ACK_DATA):
            return
        way = self._sent(side, "cotp.number_unanswered", "sent in a numbered TPDU", buf[at : at + 16], frame, time_ns)
        side.numbers_fine = way is not None and way.fine

    def _sent(self, side: Side, slug: str, said: str, octets: bytes, frame: i64, time_ns: i64) -> Way | None:
        """A message is sent in a way that some devices do not accept: if it is a request, that may be why it stays unanswered.

        Return that way, None for any other message.
        """
        if len(octets) < 2 or octets[0] != PROTOCOL_ID or not is_request(octets):
            return None
        exchange = self._exchange
        waited: bool = exchange.causes.waits(side.connection)
        way = exchange.causes.sent(side, slug, said, exchange.dialogue.count + 1, frame, time_ns)
        if not waited and exchange.causes.waits(side.connection):
            exchange.dialogue.holding.append(side)  # findings may wait from now on, so the timers have to run
        return way

    def _fragment(self, side: Side, data: bytes, eot: bool, frame: i64, time_ns: i64) -> None:
        begun: bool = not side.assembler.clear
        overflows: i64 = side.assembler.overflows
        tsdu = side.assembler.push(data, eot)
        if not eot:
            if data:
                side.begun_tsdu = side.note_place(side.begun_tsdu, frame, time_ns)
            elif not begun and side.connection.open_requests[1 - side.index].count:
                note_early(self._exchange.reporter, side, frame, time_ns)
        if side.assembler.overflows > overflows:
            who = side.tcp.ends[side.index]
            self._exchange.reporter.note("cotp.tsdu_too_long", side.connection.number, [frame], time_ns, f"from {who}")
        if begun and eot and is_sound(data, 0, len(data)):
            self.end_of_parts(side, tsdu, data, "cotp.unfinished_tsdu", frame, time_ns)
        elif tsdu is not None:
            if data and len(tsdu) > len(data):
                note_large(side, len(tsdu))
                self._sent(side, "cotp.fragments_unanswered", "sent in several TPDUs", tsdu, frame, time_ns)
            self._tsdu(side, tsdu, 0, len(tsdu), frame, time_ns)

    def end_of_parts(self, side: Side, tsdu: bytes | None, data: bytes, slug: str, frame: i64, time_ns: i64) -> None:
        """Take the last part of a message as a PDU if it is a sound one by itself, unless the whole message is sound as well.

        ``tsdu`` is the whole message, None if it was dropped; ``data`` its last part. ``slug`` is the finding to report.
        """
        if tsdu is not None and is_sound(tsdu, 0, len(tsdu)):
            self._tsdu(side, tsdu, 0, len(tsdu), frame, time_ns)
            return
        before: i64 = 0
        if tsdu is not None:
            before = len(tsdu) - len(data)
        detail = f"from {side.tcp.ends[side.index]}: a complete PDU follows it"
        self._exchange.reporter.note(slug, side.connection.number, [frame], time_ns, detail)
        if tsdu is not None and is_sound(tsdu, 0, before):
            # The earlier parts are a sound PDU too: only its end mark (EOT) was missing.
            place = side.begun_tsdu
            if place is not None:
                self._take_back(side, tsdu[:before], before, place, False)
            else:
                self._tsdu(side, tsdu, 0, before, frame, time_ns)
        else:
            side.assembler.dropped += before
        self._tsdu(side, data, 0, len(data), frame, time_ns)

    def _odd_data(self, side: Side, tpdu: Tpdu, octets: bytes, place: i64, frame: i64, time_ns: i64) -> None:
        """Report a DT that is malformed, or whose length indicator does not fit class 0; it neither begins nor ends a TSDU.

        ``place`` is where a whole PDU begins in it, -1 for none.
        """
        self._note_malformed(side, f"DT: {odd_said(tpdu, octets)}", frame, time_ns)
        if place >= 0:
            self._tsdu(side, octets, place, len(octets) - place, frame, time_ns)
        else:
            side.assembler.dropped += len(tpdu.data)

    def _behind(self, side: Side, tpdu: Tpdu, octets: bytes, place: i64, frame: i64, time_ns: i64) -> None:
        """Take a whole PDU, from ``place`` on, behind a header that does not fit a class 0 DT."""
        plus: bool = octets[place] != PROTOCOL_ID
        name = "S7comm-plus" if plus else "S7comm"
        said = f"{tpdu.name}: {tpdu.malformed[0]}; behind it {name}, {count(len(octets) - int(place), 'byte')}"
        self._note_malformed(side, said, frame, time_ns)
        connection = side.connection
        if connection.protocol == "":
            connection.protocol = UPPER_NAMES[S7COMM_PLUS if plus else S7COMM]
        connection.behind += 1
        (self._plus if plus else self._s7).behind(side, octets[place:], frame, time_ns)
        self._exchange.completed(None, frame, time_ns)

    def _note_malformed(self, side: Side, said: str, frame: i64, time_ns: i64) -> None:
        self._exchange.reporter.note("cotp.malformed", side.connection.number, [frame], time_ns, said)

    def _other_tpdu(self, side: Side, tpdu: Tpdu, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take any TPDU except the plain DT; ``octets`` are the whole TPDU."""
        reporter = self._exchange.reporter
        connection = side.connection
        type_: i64 = tpdu.type
        self.tpdus.add(type_)
        connecting: bool = (type_ == CR or type_ == CC) and not connection.established
        if connecting and tpdu.variable and is_rdp_connect(tpdu.variable):
            self._connections.foreign.take(side, "rdp", frame, time_ns, identify_connect(tpdu.variable))
            return
        place: i64 = odd_place(tpdu, octets, connection.class_)
        if place >= 0 and not holds_data(octets):
            self._behind(side, tpdu, octets, place, frame, time_ns)
            return
        if is_odd(tpdu, octets, connection.class_):
            self._odd_data(side, tpdu, octets, place, frame, time_ns)
            return
        if tpdu.malformed:
            self._note_malformed(side, f"{tpdu.name}: {tpdu.malformed[0]}", frame, time_ns)
        else:
            judge_order(reporter, side, type_, frame, time_ns)
        if type_ == DT:
            self._fragment(side, tpdu.data, tpdu.field("eot") == 1, frame, time_ns)
        elif type_ == CR:
            self._connect_request(side, tpdu, frame, time_ns)
        elif type_ == CC:
            asking = side.peer
            seen: bool = asking is not None and asking.stream.octets > 0 and asking.holes == 0
            if not connection.cr_seen and not connection.mid_stream and seen:
                reporter.note("cotp.answer_without_request", connection.number, [frame], time_ns)
            judge_confirm(reporter, side, tpdu, frame, time_ns)
            if not (tpdu.malformed and connection.established):
                connection._note_cc(side.index, tpdu, frame)
        elif type_ == DR:
            judge_disconnect(reporter, side, tpdu, self._connections.table, frame, time_ns)
            if connection.refused:
                self._connections.scans.refused(connection, time_ns)
        elif type_ == ER:
            judge_error_tpdu(reporter, side, tpdu, frame, time_ns)
        elif type_ == ED and len(tpdu.data) > MAX_EXPEDITED:
            judge_expedited(reporter, side, len(tpdu.data), frame, time_ns)

    def _connect_request(self, side: Side, tpdu: Tpdu, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        if tpdu.malformed and connection.established:
            return  # reported already; a damaged CR does not begin another connection
        if connection.established and (connection.cr_seen or connection.tpdu_size == 0):
            # Another transport connection begins; the TCP close and open in between were not captured. (A CC before this CR,
            # with no CR so far, belongs to the same connection: the packets are out of order.)
            self._connections.replace(side, frame, time_ns)
            connection = side.connection
        elif connection.cr_seen:
            self._exchange.reporter.note("cotp.repeated_request", connection.number, [frame], time_ns)
        connection.mid_stream = False
        connection._note_cr(side.index, tpdu, frame)
        self._connections.scans.asked(connection, frame, time_ns)

    def _tsdu(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        decoder = self._exchange.decoder
        if decoder is not None and decoder.tsdu(side, buf[at : at + size], frame, time_ns):
            self.tsdus.add(SCD)
            return
        self.message(side, buf, at, size, frame, time_ns)

    def message(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take a whole message, which is a TSDU or comes from an IBH-NetLink packet: pass it to its protocol."""
        session = side.connection.tls
        if session is not None and self._tls.wants(side, session, buf, at, size):
            self.tsdus.add(TLS)
            self._tls.feed(side, buf, at, size, frame, time_ns)
            return
        if size >= 10 and buf[at] == 0x32 and 1 <= buf[at + 1] <= 7:
            self.tsdus.often_count += 1
            self._s7.feed(side, buf, at, size, frame, time_ns)
            return
        upper: i64 = classify(buf, at, at + size)
        self.tsdus.add(upper)
        if upper == S7COMM:
            self._s7.feed(side, buf, at, size, frame, time_ns)
        elif upper == S7COMM_PLUS:
            self._plus.feed(side, buf, at, size, frame, time_ns)
        elif upper == TLS:
            self._tls.feed(side, buf, at, size, frame, time_ns)
        else:
            self._connections.foreign.tsdu(side, upper, buf, at, size, frame, time_ns)

    # ---- gaps and cut packets ---------------------------------------------------------------------------------------

    def gap(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """Take note that ``size`` octets are missing here; ``cut``: the capture cut them off a packet (snaplen)."""
        reporter = self._exchange.reporter
        inside = side.framer.hole(size, cut)
        if cut and len(side.framer.cut_packet) > 7:
            self._cut_tpkt(side, side.framer.cut_packet, frame, time_ns)
        side.framer.cut_packet = b""
        number = side.connection.number
        if not cut:
            where = "inside a TPKT" if inside else "between TPKTs"
            detail = f"{size} bytes from {side.tcp.ends[side.index]}, {where}"
            reporter.note("stream.hole", number, [frame], time_ns, detail)
        if side.assembler.parts is not None:
            side.assembler.abandon()
            lost = "the capture truncated one of its packets" if cut else "bytes were lost"
            reporter.note("cotp.unfinished_tsdu", number, [frame], time_ns, lost)
        self._tls.gap(side, size, cut, frame, time_ns)
        self._plus.gap(side, size, cut, frame, time_ns)

    def _cut_tpkt(self, side: Side, packet: bytes, frame: i64, time_ns: i64) -> None:
        """Take a TPKT that the capture cut off: an S7 header that is still there shows the request or response."""
        if packet[4] != 2 or packet[5] != 0xF0 or packet[6] < 0x80 or side.assembler.parts is not None:
            return
        pdu = packet[7:]
        if len(pdu) < 10 or (pdu[0] != 0x32 and pdu[0] != 0x72):
            return
        self.tpdus.add(DT)
        self.cut(side, pdu, frame, time_ns)

    def cut(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the beginning of an S7comm or S7comm-plus message whose rest the capture cut off."""
        plus: bool = octets[0] == 0x72
        self.tsdus.add(S7COMM_PLUS if plus else S7COMM)
        (self._plus if plus else self._s7).cut(side, octets, frame, time_ns)

    def _note_reserved(self, side: Side, value: i64, frame: i64, time_ns: i64) -> None:
        who = side.tcp.ends[side.index]
        detail = f"0x{value:02x} from {who}"
        self._exchange.reporter.note("tpkt.reserved", side.connection.number, [frame], time_ns, detail)

    # ---- the end ----------------------------------------------------------------------------------------------------

    def finish(self, side: Side, frame: i64, time_ns: i64) -> None:
        """Nothing more comes from ``side``: let `Tls` and `S7Plus` use what they have of unfinished messages."""
        self._tls.finish(side, frame, time_ns)
        self._plus.finish(side, frame, time_ns)

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """Report an unfinished TSDU and TPKT of ``side``, and TLS that was not decrypted."""
        who = side.tcp.ends[side.index]
        reporter = self._exchange.reporter
        if side.assembler.parts is not None:
            side.assembler.abandon()
            reporter.note("cotp.unfinished_tsdu", side.connection.number, [frame], time_ns, f"from {who}")
        self._tls.end(side, frame, time_ns)
        end_stray(reporter, side)
        if side.framer.buffered:
            detail = f"{side.framer.buffered} bytes from {who}"
            reporter.note("tpkt.unfinished", side.connection.number, [frame], time_ns, detail)

    def held(self, side: Side) -> i64:
        """Return how many octets of ``side`` are kept for an unfinished TPKT, TSDU, TLS record and PDU."""
        parts = side.assembler.parts
        return (
            super().held(side) + (len(parts) if parts is not None else 0) + self._plus.held(side) + self._tls.held(side)
        )

    # ---- what was counted -------------------------------------------------------------------------------------------

    def describe(self) -> dict[str, object]:
        """Return the sections ``tsdus`` and ``tpdus``."""
        named = zip(UPPER_NAMES, self.tsdus.counts(), strict=True)
        return {
            "tsdus": {name: count for name, count in named if count or name in _ALWAYS},
            "tpdus": {TPDU_TYPES.name(code): count for code, count in enumerate(self.tpdus.counts()) if count},
        }
