"""`Exchange` takes the requests, responses and indications of all protocols, pairs them and has them judged.

When a message completes a transaction, the rules judge it first (`judge_transaction`), then the observer gets it, then `Watch`,
which handles operations, security and stations. All findings go through the one `Reporter` of this object, so they are counted
and bounded in one place for all protocols. A read without an error is only paired and reported to the observer.

`PayloadDecoder` looks for another protocol inside the payloads (`dissect.meaning.bindings`: SCD). It hands what it finds back
to `Exchange`, as all protocols do.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mypy_extensions import i64, mypyc_attr

from dissect.engine.acts.book import ActBook
from dissect.engine.findings.explaining import Causes
from dissect.engine.findings.ledger import Ledger
from dissect.engine.findings.operation_rules import judge_loaded, judge_operation, judge_strays
from dissect.engine.findings.plus_rules import PlusWatch
from dissect.engine.findings.reporter import Reporter
from dissect.engine.findings.security_rules import SAMPLED, SecurityWatch
from dissect.engine.findings.session_rules import judge_grant
from dissect.engine.findings.station_rules import StationWatch
from dissect.engine.findings.transaction_rules import judge_body, judge_szl, judge_transaction, judge_unanswered
from dissect.engine.observer import Observer
from dissect.engine.stations.evidence import TELLING
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.behind import Behind
from dissect.engine.transactions.connection import Connection, Traits
from dissect.engine.transactions.naming import Naming
from dissect.engine.transactions.operation import DONE, DOWNLOAD, TRANSFERS, Operation
from dissect.engine.transactions.operations import Operations
from dissect.engine.transactions.pairing import Dialogue
from dissect.engine.transactions.payloads import SCD, ScdParameters
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.subscriptions import follow
from dissect.engine.transactions.transaction import ANSWERED, BEHIND_MALFORMED, UNANSWERED, Transaction
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import GROUP_CPU, JOB, READ_VAR, SETUP_COMMUNICATION, USERDATA, WRITE_VAR

if TYPE_CHECKING:
    from dissect.engine.findings.block_rules import BlockWatch


@mypyc_attr(allow_interpreted_subclasses=True)
class PayloadDecoder:
    """Looks for messages of another protocol; this base class finds none.

    ``udp_ports`` are the UDP ports whose datagrams it wants.
    """

    def __init__(self) -> None:
        self.udp_ports: set[int] = set()

    def attach(self, exchange: Exchange) -> None:
        """Set the exchange that gets the messages; called once, before the first packet."""

    def claims_port(self, transport: str, connection: Connection) -> bool:
        """Return whether the decoder claims a new conversation, and set its client if so; ``transport`` is "tcp" or "udp"."""
        return False

    def datagram(self, side: Side, octets: bytes, missing: i64, frame: i64, time_ns: i64) -> None:
        """Take a UDP payload of a claimed conversation; ``missing`` octets of it were not captured."""

    def stream(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a claimed TCP connection."""

    def hole(self, side: Side, size: i64, frame: i64, time_ns: i64) -> None:
        """Take note that ``size`` octets of a claimed TCP connection are missing here."""

    def claims_tsdus(self, connection: Connection) -> bool:
        """Return whether the decoder claims the TSDUs of a connection, judged by the TSAPs that are known so far."""
        return False

    def tsdu(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> bool:
        """Take a TSDU that is neither S7comm nor S7comm-plus; False if it is not of the decoder's protocol."""
        return False

    def transaction(self, transaction: Transaction) -> None:
        """Take an S7 transaction before it is reported, and those of the decoder itself except `ScdParameters.settled`."""

    def restart(self) -> None:
        """Another capture begins: forget what was seen."""

    def message_count(self) -> int:
        """Return how many messages were found."""
        return 0

    def as_dict(self) -> dict[str, Any]:
        """Return what was found, as JSON-ready values for the analysis."""
        return {}

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """The connection of ``side`` is over."""


class Watch:
    """Takes all transactions except plain reads and writes, and makes operations, findings and facts of them."""

    def __init__(self, observer: Observer, reporter: Reporter) -> None:
        self._observer = observer
        self._reporter = reporter
        self.operations = Operations()
        self.acts = ActBook(self.operations)
        self.security = SecurityWatch(reporter, self.acts)
        self.plus = PlusWatch(reporter, self.security, self.operations)
        self._blocks: BlockWatch | None = None
        self.stations = StationWatch(reporter, observer.own_book)

    def opened(self, connection: Connection) -> None:
        """A connection was recognised."""
        if connection.tcp.macs:
            self._facts(self.stations.opened(connection, self._observer.wants_facts))

    def take(self, transaction: Transaction) -> None:
        """Take a transaction that is neither a read nor a write."""
        if transaction.is_plus:
            self.plus.take(transaction)
            session = transaction.connection.plus
            if session is not None and session.identity.told:
                self._facts(self.stations.identified(session.identity, transaction, self._observer.wants_facts))
            self._tell()
            return
        self.operations.take(transaction)
        act = self.acts.take(transaction)
        head = transaction.parameters.userdata
        if head is not None and head.group == GROUP_CPU:
            judge_szl(self._reporter, transaction)
        elif not (transaction.has_errors or transaction._outcome == UNANSWERED):
            judge_body(self._reporter, transaction)  # a failed one was judged before
        if transaction._flags:
            judge_strays(self._reporter, transaction)
        self.security.take(transaction, act)
        if head is not None and head.group in TELLING:
            self._facts(self.stations.take(transaction))
        self._tell()

    def behind(self, transaction: Transaction) -> None:
        """Take an unpaired message behind a malformed header: it counts for security, and for nothing else."""
        function: i64 = transaction.parameters.function
        if transaction.is_plus:
            self.plus.behind(transaction)
        elif function == WRITE_VAR:
            traits = transaction.connection.traits
            if transaction.request_frame and transaction.parameters.written & ~traits.written:
                self.security.write(transaction)
        elif function != READ_VAR:
            self.security.take(transaction, self.acts.take(transaction, alone=True))
        self.tell_acts()

    def end(self, connection: Connection, reason: str) -> None:
        """A connection is over; ``reason`` is one of the reasons of transactions."""
        if connection.plus is not None:
            self.plus.finish(connection)
        self.operations.end(connection, reason)
        self.security.end(connection)
        if connection.plus is not None:
            self.plus.end(connection)
        if connection.has_loaded:
            judge_loaded(self._reporter, connection, reason)
        self._tell()

    def forget(self) -> None:
        """Nothing more comes: forget the statements of stations, which were only needed to find contradictions."""
        self.stations = StationWatch(self._reporter)

    def tell_acts(self) -> None:
        """Pass the finished acts to the observer."""
        if self.acts.fresh:
            fresh = self.acts.fresh
            self.acts.fresh = []
            for act in fresh:
                self._observer.act(act)

    def _tell(self) -> None:
        self.tell_acts()
        over = self.operations.over
        if not over:
            return
        self.operations.over = []
        for operation in over:
            if operation.oddities or operation.result != DONE:  # the rule is not compiled, and each setup comes here
                judge_operation(self._reporter, operation)
            act = self.acts.over(operation)
            if act is not None and not operation.begun and operation.kind == DOWNLOAD:
                self.security.loaded(act)
            self.tell_acts()
            if operation.content and operation.kind in TRANSFERS:
                self._look_at_block(operation)
            self._observer.operation(operation)
            if operation.content_head is not None:
                self._facts(self.stations.joined(operation))

    def _facts(self, facts: list[Fact]) -> None:
        if facts and self._observer.wants_facts:
            for fact in facts:
                self._observer.fact(fact)

    def _look_at_block(self, operation: Operation) -> None:
        if operation.connection.plus is not None:
            return  # unknown: which parts of an S7comm-plus block the CPU changes by itself
        if self._blocks is None:
            from dissect.engine.findings.block_rules import BlockWatch  # late: few captures have blocks

            self._blocks = BlockWatch(self._reporter)
        self._blocks.take(operation)


class Exchange:
    """Requests, responses and indications in, transactions and findings out."""

    def __init__(self, observer: Observer, decoder: PayloadDecoder | None, strict: bool, slow_ns: i64) -> None:
        self.observer: Observer = observer
        self.reporter: Reporter = Reporter()
        self.reporter.every = observer.wants_every_finding
        self.dialogue: Dialogue = Dialogue()
        self.causes: Causes = Causes(self.reporter, slow_ns)
        self.behind: Behind = Behind(self.dialogue)
        self.watch: Watch = Watch(observer, self.reporter)
        self.decoder: PayloadDecoder | None = decoder
        self.naming: Naming | None = None  # names of addresses, if the user gave any
        self.strict: bool = strict
        self.bug: Exception | None = None  # the first one, until `Run` has found out whose fault it is
        self._slow_ns: i64 = slow_ns
        if decoder is not None:
            decoder.attach(self)

    # ---- messages of other protocols than S7comm, whole and without an offset ---------------------------------------

    def request(
        self, side: Side, reference: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take a request that ``side`` sent; ``reference`` is what its response will repeat."""
        size: i64 = len(octets)
        done = self.dialogue.ask(side, parameters.rosctr, reference, parameters, octets, 0, size, frame, time_ns)
        self.dialogue.shared = False  # other protocols have their own rules for a number that is used twice
        self.completed(done, frame, time_ns)

    def response(
        self, side: Side, reference: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take a response that ``side`` sent."""
        size: i64 = len(octets)
        done = self.dialogue.answer(side, parameters.rosctr, reference, parameters, octets, 0, size, 0, frame, time_ns)
        self.completed(done, frame, time_ns)

    def indication(
        self, side: Side, reference: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take a message that ``side`` sent without a request."""
        size: i64 = len(octets)
        self.completed(self.dialogue.push(side, reference, parameters, octets, 0, size, frame, time_ns), frame, time_ns)

    # ---- transactions -----------------------------------------------------------------------------------------------

    def completed(self, transaction: Transaction | None, frame: i64, time_ns: i64) -> None:
        """Report other transactions that a message ended; then judge and report the transaction that it completed, if any."""
        if self.dialogue.also:
            self.beside(frame, time_ns)
        if transaction is None:
            return
        if (
            transaction.parameters.function == READ_VAR
            and not transaction._flags
            and not transaction.has_errors
            and self.decoder is None
            and transaction.rosctr == JOB
            and 0 <= transaction.response_ns - transaction.request_ns <= self._slow_ns
        ):
            self.observer.transaction(transaction)  # the usual case: nothing to judge
        else:
            self._complete(transaction)

    def _complete(self, transaction: Transaction) -> None:
        """Judge and report a transaction that has an answer."""
        self.causes.begin(transaction, transaction.response_ns)
        function: i64 = transaction.parameters.function
        if function == SETUP_COMMUNICATION:
            judge_grant(self.reporter, transaction)
        if transaction.rosctr == USERDATA:
            follow(transaction)
        if transaction.has_errors:
            transaction.connection._note_error(transaction.parameters, transaction.response_ns, transaction.error_code)
        if (
            transaction._flags
            or transaction.has_errors
            or (
                transaction.request_frame and not 0 <= transaction.response_ns - transaction.request_ns <= self._slow_ns
            )
        ):
            self._judge_command(transaction)
            judge_transaction(self.reporter, transaction, self._slow_ns)
        if self.decoder is not None:
            self._look_inside(self.decoder, transaction)
        self.observer.transaction(transaction)
        if transaction.has_errors or function != READ_VAR:
            self._watch(transaction)
        self.causes.close()

    def beside(self, frame: i64, now_ns: i64) -> None:
        """Report the transactions that the current message ended, besides the one that it completed."""
        also = self.dialogue.also
        self.dialogue.also = []
        for transaction in also:
            try:
                if transaction._outcome == ANSWERED:  # it waited until its answer was known
                    self._complete(transaction)
                elif transaction._outcome == BEHIND_MALFORMED:
                    self.observer.transaction(transaction)
                    self.watch.behind(transaction)
                else:
                    self._end(transaction, now_ns)
            except Exception as bug:
                self.note_bug(bug, frame, now_ns)

    def _end(self, transaction: Transaction, now_ns: i64) -> None:
        """Judge and report a transaction without an answer, or without a request."""
        if transaction.has_errors:
            transaction.connection._note_error(transaction.parameters, transaction.response_ns, transaction.error_code)
        self.causes.begin(transaction, now_ns)
        self._judge_command(transaction)
        if transaction._outcome == UNANSWERED:
            judge_unanswered(self.reporter, transaction, now_ns, self._slow_ns)
        else:
            judge_transaction(self.reporter, transaction, self._slow_ns)
        if self.decoder is not None:
            self.decoder.transaction(transaction)
        self.observer.transaction(transaction)
        self._watch(transaction)
        self.causes.close()

    def _judge_command(self, transaction: Transaction) -> None:
        """Judge the content of a failed command or service before its outcome: the content may explain the outcome."""
        head = transaction.parameters.userdata
        if (transaction.has_errors or transaction._outcome == UNANSWERED) and (head is None or head.group != GROUP_CPU):
            if transaction.rosctr <= USERDATA:
                judge_body(self.reporter, transaction)

    def _look_inside(self, decoder: PayloadDecoder, transaction: Transaction) -> None:
        if transaction.rosctr == SCD:
            parameters = transaction.parameters
            if isinstance(parameters, ScdParameters) and parameters.settled:
                return
        try:
            decoder.transaction(transaction)
        except Exception as bug:
            self.note_bug(bug, max(transaction.request_frame, transaction.response_frame), transaction.response_ns)

    def _watch(self, transaction: Transaction) -> None:
        """Pass to `Watch` the transactions that it needs: of reads and writes only samples, new areas and refusals."""
        parameters = transaction.parameters
        function: i64 = parameters.function
        if function != READ_VAR and function != WRITE_VAR:
            if transaction.rosctr <= USERDATA or transaction.is_plus:
                self.watch.take(transaction)
        else:
            traits = transaction.connection.traits
            if function == WRITE_VAR:
                writes = traits.writes
                writes.count += 1
                if writes.count % SAMPLED == 0:
                    self.watch.security.sample(transaction)
            if parameters.written & ~traits.written:
                self.watch.security.write(transaction)
                self.watch.tell_acts()
            elif parameters.written:
                self._write_again(transaction, traits)
            if transaction.has_errors:
                self.watch.security.refused_items(transaction)
                self.watch.tell_acts()

    def _write_again(self, transaction: Transaction, traits: Traits) -> None:
        """Count a write to areas that the connection wrote to before; faultless writes are added up and counted later."""
        if transaction.has_errors or self.reporter.every:
            self.watch.security.write_again(transaction)
            return
        writes = traits.writes
        if writes.areas != transaction.parameters.written:
            self.watch.security.count_writes(transaction.connection)
            writes.areas = transaction.parameters.written
        writes.note(
            max(transaction.request_frame, transaction.response_frame),
            max(transaction.request_ns, transaction.response_ns),
        )

    # ---- findings and bugs ------------------------------------------------------------------------------------------

    @property
    def ledger(self) -> Ledger:
        """The facts of each rule; if the observer selects, only those of the selected findings."""
        selected = self.observer.own_ledger
        return selected if selected is not None else self.reporter.ledger

    def tick(self, now_ns: i64) -> None:
        """Time has passed."""
        self.causes.tick(now_ns)
        self.reporter.tick(now_ns)

    def finish(self) -> None:
        """The capture ends: report the findings that were only counted."""
        self.reporter.remind()
        self.report_findings()

    def report_findings(self) -> None:
        """Hand detailed findings to the observer."""
        fresh = self.reporter.fresh
        self.reporter.fresh = []
        for finding in fresh:
            try:
                if finding.repeated:
                    self.observer.repeated(finding)
                else:
                    self.observer.finding(finding)
            except Exception as bug:
                if self.strict:
                    raise
                self.bug = self.bug or bug
                # Only count it: reporting it would fail as well.
                self.reporter.count("internal.bug", 0, finding.frames[-1] if finding.frames else 0, finding.time_ns)

    def note_bug(self, bug: Exception, frame: i64, time_ns: i64) -> None:
        """Report a bug of the analyzer or of an observer: the current packet is lost, and the analysis continues.

        Strict: raise it.
        """
        if self.strict:
            raise bug
        self.bug = self.bug or bug
        self.causes.close()  # the bug may have occurred during a judgement
        self.reporter.note("internal.bug", 0, [frame], time_ns, f"{type(bug).__name__}: {bug}")
