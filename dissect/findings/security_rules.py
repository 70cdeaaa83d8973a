"""Events that matter for security (reference 7.4): who stopped, loaded, read out, wrote, forced, guessed or looked around.

What is said of a connection is said of requests that were answered well, or attempts where the attempt is the event. The
sentence of a finding names who did what to whom, and what became of it.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.findings.reporter import Reporter
from dissect.s7.diagnostics import event_name, states_stop
from dissect.s7.errors import ERROR_CODES
from dissect.s7.items import WRITTEN_ELSEWHERE, WRITTEN_IO, ItemResult, written_areas
from dissect.s7.layouts import DATA_HEAD
from dissect.s7.parameters import HEADER_SIZE, UserdataHead
from dissect.s7.services import NC_PREFIX, PI_SERVICES
from dissect.s7.tables import (
    ALARM_CHANGE,
    CLOCK,
    DEBUG,
    DIAGNOSTIC_MESSAGE,
    FLASH,
    FORCE,
    FUNCTIONS,
    GROUP_BLOCKS,
    GROUP_CPU,
    GROUP_MODE,
    GROUP_SECURITY,
    MEMORY,
    MODE_STOP,
    PI_SERVICE,
    PROGRAM_CHANGE,
    PROGRAM_READ,
    READ,
    READ_SZL,
    RETURN_CODES,
    SEND_PASSWORD,
    START,
    STOP,
    SUCCESS,
    USERDATA,
    USERDATA_SUBFUNCTIONS,
)
from dissect.s7plus.tables import PARTIAL_ERROR
from dissect.s7plus.tables import RETURN_CODES as PLUS_CODES
from dissect.tcp.link import within
from dissect.transactions.connection import Connection, Writes
from dissect.transactions.naming import items_said, subject
from dissect.transactions.operation import Operation
from dissect.transactions.results import half_captured
from dissect.transactions.transaction import ANSWERED, ORPHAN, PUSH, UNANSWERED, Transaction
from dissect.wire.codes import coded
from dissect.wire.octets import u16
from dissect.wire.text import duration_text, hex_number, titled

#: SZL lists that tell what a device is, apart from its state (reference 7.4): id lists, identification. What it can do in
#: communication (0x31, 0x32) panels ask at each start.
_TELLING: Final = frozenset((0x00, 0x11, 0x1C))
#: Inquiries on one connection that make it a reconnaissance, the third, and distinct lists, the tenth.
_INQUIRIES: Final = 3
_MANY_LISTS: Final = 10

#: Failed passwords of one client at one server that make it guessing.
_GUESSES: Final = 3
#: Errors that say that a protection level stands against a request.
_PROTECTED: Final = frozenset((0xD241, 0xD602))
#: What S7-1200/1500 say to reads and writes while PUT/GET access is off, and any device that does not support a request.
_MAYBE_PROTECTED: Final = 0x8104
_ACCESS_DENIED: Final = 0x03
#: Refused reads and writes of a connection that are looked at.
_LOOKED_AT: Final = 100

#: PDUs of one connection within a second that are a flood: no PLC answers so many.
PACE: Final = 2048
#: Writes of one connection that are judged together, and of which one in `SAMPLED` is looked at.
_WRITES: Final = 256
SAMPLED: Final = 16
#: They are a flood when they come within so long, are most of what the connection carries, repeat so few requests, and the
#: client leaves the server no more time than that takes to answer: so no recipe is written and no heartbeat beats.
_WRITES_NS: Final = 5_000_000_000
_MOST: Final = 0.75
_FEW_VARIABLES: Final = 4
_BUSY: Final = 0.5
#: Without answers, as when only the client was captured, they are one when they come within so long: half of that is what the
#: fastest PLCs take to answer so many.
_UNHEARD_NS: Final = 1_500_000_000
#: Variables that the finding of a modification or force names, and return codes that one of a refused write does.
_NAMED: Final = 8
_SECOND_NS: Final = 1_000_000_000

#: A diagnostic message so long before a STOP states its cause: a CPU sends it as it stops.
_CAUSE_NS: Final = 5_000_000_000

#: What a PLC says of itself, whether it was asked for it or not.
_REPORTS: Final = frozenset(("security.mode_changed", "security.stopped"))

#: Kinds of areas that are written, and the slug of each.
_WRITES_TO: Final = ((WRITTEN_IO, "security.write_outputs"), (WRITTEN_ELSEWHERE, "security.write"))
#: Clients, servers and pairs of them that are remembered.
_MAX_REMEMBERED: Final = 4096


class SecurityWatch:
    """Judges transactions as events of security. One for a whole analysis: a new writer is one among several connections."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self._writers: dict[str, str] = {}  # server: the client that wrote first
        self._pairs: set[tuple[str, str]] = set()  # (client, server): writers that were told
        self._failures: dict[tuple[str, str], int] = {}

    # ---- writes -----------------------------------------------------------------------------------------------------

    def write(self, transaction: Transaction) -> None:
        """A write to kinds of areas that this connection did not write before: what became of each item is what counts."""
        traits = transaction.connection.traits
        unanswered = transaction.outcome == UNANSWERED
        if unanswered and not transaction.parameters.written & ~(traits.written | traits.sent):
            return
        became = _Became(transaction)
        naming = transaction.connection.naming
        for area, slug in _WRITES_TO:
            for found, said in ((became.written, ""), (became.unsure, "" if unanswered else ", without a return code")):
                items = [result for result in found if result.item is not None and written_areas([result.item]) & area]
                if items:
                    what = f"{transaction.function_name} {items_said(naming, items, True)}{said}"
                    self.wrote(slug, area, transaction, what, sure=not said and not unanswered)
        if became.refused and traits.first("security.write_refused"):
            codes = "" if transaction.error_code else _item_codes(became.refused)
            what = f"{transaction.function_name} {items_said(naming, became.refused, True)}{codes}"
            self.tell("security.write_refused", transaction, what)

    def wrote(
        self, slug: str, area: i64, transaction: Transaction, what: str, code: int = -1, sure: bool = True
    ) -> None:
        """A write to areas of a kind, told when it is the first of this connection.

        One that is not ``sure`` to have been carried out is told as well, and hides none that was.
        """
        traits = transaction.connection.traits
        if (traits.written if sure else traits.written | traits.sent) & area:
            return
        if sure:
            traits.written |= area
        else:
            traits.sent |= area
        self.tell(slug, transaction, what, code)
        if sure:
            self._writer(transaction)

    def _writer(self, transaction: Transaction) -> None:
        """Take a write: a client other than the first that wrote to a PLC is reported."""
        client, server = _ends(transaction)
        if len(self._writers) >= _MAX_REMEMBERED or len(self._pairs) >= _MAX_REMEMBERED:
            self._writers.clear()
            self._pairs.clear()
        first = self._writers.setdefault(server, client)
        if transaction.connection.mid_stream:
            # Who was there when the capture began may have written long before.
            self._pairs.add((client, server))
        elif first != client and (client, server) not in self._pairs:
            self._pairs.add((client, server))
            self.tell("security.new_writer", transaction, f"until now only {first} wrote to {server}")

    def sample(self, transaction: Transaction) -> None:
        """Take one write in `SAMPLED`; each `_WRITES` of a connection are judged by its own pace."""
        connection = transaction.connection
        writes = connection.traits.writes
        now_ns = int(max(transaction.request_ns, transaction.response_ns))
        writes.variables.add(transaction.parameters.octets)
        if transaction.outcome == ANSWERED:
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
        """Judge `_WRITES` writes of few variables that took so long."""
        connection = transaction.connection
        answers = writes.answers_ns
        if not answers:
            # What else passes, `end` knows; what answers alone are to, nobody does.
            if writes.hasty is None and took_ns <= _UNHEARD_NS and transaction.outcome == UNANSWERED:
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
        if connection.traits.first("security.flood"):
            items = items_said(connection.naming, transaction.results(), False)
            what = f"{_WRITES} writes within {duration_text(took_ns)}{answered}"
            self.tell("security.flood", transaction, f"{transaction.function_name} {items}: {what}")

    def end(self, connection: Connection) -> None:
        """A connection is over, and all of its requests are known: hasty writes without answers may be most of them."""
        writes = connection.hasty_writes
        if writes is None or writes.hasty is None:
            return
        if int(writes.count) >= _MOST * int(connection.answered + connection.unanswered):
            self._flood(writes.hasty, int(writes.hasty_ns), "")

    # ---- everything else --------------------------------------------------------------------------------------------

    def take(self, transaction: Transaction) -> None:
        """Judge a transaction that is neither a read nor a write."""
        head = transaction.parameters.userdata
        if head is not None and transaction.rosctr == USERDATA:
            self._userdata(transaction, head)
        elif _asked(transaction):
            self._job(transaction)
        if transaction.error_code in _PROTECTED and transaction.connection.traits.first("security.protected"):
            self.tell("security.protected", transaction, transaction.function_name)

    def refused_items(self, transaction: Transaction) -> None:
        """Judge a read or write of which something was refused: is it protection? Looks at the first refusals only."""
        traits = transaction.connection.traits
        if traits.refusals >= _LOOKED_AT or not traits.first("security.protected"):
            return
        traits.refusals += 1
        codes = [result.return_code for result in transaction.results()]
        # Where other items of it succeeded, it is these addresses that the device does not give.
        denied = _ACCESS_DENIED in codes and SUCCESS not in codes
        perhaps = transaction.error_code == _MAYBE_PROTECTED
        if transaction.error_code in _PROTECTED or perhaps or denied:
            why = "" if transaction.error_code else f": {RETURN_CODES.name(_ACCESS_DENIED)}"
            if perhaps:
                why = " (protected, or not supported)"
            self.tell("security.protected", transaction, subject(transaction) + why)
        else:
            traits.told.discard("security.protected")

    def _job(self, transaction: Transaction) -> None:
        if transaction.function == PI_SERVICE:
            self._pi_service(transaction)
            return
        slug = _SLUGS.get(FUNCTIONS.effect(transaction.function), "")
        if slug:
            self.tell(slug, transaction, "PLC stop" if slug == "security.plc_stop" else "")

    def _pi_service(self, transaction: Transaction) -> None:
        body = transaction.request_body
        name = body.text("service") if body is not None else ""
        slug = _service_slug(name)
        if slug == "security.unknown_service" and _is_cut_short(transaction, name):
            return
        if slug:
            self.tell(slug, transaction)

    def _userdata(self, transaction: Transaction, head: UserdataHead) -> None:
        if transaction.outcome == PUSH:
            if head.group == GROUP_MODE:
                self._mode(transaction, head)
            elif head.group == GROUP_CPU and head.subfunction == DIAGNOSTIC_MESSAGE:
                event = _pushed_event(transaction)
                if states_stop(event):
                    frame, time_ns = int(transaction.response_frame), int(transaction.response_ns)
                    transaction.connection.traits.stop_event = (event, frame, time_ns)
            return
        if not _asked(transaction):
            return
        group, subfunction = head.group, head.subfunction
        table = USERDATA_SUBFUNCTIONS.get(group)
        slug = _SLUGS.get(table.effect(subfunction), "") if table is not None else ""
        if slug:
            if slug in _ONCE and not transaction.connection.traits.first(slug):
                return
            self.tell(slug, transaction, _forced(transaction) if slug == "security.force" else "")
        elif group == GROUP_BLOCKS:
            self._inquiry(transaction, -subfunction)
        elif group == GROUP_CPU and subfunction == READ_SZL:
            szl_id = _szl_id(transaction)
            if szl_id >= 0:
                self._inquiry(transaction, szl_id)
        elif group == GROUP_SECURITY and subfunction == SEND_PASSWORD:
            self.password(transaction)

    def loaded(self, operation: Operation) -> None:
        """Take a download whose beginning was not captured: its pieces tell that a client loaded a block."""
        number = operation.connection.number
        if self._reporter.wants("security.program_change", number):
            ends = operation.connection.tcp.ends
            who = f"{ends[operation.asked_by]} to {ends[1 - operation.asked_by]}"
            what = f"download {operation.subject}, {operation.octets} bytes, beginning not captured"
            frames = sorted({operation.first_frame, operation.last_frame})
            self._reporter.detail("security.program_change", number, frames, operation.end_ns, f"{who}: {what}")

    def _mode(self, transaction: Transaction, head: UserdataHead) -> None:
        """A PLC reports its mode; of a STOP it may just have stated the cause, by a diagnostic message."""
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
        """A client asks what the device is, by SZL-ID or (negative) block function: reported once, unless routine."""
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
        """Take a password that was sent, and count those that were refused; ``code`` as for `tell`."""
        client, server = _ends(transaction)
        if not (transaction.error_code if code < 0 else code):
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
        """Look at how long the latest `PACE` PDUs of a connection took; call it after each so many."""
        since = connection.traits.pace_ns or int(connection.tcp.first_ns)
        connection.traits.pace_ns = int(now_ns)
        if 0 <= now_ns - since < _SECOND_NS and connection.traits.first("security.flood"):
            within = duration_text(int(now_ns - since))
            who = f"{connection.client} and {connection.server}"
            detail = f"{PACE} messages within {within} between {who}, both directions together"
            self._reporter.note("security.flood", connection.number, [frame], now_ns, detail)

    def tell(self, slug: str, transaction: Transaction, what: str = "", code: int = -1, before: int = 0) -> None:
        """Note an event; unless ``what`` says it, it is what the request asks for.

        ``code`` is the error of what it is about, where that is one item of several: 0 for none, -1 for the transaction's.
        ``before`` is a packet of an earlier transaction that ``what`` is about as well, 0 for none.
        """
        number = transaction.connection.number
        if not self._reporter.wants(slug, number):
            return
        frames = transaction.frames
        if before and before not in frames:
            frames.insert(0, before)
        ends = transaction.connection.tcp.ends
        asked, told = ends[transaction.asked_by], ends[1 - transaction.asked_by]
        reports = transaction.outcome == PUSH or slug in _REPORTS
        who = f"{told} reports to {asked}" if reports else f"{asked} to {told}"
        result = ""
        good = not code or (code < 0 and not transaction.has_errors)
        if code < 0:
            code = int(transaction.error_code)
        if code:
            codes = PLUS_CODES if transaction.is_plus else ERROR_CODES
            part = " in part" if transaction.is_plus and code == PARTIAL_ERROR else ""
            result = f", refused{part}: {codes.coded(code)}"
        elif transaction.outcome == UNANSWERED:
            result = ", answer not captured" if transaction.unseen else ", not answered"
        elif good and not reports and slug in _COMMANDS:
            result = ", accepted"
        if transaction.outcome == ORPHAN:
            what = what or transaction.function_name
            result += ", request not captured"
        what = what or _named(transaction)
        time_ns = max(int(transaction.request_ns), int(transaction.response_ns))
        self._reporter.detail(slug, number, frames, time_ns, f"{who}: {what}{result}")


