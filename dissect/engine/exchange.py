"""The shared pairing: what every protocol hands its requests, responses and indications to.

Here a transaction is completed, judged, shown to those who watch, and reported to the observer. Findings are made through the
`Reporter` of this object, so that they are counted and bounded in one place whatever protocol they are about.
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.observer import Observer, Options
from dissect.engine.payload import PayloadDecoder
from dissect.engine.watch import Watch
from dissect.findings.reporter import Reporter
from dissect.findings.security_rules import SAMPLED
from dissect.findings.session_rules import judge_grant
from dissect.findings.transaction_rules import judge_transaction, judge_unanswered
from dissect.s7.parameters import Parameters
from dissect.s7.tables import READ_VAR, SETUP_COMMUNICATION, USERDATA, WRITE_VAR
from dissect.transactions.dialogue import Dialogue
from dissect.transactions.naming import Naming
from dissect.transactions.subscriptions import follow
from dissect.transactions.table import Side
from dissect.transactions.transaction import UNANSWERED, Transaction


class Exchange:
    """Requests, responses and indications in, transactions and findings out."""

    def __init__(self, observer: Observer, options: Options) -> None:
        self.observer: Observer = observer
        self.reporter: Reporter = Reporter()
        self.dialogue: Dialogue = Dialogue()
        self.watch: Watch = Watch(observer, self.reporter)
        self.decoder: PayloadDecoder | None = options.decoder
        self.naming: Naming | None = options.naming
        self.strict: bool = options.strict
        self._slow_ns: i64 = options.slow_ns
        if options.decoder is not None:
            options.decoder.attach(self)

    # ---- messages of other protocols than S7comm, whole and without an offset ---------------------------------------

    def request(
        self, side: Side, reference: i64, parameters: Parameters, octets: bytes, frame: i64, time_ns: i64
    ) -> None:
        """Take a request that ``side`` sent; ``reference`` is what its response will repeat."""
        size: i64 = len(octets)
        done = self.dialogue.ask(side, parameters.rosctr, reference, parameters, octets, 0, size, frame, time_ns)
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
        """Take what ``side`` sent without being asked."""
        size: i64 = len(octets)
        self.done(self.dialogue.push(side, reference, parameters, octets, 0, size, frame, time_ns))

    # ---- transactions -----------------------------------------------------------------------------------------------

    def completed(self, done: Transaction | None, frame: i64, time_ns: i64) -> None:
        """A message was paired: report what ended beside it, and the transaction it completes, if it does."""
        if self.dialogue.also:
            self.beside(frame, time_ns)
        if done is None:
            return
        if done.parameters.function == SETUP_COMMUNICATION:
            judge_grant(self.reporter, done)
        self.done(done)

    def done(self, transaction: Transaction) -> None:
        """A transaction is complete: judge it when it is odd, and report it."""
        if transaction.rosctr == USERDATA:
            follow(transaction)
        if transaction.has_errors:
            transaction.connection.note_error(transaction.parameters, transaction.response_ns, transaction.error_code)
        if (
            transaction.flags
            or transaction.has_errors
            or (transaction.request_frame and transaction.response_ns - transaction.request_ns > self._slow_ns)
        ):
            judge_transaction(self.reporter, transaction, self._slow_ns)
        if self.decoder is not None:
            self._look_inside(self.decoder, transaction)
        self.observer.transaction(transaction)
        if transaction.has_errors or transaction.parameters.function != READ_VAR:
            self._watch(transaction)

    def beside(self, frame: i64, now_ns: i64) -> None:
        """Report the transactions that ended beside the one at hand."""
        also = self.dialogue.also
        self.dialogue.also = []
        for transaction in also:
            if transaction.has_errors:
                transaction.connection.note_error(
                    transaction.parameters, transaction.response_ns, transaction.error_code
                )
            try:
                if transaction.outcome == UNANSWERED:
                    judge_unanswered(self.reporter, transaction, now_ns, self._slow_ns)
                else:
                    judge_transaction(self.reporter, transaction, self._slow_ns)
                if self.decoder is not None:
                    self.decoder.transaction(transaction)
                self.observer.transaction(transaction)
                self._watch(transaction)
            except Exception as bug:
                if self.strict:
                    raise
                self.note_bug(bug, frame, now_ns)

    def _look_inside(self, decoder: PayloadDecoder, transaction: Transaction) -> None:
        try:
            decoder.transaction(transaction)
        except Exception as bug:
            if self.strict:
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
            traits = transaction.connection.traits
            if function == WRITE_VAR:
                writes = traits.writes
                writes.count += 1
                if writes.count % SAMPLED == 0:
                    self.watch.security.sample(transaction)
            if parameters.written & ~traits.written:
                self.watch.security.write(transaction)
            if transaction.has_errors:
                self.watch.security.refused_items(transaction)

    # ---- findings and bugs ------------------------------------------------------------------------------------------

    def report_findings(self) -> None:
        """Hand detailed findings to the observer."""
        fresh = self.reporter.fresh
        self.reporter.fresh = []
        for finding in fresh:
            try:
                self.observer.finding(finding)
            except Exception:
                if self.strict:
                    raise
                self.reporter.wants("internal.bug", 0)  # counted only: reporting it would fail as well

    def note_bug(self, bug: Exception, frame: i64, time_ns: i64) -> None:
        """A bug of ours, or of an observer, struck: it costs what was at hand and is reported, and the analysis goes on."""
        self.reporter.note("internal.bug", 0, [frame], time_ns, f"{type(bug).__name__}: {bug}")
