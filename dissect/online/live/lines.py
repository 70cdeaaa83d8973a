"""Events of a live run as lines of text, one for each event: the plain form of `s7dissect monitor`."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from typing import Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.stations.facts import KEYS, Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import NO_FAILURES, Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report import endings, words
from dissect.meaning.report.operations import operation_line
from dissect.meaning.report.styled import DIM, FAILED, HANG, PLAIN, Line
from dissect.meaning.report.words import Places, named
from dissect.meaning.report.writers.text import scd_line, transaction_line
from dissect.online.live.events import CLOSED, DEVICE, FINDING, OPENED, OPERATION, PROBLEM, SCD, TRANSACTION, Event
from dissect.online.live.session import Status
from dissect.packets.tcp.link import within
from dissect.wire.text import Clock, printable, shortened

#: Topics that a user can choose, and the kinds of events that each means.
TOPICS: Final = {
    "connections": (OPENED, CLOSED),
    "transactions": (TRANSACTION,),
    "operations": (OPERATION,),
    "findings": (FINDING,),
    "devices": (DEVICE,),
    "scd": (SCD,),
}
#: At most this many characters of a finding's detail are shown.
_DETAIL: Final = 300


def kinds_of(topics: Iterable[str]) -> frozenset[str]:
    """Return the kinds of events that ``topics`` mean; all kinds for no topics. Problems are always included."""
    wanted = list(topics) or list(TOPICS)
    return frozenset([PROBLEM, *[kind for topic in wanted for kind in TOPICS[topic]]])


class PlainLines:
    """Makes lines of text of events of the wanted ``kinds``. ``clock`` writes times, by default in UTC."""

    def __init__(self, kinds: Collection[str], clock: Clock | None = None) -> None:
        self._kinds = kinds
        self._clock = clock or Clock()
        self._places = Places([], False)

    def lines(self, events: Iterable[Event]) -> list[str]:
        """Return the lines of events, in their order."""
        return [self.line(event) for event in events if event.kind in self._kinds]

    def written(self, events: Iterable[Event], lost: Iterable[str] = ()) -> list[str | Line]:
        """Return the lines of events with their style, in their order, then ``lost``: lines that `lost` returned."""
        lines: list[str | Line] = [
            Line(self.line(event), _style(event), HANG) for event in events if event.kind in self._kinds
        ]
        return lines + [Line(text, "warning", HANG) for text in lost]

    def end(self, status: Status) -> list[str | Line]:
        """Return no lines: `summary_lines` are written elsewhere."""
        return []

    def line(self, event: Event) -> str:
        """Return the line of an event of any kind; if there are several interfaces, it begins with its own."""
        line = self._line(event)
        return f"{printable(event.interface)}  {line}" if event.interface else line

    def _line(self, event: Event) -> str:
        what = event.what
        if isinstance(what, Transaction):
            return transaction_line(what, self._clock, self._places)
        if isinstance(what, Operation):
            return operation_line(what, self._clock, self._places)
        if isinstance(what, tuple):
            return scd_line(what[0], what[1], self._clock, self._places)
        begun = self._clock.moment(event.time_ns)
        if isinstance(what, Connection):
            return f"{begun}  {self._connection(event.kind, what)}"
        if isinstance(what, Finding):
            return f"{begun}  {self._finding(what)}"
        if isinstance(what, Fact):
            return f"{begun}  {self._device(what)}"
        return f"{begun}  PROBLEM  {printable(what)}"

    def lost(self, now_ns: int, counts: dict[str, int]) -> str:
        """Return the line on how many events, by kind, were left out because the output was read too slowly."""
        said = ", ".join([words.count(number, kind.replace("_", " ")) for kind, number in sorted(counts.items())])
        return f"{self._clock.moment(now_ns)}  NOT SHOWN  {said}: this output is not taken fast enough"

    def _connection(self, kind: str, connection: Connection) -> str:
        arrow = "→" if connection.client_known else "↔"
        over = " UDP" if connection.udp else ""
        who = f"connection {connection.number}  {connection.client} {arrow} {connection.server}{over}"
        if kind == OPENED:
            return f"{who}  opened"
        name = f"  {named(connection)}" if connection.protocol not in {"", "s7comm"} else ""
        refused = f"  REFUSED: {connection.refused}" if connection.refused else ""
        counts = [f"{connection.answered} answered"]
        if connection.missed:
            counts.append(f"{connection.missed} UNANSWERED")
        if connection.errors:
            counts.append(f"{connection.errors} with errors")
        return f"{who}{name}  {endings.phrase(connection, self._places)}{refused}  ({', '.join(counts)})"

    def _device(self, fact: Fact) -> str:
        name = shortened(f"{within(fact.host, fact.vlan)} {fact.module}".rstrip(), _DETAIL)
        kind = KEYS.get(fact.key, fact.key)
        before = f", before {shortened(fact.before, _DETAIL)}" if fact.before else ""
        place = self._places.phrase(fact.frames)
        return f"DEVICE  {name}  {printable(kind)} {shortened(fact.value, _DETAIL)}{before}  ({fact.source}, {place})"

    def _finding(self, finding: Finding) -> str:
        where = [f"connection {finding.connection}"] if finding.connection else []
        if finding.frames:
            where.append(self._places.phrase(finding.frames))
        place = f"  {', '.join(where)}" if where else ""
        said = shortened(finding.detail, _DETAIL) if finding.detail else finding.rule.sentence
        weight = "EXPLAINED" if finding.because else finding.severity.upper()
        return f"{weight}  {finding.slug}{place}: {said}"


def _style(event: Event) -> str:
    what = event.what
    if isinstance(what, Finding):
        return DIM if what.because else what.severity
    if isinstance(what, str):
        return "warning"
    failed = (
        (isinstance(what, Transaction) and what.failed)
        or (isinstance(what, Operation) and what.result not in NO_FAILURES)
        or (isinstance(what, Connection) and bool(what.refused))
    )
    return FAILED if failed else PLAIN


def summary_lines(status: Status, engine: str) -> list[str]:
    """Return a few lines for the end of a run: its counts, and what was lost."""
    said = [words.count(status.packets, "packet"), words.count(status.connections, "connection")]
    transactions = words.count(status.transactions, "transaction")
    odd = [f"{status.unanswered} unanswered"] if status.unanswered else []
    odd += [f"{status.with_errors} with errors"] if status.with_errors else []
    said.append(f"{transactions} ({', '.join(odd)})" if odd else transactions)
    said.append(words.count(status.findings, "finding"))
    lines = [", ".join(said)]
    if engine not in {"", "file", "pipe"}:
        lost = [
            f"{'an unknown number' if count is None else count} by the {who}"
            for who, count in (("kernel", status.drops.kernel), ("interface", status.drops.interface))
        ]
        lines.append(f"packets lost while capturing: {', '.join(lost)}")
    elif engine == "pipe":
        lines.append("packets lost while capturing: unknown; the program that writes the pipe does not report it here")
    if status.lost_events:
        lines.append(f"events not shown because the output was too slow: {status.lost_events}")
    return lines
