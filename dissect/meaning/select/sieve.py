"""`Sieve`: an observer between the pipeline and another observer, which passes on only what is selected.

A thing that has all fields of the expression is selected by its own fields. Any other thing is selected with transactions: a
connection that has a selected transaction, an operation that contains one, a finding that names a packet of one.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from dissect.engine.acts.act import Act
from dissect.engine.findings.bounds import COUNTED, Bounds
from dissect.engine.findings.ledger import Ledger
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.engine.stations.facts import MAC, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.analysis import Part
from dissect.meaning.report.headers import irregular
from dissect.meaning.select.things import CONNECTION, FINDING, MESSAGE, OPERATION, TRANSACTION, Message
from dissect.meaning.select.where import PLURALS, Where
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES

#: `Numbers` takes a bit for each number, in pages of `_PAGE` bits. It keeps up to `_PAGES` pages: 16 million numbers in 2 MiB.
_PAGE: Final = 32_768
_PAGES: Final = 512
#: This many findings wait for a transaction that may select them; further ones are judged by the transactions so far.
MAX_WAITING: Final = 20_000


class Numbers:
    """A set of numbers that are added roughly in order, in little memory; the oldest page is forgotten first."""

    def __init__(self) -> None:
        self._pages: OrderedDict[int, bytearray] = OrderedDict()

    def add(self, number: int) -> None:
        """Remember a number."""
        at, bit = divmod(number, _PAGE)
        page = self._pages.get(at)
        if page is None:
            page = self._pages[at] = bytearray(_PAGE // 8)
            if len(self._pages) > _PAGES:
                self._pages.popitem(last=False)
        page[bit >> 3] |= 1 << (bit & 7)

    def __contains__(self, number: int) -> bool:
        at, bit = divmod(number, _PAGE)
        page = self._pages.get(at)
        return page is not None and bool(page[bit >> 3] & 1 << (bit & 7))


class Sieve(Observer):
    """Passes on to ``observer`` what ``where`` selects.

    ``left_out`` counts what was not passed on, by kind; ``findings`` counts the findings passed on, by slug, and ``explained``
    those of them that another finding explains, by the slugs of both; ``own_ledger`` has their facts. With ``at_once``, for
    live runs, a finding is judged when it comes. Otherwise a finding that is selected with its transactions waits until its
    connection is over, since its transaction may come later.
    """

    def __init__(self, observer: Observer, where: Where, at_once: bool = False) -> None:
        super().__init__()
        self.wants_pdus = observer.wants_pdus
        self.wants_tpdus = observer.wants_tpdus
        self.wants_every_finding = True  # selected findings are counted before any limit, and limited here
        self.passed = dict.fromkeys((TRANSACTION, OPERATION, FINDING, CONNECTION), 0)
        self.messages = 0  # number of messages, and of those passed on
        self.left_out = dict.fromkeys(self.passed, 0)
        self.findings: dict[str, int] = {}
        self.explained: dict[tuple[str, str], int] = {}
        self.own_ledger: Ledger | None = Ledger()
        self._observer = observer
        self._where = where
        self._at_once = at_once
        self._carrying = b""  # the present TPKT
        self._wanted = where.predicate(TRANSACTION)
        self._connections = set[int]()  # open ones with a selected transaction
        self._open = set[int]()
        self._numbers = Numbers()
        self._frames = Numbers()
        self._waiting: dict[int, list[Finding]] = {}
        self._waiting_count = 0
        self._bounds = Bounds()
        self._explained_bounds = Bounds()
        self._passing = False  # whether the latest transaction or operation was selected
        self._by_itself = {kind: where.knows(kind) for kind in PLURALS}

    def part(self, pipeline: Pipeline) -> Part:
        """Return the `Part` for an analysis: how much was selected and left out. Call it after ``pipeline`` has finished."""
        part = Part(self._where.text)
        part.passed = self.messages + sum(self.passed.values())
        part.transactions = self.left_out[TRANSACTION]
        part.operations = self.left_out[OPERATION]
        part.connections = self.left_out[CONNECTION]
        part.findings = self.left_out[FINDING]
        part.not_read = pipeline.connections.left_out
        judged = self.passed[FINDING] + self.left_out[FINDING]
        reporter = pipeline.exchange.reporter
        part.findings_not_judged = max(0, sum(reporter.counts.values()) + sum(reporter.explained.values()) - judged)
        part.finding_counts = dict(self.findings)
        part.explained_counts = dict(self.explained)
        part.ledger = self.own_ledger or Ledger()
        return part

    @property
    def nothing(self) -> bool:
        """Whether nothing at all was passed on."""
        return not self.messages and not any(self.passed.values())

    def connection_opened(self, connection: Connection) -> None:
        """Pass on a new connection if its own fields select it."""
        self._where.context.opened(connection)
        self._open.add(int(connection.number))
        if self._by_itself[CONNECTION] and self._where.connection(connection):
            self._observer.connection_opened(connection)

    def connection_closed(self, connection: Connection) -> None:
        """Judge the findings that waited for the end of this connection, then the connection itself."""
        number = int(connection.number)
        self._where.context.closed(connection)
        self._open.discard(number)
        waited = self._waiting.pop(number, ())
        self._waiting_count -= len(waited)
        for finding in waited:
            self._pass_finding(finding, self._shows_selected(finding))
        self._bounds.over(number)
        self._explained_bounds.over(number)
        wanted = self._where.connection(connection) if self._by_itself[CONNECTION] else number in self._connections
        self._connections.discard(number)
        self._count(CONNECTION, wanted)
        if wanted:
            self._observer.connection_closed(connection)

    def transaction(self, transaction: Transaction) -> None:
        """Pass on a transaction that is selected, and remember it for the things that are selected with it."""
        self._passing = bool(self._wanted(transaction))
        if not self._passing:
            self.left_out[TRANSACTION] += 1
            return
        self.passed[TRANSACTION] += 1
        if not self._by_itself[CONNECTION]:
            self._connections.add(int(transaction.connection.number))
        if not self._by_itself[OPERATION]:
            self._numbers.add(int(transaction.number))
        if not self._by_itself[FINDING]:
            for frame in (transaction.request_frame, transaction.response_frame):
                if frame:
                    self._frames.add(int(frame))
        self._observer.transaction(transaction)

    def operation(self, operation: Operation) -> None:
        """Pass on an operation that is selected, or that contains a selected transaction."""
        if self._by_itself[OPERATION]:
            wanted = self._where.operation(operation)
        else:
            wanted = any([number in self._numbers for number in operation.transactions])
        self._passing = wanted
        self._count(OPERATION, wanted)
        if wanted:
            self._observer.operation(operation)

    def act(self, act: Act) -> None:
        """Pass on an act of which the transaction or, for a transfer, the operation is selected."""
        operation = act.operation
        if operation is None or not act.row.lasts:
            wanted = self._passing  # it comes right after its transaction
        elif self._by_itself[OPERATION]:
            wanted = self._where.operation(operation)
        else:
            wanted = any([number in self._numbers for number in act.transactions])
        if wanted:
            self._observer.act(act)

    def finding(self, finding: Finding) -> None:
        """Pass on a finding that is selected, or that names a packet of a selected transaction."""
        if self._by_itself[FINDING]:
            self._pass_finding(finding, self._where.finding(finding))
        elif self._shows_selected(finding):
            self._pass_finding(finding, True)
        elif self._at_once or finding.connection not in self._open or self._waiting_count >= MAX_WAITING:
            self._pass_finding(finding, False)
        else:
            self._waiting_count += 1
            self._waiting.setdefault(int(finding.connection), []).append(finding)

    def fact(self, fact: Fact) -> None:
        """Pass on a fact that a station stated in the current transaction or operation if that is selected; MACs always."""
        if self._passing or fact.key == MAC:
            self._observer.fact(fact)

    def _shows_selected(self, finding: Finding) -> bool:
        return any([int(frame) in self._frames for frame in finding.frames])

    def _pass_finding(self, finding: Finding, wanted: bool) -> None:
        """Count a selected finding."""
        if finding.reported:
            self._count(FINDING, wanted)
        if not wanted:
            return
        self._note(finding)
        if self._at_once or self._observer.wants_every_finding:
            self._observer.finding(finding)
            return
        if finding.bare:
            return
        bounds = self._explained_bounds if finding.because else self._bounds
        finding.room = bounds.take(finding.slug, finding.client, finding.server, finding.connection)
        if finding.room != COUNTED:
            self._observer.finding(finding)

    def _note(self, finding: Finding) -> None:
        """Count what is selected."""
        if self.own_ledger is not None:
            place = (finding.client, finding.server, finding.connection, finding.frames, finding.time_ns)
            self.own_ledger.add(finding.slug, finding.because, *place, finding.reported)
        if not finding.reported:
            return
        if finding.because:
            pair = (finding.because, finding.slug)
            self.explained[pair] = self.explained.get(pair, 0) + 1
        else:
            self.findings[finding.slug] = self.findings.get(finding.slug, 0) + 1

    def repeated(self, finding: Finding) -> None:
        """Do nothing: findings that were only counted are not known to be selected."""

    def _count(self, kind: str, wanted: bool) -> None:
        if wanted:
            self.passed[kind] += 1
        else:
            self.left_out[kind] += 1

    # ---- messages ---------------------------------------------------------------------------------------------------

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Pass on an S7 PDU that its own fields select."""
        if self._takes(UPPER_NAMES[S7COMM], frame, time_ns, side, octets, cut):
            self._observer.pdu(frame, time_ns, side, octets, cut)

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Pass on an S7comm-plus PDU that its own fields select."""
        if self._takes(UPPER_NAMES[S7COMM_PLUS], frame, time_ns, side, octets, cut):
            self._observer.plus_pdu(frame, time_ns, side, octets, cut)

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        """Pass on an SCD message that its own fields select."""
        if self._takes(UPPER_NAMES[SCD], frame, time_ns, side, found.octets, scd=found):
            self._observer.scd(frame, time_ns, side, found)

    def _takes(
        self,
        protocol: str,
        frame: int,
        time_ns: int,
        side: Side,
        octets: bytes,
        cut: bool = False,
        scd: ScdMessage | None = None,
    ) -> bool:
        if not self._by_itself[MESSAGE]:
            return False
        header = irregular(self._carrying, octets, side.connection.class_)
        behind = header is not None and header.behind
        message = Message(
            protocol, int(frame), int(time_ns), side.connection, int(side.index), octets, cut, scd, behind
        )
        wanted = self._where.message(message)
        self.messages += wanted
        return wanted

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Pass on every TPKT: an observer needs it for the PDU in it, whose selection comes later."""
        self._carrying = octets
        self._observer.tpdu(frame, time_ns, side, octets)

    def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Pass on every IBH-NetLink packet, for the same reason."""
        self._observer.ibh_packet(frame, time_ns, side, octets)

    def comment(self, frame: int, text: str) -> None:
        """Pass on every packet comment."""
        self._observer.comment(frame, text)