class _Became:
    """The items of a write by what became of them: written, refused, or without a word about it."""

    __slots__ = ("refused", "unsure", "written")

    def __init__(self, transaction: Transaction) -> None:
        self.written: list[ItemResult] = []
        self.refused: list[ItemResult] = []
        self.unsure: list[ItemResult] = []
        for result in transaction.results():
            if result.item is None:
                continue  # a return code too many
            if transaction.error_code or result.refused:
                self.refused.append(result)
            elif result.return_code == SUCCESS:
                self.written.append(result)
            else:
                self.unsure.append(result)


def _item_codes(refused: list[ItemResult]) -> str:
    """Return with which return codes items were refused; empty where they have none, as the whole request was refused."""
    codes = sorted({int(result.return_code) for result in refused if result.refused})
    said = [RETURN_CODES.coded(code) for code in codes[:_NAMED]]
    return f", refused: {', '.join(said)}" if said else ""


def _asked(transaction: Transaction) -> bool:
    """Tell whether a request was made: it was captured, or an answer says so whose request is missing from the capture."""
    return transaction.request_frame > 0 or (transaction.outcome == ORPHAN and half_captured(transaction))


def _ends(transaction: Transaction) -> tuple[str, str]:
    """Return who asked and who was asked, without their ports, each with its network where that has a number."""
    tcp = transaction.connection.tcp
    asking, asked = tcp.ends[transaction.asked_by], tcp.ends[1 - transaction.asked_by]
    return within(asking.host, tcp.vlan), within(asked.host, tcp.vlan)


