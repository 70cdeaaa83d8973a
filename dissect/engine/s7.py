"""S7comm: turns PDUs into requests, responses and indications, which `Exchange` pairs (reference section 2 and 5)."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.exchange import Exchange
from dissect.engine.findings.security_rules import PACE
from dissect.engine.findings.session_rules import (
    judge_answer_size,
    judge_header,
    judge_port,
    judge_request,
    judge_shared,
    judge_size,
)
from dissect.engine.findings.transaction_rules import judge_parameters
from dissect.engine.transactions.connection import ISO, Connection
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.results import BAD_DATA
from dissect.engine.transactions.side import Side
from dissect.protocols.iso.upper import S7COMM, UPPER_NAMES
from dissect.protocols.s7.message import parse_pdu
from dissect.protocols.s7.parameters import (
    ACK_HEADER_SIZE,
    HEADER_SIZE,
    PUSH,
    REQUEST,
    RESPONSE,
    ParameterCache,
    Parameters,
    header_size,
    is_plc_push,
    is_request,
    read_header,
)
from dissect.protocols.s7.tables import ACK, ACK_DATA, JOB, READ_VAR, ROSCTR, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.wire.octets import Tally, u16


class S7(Protocol):
    """Takes whole S7 PDUs from any transport; counts them by ROSCTR and function."""

    def __init__(self, exchange: Exchange) -> None:
        super().__init__()
        self._exchange: Exchange = exchange
        self.rosctrs: Tally = Tally(256, JOB, ACK_DATA)
        self.functions: Tally = Tally(256, READ_VAR, WRITE_VAR)
        self.pdus: i64 = 0
        self.cut_pdus: i64 = 0
        self.unpaired: i64 = 0  # PDUs that cannot be paired: of an unknown kind, or too damaged
        self.behind_malformed: i64 = 0  # whole PDUs behind malformed TPDU headers, which are in no other count
        self._parameters: ParameterCache = ParameterCache()

    def forget(self) -> None:
        """Nothing more comes: forget the parsed parameter blocks."""
        self._parameters.clear()

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take a whole PDU. The caller has checked its protocol id, and that its ROSCTR is from 1 to 7."""
        rosctr: i64 = buf[at + 1]
        pdu_ref: i64 = 0
        param_length: i64 = -1
        if size >= HEADER_SIZE:
            _, pdu_ref, param_length, data_length = read_header(buf, at)
            if header_size(rosctr) + param_length + data_length != size or (rosctr > ACK_DATA and rosctr != USERDATA):
                param_length = -1
        self.take(side, rosctr, pdu_ref, param_length, buf, at, size, frame, time_ns)

    def take(
        self,
        side: Side,
        rosctr: i64,
        pdu_ref: i64,
        param_length: i64,
        buf: bytes,
        at: i64,
        size: i64,
        frame: i64,
        time_ns: i64,
    ) -> None:
        """Take a whole PDU; ``param_length`` is -1 if its ROSCTR is unknown or its lengths do not add up to ``size``."""
        exchange = self._exchange
        connection = side.connection
        self.pdus += 1
        if rosctr == JOB:
            self.rosctrs.often_count += 1
        elif rosctr == ACK_DATA:
            self.rosctrs.also_count += 1
        else:
            self.rosctrs.add(rosctr)
        pdus: i64 = connection.pdus
        if pdus == 0:
            self._first_pdu(connection, frame, time_ns)
        pdus += 1
        connection.pdus = pdus
        if pdus & (PACE - 1) == 0:
            exchange.watch.security.pace(connection, frame, time_ns)
        if exchange.observer.wants_pdus:
            exchange.observer.pdu(frame, time_ns, side, buf[at : at + size], False)
        if param_length < 0:
            self._damaged(side, buf[at : at + size], frame, time_ns)
            return
        head: i64 = HEADER_SIZE
        if rosctr == ACK_DATA or rosctr == ACK:  # `header_size`, inlined
            head = ACK_HEADER_SIZE
        data_at: i64 = at + head + param_length
        parameters = self._parameters.get(buf, at + head, data_at, rosctr)
        function: i64 = parameters.function
        if function == READ_VAR:
            self.functions.often_count += 1
        elif function >= 0:
            self.functions.add(function)
        if parameters.malformed:
            self._note_malformed(side, buf[at : at + size], frame, time_ns)
        if parameters.unjudged:
            judge_parameters(exchange.reporter, side, parameters, frame, time_ns)
        limit: i64 = connection.pdu_length
        if limit and (size > limit or parameters.answer_size > limit):
            self._judge_length(connection, parameters, buf[at : at + size], frame, time_ns)
        if buf[at + 2] or buf[at + 3] or (rosctr == ACK and size > head):
            judge_header(exchange.reporter, side, rosctr, size - head, u16(buf, at + 2), frame, time_ns)
        dialogue = exchange.dialogue
        if rosctr == JOB:
            done = dialogue.ask(side, JOB, pdu_ref, parameters, buf, at, size, frame, time_ns)  # `_request`, inlined
            if connection.granted is None or function == SETUP_COMMUNICATION or dialogue.several:
                self._judge(side, parameters, frame, time_ns)
            if done is not None or dialogue.also:
                exchange.completed(done, frame, time_ns)
            return
        if rosctr == USERDATA:
            userdata = parameters.userdata
            kind: i64 = -1
            if userdata is not None:
                kind = userdata.type
            if kind == REQUEST:
                self._request(side, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
                return
            if kind == PUSH:
                self._pushed(side, pdu_ref, parameters, buf, at, size, frame, time_ns)
                return
            if kind != RESPONSE:
                self.unpaired += 1
                return
        done = dialogue.answer(side, rosctr, pdu_ref, parameters, buf, at, size, data_at, frame, time_ns)
        exchange.completed(done, frame, time_ns)

    def _pushed(
        self,
        side: Side,
        pdu_ref: i64,
        parameters: Parameters,
        buf: bytes,
        at: i64,
        size: i64,
        frame: i64,
        time_ns: i64,
    ) -> None:
        """Take userdata of type push: an indication, or a request that the client marked with the wrong type."""
        exchange = self._exchange
        if self._pushed_by_client(side, parameters, frame, time_ns):
            # The client waits for an answer all the same.
            self._request(side, USERDATA, pdu_ref, parameters, buf, at, size, frame, time_ns)
        else:
            pushed = exchange.dialogue.push(side, pdu_ref, parameters, buf, at, size, frame, time_ns)
            exchange.completed(pushed, frame, time_ns)

    def _pushed_by_client(self, side: Side, parameters: Parameters, frame: i64, time_ns: i64) -> bool:
        """Return whether a client sent a push of a kind that only PLCs send; report that this request has the wrong type."""
        connection = side.connection
        if not connection.client_known or side.index != connection.client_side or not is_plc_push(parameters):
            return False
        self._exchange.reporter.note("s7.client_push", connection.number, [frame], time_ns, parameters.function_name)
        return True

    def _first_pdu(self, connection: Connection, frame: i64, time_ns: i64) -> None:
        if connection._state == ISO:  # the name of an IBH-NetLink gateway stays, whatever it carries
            connection.protocol = UPPER_NAMES[S7COMM]
        judge_port(self._exchange.reporter, connection, frame, time_ns)

    def _request(
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
        exchange = self._exchange
        dialogue = exchange.dialogue
        done = dialogue.ask(side, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
        self._judge(side, parameters, frame, time_ns)
        if done is not None or dialogue.also:
            exchange.completed(done, frame, time_ns)

    def _judge(self, side: Side, parameters: Parameters, frame: i64, time_ns: i64) -> None:
        """Apply the rules about sessions to a request that `Dialogue.ask` just took."""
        exchange = self._exchange
        connection = side.connection
        fault = ""
        if exchange.behind.used and connection._aside is not None:
            exchange.behind.asked(side)
        shared: bool = exchange.dialogue.shared
        if shared:
            exchange.dialogue.shared = False
            judge_shared(exchange.reporter, side, parameters, frame, time_ns)
        if connection.granted is None or parameters.function == SETUP_COMMUNICATION:
            fault = judge_request(exchange.reporter, side, parameters, 0, frame, time_ns)
        elif not shared:
            requests = connection.open_requests[side.index]
            if requests.count > 1:
                open_now: i64 = requests.count - requests.held
                agreed: bool = connection.setup_seen and not connection.setup_open
                if open_now > 1 and not (agreed and open_now <= connection.jobs_allowed(side.index)):
                    peer = side.peer
                    if peer is not None:
                        open_now = _surely_open(peer, open_now)
                    fault = judge_request(exchange.reporter, side, parameters, open_now, frame, time_ns)
        if fault:
            exchange.causes.blame(connection, exchange.dialogue.count, fault)

    # ---- PDUs behind malformed headers ------------------------------------------------------------------------------

    def behind(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take a whole PDU behind the malformed header of a TPDU: it is judged alone, and counts for no limit."""
        exchange = self._exchange
        self.behind_malformed += 1
        if exchange.observer.wants_pdus:
            exchange.observer.pdu(frame, time_ns, side, octets, False)
        rosctr, pdu_ref, param_length, data_length = read_header(octets, 0)
        if rosctr not in ROSCTR:
            exchange.reporter.note("s7.unknown_rosctr", side.connection.number, [frame], time_ns, f"ROSCTR {rosctr}")
            self.unpaired += 1
            return
        head: i64 = header_size(rosctr)
        parameters = self._parameters.get(octets, head, head + param_length, rosctr)
        if parameters.malformed or head + param_length + data_length != len(octets):
            self._note_malformed(side, octets, frame, time_ns)
        if parameters.unjudged:
            judge_parameters(exchange.reporter, side, parameters, frame, time_ns)
        userdata = parameters.userdata
        kind: i64 = userdata.type if userdata is not None else -1
        if rosctr == JOB or (rosctr == USERDATA and kind == REQUEST):
            exchange.behind.ask(side, rosctr, pdu_ref, parameters, octets, frame, time_ns)
        elif rosctr != USERDATA or kind == RESPONSE:
            exchange.behind.answer(side, rosctr, pdu_ref, parameters, octets, frame, time_ns)
        else:
            exchange.behind.push(side, pdu_ref, parameters, octets, frame, time_ns)

    # ---- PDUs that are damaged or cut -------------------------------------------------------------------------------

    def cut(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take a PDU that the capture cut off after ten octets or more: its header can still be paired."""
        self.pdus += 1
        self.cut_pdus += 1
        self.rosctrs.add(octets[1])
        if side.connection.pdus == 0:
            self._first_pdu(side.connection, frame, time_ns)
        side.connection.pdus += 1
        if self._exchange.observer.wants_pdus:
            self._exchange.observer.pdu(frame, time_ns, side, octets, True)
        self._pair_damaged(side, octets, frame, time_ns)

    def _damaged(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Report a PDU with an unknown ROSCTR or wrong lengths; pair it if its header can be read."""
        if len(octets) >= 10 and octets[1] not in ROSCTR:
            number = side.connection.number
            self._exchange.reporter.note("s7.unknown_rosctr", number, [frame], time_ns, f"ROSCTR {octets[1]}")
            self.unpaired += 1
            return
        self._note_malformed(side, octets, frame, time_ns)
        self._pair_damaged(side, octets, frame, time_ns)

    def _pair_damaged(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        exchange = self._exchange
        rosctr: i64 = octets[1]
        head: i64 = header_size(rosctr)
        size: i64 = len(octets)
        if size < head or rosctr not in ROSCTR:
            self.unpaired += 1
            return
        pdu_ref: i64 = u16(octets, 4)
        data_at: i64 = min(head + u16(octets, 6), size)
        parameters = self._parameters.get(octets, head, data_at, rosctr)
        if parameters.function >= 0:
            self.functions.add(parameters.function)
        userdata = parameters.userdata
        kind: i64 = userdata.type if userdata is not None else -1
        if rosctr == JOB or (rosctr == USERDATA and kind == REQUEST):
            self._request(side, rosctr, pdu_ref, parameters, octets, 0, size, frame, time_ns)
        elif rosctr != USERDATA or kind == RESPONSE:
            done = exchange.dialogue.answer(side, rosctr, pdu_ref, parameters, octets, 0, size, data_at, frame, time_ns)
            if done is not None:
                done._flags &= ~BAD_DATA  # the damage was reported already
            exchange.completed(done, frame, time_ns)
        elif kind == PUSH:
            self._pushed(side, pdu_ref, parameters, octets, 0, size, frame, time_ns)
        else:
            self.unpaired += 1

    def _note_malformed(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        reporter = self._exchange.reporter
        if reporter.wants("s7.malformed", side.connection.number, frame, frame, time_ns):
            pdu = parse_pdu(octets)
            what = str(pdu.malformed[0]) if pdu.malformed else "its lengths do not add up"
            detail = f"{pdu.rosctr_name} from {side.tcp.ends[side.index]}: {what}"
            reporter.detail("s7.malformed", side.connection.number, [frame], time_ns, detail)
        self._blame_next(side.connection, octets, "s7.malformed")

    def _judge_length(
        self, connection: Connection, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        reporter = self._exchange.reporter
        if len(octets) > connection.pdu_length:
            judge_size(reporter, connection, len(octets), frame, time_ns)
            self._blame_next(connection, octets, "session.pdu_too_long")
        if parameters.answer_size > connection.pdu_length:
            judge_answer_size(reporter, connection, parameters, frame, time_ns)
            self._blame_next(connection, octets, "session.read_too_long")

    def _blame_next(self, connection: Connection, octets: bytes, slug: str) -> None:
        """A PDU has a fault.

        If the PDU is a request, it will be the next transaction, because `Dialogue.ask` is called after this.
        """
        if is_request(octets):
            exchange = self._exchange
            exchange.causes.blame(connection, exchange.dialogue.count + 1, slug)

    # ---- what was counted -------------------------------------------------------------------------------------------

    def describe(self) -> dict[str, object]:
        """Return the section ``s7``."""
        return {
            "s7": {
                "pdus": self.pdus,
                **({"behind_malformed": self.behind_malformed} if self.behind_malformed else {}),
                "cut": self.cut_pdus,
                "unpaired": self.unpaired,
                "rosctr": {str(code): count for code, count in enumerate(self.rosctrs.counts()) if count},
                "functions": {f"0x{code:02x}": count for code, count in enumerate(self.functions.counts()) if count},
            }
        }

    def counted(self) -> list[tuple[int, str]]:
        """Return the number of PDUs, even if it is zero."""
        return [(self.pdus, "S7 PDU")]


def _surely_open(answering: Side, open_now: i64) -> i64:
    """Return ``open_now``, or 0 while octets of ``answering`` are missing, out of order or unfinished: they may be answers.

    A declared gap may contain answers as well. `judge_request` takes that into account; it examines only a few requests,
    because with thousands of open ones a full check for each new request would take seconds.
    """
    if answering.unfinished or answering.stream.held is not None or answering.unseen:
        return 0  # the asking side has acknowledged octets that the capture did not show, at least not so far
    return open_now
