"""Findings about S7comm-plus transactions, mostly by the security rules of S7comm, and the programs of CPUs.

`dissect.protocols.s7plus.events` finds out what a transaction means; this module makes findings of these events.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.acts.act import Act
from dissect.engine.acts.plus import TEXT
from dissect.engine.findings.plus_sessions import PlusSessions, server_of
from dissect.engine.findings.reporter import Reporter
from dissect.engine.findings.security_rules import SecurityWatch
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import OperationBook
from dissect.engine.transactions.plus_operations import PlusOperations
from dissect.engine.transactions.transaction import ANSWERED, BEHIND_MALFORMED, UNANSWERED, Transaction
from dissect.packets.tcp.link import within
from dissect.protocols.s7.items import WRITTEN_ELSEWHERE, WRITTEN_IO
from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.check_response import count_mismatch
from dissect.protocols.s7plus.event import (
    READ_OUT,
    REPLAYED,
    RUNNING,
    SESSION,
    STOPPED,
    SUBSCRIBED,
    SUBSCRIBED_ALARMS,
    WRITTEN,
    WRITTEN_OUTPUTS,
    Event,
    Facts,
)
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.reads import Reads
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import EXPLORE, GET_MULTI_VARIABLES, PARTIAL_ERROR, SET_MULTI_VARIABLES
from dissect.protocols.s7plus.walk import MAX_WORK, STEP
from dissect.wire.malformed import Malformed
from dissect.wire.text import shortened

#: Findings of events other than acts.
_SLUGS: Final[dict[str, str]] = {
    STOPPED: "security.stopped",
    RUNNING: "security.mode_changed",
    REPLAYED: "security.replay",
    WRITTEN: "security.write",
    WRITTEN_OUTPUTS: "security.write_outputs",
}
#: The kind of area that an event of each kind writes to.
_AREAS: Final[dict[str, int]] = {WRITTEN: WRITTEN_ELSEWHERE, WRITTEN_OUTPUTS: WRITTEN_IO}
#: Return value "access denied": the client lacks the rights for a request.
_PROTECTED: Final = 0xFF9C
#: From this many Explore requests on, a connection counts as reconnaissance, unless its client subscribes to something at that
#: CPU.
_EXPLORES: Final = 3
_SUBSCRIBING: Final = frozenset((SUBSCRIBED, SUBSCRIBED_ALARMS))
#: Maximum number of subscribers that are remembered.
MAX_SUBSCRIBERS: Final = 4096
#: Maximum number of CPUs that are remembered; beyond that the CPU seen first is forgotten.
MAX_CPUS: Final = 256


class PlusWatch:
    """Judges S7comm-plus transactions. One object per analysis: any connection of a CPU may carry parts of its program."""

    def __init__(self, reporter: Reporter, security: SecurityWatch, book: OperationBook) -> None:
        self._operations = PlusOperations(book)
        self._reporter = reporter
        self._security = security
        self._acts = security.acts
        self._sessions = PlusSessions(security)
        self._cpus: dict[str, tuple[Program, Identity]] = {}
        self._subscribers: set[tuple[str, str]] = set()  # (client, CPU)

    def take(self, transaction: Transaction) -> None:
        """Take a transaction of any function."""
        connection = transaction.connection
        session = connection.plus
        if session is None:
            session = self._begin(connection)
        function: i64 = transaction.function
        told = transaction._checked
        transaction._checked = None
        if function >= 0:
            self._sessions.take(session, transaction)
            if function == EXPLORE and transaction.request_frame:
                session.note_explore(int(transaction.request_frame), transaction.request_ns)
        elif len(session.subscriptions) > 0 or connection.mid_stream:
            if told is None:
                told = check(transaction.response_octets)
            if self._operations.notified(told.subscription_id, transaction):
                self._subscribes(connection)
        read: Reads | None = None
        if (function == GET_MULTI_VARIABLES or function == SET_MULTI_VARIABLES) and transaction._outcome == ANSWERED:
            if function == GET_MULTI_VARIABLES:
                read = self._operations.polled(session, transaction)
            if told is None:
                told = check(transaction.response_octets)
            wrong = count_mismatch(function, transaction.request_octets, told)
            if wrong:
                self._note("transaction.count_mismatch", transaction, wrong)
        facts = take(session, function, transaction.request_octets, transaction.response_octets, told, read)
        if facts is not None:
            for event in facts.events:
                code = _code_of(event, transaction)
                act = self._acts.event(event, transaction, code)
                self._operations.take(event, session, transaction, code, act.command if act is not None else "")
                self._tell(session, event, transaction, code, act)
                if event.kind == SESSION:
                    self._sessions.opened(session, event.object_id, transaction)
                elif event.kind in _SUBSCRIBING:
                    self._subscribes(connection)
            if facts.malformed:
                self._odd_contents(transaction, facts)
            if facts.exhausted:
                self._note("s7.plus_too_long", transaction, f"more than {MAX_WORK // STEP} values")
        if transaction.error_code == _PROTECTED and self._security.first_of(transaction, "security.protected"):
            self._security.tell("security.protected", transaction, transaction.function_name)

    def behind(self, transaction: Transaction) -> None:
        """Take an unanswered request behind a malformed header: the request counts, but changes no session."""
        asked = transaction.request_octets
        if not asked:
            return
        session = PlusSession(Program(), Identity())
        facts = take(session, transaction.function, asked, b"")
        if facts is not None:
            for event in facts.events:
                self._tell(session, event, transaction, 0, self._acts.event(event, transaction, 0, alone=True))
            if facts.malformed:
                self._odd_contents(transaction, facts)

    def _subscribes(self, connection: Connection) -> None:
        """Remember that the client of ``connection`` subscribes to something at its CPU, or did before the capture."""
        if len(self._subscribers) < MAX_SUBSCRIBERS:
            self._subscribers.add(_stations(connection))

    def _note(self, slug: str, transaction: Transaction, what: str) -> None:
        frames = transaction.frames
        time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
        detail = f"{transaction.function_name}: {what}"
        self._reporter.note(slug, transaction.connection.number, frames, time_ns, detail)

    def _odd_contents(self, transaction: Transaction, facts: Facts) -> None:
        """Report contradictions; report once per connection that its PDUs contain elements of an unknown kind."""
        asked, told = facts.malformed[: facts.in_request], facts.malformed[facts.in_request :]
        self._faults("s7plus.malformed", transaction, _by_kind(asked, False), _by_kind(told, False))
        asked, told = _by_kind(asked, True), _by_kind(told, True)
        if (asked or told) and self._security.first_of(transaction, "s7plus.unknown_kind"):
            self._faults("s7plus.unknown_kind", transaction, asked, told)

    def _faults(self, slug: str, transaction: Transaction, asked: list[Malformed], told: list[Malformed]) -> None:
        """Report the first fault of the request and of the response, each with its packet."""
        if not (asked or told):
            return
        frames = [int(transaction.request_frame)] if asked else []
        said = [f"request: {asked[0]}"] if asked else []
        if told:
            frames.append(int(transaction.response_frame))
            said.append(f"response: {told[0]}" if transaction.function >= 0 else str(told[0]))
        time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
        detail = f"{transaction.function_name}: {'; '.join(said)}"
        self._reporter.note(slug, transaction.connection.number, frames, time_ns, detail)

    def _begin(self, connection: Connection) -> PlusSession:
        host = server_of(connection)
        known = self._cpus.get(host)
        if known is None:
            if len(self._cpus) >= MAX_CPUS:
                del self._cpus[next(iter(self._cpus))]
            known = (Program(), Identity())
            naming = connection.naming
            declared = naming.program(connection.server.host) if naming is not None else None
            if declared is not None:
                known[0].adopt(declared)
            self._cpus[host] = known
        session = PlusSession(known[0], known[1])
        connection.plus = session
        return session

    def _tell(self, session: PlusSession, event: Event, transaction: Transaction, code: int, act: Act | None) -> None:
        """Report an event; ``code`` is its error, 0 for none; ``act`` is the act of the event, None if it is not an act."""
        kind = event.kind
        if act is not None:
            if kind != READ_OUT or self._security.first_of(transaction, act.slug):
                self._security.act(act, transaction, code)
            return
        slug = _SLUGS.get(kind, "")
        if not slug:
            return
        area = _AREAS.get(kind, 0)
        if area:
            self._wrote(session, slug, area, event, transaction, code)
        else:
            self._security.tell(slug, transaction, shortened(event.text, TEXT), code)

    def _wrote(
        self, session: PlusSession, slug: str, area: int, event: Event, transaction: Transaction, code: int
    ) -> None:
        """Report a write that was refused, or that goes to a kind of area that this connection did not write to before."""
        if code in {0, PARTIAL_ERROR}:
            sure: bool = transaction._outcome not in {UNANSWERED, BEHIND_MALFORMED}
            if not self._security.wrote_before(slug, area, transaction, sure):
                self._security.wrote(slug, area, transaction, shortened(event.text, TEXT), code, sure)
            return
        what = shortened(event.text, TEXT)
        if area == WRITTEN_IO:
            self._security.refused_outputs(transaction, what, code)
        if self._security.first_of(transaction, "security.write_refused"):
            self._security.tell("security.write_refused", transaction, what, code)

    def programs(self) -> dict[str, Program]:
        """Return the programs of CPUs by host, as far as they were captured; CPUs without any captured part are omitted."""
        return {host: program for host, (program, _) in self._cpus.items() if program.count}

    def finish(self, connection: Connection) -> None:
        """A connection is over, and its operations are still open."""
        self._operations.finish(connection)

    def end(self, connection: Connection) -> None:
        """A connection is over: report a reconnaissance if its client explored and subscribed to nothing."""
        self._operations.end(connection)
        session = connection.plus
        if session is None or session.explores < _EXPLORES:
            return
        if _stations(connection) in self._subscribers:
            return
        if connection.traits.first("security.reconnaissance"):
            who = f"{connection.client} to {connection.server}"
            detail = f"{who}: {session.explores} Explore requests and no subscription"
            frames = list(session.explored)
            self._reporter.note("security.reconnaissance", connection.number, frames, session.explored_ns, detail)


def _by_kind(faults: list[Malformed], unknown: bool) -> list[Malformed]:
    """Return either the elements of an unknown kind or the contradictions among ``faults``."""
    return [fault for fault in faults if fault.is_unknown == unknown]


def _code_of(event: Event, transaction: Transaction) -> int:
    """Return the error of an event: the error of its own item, unless the answer refuses the whole request."""
    code = int(transaction.error_code)
    return event.refusal if event.refusal >= 0 and code in {0, PARTIAL_ERROR} else code


def _stations(connection: Connection) -> tuple[str, str]:
    """Return client and CPU of a connection, as `server_of` names them."""
    return within(connection.client.host, connection.tcp.vlan), server_of(connection)