def _szl_id(transaction: Transaction) -> int:
    """Return the SZL-ID that a request asks for, read in place because panels poll SZLs; -1 when there is none.

    A request for a further part of an answer has no payload.
    """
    at = transaction.request_offset + HEADER_SIZE + len(transaction.parameters.octets) + DATA_HEAD.size
    end = transaction.request_offset + transaction.request_size
    return int(u16(transaction.request_buf, at)) if at + 4 <= end else -1


def _pushed_event(transaction: Transaction) -> int:
    """Return the event of a diagnostic message, which its payload begins with; -1 when it is cut before."""
    told = transaction.response_parameters
    if told is None:
        return -1
    at = transaction.response_offset + HEADER_SIZE + len(told.octets) + DATA_HEAD.size
    end = transaction.response_offset + transaction.response_size
    return int(u16(transaction.response_buf, at)) if at + 2 <= end else -1


def _named(transaction: Transaction) -> str:
    """Return the function and what its request is about."""
    body = transaction.request_body
    notes = ", ".join(body.notes[:3]) if body is not None else ""
    return titled(transaction.function_name, notes)


def _forced(transaction: Transaction) -> str:
    """Return the function, and which variables it sets to which value; empty where the request does not say it."""
    said = items_said(transaction.connection.naming, transaction.results(), True, _NAMED)
    return f"{transaction.function_name} {said}" if said else ""


