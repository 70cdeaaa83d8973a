"""From octets in order to transactions: TPKT, TPDU, TSDU, S7 PDU, and what they mean for their connection.

`Conversation` is the upper half of the path; `dissect.engine.pipeline` is the lower one and tells where it leads. The methods stand
in the order in which a byte passes them; the last ones are those of `Exchange`:

    octets → _tpkt → _tsdu → _pdu → _ask / _answered → done
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.observer import Observer, Options
from dissect.engine.plus import PlusExchange
from dissect.findings.scan_rules import ScanWatch
from dissect.findings.session_rules import judge_cut, judge_disconnect, judge_end, judge_error_tpdu
from dissect.findings.transport_rules import judge_confirm, judge_data, judge_number, judge_order
from dissect.iso.cotp import Tpdu, parse_tpdu
from dissect.iso.foreign import identify, identify_connect
from dissect.iso.recognition import HERE, OTHER, PROBES, WITHIN, raw_protocol, recognise
from dissect.iso.tables import CC, CR, DR, DT, ER
from dissect.iso.tpkt import BAD_VERSION, HIDING
from dissect.iso.upper import (
    RDP,
    S7COMM,
    S7COMM_PLUS,
    SCD,
    TLS,
    UNKNOWN,
    UPPER_NAMES,
    classify,
    is_rdp_connect,
    is_sound,
    stated_size,
)
from dissect.tcp.stream import MASK
from dissect.transactions.connection import CARRIED, FOREIGN, ISO, ISO_TSAP_PORT, Connection
from dissect.transactions.ending import Ending
from dissect.transactions.payloads import Backlog
from dissect.transactions.table import Side
from dissect.transactions.transaction import CONNECTION_CLOSED
from dissect.wire.octets import u16

__all__ = ["Conversation", "Observer", "Options"]


class Conversation(PlusExchange):
    """Octets of known connections in, transactions and findings out; counts TPDUs, TSDUs and PDUs on the way."""

    def __init__(self, observer: Observer, options: Options) -> None:
        super().__init__(observer, options)
        self.connections: i64 = 0
        self.scans: ScanWatch = ScanWatch(self.judge)
        self.tpdus: list[int] = [0] * 17  # by type, the last for TPDUs too short to have one
        self.tsdus: list[int] = [0] * len(UPPER_NAMES)
        self._named: set[int] = set()  # (connection, protocol) pairs of which a foreign protocol was told

    # ---- is it ISO-on-TCP? ------------------------------------------------------------------------------------------

    def probe(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Look at octets of a connection not known yet: does it speak ISO-on-TCP."""
        connection = side.connection
        size: i64 = len(octets)
        at_start: bool = side.tcp.known_start and (side.end_seq - size) & MASK == side.stream.start_seq
        found: i64 = recognise(octets, at_start, self.on_102(side), connection.probed)
        if found == HERE or found == WITHIN:
            # Garbage before the first TPKT is told only when it is certain that nothing was missed.
            self._open(side, found == HERE or at_start, frame, time_ns)
            self.octets(side, octets, frame, time_ns)
            return
        connection.probed += 1
        if connection.protocol == "":
            raw: i64 = raw_protocol(octets)
            connection.protocol = UPPER_NAMES[raw]
            connection.identified_by = identify(raw, octets, 0, len(octets))
        if found == OTHER:
            self._give_to_others(side, connection.protocol, frame, time_ns)
        side.framer.skipped += size

    def end_unrecognised(self, side: Side, frame: i64, time_ns: i64) -> None:
        """A connection is over and was never recognised: on port 102 that is worth saying, unless little of it was seen."""
        if side.tcp.known_start or side.connection.probed >= PROBES:
            self._give_to_others(side, side.connection.protocol, frame, time_ns)

    def follow(self, side: Side, transport: str, at_start: bool) -> bool:
        """Open a conversation over ``tcp`` or ``udp`` for the carrier if it claims it; ``at_start``: its first octets."""
        connection = side.connection
        carrier = self.carrier
        if carrier is None or not carrier.claims_port(transport, connection):
            return False
        connection.state = CARRIED
        self.connections += 1
        connection.number = self.connections
        side.backlog = Backlog()
        peer = side.peer
        assert peer is not None
        peer.backlog = Backlog()
        side.framer.synced = at_start
        peer.framer.synced = side.tcp.known_start and peer.stream.octets == 0
        self.observer.connection_opened(connection)
        return True

    def carried_octets(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a connection that a carrier follows."""
        carrier = self.carrier
        assert carrier is not None
        try:
            carrier.stream(side, octets, frame, time_ns)
        except Exception as bug:
            if self._strict:
                raise
            self.note_bug(bug, frame, time_ns)

    def on_102(self, side: Side) -> bool:
        """Tell whether a connection uses the port that ISO-on-TCP is registered on."""
        ends = side.tcp.ends
        return ends[0].port == ISO_TSAP_PORT or ends[1].port == ISO_TSAP_PORT

    def _open(self, side: Side, in_step: bool, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        connection.state = ISO
        connection.protocol = ""
        self.connections += 1
        connection.number = self.connections
        peer = side.peer
        assert peer is not None
        side.framer.synced = in_step
        peer.framer.synced = side.tcp.known_start and peer.stream.octets == 0
        self.observer.connection_opened(connection)

    def _give_to_others(self, side: Side, protocol: str, frame: i64, time_ns: i64, identity: str = "") -> None:
        """Another protocol: its packets are counted from now on, nothing more. ``identity`` says what tells it."""
        connection = side.connection
        connection.state = FOREIGN
        connection.protocol = protocol
        connection.identified_by = identity or connection.identified_by
        if self.on_102(side):
            detail = f"{protocol}: {connection.identified_by}" if connection.identified_by else protocol
            self.judge.note("session.foreign_on_102", connection.number, [frame], time_ns, detail)

    # ---- octets → TPKT ----------------------------------------------------------------------------------------------

    def octets(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a connection that speaks ISO-on-TCP, or did."""
        framer = side.framer
        at: i64 = 0
        end: i64 = len(octets)
        if framer.synced and framer.pending is None and framer.skip == 0:
            while end - at >= 7 and octets[at] == 3:
                length: i64 = u16(octets, at + 2)
                if length < 7 or at + length > end:
                    break
                if octets[at + 4] != 2 or (length > 7 and stated_size(octets, at + 7, at + length) != length - 7):
                    break  # not simply one S7 PDU: what else its length covers is for the framer to see
                framer.framed += length
                at += length
                try:
                    self._tpkt(side, octets, at - length, length, frame, time_ns)
                except Exception as bug:
                    if self._strict:
                        raise
                    self.note_bug(bug, frame, time_ns)
            if at:
                side.garbage = False
            if at == end:
                return
        if side.connection.state == FOREIGN:
            framer.skipped += end - at
            return
        skipped: i64 = framer.skipped
        framer.push(octets, at, at == 0)
        if framer.faults:
            self._faults(side, framer.skipped - skipped, frame, time_ns)
        if framer.synced:
            side.garbage = False
        if framer.packets:
            packets = framer.packets
            framer.packets = []
            for packet in packets:
                try:
                    self._tpkt(side, packet, 0, len(packet), frame, time_ns)
                except Exception as bug:
                    if self._strict:
                        raise
                    self.note_bug(bug, frame, time_ns)
                del framer.ends[0]

    def _faults(self, side: Side, skipped: i64, frame: i64, time_ns: i64) -> None:
        number = side.connection.number
        who = side.tcp.ends[side.index]
        for fault in side.framer.faults:
            if fault.kind == BAD_VERSION:
                if not side.garbage:
                    detail = f"{skipped} octets from {who}, first 0x{fault.value:02x}"
                    self.judge.note("tpkt.garbage", number, [frame], time_ns, detail)
                side.garbage = True
            elif fault.kind == HIDING:
                detail = f"length {fault.value} from {who}"
                self.judge.note("tpkt.false_length", number, [frame], time_ns, detail)
            else:
                self.judge.note("tpkt.bad_length", number, [frame], time_ns, f"length {fault.value} from {who}")
        side.framer.faults = []

    # ---- TPKT → TSDU ------------------------------------------------------------------------------------------------

    def _tpkt(self, side: Side, buf: bytes, at: i64, length: i64, frame: i64, time_ns: i64) -> None:
        if self.observer.wants_tpdus:
            self.observer.tpdu(frame, time_ns, side, buf[at : at + length])
        if buf[at + 1] != 0:
            self._note_reserved(side, buf[at + 1], frame, time_ns)
        if buf[at + 4] == 2 and buf[at + 5] == 0xF0:  # DT of class 0
            self.tpdus[DT] = self.tpdus[DT] + 1
            if length - 4 > side.connection.dt_limit:
                judge_data(self.judge, side, length - 4, frame, time_ns)
            if buf[at + 6] & 0x7F:
                judge_number(self.judge, side, buf[at + 6] & 0x7F, frame, time_ns)
            if buf[at + 6] >= 0x80 and side.assembler.parts is None and side.assembler.clear:
                self._tsdu(side, buf, at + 7, length - 7, frame, time_ns)
            else:
                self._fragment(side, buf[at + 7 : at + length], buf[at + 6] >= 0x80, frame, time_ns)
        else:
            octets = buf[at + 4 : at + length]
            self._other_tpdu(side, parse_tpdu(octets), octets, frame, time_ns)

    def _fragment(self, side: Side, data: bytes, eot: bool, frame: i64, time_ns: i64) -> None:
        begun: bool = not side.assembler.clear
        overflows: i64 = side.assembler.overflows
        tsdu = side.assembler.push(data, eot)
        if side.assembler.overflows > overflows:
            who = side.tcp.ends[side.index]
            self.judge.note("cotp.tsdu_too_long", side.connection.number, [frame], time_ns, f"from {who}")
        if begun and eot and is_sound(data, 0, len(data)):
            self._end_of_parts(side, tsdu, data, "cotp.unfinished_tsdu", frame, time_ns)
        elif tsdu is not None:
            self._tsdu(side, tsdu, 0, len(tsdu), frame, time_ns)

    def _end_of_parts(self, side: Side, tsdu: bytes | None, data: bytes, slug: str, frame: i64, time_ns: i64) -> None:
        """The last part of a TSDU is a sound PDU by itself: it counts alone, unless the whole is sound as well."""
        if tsdu is not None and is_sound(tsdu, 0, len(tsdu)):
            self._tsdu(side, tsdu, 0, len(tsdu), frame, time_ns)
            return
        before: i64 = len(tsdu) - len(data) if tsdu is not None else 0
        detail = f"from {side.tcp.ends[side.index]}: what follows it is a whole PDU"
        self.judge.note(slug, side.connection.number, [frame], time_ns, detail)
        if tsdu is not None and is_sound(tsdu, 0, before):
            self._tsdu(side, tsdu, 0, before, frame, time_ns)  # only its end mark was missing
        else:
            side.assembler.dropped += before
        self._tsdu(side, data, 0, len(data), frame, time_ns)

    def _odd_data(self, side: Side, tpdu: Tpdu, octets: bytes, frame: i64, time_ns: i64) -> None:
        """A DT with a length indicator that its class does not have: it begins and ends nothing.

        A PDU counts that is sound where class 0 has it, or else where the length indicator says.
        """
        size: i64 = len(octets)
        what = str(tpdu.malformed[0]) if tpdu.malformed else f"length indicator {octets[0]}, class 0 has 2"
        self.judge.note("cotp.malformed", side.connection.number, [frame], time_ns, f"DT: {what}")
        if size > 3 and octets[2] >= 0x80 and is_sound(octets, 3, size):
            self._tsdu(side, octets, 3, size - 3, frame, time_ns)
        elif is_sound(tpdu.data, 0, len(tpdu.data)):
            self._tsdu(side, tpdu.data, 0, len(tpdu.data), frame, time_ns)
        else:
            side.assembler.dropped += len(tpdu.data)

    def _other_tpdu(self, side: Side, tpdu: Tpdu, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Any TPDU but the plain DT; ``octets`` are all of it."""
        connection = side.connection
        type_: i64 = tpdu.type
        self.tpdus[type_ if 0 <= type_ < 16 else 16] += 1
        connecting: bool = (type_ == CR or type_ == CC) and not connection.established
        if connecting and tpdu.variable and is_rdp_connect(tpdu.variable):
            self._give_to_others(side, "rdp", frame, time_ns, identify_connect(tpdu.variable))
            return
        if type_ == DT and (tpdu.malformed or (octets[0] != 2 and self._is_class_0(connection, octets))):
            self._odd_data(side, tpdu, octets, frame, time_ns)
            return
        if tpdu.malformed:
            self.judge.note("cotp.malformed", connection.number, [frame], time_ns, f"{tpdu.name}: {tpdu.malformed[0]}")
        else:
            judge_order(self.judge, side, type_, frame, time_ns)
        if type_ == DT:
            self._fragment(side, tpdu.data, tpdu.field("eot") == 1, frame, time_ns)
        elif type_ == CR:
            self._connect_request(side, tpdu, frame, time_ns)
        elif type_ == CC:
            asking = side.peer
            seen: bool = asking is not None and asking.stream.octets > 0 and asking.holes == 0
            if not connection.cr_seen and not connection.mid_stream and seen:
                self.judge.note("cotp.answer_without_request", connection.number, [frame], time_ns)
            judge_confirm(self.judge, side, tpdu, frame, time_ns)
            if not (tpdu.malformed and connection.established):
                connection.note_cc(side.index, tpdu)
        elif type_ == DR:
            judge_disconnect(self.judge, side, tpdu, frame, time_ns)
            if connection.refused:
                self.scans.refused(connection, time_ns)
        elif type_ == ER:
            judge_error_tpdu(self.judge, side, tpdu, frame, time_ns)

    def _is_class_0(self, connection: Connection, octets: bytes) -> bool:
        """Tell whether a DT is one of class 0: by the connect confirm, and where that is missing, by what it holds."""
        if connection.class_ >= 0:
            return connection.class_ == 0
        return len(octets) > 3 and octets[2] >= 0x80 and is_sound(octets, 3, len(octets))

    def _connect_request(self, side: Side, tpdu: Tpdu, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        if tpdu.malformed and connection.established:
            return  # told already; what is damaged begins nothing anew
        if connection.established and (connection.cr_seen or connection.tpdu_size == 0):
            # The TCP close and open in between were not captured: what follows is another transport connection.
            # (With a CC seen before its CR it is the same one: packets out of order.)
            self._replace_connection(side, frame, time_ns)
            connection = side.connection
        elif connection.cr_seen:
            self.judge.note("cotp.repeated_request", connection.number, [frame], time_ns)
        connection.mid_stream = False
        connection.note_cr(side.index, tpdu)
        self.scans.asked(connection, frame, time_ns)

    def _replace_connection(self, side: Side, frame: i64, now_ns: i64) -> None:
        peer = side.peer
        assert peer is not None
        old = side.connection
        old.closed_reason = "replaced"
        self.end(side, CONNECTION_CLOSED, frame, now_ns)
        self.connections += 1
        connection = Connection(self.connections, side.tcp)
        connection.state = ISO
        connection.told = old.told  # of the octets that are still on their way
        for end in (side, peer):
            end.connection = connection
            end.requests = 0
        self.observer.connection_opened(connection)

    def _tsdu(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        if self.carrier is not None and self.carrier.tsdu(side, buf[at : at + size], frame, time_ns):
            self.tsdus[SCD] += 1
            return
        upper: i64 = (
            S7COMM if size >= 10 and buf[at] == 0x32 and 1 <= buf[at + 1] <= 7 else classify(buf, at, at + size)
        )
        self.tsdus[upper] = self.tsdus[upper] + 1
        if upper == S7COMM:
            self._pdu(side, buf, at, size, frame, time_ns)
        elif upper == S7COMM_PLUS:
            self.plus_frame(side, buf[at : at + size], frame, time_ns)
        else:
            self._other_tsdu(side, upper, buf, at, size, frame, time_ns)

    def _other_tsdu(self, side: Side, upper: i64, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """What is not S7 is named and counted; on port 102 that is said once for a protocol and connection."""
        connection = side.connection
        name = UPPER_NAMES[upper]
        if name == "empty" or connection.protocol == name:
            return
        key: i64 = connection.number * len(UPPER_NAMES) + upper
        fresh: bool = connection.protocol == "" or connection.protocol == UPPER_NAMES[UNKNOWN]
        if not fresh and key in self._named:
            return
        identity = identify(upper, buf, at, at + size)
        if upper == RDP and connection.pdus == 0:
            self._give_to_others(
                side, name, frame, time_ns, identity
            )  # what it says besides TPKTs is no fault of framing
            return
        if fresh:
            connection.protocol = name
            connection.identified_by = identity
        if (upper == UNKNOWN and side.holes) or key in self._named:
            return  # the rest of a message whose beginning is missing, or told before
        self._named.add(key)
        if upper == TLS and connection.protocol == UPPER_NAMES[S7COMM_PLUS]:
            after = "InitSSL" if connection.identified_by == "InitSSL" else "S7comm-plus"
            connection.identified_by = f"{after}, then {identity}"
            identity = f"{identity}, after {after}"
        if self.on_102(side):
            detail = f"{name}: {identity}" if identity else name
            self.judge.note("session.foreign_on_102", connection.number, [frame], time_ns, detail)

    # ---- what is irregular ------------------------------------------------------------------------------------------

    def hole(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """Take note of ``size`` octets missing here; ``cut``: the capture cut them off a packet."""
        side.holes += 1
        side.missing += size
        side.hole_frame = frame
        if side.backlog is not None:
            self._carried_hole(side, size, cut, frame, time_ns)
            return
        inside = side.framer.hole(size, cut)
        if cut and len(side.framer.cut_packet) > 7:
            self._cut_tpkt(side, side.framer.cut_packet, frame, time_ns)
        side.framer.cut_packet = b""
        if side.connection.state == ISO and not cut:
            number = side.connection.number
            where = "inside a TPKT" if inside else "between TPKTs"
            self.judge.note(
                "stream.hole", number, [frame], time_ns, f"{size} octets from {side.tcp.ends[side.index]}, {where}"
            )
        if side.assembler.parts is not None:
            side.assembler.abandon()
            lost = "the capture cut a packet of it" if cut else "octets were lost"
            self.judge.note("cotp.unfinished_tsdu", side.connection.number, [frame], time_ns, lost)
        self.finish_plus(side, frame, time_ns)

    def _carried_hole(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        if not cut:
            detail = f"{size} octets from {side.tcp.ends[side.index]}"
            self.judge.note("stream.hole", side.connection.number, [frame], time_ns, detail)
        if self.carrier is not None:
            self.carrier.hole(side, size, frame, time_ns)

    def _cut_tpkt(self, side: Side, packet: bytes, frame: i64, time_ns: i64) -> None:
        """A TPKT the capture cut: an S7 header that is there still tells what was asked or answered."""
        if packet[4] != 2 or packet[5] != 0xF0 or packet[6] < 0x80 or side.assembler.parts is not None:
            return
        pdu = packet[7:]
        if len(pdu) < 10 or (pdu[0] != 0x32 and pdu[0] != 0x72):
            return
        self.tpdus[DT] = self.tpdus[DT] + 1
        if pdu[0] == 0x72:
            self.tsdus[S7COMM_PLUS] += 1
            self.finish_plus(side, frame, time_ns)
            self.plus_pdu(side, pdu, True, frame, time_ns)
            return
        self.tsdus[S7COMM] += 1
        self.cut_pdu(side, pdu, frame, time_ns)

    def _note_reserved(self, side: Side, value: i64, frame: i64, time_ns: i64) -> None:
        who = side.tcp.ends[side.index]
        self.judge.note("tpkt.reserved", side.connection.number, [frame], time_ns, f"0x{value:02x} from {who}")

    # ---- the end ----------------------------------------------------------------------------------------------------

    def end(self, side: Side, reason: str, frame: i64, now_ns: i64) -> None:
        """A connection is over (``reason`` is why its open requests stay unanswered): close what is open on both sides."""
        peer = side.peer
        assert peer is not None
        self.finish_plus(side, frame, now_ns)
        self.finish_plus(peer, frame, now_ns)
        first, second = (side, peer) if side.index == 0 else (peer, side)
        ending = Ending(side.connection, [second.hole_frame, first.hole_frame], frame, now_ns)
        side.connection.ending = ending
        judge_end(self.judge, side, frame, now_ns)
        judge_cut(self.judge, side, ending)
        if ending.connecting:
            self.scans.refused(side.connection, ending.time_ns)
        for end in (side, peer):
            who = end.tcp.ends[end.index]
            if end.assembler.parts is not None:
                end.assembler.abandon()
                self.judge.note("cotp.unfinished_tsdu", end.connection.number, [frame], now_ns, f"from {who}")
            if end.framer.buffered and end.connection.state == ISO:
                detail = f"{end.framer.buffered} octets from {who}"
                self.judge.note("tpkt.unfinished", end.connection.number, [frame], now_ns, detail)
            self.dialogue.end(end, reason)
        if self.dialogue.also:
            self.beside(frame, now_ns)
        if self.carrier is not None:
            self.carrier.end(side, frame, now_ns)
        for upper in range(len(UPPER_NAMES)):
            self._named.discard(side.connection.number * len(UPPER_NAMES) + upper)
        self.watch.end(side.connection, reason)
        self.observer.connection_closed(side.connection)
