"""Findings that matter for security (reference 7.4): stops, loads, uploads, writes, forces, password guesses, inquiries.

Most rules are about requests that were carried out; if the attempt itself matters, the attempt is reported. The detail of a
finding names the client, its action, the target and the result.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.acts.act import Act
from dissect.engine.acts.book import ActBook
from dissect.engine.acts.classic import Became, asked, is_push
from dissect.engine.acts.tables import COMMANDS
from dissect.engine.findings.ledger import Occurrences
from dissect.engine.findings.reporter import Reporter
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.naming import items_said, subject
from dissect.engine.transactions.refusals import read_codes
from dissect.engine.transactions.results import DATA, refusal
from dissect.engine.transactions.transaction import (
    ANSWERED,
    BEHIND_MALFORMED,
    CAPTURE_ENDED,
    ORPHAN,
    PUSH,
    UNANSWERED,
    Transaction,
)
from dissect.engine.transactions.writes import Writes
from dissect.packets.tcp.link import within
from dissect.protocols.s7.diagnostics import event_name, states_stop
from dissect.protocols.s7.errors import may_protect, protects
from dissect.protocols.s7.items import WRITTEN_ELSEWHERE, WRITTEN_IO, ItemResult, written_areas
from dissect.protocols.s7.layouts import DATA_HEAD
from dissect.protocols.s7.parameters import HEADER_SIZE, UserdataHead
from dissect.protocols.s7.tables import (
    DIAGNOSTIC_MESSAGE,
    GROUP_BLOCKS,
    GROUP_CPU,
    GROUP_MODE,
    MODE_STOP,
    READ_SZL,
    RETURN_CODES,
    SUCCESS,
    USERDATA,
)
from dissect.protocols.s7plus.tables import PARTIAL_ERROR
from dissect.protocols.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.wire.codes import coded
from dissect.wire.octets import u16
from dissect.wire.text import duration_text, hex_number, titled

#: SZL lists that identify a device (reference 7.4): list of ids, identification. The lists of communication capabilities (0x31,
#: 0x32) are not among them, because panels read them at each start.
_TELLING: Final = frozenset((0x00, 0x11, 0x1C))
#: A connection with this many inquiries, or this many distinct lists, counts as reconnaissance.
_INQUIRIES: Final = 3
_MANY_LISTS: Final = 10

#: This many refused passwords in a row, from one client at one server, count as guessing.
_GUESSES: Final = 3
#: The return code for denied access; the corresponding error codes are in `dissect.protocols.s7.errors`.
_ACCESS_DENIED: Final = 0x03
#: Maximum number of refused reads and writes of a connection that are examined.
_LOOKED_AT: Final = 100

#: This many PDUs of one connection within a second are a flood: no PLC answers as fast.
PACE: Final = 2048
#: Writes of one connection are judged in groups of this size; one write in `SAMPLED` is examined.
_WRITES: Final = 256
SAMPLED: Final = 16
#: A group of writes is a flood if it came within `_WRITES_NS`, is at least the share `_MOST` of the traffic of its connection,
#: repeats at most `_FEW_VARIABLES` requests, and kept the server busy for at least the share `_BUSY` of the time. The writing
#: of a recipe and a heartbeat do not meet all of these.
_WRITES_NS: Final = 5_000_000_000
_MOST: Final = 0.75
_FEW_VARIABLES: Final = 4
_BUSY: Final = 0.5
#: Without answers, for example if only the client was captured, a group is a flood if it came within this time: half the time
#: that the fastest PLCs need to answer this many.
_UNHEARD_NS: Final = 1_500_000_000
#: Maximum number of variables in a finding about modifying or forcing, and of return codes in one about a refused write.
_NAMED: Final = 8
_SECOND_NS: Final = 1_000_000_000

#: A diagnostic message at most this long before a STOP states its cause, because a CPU sends it as it stops.
_CAUSE_NS: Final = 5_000_000_000

#: The connection remembers this text once a write to outputs was refused.
_OUTPUTS_REFUSED: Final = "refused write to outputs"

#: Events that a PLC reports about itself, on request or not.
_REPORTS: Final = frozenset(("security.mode_changed", "security.stopped"))

#: Kinds of areas, and the slug for writes to them.
_WRITES_TO: Final = ((WRITTEN_IO, "security.write_outputs"), (WRITTEN_ELSEWHERE, "security.write"))
#: Limit of each of the two memories: servers with their first writer, and pairs of client and server.
_MAX_REMEMBERED: Final = 4096


class SecurityWatch:
    """Judges transactions as security events.

    One object per analysis, because a new writer can only be recognised across connections.
    """

    def __init__(self, reporter: Reporter, acts: ActBook) -> None:
        self.acts = acts
        self._reporter = reporter
        self._writers: dict[str, str] = {}  # server → the client that wrote first
        self._pairs: set[tuple[str, str]] = set()  # pairs of client and server that were reported or need no report
        self._failures: dict[tuple[str, str], int] = {}

    # ---- writes -----------------------------------------------------------------------------------------------------

    def write(self, transaction: Transaction) -> None:
        """Judge a write to kinds of areas that this connection did not write to before, by the result of each item."""
        traits = transaction.connection.traits
        unanswered = transaction._outcome in {UNANSWERED, BEHIND_MALFORMED}
        if unanswered and not transaction.parameters.written & ~(traits.written | traits.sent):
            self._count_writes(transaction)
            return
        became = Became(transaction)
        naming = transaction.connection.naming
        for area, slug in _WRITES_TO:
            written, unsure = _items_in(became.written, area), _items_in(became.unsure, area)
            said = [items_said(naming, written, True)] if written else []
            if unsure:
                said.append(f"{items_said(naming, unsure, True)}{'' if unanswered else ', without a return code'}")
            if said:  # one write, whatever the results of its items are
                what = f"{transaction.function_name} {', '.join(said)}"
                self.wrote(slug, area, transaction, what, sure=bool(written))
        self._refused(transaction, became)

    def _refused(self, transaction: Transaction, became: Became) -> None:
        """Report the first refused write of a connection, also one with only some refused items."""
        outputs = _items_in(became.refused, WRITTEN_IO)
        if outputs:
            what = items_said(transaction.connection.naming, outputs, True)
            self.refused_outputs(
                transaction, f"{transaction.function_name} {what}", return_code=int(outputs[0].return_code)
            )
        if became.refused and self._first(transaction, "security.write_refused"):
            codes = "" if transaction.error_code else _item_codes(became.refused)
            what = (
                f"{transaction.function_name} {items_said(transaction.connection.naming, became.refused, True)}{codes}"
            )
            self.tell("security.write_refused", transaction, what)

    def refused_outputs(self, transaction: Transaction, what: str, code: int = -1, return_code: int = -1) -> None:
        """Take a refused write to outputs: the first one of a connection is an act; codes as for `ActBook.wrote`."""
        if transaction.connection.traits.first(_OUTPUTS_REFUSED):
            self.acts.wrote(transaction, what, code, True, return_code)

    def write_again(self, transaction: Transaction) -> None:
        """Count a write to kinds of areas that this connection wrote to before."""
        if not transaction.has_errors:
            self._count_writes(transaction)
            return
        became = Became(transaction)
        done = written_areas([result.item for result in became.written + became.unsure if result.item is not None])
        self._count_writes(transaction, done)
        self._refused(transaction, became)

    def count_writes(self, connection: Connection) -> None:
        """Add the writes of a connection that were only added up so far to the counts."""
        writes = connection._counted_writes
        if writes is None:
            return
        events = Occurrences()
        events.events = writes.again
        events.first_frame, events.first_ns = writes.first_frame, writes.first_ns
        events.last_frame, events.last_ns = writes.last_frame, writes.last_ns
        for area, slug in _WRITES_TO:
            if writes.areas & area:
                self._reporter.many(slug, connection.number, events)
        writes.again = 0

    def _count_writes(self, transaction: Transaction, areas: i64 = WRITTEN_IO | WRITTEN_ELSEWHERE) -> None:
        """Count a write once for each kind of area in ``areas`` that it writes to; these writes are not reported."""
        areas &= transaction.parameters.written
        frame: i64 = max(transaction.request_frame, transaction.response_frame)
        time_ns: i64 = max(transaction.request_ns, transaction.response_ns)
        for area, slug in _WRITES_TO:
            if areas & area:
                self._reporter.again(slug, transaction.connection.number, frame, time_ns)

    def wrote(
        self, slug: str, area: i64, transaction: Transaction, what: str, code: int = -1, sure: bool = True
    ) -> None:
        """Report a write to a kind of area, if it is the first of this connection.

        A write that may have failed (``sure`` is False) is reported, too; the first sure one is reported in addition.
        """
        if self.wrote_before(slug, area, transaction, sure):
            return
        traits = transaction.connection.traits
        if sure:
            traits.written |= area
        else:
            traits.sent |= area
        if area == WRITTEN_IO:
            self.acts.wrote(transaction, what, code)
        self.tell(slug, transaction, what, code)
        if sure:
            self._writer(transaction)

    def wrote_before(self, slug: str, area: i64, transaction: Transaction, sure: bool) -> bool:
        """Return whether this connection wrote to a kind of area before; then the write is only counted, for any target."""
        traits = transaction.connection.traits
        before: i64 = traits.written if sure else traits.written | traits.sent
        if before & area == 0:
            return False
        frame: i64 = max(transaction.request_frame, transaction.response_frame)
        time_ns: i64 = max(transaction.request_ns, transaction.response_ns)
        self._reporter.again(slug, transaction.connection.number, frame, time_ns)
        return True

    def _writer(self, transaction: Transaction) -> None:
        """Report a client that writes to a PLC after another client did."""
        client, server = _ends(transaction)
        if len(self._writers) >= _MAX_REMEMBERED or len(self._pairs) >= _MAX_REMEMBERED:
            self._writers.clear()
            self._pairs.clear()
        first = self._writers.setdefault(server, client)
        if transaction.connection.mid_stream:
            # a client that connected before the capture began may have written long before
            self._pairs.add((client, server))
        elif first != client and (client, server) not in self._pairs:
            self._pairs.add((client, server))
            what = f"until now only {first} wrote to {server}"
            if transaction.connection.tcp.has_holes:
                what += ", as far as was captured: its connection has gaps"
            self.tell("security.new_writer", transaction, what)

    def sample(self, transaction: Transaction) -> None:
        """Examine one write in `SAMPLED`; after each `_WRITES` of a connection, judge how fast they came."""
        connection = transaction.connection
        writes = connection.traits.writes
        self.count_writes(connection)
        now_ns = int(max(transaction.request_ns, transaction.response_ns))
        writes.variables.add(transaction.parameters.octets)
        if transaction._outcome == ANSWERED:
            writes.answers_ns.append(int(transaction.response_ns - transaction.request_ns))
        if writes.count % _WRITES:
            return
        took_ns = now_ns - int(writes.since_ns or connection.tcp.first_ns)
        if took_ns >= 0 and len(writes.variables) <= _FEW_VARIABLES:
            self._judge_writes(transaction, writes, took_ns)
        writes.since_ns = now_ns
        writes.pdus = connection.pdus
        writes.answers_ns = []
        writes.variables = set()

    def _judge_writes(self, transaction: Transaction, writes: Writes, took_ns: int) -> None:
        """Judge a group of `_WRITES` writes to few variables that came within ``took_ns``."""
        connection = transaction.connection
        answers = writes.answers_ns
        if not answers:
            # The share of these writes in the traffic is known only at the `end`; if only answers were captured, it is never
            # known.
            if writes.hasty is None and took_ns <= _UNHEARD_NS and transaction._outcome == UNANSWERED:
                writes.hasty = transaction
                writes.hasty_ns = took_ns
            return
        share = 2 * _WRITES / max(1, int(connection.pdus - writes.pdus))
        busy = SAMPLED * sum(answers) / max(1, took_ns)
        if took_ns <= _WRITES_NS and share >= _MOST and busy >= _BUSY:
            answers.sort()
            median = duration_text(answers[len(answers) // 2])
            self._flood(transaction, took_ns, f", answered after {median} (median of {len(answers)} of them)")

    def _flood(self, transaction: Transaction, took_ns: int, answered: str) -> None:
        connection = transaction.connection
        if self.first_of(transaction, "security.flood"):
            items = items_said(connection.naming, transaction.s7_results, False)
            what = f"{_WRITES} writes within {duration_text(took_ns)}{answered}"
            self.tell("security.flood", transaction, f"{transaction.function_name} {items}: {what}")

    def end(self, connection: Connection) -> None:
        """A connection is over, so all its requests are counted: judge fast writes without answers by their share."""
        self.count_writes(connection)
        writes = connection._hasty_writes
        if writes is None or writes.hasty is None:
            return
        if int(writes.count) >= _MOST * int(connection.answered + connection.unanswered):
            self._flood(writes.hasty, int(writes.hasty_ns), "")

    # ---- everything else --------------------------------------------------------------------------------------------

    def take(self, transaction: Transaction, act: Act | None) -> None:
        """Judge a transaction that is neither a read nor a write; ``act`` is the act that it is or begins, None for none."""
        head = transaction.parameters.userdata
        if act is not None:
            self.act(act, transaction)
        elif head is not None and transaction.rosctr == USERDATA:
            self._userdata(transaction, head)
        if transaction.has_errors and _denied(transaction) and self._first(transaction, "security.protected"):
            self.tell("security.protected", transaction, transaction.function_name)

    def act(self, act: Act, transaction: Transaction, code: int = -1) -> None:
        """Report an act; ``code`` as for `tell`."""
        slug = act.slug
        if slug == "security.password":
            self.password(transaction, code)
        elif slug and (slug not in _ONCE or self.first_of(transaction, slug)):
            self.tell(slug, transaction, act.text, code)

    def refused_items(self, transaction: Transaction) -> None:
        """Report a read or write that was refused by protection. Only the first refusals of a connection are examined."""
        traits = transaction.connection.traits
        told = "security.protected" in traits.told
        if traits.refusals >= _LOOKED_AT and not told:
            return
        if not told:
            traits.refusals += 1
        codes = read_codes(transaction)
        if codes is None:
            codes = [int(result.return_code) for result in transaction.s7_results]
        # If other items of the request succeeded, access is not denied as a whole; only these addresses are refused.
        denied = _ACCESS_DENIED in codes and SUCCESS not in codes
        code = int(transaction.error_code)
        perhaps = code != 0 and may_protect(code, transaction.function)
        if denied or perhaps or (code and protects(code)):
            why = "" if transaction.error_code else f": {RETURN_CODES.name(_ACCESS_DENIED)}"
            if perhaps:
                why = " (protected, or not supported)"
            if self._first(transaction, "security.protected"):
                self.tell("security.protected", transaction, subject(transaction) + why)

    def _userdata(self, transaction: Transaction, head: UserdataHead) -> None:
        group, subfunction = head.group, head.subfunction
        if is_push(transaction, head):
            if group == GROUP_MODE:
                self._mode(transaction, head)
            elif group == GROUP_CPU and subfunction == DIAGNOSTIC_MESSAGE:
                event = _pushed_event(transaction)
                if states_stop(event):
                    frame, time_ns = int(transaction.response_frame), int(transaction.response_ns)
                    transaction.connection.traits.stop_event = (event, frame, time_ns)
        elif not asked(transaction):
            return
        elif group == GROUP_BLOCKS:
            self._inquiry(transaction, -subfunction)
        elif group == GROUP_CPU and subfunction == READ_SZL:
            szl_id = _szl_id(transaction)
            if szl_id >= 0:
                self._inquiry(transaction, szl_id)

    def loaded(self, act: Act) -> None:
        """Report a download whose beginning was not captured: its pieces show that a client loaded a block."""
        number = act.connection.number
        if self._reporter.wants(act.slug, number, act.first_frame, act.last_frame, act.end_ns):
            ends = act.connection.tcp.ends
            who = f"{ends[act.asked_by]} to {ends[1 - act.asked_by]}"
            what = f"download {act.subject}, {act.octets} bytes, beginning not captured"
            self._reporter.detail(act.slug, number, act.frames, act.end_ns, f"{who}: {what}")

    def _mode(self, transaction: Transaction, head: UserdataHead) -> None:
        """Report the mode that a PLC announces; for a STOP, add the cause from a diagnostic message just before."""
        traits = transaction.connection.traits
        stated = traits.stop_event
        traits.stop_event = None
        what = f"mode {head.subfunction_name}"
        if head.subfunction != MODE_STOP:
            self.tell("security.mode_changed", transaction, what)
        elif stated is None or transaction.response_ns - stated[2] > _CAUSE_NS:
            self.tell("security.stopped", transaction, what)
        else:
            event, frame, _ = stated
            cause = f"its diagnostic message states the cause: {coded(hex_number(event, 4), event_name(event))}"
            self.tell("security.stopped", transaction, f"{what}; {cause}", before=frame)

    def _inquiry(self, transaction: Transaction, inquiry: int) -> None:
        """Count inquiries about the device, and report too many once. ``inquiry``: an SZL-ID, or a block function, negated."""
        traits = transaction.connection.traits
        if "security.reconnaissance" in traits.told:
            return
        if inquiry < 0 or inquiry & 0xFF in _TELLING:
            traits.inquiries += 1
        if len(traits.szl_ids) < _MANY_LISTS:
            traits.szl_ids.add(inquiry)
        if (traits.inquiries >= _INQUIRIES or len(traits.szl_ids) >= _MANY_LISTS) and traits.first(
            "security.reconnaissance"
        ):
            which = "third inquiry" if traits.inquiries >= _INQUIRIES else f"{_MANY_LISTS}th list"
            self.tell("security.reconnaissance", transaction, f"{which}: {_named(transaction)}")

    def password(self, transaction: Transaction, code: int = -1) -> None:
        """Report a password that was sent; count the refused ones. ``code`` as for `tell`."""
        client, server = _ends(transaction)
        if not (transaction.refused if code < 0 else code):
            if transaction._outcome != BEHIND_MALFORMED:
                self._failures.pop((client, server), None)
            self.tell("security.password", transaction, "password", code)
            return
        if len(self._failures) >= _MAX_REMEMBERED:
            self._failures.clear()
        failures = self._failures.get((client, server), 0) + 1
        self._failures[client, server] = failures
        self.tell("security.password_failed", transaction, f"attempt {failures}", code)
        if failures == _GUESSES:
            self.tell("security.password_guessing", transaction, f"{failures} wrong passwords in a row", code)

    def pace(self, connection: Connection, frame: int, now_ns: int) -> None:
        """Judge the duration of the latest `PACE` PDUs of a connection; call it once for each `PACE` PDUs."""
        since = connection.traits.pace_ns or int(connection.tcp.first_ns)
        connection.traits.pace_ns = int(now_ns)
        if 0 <= now_ns - since < _SECOND_NS and self._reporter.first(connection, "security.flood", frame, now_ns):
            within = duration_text(int(now_ns - since))
            who = f"{connection.client} and {connection.server}"
            detail = f"{PACE} messages within {within} between {who}, both directions together"
            self._reporter.note("security.flood", connection.number, [frame], now_ns, detail)

    def _first(self, transaction: Transaction, slug: str) -> bool:
        """Return whether to make a report that is due once per connection; a finding with a cause is not the report."""
        if self._reporter.cause_of(slug, transaction.connection.number) is not None:
            return True
        return self.first_of(transaction, slug)

    def first_of(self, transaction: Transaction, slug: str) -> bool:
        """Return whether a transaction is the first on its connection to which a rule applies; count the others."""
        frame = int(max(transaction.request_frame, transaction.response_frame))
        time_ns = int(max(transaction.request_ns, transaction.response_ns))
        return self._reporter.first(transaction.connection, slug, frame, time_ns)

    def tell(self, slug: str, transaction: Transaction, what: str = "", code: int = -1, before: int = 0) -> None:
        """Report an event. ``what`` describes the object; by default it is the object of the request.

        ``code`` is the error of the item that the event is about: 0 for none, -1 to use the transaction's. ``before`` is a
        packet of an earlier transaction that belongs to the event as well, 0 for none.
        """
        number = transaction.connection.number
        if not self._reporter.wants_of(slug, transaction):
            return
        frames = transaction.frames
        if before and before not in frames:
            frames.insert(0, before)
        ends = transaction.connection.tcp.ends
        asked, told = ends[transaction.asked_by], ends[1 - transaction.asked_by]
        behind = transaction._outcome == BEHIND_MALFORMED
        reports = transaction._outcome == PUSH or slug in _REPORTS
        result = ""
        good = not code or (code < 0 and not transaction.has_errors)
        error = refusal(transaction) if code < 0 else None
        refused = PLUS_CODES.coded(code) if code > 0 else error.coded if error is not None else ""
        if refused:
            partial = transaction.is_plus and (code if code > 0 else transaction.error_code) == PARTIAL_ERROR
            result = f", refused{' in part' if partial else ''}: {refused}"
        elif transaction._outcome == UNANSWERED:
            result = _unanswered(transaction)
        elif behind:
            result = "" if reports else ", not answered"
        elif good and not reports and slug in COMMANDS:
            result = ", accepted"
        if transaction._outcome == ORPHAN:
            what = what or transaction.function_name
            result += ", request not captured"
        if transaction.is_behind:
            result += ", behind a malformed TPDU header"
        what = what or _named(transaction)
        time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
        detail = f"{told} reports to {asked}: {what}{result}" if reports else f"{asked} to {told}: {what}{result}"
        self._reporter.detail(slug, number, frames, time_ns, detail)


def _denied(transaction: Transaction) -> bool:
    """Return whether an answer refuses its request as a whole because the PLC is protected."""
    error = refusal(transaction)
    return error is not None and (error.code == _ACCESS_DENIED if error.part == DATA else protects(error.code))


def _items_in(results: list[ItemResult], area: i64) -> list[ItemResult]:
    """Return the items of a kind of areas."""
    return [result for result in results if result.item is not None and written_areas([result.item]) & area]


def _item_codes(refused: list[ItemResult]) -> str:
    """Return the return codes of refused items as text; empty if the whole request was refused."""
    codes = sorted({int(result.return_code) for result in refused if result.refused})
    said = [RETURN_CODES.coded(code) for code in codes[:_NAMED]]
    return f", refused: {', '.join(said)}" if said else ""


def _unanswered(transaction: Transaction) -> str:
    """Return how a request without an answer ended."""
    if transaction.unseen:
        return ", answer not captured"
    return ", the capture ends before an answer" if transaction.reason == CAPTURE_ENDED else ", not answered"


def _ends(transaction: Transaction) -> tuple[str, str]:
    """Return client and server of a transaction, without ports, each with its VLAN if it has one."""
    tcp = transaction.connection.tcp
    asking, asked = tcp.ends[transaction.asked_by], tcp.ends[1 - transaction.asked_by]
    return within(asking.host, tcp.vlan), within(asked.host, tcp.vlan)


def _szl_id(transaction: Transaction) -> int:
    """Return the SZL-ID that a request reads; -1 if it has no payload, like a request for the next part of an answer.

    It is read in place, because panels poll SZLs.
    """
    at = transaction._request_offset + HEADER_SIZE + len(transaction.parameters.octets) + DATA_HEAD.size
    end = transaction._request_offset + transaction.request_size
    return int(u16(transaction._request_buf, at)) if at + 4 <= end else -1


def _pushed_event(transaction: Transaction) -> int:
    """Return the event of a diagnostic message, which is the first word of its payload; -1 if the payload is shorter."""
    told = transaction.response_parameters
    if told is None:
        return -1
    at = transaction._response_offset + HEADER_SIZE + len(told.octets) + DATA_HEAD.size
    end = transaction._response_offset + transaction.response_size
    return int(u16(transaction._response_buf, at)) if at + 2 <= end else -1


def _named(transaction: Transaction) -> str:
    """Return the name of the function and the content of the request."""
    body = transaction.request_body
    notes = ", ".join(body.notes[:3]) if body is not None else ""
    return titled(transaction.function_name, notes)


#: Reported once per connection, because a session does them repeatedly.
_ONCE: Final = frozenset(("security.debug", "security.alarm_change"))
