"""From S7 PDUs to transactions: who asked, who answered, what is worth saying about it."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.observer import Observer, Options
from dissect.engine.payload import PayloadDecoder
from dissect.engine.watch import Watch
from dissect.findings.item_rules import judge_parameters
from dissect.findings.reporter import Reporter
from dissect.findings.security_rules import PACE
from dissect.findings.session_rules import judge_grant, judge_header, judge_length, judge_port, judge_request
from dissect.findings.transaction_rules import judge_transaction, judge_unanswered
from dissect.iso.upper import S7COMM, UPPER_NAMES
from dissect.s7.message import header_size, parse_pdu, read_header
from dissect.s7.parameters import PUSH, REQUEST, RESPONSE, ParameterCache, Parameters
from dissect.s7.tables import ACK, ACK_DATA, JOB, READ_VAR, ROSCTR, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.tcp.stream import HALF_SPACE, MASK
from dissect.transactions.connection import IBH, Connection
from dissect.transactions.dialogue import BAD_DATA, Dialogue
from dissect.transactions.table import Side
from dissect.transactions.transaction import UNANSWERED, Transaction
from dissect.wire.octets import u16


class Exchange:
    """S7 PDUs in, transactions and findings out: the end of the path, the upper half of `Conversation`."""

    def __init__(self, observer: Observer, options: Options) -> None:
        self.observer: Observer = observer
        self.judge: Reporter = Reporter()
        self.dialogue: Dialogue = Dialogue()
        self.rosctrs: list[int] = [0] * 256
        self.functions: list[int] = [0] * 256
        self.pdus: i64 = 0
        self.cut_pdus: i64 = 0
        self.unpaired: i64 = 0  # PDUs of a kind that cannot be paired, or too damaged for it
        self._parameters: ParameterCache = ParameterCache()
        self._slow_ns: i64 = options.slow_ns
        self._strict: bool = options.strict
        self.watch: Watch = Watch(observer, self.judge)
        self.carrier: PayloadDecoder | None = options.carrier
        if options.carrier is not None:
            options.carrier.attach(self)

    def _pdu(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        connection = side.connection
        self.pdus += 1
        self.rosctrs[buf[at + 1]] = self.rosctrs[buf[at + 1]] + 1
        if connection.pdus == 0:
            self._first_pdu(connection, frame, time_ns)
        connection.pdus += 1
        if connection.pdus & (PACE - 1) == 0:
            self.watch.security.pace(connection, frame, time_ns)
        if self.observer.wants_pdus:
            self.observer.pdu(frame, time_ns, side, buf[at : at + size], False)
        if size < 10:
            self._damaged_pdu(side, buf[at : at + size], frame, time_ns)
            return
        rosctr, pdu_ref, param_length, data_length = read_header(buf, at)
        head: i64 = 12 if rosctr == ACK_DATA or rosctr == ACK else 10
        data_at: i64 = at + head + param_length
        if data_at + data_length != at + size or (rosctr > ACK_DATA and rosctr != USERDATA):
            self._damaged_pdu(side, buf[at : at + size], frame, time_ns)
            return
        parameters = self._parameters.get(buf[at + head : data_at], rosctr)
        if parameters.function >= 0:
            self.functions[parameters.function] = self.functions[parameters.function] + 1
        if parameters.malformed:
            self._note_malformed(side, buf[at : at + size], frame, time_ns)
        if parameters.unjudged:
            judge_parameters(self.judge, side, parameters, frame, time_ns)
        limit: i64 = connection.pdu_length
        if limit and (size > limit or parameters.answer_size > limit):
            judge_length(self.judge, connection, parameters, size, frame, time_ns)
        if (rosctr == ACK and size > head) or u16(buf, at + 2):
            judge_header(self.judge, side, rosctr, size - head, u16(buf, at + 2), frame, time_ns)
        if rosctr == JOB:
            self._ask(side, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
        elif rosctr != USERDATA:
            done = self.dialogue.answer(side, rosctr, pdu_ref, parameters, buf, at, size, data_at, frame, time_ns)
            self._answered(done, frame, time_ns)
        else:
            userdata = parameters.userdata
            kind: i64 = userdata.type if userdata is not None else -1
            if kind == REQUEST:
                self._ask(side, rosctr, pdu_ref, parameters, buf, at, size, frame, time_ns)
            elif kind == RESPONSE:
                done = self.dialogue.answer(side, rosctr, pdu_ref, parameters, buf, at, size, data_at, frame, time_ns)
                self._answered(done, frame, time_ns)
            elif kind == PUSH:
                self.done(self.dialogue.push(side, pdu_ref, parameters, buf, at, size, frame, time_ns))
            else:
                self.unpaired += 1

    def _first_pdu(self, connection: Connection, frame: i64, time_ns: i64) -> None:
        if connection.state != IBH:
            connection.protocol = UPPER_NAMES[S7COMM]
        judge_port(self.judge, connection, frame, time_ns)

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
                peer = side.peer
                if peer is not None:
                    open_now = _surely_open(side, peer, open_now)
                judge_request(self.judge, side, parameters, open_now, frame, time_ns)
        self._answered(done, frame, time_ns)

    def _answered(self, done: Transaction | None, frame: i64, time_ns: i64) -> None:
        if self.dialogue.also:
            self.beside(frame, time_ns)
        if done is None:
            return
        if done.parameters.function == SETUP_COMMUNICATION:
            judge_grant(self.judge, done)
        self.done(done)

    def done(self, transaction: Transaction) -> None:
        """A transaction is complete: judge it when it is odd, and tell it."""
        if transaction.has_errors:
            transaction.connection.note_error(transaction.parameters, transaction.response_ns, transaction.error_code)
        if (
            transaction.flags
            or transaction.has_errors
            or (transaction.request_frame and transaction.response_ns - transaction.request_ns > self._slow_ns)
        ):
            judge_transaction(self.judge, transaction, self._slow_ns)
        if self.carrier is not None:
            self._look_inside(self.carrier, transaction)
        self.observer.transaction(transaction)
        if transaction.has_errors or transaction.parameters.function != READ_VAR:
            self._watch(transaction)

    # ---- what a carrier found ---------------------------------------------------------------------------------------

    def carried_request(
        self, side: Side, reference: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take a request of another protocol that ``side`` sent; ``reference`` is what its answer will repeat."""
        size: i64 = len(octets)
        done = self.dialogue.ask(side, parameters.rosctr, reference, parameters, octets, 0, size, frame, time_ns)
        self._answered(done, frame, time_ns)

    def carried_answer(
        self, side: Side, reference: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take an answer of another protocol that ``side`` sent."""
        size: i64 = len(octets)
        done = self.dialogue.answer(side, parameters.rosctr, reference, parameters, octets, 0, size, 0, frame, time_ns)
        self._answered(done, frame, time_ns)

    def carried_push(
        self, side: Side, reference: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take what ``side`` sent without being asked, in another protocol."""
        size: i64 = len(octets)
        self.done(self.dialogue.push(side, reference, parameters, octets, 0, size, frame, time_ns))

    def _look_inside(self, carrier: PayloadDecoder, transaction: Transaction) -> None:
        try:
            carrier.transaction(transaction)
        except Exception as bug:
            if self._strict:
                raise
            self.note_bug(bug, max(transaction.request_frame, transaction.response_frame), transaction.response_ns)

    def _watch(self, transaction: Transaction) -> None:
        """Show what is more than polling to those who watch."""
        parameters = transaction.parameters
        function: i64 = parameters.function
        if function != READ_VAR and function != WRITE_VAR:
            if transaction.rosctr <= USERDATA or transaction.is_plus:
                self.watch.take(transaction)
        else:
            if parameters.written & ~transaction.connection.traits.written:
                self.watch.security.write(transaction)
            if transaction.has_errors:
                self.watch.security.refused_items(transaction)

    def beside(self, frame: i64, now_ns: i64) -> None:
        """Tell the transactions that ended beside the one at hand."""
        also = self.dialogue.also
        self.dialogue.also = []
        for transaction in also:
            if transaction.has_errors:
                transaction.connection.note_error(
                    transaction.parameters, transaction.response_ns, transaction.error_code
                )
            try:
                if transaction.outcome == UNANSWERED:
                    judge_unanswered(self.judge, transaction, now_ns, self._slow_ns)
                else:
                    judge_transaction(self.judge, transaction, self._slow_ns)
                if self.carrier is not None:
                    self.carrier.transaction(transaction)
                self.observer.transaction(transaction)
                self._watch(transaction)
            except Exception as bug:
                if self._strict:
                    raise
                self.note_bug(bug, frame, now_ns)

    # ---- PDUs that are damaged or cut -------------------------------------------------------------------------------

    def cut_pdu(self, side: Side, pdu: bytes, frame: i64, time_ns: i64) -> None:
        """Take an S7 PDU of which the capture kept ten octets or more."""
        self.pdus += 1
        self.cut_pdus += 1
        self.rosctrs[pdu[1]] += 1
        if side.connection.pdus == 0:
            self._first_pdu(side.connection, frame, time_ns)
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
            self.functions[parameters.function] = self.functions[parameters.function] + 1
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
            self._answered(done, frame, time_ns)
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

    # ---- findings and bugs ------------------------------------------------------------------------------------------

    def tell_findings(self) -> None:
        """Hand detailed findings to the observer."""
        fresh = self.judge.fresh
        self.judge.fresh = []
        for finding in fresh:
            try:
                self.observer.finding(finding)
            except Exception:
                if self._strict:
                    raise
                self.judge.wants("internal.bug", 0)  # counted only: telling it would fail as well

    def note_bug(self, bug: Exception, frame: i64, time_ns: i64) -> None:
        """A bug of ours, or of an observer, struck: it costs what was at hand and is told, and the analysis goes on."""
        self.judge.note("internal.bug", 0, [frame], time_ns, f"{type(bug).__name__}: {bug}")


def _surely_open(side: Side, answering: Side, open_now: i64) -> i64:
    """Return how many requests of ``side`` are open, 0 while octets that may be answers are missing or out of order.

    What a hole that was given up may have swallowed is left to `judge_request`, which looks at few requests only: walking
    over thousands for each one that is asked would take seconds.
    """
    half = answering.stream
    if half.held is not None or 0 < (side.last_ack - half.next_seq) & MASK < HALF_SPACE:
        return 0  # the asking side has octets that the capture did not show, or not yet
    return open_now
