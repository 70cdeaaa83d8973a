"""From S7comm-plus frames to transactions: the same pairing as S7comm, by sequence number (docs/s7plus.md)."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.findings.exchange import Exchange
from dissect.findings.observer import Observer, Options
from dissect.findings.session_rules import judge_port
from dissect.iso.upper import S7COMM_PLUS, UNKNOWN, UPPER_NAMES
from dissect.s7plus.assembly import PlusAssembler
from dissect.s7plus.message import SHORT_HEADS, PlusPdu, is_beginning, parse_plus
from dissect.s7plus.parameters import PLUS, PlusParameterCache
from dissect.s7plus.tables import NOTIFICATION, REQUEST, RESPONSE2, V1
from dissect.transactions.connection import Connection
from dissect.transactions.table import Side


class PlusExchange(Exchange):
    """S7comm-plus TSDUs in, transactions and findings out.

    A request and its response share a sequence number; a response carries no session, so that there is nothing else to
    check. What wants no answer, and what nobody asked for, is a transaction with one half.
    """

    def __init__(self, observer: Observer, options: Options) -> None:
        super().__init__(observer, options)
        self.plus_pdus: i64 = 0
        self.plus_cut: i64 = 0  # not whole: the capture ends, has a hole, or they were too long
        self.plus_unpaired: i64 = 0  # without an opcode, of an unknown one, or too damaged
        self.plus_versions: list[int] = [0] * 256
        self.plus_opcodes: list[int] = [0] * 256
        self.plus_functions: dict[int, int] = {}  # PDUs by function code, which has 16 bits
        self._plus_parameters: PlusParameterCache = PlusParameterCache()

    def plus_frame(self, side: Side, tsdu: bytes, frame: i64, time_ns: i64) -> None:
        """Take a TSDU that begins with 0x72: a frame with its trailer, or one of several frames of a PDU."""
        assembler = side.plus
        if assembler is None:
            assembler = PlusAssembler()
            side.plus = assembler
        whole = assembler.push(tsdu)
        if whole is None:
            return
        if assembler.left_out and assembler.parts is None and whole is not tsdu:
            who = side.tcp.ends[side.index]
            detail = f"{len(whole)} octets from {who} kept, {assembler.left_out} left out"
            self.judge.note("s7.plus_too_long", side.connection.number, [frame], time_ns, detail)
            self.plus_pdu(side, whole, True, frame, time_ns)
        else:
            self.plus_pdu(side, whole, False, frame, time_ns)

    def finish_plus(self, side: Side, frame: i64, time_ns: i64) -> None:
        """A hole, or the end: what there is of an unfinished PDU is all there will be."""
        assembler = side.plus
        if assembler is not None and assembler.parts is not None:
            self.plus_pdu(side, assembler.finish(), True, frame, time_ns)

    def plus_pdu(self, side: Side, octets: bytes, cut: bool, frame: i64, time_ns: i64) -> None:
        """Take a PDU; ``cut`` says that octets of it are missing at its end."""
        connection = side.connection
        pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
        self.plus_pdus += 1
        if cut:
            self.plus_cut += 1
        if connection.pdus == 0:
            self._first_plus_pdu(connection, frame, time_ns)
        connection.pdus += 1
        if self.observer.wants_pdus:
            self.observer.plus_pdu(frame, time_ns, side, octets, cut)
        if pdu.version >= 0:
            self.plus_versions[pdu.version] += 1
        if pdu.opcode >= 0 and is_beginning(pdu):
            self.plus_opcodes[pdu.opcode] += 1
            if pdu.function >= 0:
                self.plus_functions[pdu.function] = self.plus_functions.get(pdu.function, 0) + 1
        if pdu.malformed and not (cut or side.holes or connection.mid_stream):
            detail = f"S7comm-plus {pdu.kind} from {side.tcp.ends[side.index]}: {pdu.malformed[0]}"
            self.judge.note("s7.malformed", connection.number, [frame], time_ns, detail)
        self._pair_plus(side, pdu, frame, time_ns)

    def _first_plus_pdu(self, connection: Connection, frame: i64, time_ns: i64) -> None:
        if connection.protocol == "" or connection.protocol == UPPER_NAMES[UNKNOWN]:
            connection.protocol = UPPER_NAMES[S7COMM_PLUS]
            connection.identified_by = ""
        judge_port(self.judge, connection, frame, time_ns)

    def _pair_plus(self, side: Side, pdu: PlusPdu, frame: i64, time_ns: i64) -> None:
        if not is_beginning(pdu):
            self.plus_unpaired += 1  # a system event, a keep-alive, or the rest of a PDU whose beginning is missing
            return
        octets = pdu.octets
        size: i64 = len(octets)
        connection = side.connection
        parameters = self._plus_parameters.get(pdu.function)
        if pdu.opcode == NOTIFICATION:
            connection.set_client(1 - side.index)
            self._count_notification(side, pdu, frame, time_ns)
            self.done(self.dialogue.push(side, 0, parameters, octets, 0, size, frame, time_ns))
            return
        sequence: i64 = pdu.sequence
        if pdu.opcode == REQUEST:
            connection.set_client(side.index)
            if parameters.starts_tls:
                connection.identified_by = "InitSSL"
            if not pdu.wants_response:
                self.done(self.dialogue.tell(side, sequence, parameters, octets, frame, time_ns))
                return
            done = self.dialogue.ask(side, PLUS, sequence, parameters, octets, 0, size, frame, time_ns)
        else:
            connection.set_client(1 - side.index)
            if pdu.opcode == RESPONSE2 and not self.dialogue.waits(side, PLUS, sequence):
                # Panels were seen to get it for requests that want no answer.
                self.done(self.dialogue.push(side, sequence, parameters, octets, 0, size, frame, time_ns))
                return
            done = self.dialogue.answer(side, PLUS, sequence, parameters, octets, 0, size, 0, frame, time_ns)
        self._answered(done, frame, time_ns)

    def _count_notification(self, side: Side, pdu: PlusPdu, frame: i64, time_ns: i64) -> None:
        """Note missing notifications: those of a connection count up by one, whichever subscriptions they belong to.

        Old S7-1200 count in one octet. What a hole of the capture swallowed was told with the hole.
        """
        plus = side.plus
        if plus is None or pdu.sequence < 0 or pdu.version == V1:
            return
        before: i64 = plus.notified
        number: i64 = pdu.sequence
        plus.notified = number
        expected: i64 = (before + 1) & (0xFF if pdu.subscription_id < SHORT_HEADS else 0xFFFFFFFF)
        if before < 0 or number == expected or side.holes or number == 1:
            return  # the first that is seen, the next one, or a session that begins anew
        missing = f"number {number} follows {before}"
        detail = f"{side.tcp.ends[side.index]}, subscription 0x{pdu.subscription_id:08x}: {missing}"
        self.judge.note("s7plus.notifications_lost", side.connection.number, [frame], time_ns, detail)