def _is_cut_short(transaction: Transaction, name: str) -> bool:
    """Return whether the name of a PI service is the beginning of one that is known, in a request that was captured in part."""
    request = transaction.request
    return request is not None and bool(request.malformed) and any([row.startswith(name) for row in PI_SERVICES])


def _service_slug(name: str) -> str:
    """Return what it is to call a PI service; empty for one that only reads, and for none."""
    row = PI_SERVICES.get(name)
    if row is not None:
        return "" if row.effect == READ else _SLUGS.get(row.effect, "security.nc_command")
    if name.startswith(NC_PREFIX):
        return "security.nc_command"
    return "security.unknown_service" if name else ""


#: Slugs of requests by what they do.
_SLUGS: Final[dict[str, str]] = {
    ALARM_CHANGE: "security.alarm_change",
    CLOCK: "security.clock_set",
    DEBUG: "security.debug",
    FLASH: "security.flash_led",
    FORCE: "security.force",
    MEMORY: "security.memory",
    PROGRAM_CHANGE: "security.program_change",
    PROGRAM_READ: "security.program_read",
    START: "security.plc_start",
    STOP: "security.plc_stop",
}
#: Of these the detail says that they were accepted: what they ask for is done then.
_COMMANDS: Final = frozenset((
    "security.alarm_change", "security.clock_set", "security.flash_led", "security.force", "security.memory",
    "security.nc_command", "security.password", "security.plc_start", "security.plc_stop", "security.program_change",
    "security.unknown_service",
))  # fmt: skip
#: Reported once per connection: what a session does repeatedly.
_ONCE: Final = frozenset(("security.debug", "security.alarm_change"))
