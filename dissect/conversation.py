"""From octets in order to transactions: TPKT, TPDU, TSDU, S7 PDU, and what they mean for their connection.

`Conversation` is the upper half of the path; `dissect.pipeline` is the lower one and tells where it leads. The methods stand
in the order in which a byte passes them:

    octets → _tpkt → _tsdu → _pdu → _ask / _answered → done
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.findings.finding import Finding
from dissect.findings.judge import Judge
from dissect.findings.session_rules import (
    judge_disconnect,
    judge_end,
    judge_error_tpdu,
    judge_grant,
    judge_port,
    judge_request,
)
from dissect.findings.transaction_rules import judge_transaction, judge_unanswered
from dissect.iso.cotp import Tpdu, parse_tpdu
from dissect.iso.tables import CC, CR, DR, DT, ER
from dissect.iso.tpkt import BAD_VERSION, plausible
from dissect.iso.upper import S7COMM, UNKNOWN, UPPER_NAMES, classify, is_rdp_connect
from dissect.s7.message import header_size, parse_pdu, read_header
from dissect.s7.parameters import PUSH, REQUEST, RESPONSE, ParameterCache, Parameters
from dissect.s7.tables import ACK, ACK_DATA, JOB, ROSCTR, SETUP_COMMUNICATION, USERDATA
from dissect.transactions.connection import FOREIGN, ISO, ISO_TSAP_PORT, Connection
from dissect.transactions.dialogue import BAD_DATA, Dialogue
from dissect.transactions.table import Side
from dissect.transactions.transaction import CONNECTION_CLOSED, UNANSWERED, Transaction
from dissect.wire.octets import u16

#: Segments with octets that are looked at before a connection on an unknown port counts as another protocol.
_PROBES: Final = 8
#: The same when port 102 says that it ought to be ISO-on-TCP.
_PROBES_102: Final = 64


class Options:
    """What a user can set. ``slow_ns``: an answer later than this is slow. ``strict``: a bug of ours raises."""

    def __init__(self, slow_ns: int = 1_000_000_000, strict: bool = False) -> None:
        self.slow_ns: i64 = slow_ns
        self.strict: bool = strict


@mypyc_attr(allow_interpreted_subclasses=True)
class Observer:
    """Is told what happens; override what you want to know. The ``wants_`` flags must be set before the first packet."""

    def __init__(self) -> None:
        self.wants_pdus: bool = False
        self.wants_tpdus: bool = False

    def connection_opened(self, connection: Connection) -> None:
        """ISO-on-TCP was recognised on a connection."""

    def connection_closed(self, connection: Connection) -> None:
        """A connection is over; all its transactions were told before."""

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        """A whole TPKT, header included (only with ``wants_tpdus``)."""

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        """A whole S7 PDU, or one the capture cut (only with ``wants_pdus``)."""

    def transaction(self, transaction: Transaction) -> None:
        """A transaction is complete, or given up."""

    def finding(self, finding: Finding) -> None:
        """Something deserves attention."""

    def comment(self, frame: i64, text: str) -> None:
        """The capture holds a comment about a packet."""


class Conversation:
    """Octets of known connections in, transactions and findings out; counts TPDUs, TSDUs and PDUs on the way."""

    def __init__(self, observer: Observer, options: Options) -> None:
        self.observer: Observer = observer
        self.judge: Judge = Judge()
        self.dialogue: Dialogue = Dialogue()
        self.connections: i64 = 0
        self.tpdus: list[int] = [0] * 17  # by type, the last for TPDUs too short to have one
        self.tsdus: list[int] = [0] * len(UPPER_NAMES)
        self.rosctrs: list[int] = [0] * 256
        self.functions: list[int] = [0] * 256
        self.pdus: i64 = 0
        self.cut_pdus: i64 = 0
        self.unpaired: i64 = 0  # PDUs of a kind that cannot be paired, or too damaged for it
        self._parameters: ParameterCache = ParameterCache()
        self._slow_ns: i64 = options.slow_ns

    # ---- is it ISO-on-TCP? ------------------------------------------------------------------------------------------

    def probe(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Octets of a connection not known yet: does it speak ISO-on-TCP?"""
        connection = side.connection
        at_start: bool = side.stream.position == len(octets) and side.tcp.known_start
        size: i64 = len(octets)
        if plausible(octets, 0, size) or (at_start and _may_begin_tpkt(octets)):
            self._recognise(side, frame, time_ns)
            self.octets(side, octets, frame, time_ns)
            return
        connection.probed += 1
        ends = side.tcp.ends
        on_102: bool = ends[0].port == ISO_TSAP_PORT or ends[1].port == ISO_TSAP_PORT
        if connection.probed >= (_PROBES_102 if on_102 else (1 if at_start else _PROBES)):
            self._give_to_others(side, "unknown", frame, time_ns)
        side.framer.skipped += size

    def _recognise(self, side: Side, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        connection.state = ISO
        self.connections += 1
        connection.number = self.connections
        peer = side.peer
        assert peer is not None
        for end in (side, peer):
            end.framer.synced = side.tcp.known_start and end.stream.octets == (side.stream.octets if end is side else 0)
        side.framer.synced = True
        self.observer.connection_opened(connection)

    def _give_to_others(self, side: Side, protocol: str, frame: i64, time_ns: i64) -> None:
        """Another protocol: its packets are counted from now on, nothing more."""
        connection = side.connection
        connection.state = FOREIGN
        connection.protocol = protocol
        ends = side.tcp.ends
        if ends[0].port == ISO_TSAP_PORT or ends[1].port == ISO_TSAP_PORT:
            self.judge.note("session.foreign_on_102", connection.number, [frame], time_ns, protocol)

    # ---- octets → TPKT ----------------------------------------------------------------------------------------------

    def octets(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        framer = side.framer
        at: i64 = 0
        end: i64 = len(octets)
        if framer.synced and framer.pending is None and framer.skip == 0:
            while end - at >= 7 and octets[at] == 3:
                length: i64 = u16(octets, at + 2)
                if length < 7 or at + length > end:
                    break
                self._tpkt(side, octets, at, length, frame, time_ns)
                framer.framed += length
                at += length
            if at == end:
                side.garbage = False
                return
        if side.connection.state == FOREIGN:
            framer.skipped += end - at
            return
        skipped: i64 = framer.skipped
        framer.push(octets, at, at == 0)
        if framer.faults:
            self._faults(side, framer.skipped - skipped, frame, time_ns)
        if framer.packets:
            packets = framer.packets
            framer.packets = []
            for packet in packets:
                self._tpkt(side, packet, 0, len(packet), frame, time_ns)

    def _faults(self, side: Side, skipped: i64, frame: i64, time_ns: i64) -> None:
        number = side.connection.number
        who = side.tcp.ends[side.index]
        for fault in side.framer.faults:
            if fault.kind == BAD_VERSION:
                if not side.garbage:
                    detail = f"{skipped} octets from {who}, first 0x{fault.value:02x}"
                    self.judge.note("tpkt.garbage", number, [frame], time_ns, detail)
                side.garbage = True
            else:
                self.judge.note("tpkt.bad_length", number, [frame], time_ns, f"length {fault.value} from {who}")
        side.framer.faults = []

    # ---- TPKT → TSDU ------------------------------------------------------------------------------------------------

    def _tpkt(self, side: Side, buf: bytes, at: i64, length: i64, frame: i64, time_ns: i64) -> None:
        if self.observer.wants_tpdus:
            self.observer.tpdu(frame, time_ns, side, buf[at : at + length])
        if buf[at + 4] == 2 and buf[at + 5] == 0xF0:  # DT of class 0
            self.tpdus[DT] += 1
            size: i64 = side.connection.tpdu_size
            if size and length - 4 > size:
                self._note_tpdu_size(side, length - 4, frame, time_ns)
            if buf[at + 6] >= 0x80 and side.assembler.parts is None and side.assembler.clear:
                self._tsdu(side, buf, at + 7, length - 7, frame, time_ns)
            else:
                self._fragment(side, buf[at + 7 : at + length], buf[at + 6] >= 0x80, frame, time_ns)
        else:
            self._other_tpdu(side, parse_tpdu(buf[at + 4 : at + length]), frame, time_ns)

    def _fragment(self, side: Side, data: bytes, eot: bool, frame: i64, time_ns: i64) -> None:
        overflows: i64 = side.assembler.overflows
        tsdu = side.assembler.push(data, eot)
        if side.assembler.overflows > overflows:
            who = side.tcp.ends[side.index]
            self.judge.note("cotp.tsdu_too_long", side.connection.number, [frame], time_ns, f"from {who}")
        if tsdu is not None:
            self._tsdu(side, tsdu, 0, len(tsdu), frame, time_ns)

    def _other_tpdu(self, side: Side, tpdu: Tpdu, frame: i64, time_ns: i64) -> None:
        """Any TPDU but the plain DT."""
        connection = side.connection
        type_: i64 = tpdu.type
        self.tpdus[type_ if 0 <= type_ < 16 else 16] += 1
        if (type_ == CR or type_ == CC) and tpdu.variable and is_rdp_connect(tpdu.variable):
            self._give_to_others(side, "rdp", frame, time_ns)
            return
        if tpdu.malformed:
            self.judge.note("cotp.malformed", connection.number, [frame], time_ns, f"{tpdu.name}: {tpdu.malformed[0]}")
        if type_ == DT:
            self._fragment(side, tpdu.data, tpdu.field("eot") == 1, frame, time_ns)
        elif type_ == CR:
            self._connect_request(side, tpdu, frame, time_ns)
        elif type_ == CC:
            if not connection.cr_seen and not connection.mid_stream:
                self.judge.note("cotp.answer_without_request", connection.number, [frame], time_ns)
            connection.note_cc(side.index, tpdu)
        elif type_ == DR:
            judge_disconnect(self.judge, side, tpdu, frame, time_ns)
        elif type_ == ER:
            judge_error_tpdu(self.judge, side, tpdu, frame, time_ns)

    def _connect_request(self, side: Side, tpdu: Tpdu, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        if connection.established:
            # The TCP close and open in between were not captured: what follows is another transport connection.
            self._replace_connection(side, frame, time_ns)
            connection = side.connection
        elif connection.cr_seen:
            self.judge.note("cotp.repeated_request", connection.number, [frame], time_ns)
        connection.mid_stream = False
        connection.note_cr(side.index, tpdu)

    def _replace_connection(self, side: Side, frame: i64, now_ns: i64) -> None:
        peer = side.peer
        assert peer is not None
        old = side.connection
        old.closed_reason = "replaced"
        self.end(side, CONNECTION_CLOSED, frame, now_ns)
        self.connections += 1
        connection = Connection(self.connections, side.tcp)
        connection.state = ISO
        for end in (side, peer):
            end.connection = connection
            end.requests = 0
        self.observer.connection_opened(connection)

    def _tsdu(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        upper: i64 = S7COMM if size >= 10 and buf[at] == 0x32 and 1 <= buf[at + 1] <= 7 else classify(buf, at, at + size)
        self.tsdus[upper] += 1
        if upper == S7COMM:
            self._pdu(side, buf, at, size, frame, time_ns)
        else:
            self._other_tsdu(side, upper, frame, time_ns)

    def _other_tsdu(self, side: Side, upper: i64, frame: i64, time_ns: i64) -> None:
        """What is not S7comm is named and counted; on port 102 that is said once a connection."""
        connection = side.connection
        name = UPPER_NAMES[upper]
        if name == "empty" or connection.protocol == name:
            return
        if connection.protocol == "" or connection.protocol == UPPER_NAMES[UNKNOWN]:
            connection.protocol = name
        ends = side.tcp.ends
        if ends[0].port == ISO_TSAP_PORT or ends[1].port == ISO_TSAP_PORT:
            self.judge.note("session.foreign_on_102", connection.number, [frame], time_ns, name)

    # ---- S7 PDU → transaction ---------------------------------------------------------------------------------------

    def _pdu(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        self.pdus += 1
        if connection.pdus == 0:
            connection.protocol = UPPER_NAMES[S7COMM]
            judge_port(self.judge, connection, frame, time_ns)
        connection.pdus += 1
        if self.observer.wants_pdus:
            self.observer.pdu(frame, time_ns, side, buf[at : at + size], False)
        if size < 10:
            self.rosctrs[buf[at + 1]] += 1
            self._damaged_pdu(side, buf[at : at + size], frame, time_ns)
            return
        rosctr, pdu_ref, param_length, data_length = read_header(buf, at)
        self.rosctrs[rosctr] += 1
        head: i64 = 12 if rosctr == ACK_DATA or rosctr == ACK else 10
        data_at: i64 = at + head + param_length
        if data_at + data_length != at + size or (rosctr > ACK_DATA and rosctr != USERDATA):
            self._damaged_pdu(side, buf[at : at + size], frame, time_ns)
            return
        parameters = self._parameters.get(buf[at + head : data_at], rosctr)
        if parameters.function >= 0:
            self.functions[parameters.function] += 1
        if parameters.malformed:
            self._note_malformed(side, buf[at : at + size], frame, time_ns)
        if 0 < connection.pdu_length < size:
            detail = f"{size} octets, {connection.pdu_length} negotiated"
            self.judge.note("session.pdu_too_long", connection.number, [frame], time_ns, detail)
        if rosctr == JOB:
            self._ask(side, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
        elif rosctr != USERDATA:
            done = self.dialogue.answer(side, rosctr, pdu_ref, parameters, buf, at, size, data_at, frame, time_ns)
            self._answered(side, done)
        else:
            userdata = parameters.userdata
            kind: i64 = userdata.type if userdata is not None else -1
            if kind == REQUEST:
                self._ask(side, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
            elif kind == RESPONSE:
                done = self.dialogue.answer(side, rosctr, pdu_ref, parameters, buf, at, size, data_at, frame, time_ns)
                self._answered(side, done)
            elif kind == PUSH:
                self.done(self.dialogue.push(side, pdu_ref, parameters, buf, at, size, frame, time_ns))
            else:
                self.unpaired += 1

    def _ask(
        self,
        side: Side,
        rosctr: i64,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        frame: i64,
        time_ns: i64,
    ) -> None:
        done = self.dialogue.ask(side, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
        connection = side.connection
        if connection.granted is None or parameters.function == SETUP_COMMUNICATION:
            judge_request(self.judge, side, parameters, 0, frame, time_ns)
        else:
            open_now: i64 = connection.open_requests[side.index].count
            if open_now > 1:
                judge_request(self.judge, side, parameters, open_now, frame, time_ns)
        if done is not None:
            self.done(done)
        if self.dialogue.also:
            self.beside(frame, time_ns)

    def _answered(self, side: Side, done: Transaction | None) -> None:
        if done is None:
            return
        if done.parameters.function == SETUP_COMMUNICATION:
            judge_grant(self.judge, done)
        self.done(done)

    def done(self, transaction: Transaction) -> None:
        """A transaction is complete: judge it when it is odd, and tell it."""
        if transaction.has_errors:
            transaction.connection.errors += 1
        if (
            transaction.flags
            or transaction.has_errors
            or (transaction.request_frame and transaction.response_ns - transaction.request_ns > self._slow_ns)
        ):
            judge_transaction(self.judge, transaction, self._slow_ns)
        self.observer.transaction(transaction)

    def beside(self, frame: i64, now_ns: i64) -> None:
        """Tell the transactions that ended beside the one at hand."""
        also = self.dialogue.also
        self.dialogue.also = []
        for transaction in also:
            if transaction.has_errors:
                transaction.connection.errors += 1
            if transaction.outcome == UNANSWERED:
                judge_unanswered(self.judge, transaction, now_ns, self._slow_ns)
            else:
                judge_transaction(self.judge, transaction, self._slow_ns)
            self.observer.transaction(transaction)

    # ---- what is irregular ------------------------------------------------------------------------------------------

    def hole(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        side.holes += 1
        side.missing += size
        side.hole_frame = frame
        inside = side.framer.hole(size, cut)
        if cut and len(side.framer.cut_packet) > 7:
            self._cut_tpkt(side, side.framer.cut_packet, frame, time_ns)
        side.framer.cut_packet = b""
        if side.connection.state == ISO and not cut:
            number = side.connection.number
            where = "inside a TPKT" if inside else "between TPKTs"
            self.judge.note("stream.hole", number, [frame], time_ns, f"{size} octets from {side.tcp.ends[side.index]}, {where}")
        if side.assembler.parts is not None and not cut:
            side.assembler.abandon()
            self.judge.note("cotp.unfinished_tsdu", side.connection.number, [frame], time_ns, "octets were lost")

    def _cut_tpkt(self, side: Side, packet: bytes, frame: i64, time_ns: i64) -> None:
        """A TPKT the capture cut: an S7 header that is there still tells what was asked or answered."""
        if packet[4] != 2 or packet[5] != 0xF0 or packet[6] < 0x80 or side.assembler.parts is not None:
            return
        pdu = packet[7:]
        if len(pdu) < 10 or pdu[0] != 0x32:
            return
        self.tpdus[DT] += 1
        self.tsdus[S7COMM] += 1
        self.pdus += 1
        self.cut_pdus += 1
        self.rosctrs[pdu[1]] += 1
        side.connection.pdus += 1
        if self.observer.wants_pdus:
            self.observer.pdu(frame, time_ns, side, pdu, True)
        self._pair_damaged(side, pdu, frame, time_ns)

    def _damaged_pdu(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """An S7 PDU whose lengths lie or whose kind is unknown: told, and paired as far as its header can be read."""
        if len(octets) >= 10 and octets[1] not in ROSCTR:
            number = side.connection.number
            self.judge.note("s7.unknown_rosctr", number, [frame], time_ns, f"ROSCTR {octets[1]}")
            self.unpaired += 1
            return
        self._note_malformed(side, octets, frame, time_ns)
        self._pair_damaged(side, octets, frame, time_ns)

    def _pair_damaged(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        rosctr: i64 = octets[1]
        head: i64 = header_size(rosctr)
        if len(octets) < head or rosctr not in ROSCTR:
            self.unpaired += 1
            return
        pdu_ref: i64 = u16(octets, 4)
        data_at: i64 = min(head + u16(octets, 6), len(octets))
        parameters = self._parameters.get(octets[head:data_at], rosctr)
        if parameters.function >= 0:
            self.functions[parameters.function] += 1
        userdata = parameters.userdata
        kind: i64 = userdata.type if userdata is not None else -1
        if rosctr == JOB or (rosctr == USERDATA and kind == REQUEST):
            self._ask(side, rosctr, pdu_ref, parameters, octets, 0, len(octets), frame, time_ns)
        elif rosctr != USERDATA or kind == RESPONSE:
            done = self.dialogue.answer(
                side, rosctr, pdu_ref, parameters, octets, 0, len(octets), data_at, frame, time_ns
            )
            if done is not None:
                done.flags &= ~BAD_DATA  # that the PDU is damaged was told already
            self._answered(side, done)
        elif kind == PUSH:
            self.done(self.dialogue.push(side, pdu_ref, parameters, octets, 0, len(octets), frame, time_ns))
        else:
            self.unpaired += 1

    def _note_malformed(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        if self.judge.wants("s7.malformed", side.connection.number):
            pdu = parse_pdu(octets)
            what = str(pdu.malformed[0]) if pdu.malformed else "its lengths do not add up"
            detail = f"{pdu.rosctr_name} from {side.tcp.ends[side.index]}: {what}"
            self.judge.detail("s7.malformed", side.connection.number, [frame], time_ns, detail)

    def _note_tpdu_size(self, side: Side, size: i64, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        detail = f"{size} octets, {connection.tpdu_size} negotiated"
        self.judge.note("cotp.size_exceeded", connection.number, [frame], time_ns, detail)

    def tell_findings(self) -> None:
        """Hand detailed findings to the observer."""
        fresh = self.judge.fresh
        self.judge.fresh = []
        for finding in fresh:
            self.observer.finding(finding)

    # ---- the end ----------------------------------------------------------------------------------------------------

    def end(self, side: Side, reason: str, frame: i64, now_ns: i64) -> None:
        """A connection is over (``reason`` is why its open requests stay unanswered): close what is open on both sides."""
        peer = side.peer
        assert peer is not None
        judge_end(self.judge, side, frame, now_ns)
        for end in (side, peer):
            if end.assembler.parts is not None:
                end.assembler.abandon()
                who = end.tcp.ends[end.index]
                self.judge.note("cotp.unfinished_tsdu", end.connection.number, [frame], now_ns, f"from {who}")
            if end.framer.buffered and end.connection.state == ISO:
                who = end.tcp.ends[end.index]
                detail = f"{end.framer.buffered} octets from {who}"
                self.judge.note("tpkt.unfinished", end.connection.number, [frame], now_ns, detail)
            self.dialogue.end(end, reason)
        if self.dialogue.also:
            self.beside(frame, now_ns)
        self.observer.connection_closed(side.connection)


def _may_begin_tpkt(octets: bytes) -> bool:
    """Tell whether fewer octets than a header may be the beginning of a TPKT (the first octets of a connection)."""
    if len(octets) >= 6:
        return False
    pattern = (0x03, 0x00)
    return all([octets[index] == pattern[index] for index in range(min(2, len(octets)))])
