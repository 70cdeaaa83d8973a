"""S7comm-plus: joins frames to PDUs, and pairs PDUs by sequence number, like those of S7comm (docs/s7plus.md)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.exchange import Exchange
from dissect.engine.findings.session_rules import judge_port
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.protocols.iso.upper import S7COMM_PLUS, UNKNOWN, UPPER_NAMES
from dissect.protocols.s7plus.assembly import PlusAssembler, is_notification
from dissect.protocols.s7plus.message import HEADER_SIZE, SHORT_HEADS, PlusPdu, parse_plus
from dissect.protocols.s7plus.parameters import PLUS, PlusParameterCache
from dissect.protocols.s7plus.plain import Head
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    FUNCTIONS,
    GET_MULTI_VARIABLES,
    INIT_SSL,
    KEEP_ALIVE,
    NOTIFICATION,
    REQUEST,
    RESPONSE2,
    SET_MULTI_VARIABLES,
    SYSTEM_EVENT,
    V1,
    V2,
    V3,
)
from dissect.wire.octets import Tally, u16

#: The functions with names are within this many codes from this one on.
_FIRST: Final = 0x0480
_CODES: Final = 0x0200
#: Functions after which a client may restart its sequence numbers.
_BEGINNING: Final = frozenset((CREATE_OBJECT, INIT_SSL))
#: Maximum number of requests in several frames, per connection, whose first packet is remembered.
_MAX_BEGUN: Final = 64


class S7Plus(Protocol):
    """Takes S7comm-plus frames. Counts PDUs by version, opcode and function.

    A request and its response share a sequence number; a response has no session id, so nothing else can be checked. A request
    that needs no response, and a notification, are transactions with one half.
    """

    def __init__(self, exchange: Exchange) -> None:
        super().__init__()
        self._exchange: Exchange = exchange
        self.pdus: i64 = 0
        self.cut_pdus: i64 = 0  # incomplete: the capture ends or has a gap, or the PDUs were too long
        self.unpaired: i64 = 0  # without an opcode, with an unknown one, or too damaged
        self.behind_malformed: i64 = 0  # whole PDUs behind malformed TPDU headers, which are in no other count
        self.versions: Tally = Tally(256, V3, V2)
        self.opcodes: Tally = Tally(256, NOTIFICATION, REQUEST)
        self._functions: Tally = Tally(_CODES, GET_MULTI_VARIABLES - _FIRST, SET_MULTI_VARIABLES - _FIRST)
        self._others: dict[int, int] = {}  # functions with codes outside this range
        self._parameters: PlusParameterCache = PlusParameterCache()
        self._head: Head = Head()  # of the current PDU

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take a TSDU that begins with 0x72: a frame with its trailer, or one of several frames of a PDU."""
        tsdu = buf[at : at + size]
        assembler = side.plus
        if assembler is None:
            assembler = PlusAssembler()
            assembler.holed = side.holes > 0 or side.connection.mid_stream
            side.plus = assembler
        if assembler.interrupted(tsdu):
            who = side.tcp.ends[side.index]
            detail = f"S7comm-plus PDU from {who}: a new one begins before its end"
            self._exchange.reporter.note("s7.malformed", side.connection.number, [frame], time_ns, detail)
            self._finish(side)
        whole = assembler.push(tsdu)
        if whole is None:
            if assembler.parts is not None and len(assembler.parts) == size:
                assembler.begun_frame = frame
                assembler.begun_ns = time_ns
            assembler.last_frame = frame
            assembler.last_ns = time_ns
            return
        if assembler.left_out and assembler.parts is None and whole is not tsdu:
            self._note_too_long(side, len(whole), frame, time_ns)
            self._pdu(side, whole, True, frame, time_ns)
        else:
            self._pdu(side, whole, False, frame, time_ns)

    def gap(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """Octets are missing: use what there is of an unfinished PDU; it is unknown which numbers were used in the gap."""
        self._finish(side)
        assembler = side.plus
        if assembler is not None:
            assembler.holed = True
            self._count_anew(assembler)

    def _count_anew(self, assembler: PlusAssembler) -> None:
        assembler.asked = -1
        assembler.notified = -1

    def finish(self, side: Side, frame: i64, time_ns: i64) -> None:
        """No more octets come: use what there is of an unfinished PDU."""
        self._finish(side)

    def _finish(self, side: Side) -> None:
        """Take the captured part of an unfinished PDU, with the packet that brought its last frame."""
        assembler = side.plus
        if assembler is not None and assembler.parts is not None:
            octets = assembler.finish()
            frame: i64 = assembler.last_frame
            time_ns: i64 = assembler.last_ns
            if assembler.left_out:
                self._note_too_long(side, len(octets), frame, time_ns)
            self._pdu(side, octets, True, frame, time_ns)

    def _note_too_long(self, side: Side, kept: i64, frame: i64, time_ns: i64) -> None:
        """Report how much was not kept of the PDU that the assembler returned."""
        left_out: i64 = side.plus.left_out if side.plus is not None else 0
        detail = f"{kept} bytes from {side.tcp.ends[side.index]} kept, {left_out} left out"
        self._exchange.reporter.note("s7.plus_too_long", side.connection.number, [frame], time_ns, detail)

    def cut(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the captured part of a frame; its PDU ends with it."""
        self._finish(side)
        self._pdu(side, octets, True, frame, time_ns)

    def _pdu(self, side: Side, octets: bytes, cut: bool, frame: i64, time_ns: i64) -> None:
        """Take a PDU; ``cut`` means that octets are missing at its end."""
        exchange = self._exchange
        connection = side.connection
        head = self._head
        pdu: PlusPdu | None = None
        if cut or not head.read_plain(octets):
            pdu = parse_plus(octets, frame, time_ns, connection.number, side.index, cut)
            head.take(pdu)
        self.pdus += 1
        if cut:
            self.cut_pdus += 1
        if connection.pdus == 0:
            self._first_pdu(connection, frame, time_ns)
        connection.pdus += 1
        if exchange.observer.wants_pdus:
            exchange.observer.plus_pdu(frame, time_ns, side, octets, cut)
        assembler = side.plus if side.holes or connection.mid_stream else None
        holed: bool = assembler is not None and assembler.holed
        if holed and head.opcode == NOTIFICATION and not is_notification(octets):
            head.begins = False
        if head.version >= 0:
            self.versions.add(head.version)
        if head.opcode >= 0 and head.begins:
            self.opcodes.add(head.opcode)
            if head.function >= 0:
                self._count(head.function)
        if pdu is not None and pdu.malformed and not (cut or holed):
            detail = f"S7comm-plus {pdu.kind} from {side.tcp.ends[side.index]}: {pdu.malformed[0]}"
            slug = "s7.malformed"
            if pdu.malformed[0].is_unknown:
                slug = "s7plus.unknown_kind"
            if slug == "s7.malformed" or exchange.reporter.first(connection, slug, frame, time_ns):
                exchange.reporter.note(slug, connection.number, [frame], time_ns, detail)
        exchange.dialogue.cut = cut
        self._pair(side, octets, frame, time_ns)
        exchange.dialogue.cut = False
        if holed and assembler is not None and head.version != SYSTEM_EVENT and head.version != KEEP_ALIVE:
            # It may be the rest of a PDU, with arbitrary numbers. The two exceptions can come between frames, before such a
            # rest.
            assembler.holed = False
            self._count_anew(assembler)

    def behind(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take a frame behind the malformed header of a TPDU: it is judged alone, and continues no PDU."""
        exchange = self._exchange
        connection = side.connection
        head = self._head
        begun: bool = (
            octets[1] != KEEP_ALIVE and octets[1] != SYSTEM_EVENT and HEADER_SIZE + u16(octets, 2) == len(octets)
        )
        head.take(parse_plus(octets, frame, time_ns, connection.number, side.index, begun))
        self.behind_malformed += 1
        if exchange.observer.wants_pdus:
            exchange.observer.plus_pdu(frame, time_ns, side, octets, begun)
        if not head.begins:
            self.unpaired += 1
            return
        parameters = self._parameters.get(head.function)
        sequence: i64 = head.sequence
        if head.opcode == NOTIFICATION:
            exchange.behind.push(side, 0, parameters, octets, frame, time_ns)
        elif head.opcode == REQUEST:
            exchange.behind.ask(side, PLUS, sequence, parameters, octets, frame, time_ns)
        else:
            exchange.behind.answer(side, PLUS, sequence, parameters, octets, frame, time_ns)

    def _count(self, function: i64) -> None:
        """Count a PDU of a function."""
        at: i64 = function - _FIRST
        if 0 <= at < _CODES:
            self._functions.add(at)
        else:
            self._others[int(function)] = self._others.get(int(function), 0) + 1

    def _first_pdu(self, connection: Connection, frame: i64, time_ns: i64) -> None:
        if connection.protocol == "" or connection.protocol == UPPER_NAMES[UNKNOWN]:
            connection.protocol = UPPER_NAMES[S7COMM_PLUS]
            connection.identified_by = ""
        judge_port(self._exchange.reporter, connection, frame, time_ns)

    def _pair(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Pair the current PDU."""
        head = self._head
        if not head.begins:
            self.unpaired += 1  # a system event, a keep-alive, or the rest of a PDU whose beginning is missing
            if head.version == SYSTEM_EVENT:
                side.connection.system_events += 1
            return
        exchange = self._exchange
        connection = side.connection
        parameters = self._parameters.get(head.function)
        if head.opcode == NOTIFICATION:
            connection._set_client(1 - side.index)
            self._count_notification(side, frame, time_ns)
            exchange.indication(side, 0, parameters, octets, frame, time_ns)
            return
        sequence: i64 = head.sequence
        if head.opcode == REQUEST:
            connection._set_client(side.index)
            self._count_request(side, frame, time_ns)
            if head.frames > 1:
                self._note_beginning(side, sequence, frame)
            if parameters.starts_tls:
                connection.identified_by = "InitSSL"
            # older CPUs answer all the same, with a Response2
            if head.wants_response or head.version < V3:
                exchange.request(side, sequence, parameters, octets, frame, time_ns)
            else:
                told = exchange.dialogue.tell(side, sequence, parameters, octets, frame, time_ns)
                exchange.completed(told, frame, time_ns)
            return
        connection._set_client(1 - side.index)
        if head.opcode == RESPONSE2 and head.version == V3 and not exchange.dialogue.waits(side, PLUS, sequence):
            exchange.indication(side, sequence, parameters, octets, frame, time_ns)
        else:
            exchange.response(side, sequence, parameters, octets, frame, time_ns)

    def _note_beginning(self, side: Side, sequence: i64, frame: i64) -> None:
        """Remember the first packet of a request in several frames, and what was left out; a transaction has only the last."""
        assembler = side.plus
        if assembler is None:
            return
        begun = side.connection._begun
        if begun is None:
            begun = {}
            side.connection._begun = begun
        while len(begun) >= _MAX_BEGUN:
            del begun[next(iter(begun))]
        begun[sequence, frame] = (assembler.begun_frame, assembler.begun_ns, assembler.left_out)

    def _count_request(self, side: Side, frame: i64, time_ns: i64) -> None:
        """Report a request whose sequence number is not higher than the one before: clients count up by one.

        A number that skips some is not reported, because damaged or lost requests leave gaps.
        """
        plus = side.plus
        if plus is None:
            return
        head = self._head
        before: i64 = plus.asked
        plus.asked = head.sequence
        ahead: i64 = (head.sequence - before) & 0xFFFF
        if before < 0 or 0 < ahead < 0x8000 or (head.sequence <= 1 and head.function in _BEGINNING):
            return
        ends = side.tcp.ends
        who = f"{ends[side.index]} to {ends[1 - side.index]}"
        detail = f"{who}: {FUNCTIONS.name(head.function)} with sequence number {head.sequence} follows {before}"
        self._exchange.reporter.note("security.replay", side.connection.number, [frame], time_ns, detail)

    def _count_notification(self, side: Side, frame: i64, time_ns: i64) -> None:
        """Report missing notifications: those of a connection count up by one, across all its subscriptions.

        Old S7-1200 CPUs count with one octet. Notifications in a gap of the capture are reported with the gap.
        """
        plus = side.plus
        head = self._head
        if plus is None or head.sequence < 0 or head.version == V1:
            return
        before: i64 = plus.notified
        number: i64 = head.sequence
        plus.notified = number
        expected: i64 = (before + 1) & 0xFFFFFFFF
        if head.subscription_id < SHORT_HEADS:
            expected = (before + 1) & 0xFF
        if before < 0 or number == expected or number == 1:
            return  # the first one, the one after the previous, or a new session
        detail = (
            f"{side.tcp.ends[side.index]}, subscription 0x{head.subscription_id:08x}: number {number} follows {before}"
        )
        self._exchange.reporter.note("s7plus.notifications_lost", side.connection.number, [frame], time_ns, detail)

    def held(self, side: Side) -> i64:
        """Return the octets of a PDU whose last frame has not arrived yet."""
        assembler = side.plus
        return len(assembler.parts) if assembler is not None and assembler.parts is not None else 0

    # ---- what was counted -------------------------------------------------------------------------------------------

    @property
    def functions(self) -> dict[int, int]:
        """Number of PDUs per function code."""
        found = {_FIRST + at: count for at, count in enumerate(self._functions.counts()) if count}
        return {**found, **self._others}

    def describe(self) -> dict[str, object]:
        """Return the section ``s7plus``."""
        return {
            "s7plus": {
                "pdus": self.pdus,
                **({"behind_malformed": self.behind_malformed} if self.behind_malformed else {}),
                "cut": self.cut_pdus,
                "unpaired": self.unpaired,
                "versions": {f"0x{code:02x}": count for code, count in enumerate(self.versions.counts()) if count},
                "opcodes": {f"0x{code:02x}": count for code, count in enumerate(self.opcodes.counts()) if count},
                "functions": {f"0x{code:04x}": count for code, count in sorted(self.functions.items())},
            }
        }

    def counted(self) -> list[tuple[int, str]]:
        """Return the number of PDUs."""
        return [(self.pdus, "S7comm-plus PDU")] if self.pdus else []
