"""Parses the text of a golden into a session, line by line; an error names the line and the reason."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from functools import partial
from typing import Final, NamedTuple

from dissect.engine.transactions.transaction import DOUBT_TEXTS, HOLE, LIKELY, MALFORMED_HEADER, REASON_TEXTS
from dissect.protocols.s7.build import build_setup
from dissect.protocols.s7.tables import ACK_DATA, JOB, READ_VAR, SETUP_COMMUNICATION
from dissect.testing.golden.blocks import Blocks, join_blocks
from dissect.testing.golden.exchange import PLUS, S7, SCD, Exchange
from dissect.testing.golden.forms import (
    ItemLine,
    build_answer,
    build_request,
    parse_item_text,
    parse_setup,
)
from dissect.testing.golden.model import GoldenError, Link, Session, Transaction
from dissect.testing.golden.values import hex_octets, unquoted
from dissect.testing.golden.writing import ALONE, BEHIND_HEADER, FORMAT, FORMS, OTHER_ROLE, PERHAPS, pushed
from dissect.wire.text import printable

#: The beginning of a golden of any version.
MAGIC: Final = "s7dissect golden "

#: Maximum length of a line with its continuations: a PDU has up to 65,535 octets, with three characters each.
MAX_LINE: Final = 512 * 1024

_FACT: Final = 2
_BLOCK: Final = 4
_CONTINUED: Final = 8
_FUNCTIONS: Final = {name: function for function, name in FORMS.items()}
_HEAD: Final = re.compile(r"([0-9]{1,9}) (client|server) (.+)")
_SPOKEN: Final = re.compile(r"(protocol|carrier) (.+)")
_CONNECTION: Final = re.compile(r"connection ([0-9]{1,9})")
_SIZES: Final = re.compile(r"TPDU size ([0-9]{1,5}), asked ([0-9]{1,5})")
_TSAP: Final = re.compile(r"(client|server) TSAP (<[^>]*>)")
_ADDRESS: Final = re.compile(r"(client|server) address (\S+)")
_ENDS: Final = re.compile(r"ends ([a-z_]+)(?: by (client|server))?(?: (\".*\"))?")
_TIME: Final = re.compile(r"at ([0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9]{2}:[0-9]{2}:[0-9]{2})\.([0-9]{9})Z")
_LATENCY: Final = re.compile(r"latency (-?[0-9]{1,19}) ns")
_REFERENCE: Final = re.compile(r"reference 0x([0-9a-f]{4})")
_JOB: Final = re.compile(r"job of ([0-9]{1,9})")
_HALF: Final = re.compile(r"(request|answer|says) (\S+)(?: (<[^>]*>))?")
_ERROR: Final = re.compile(r"refused 0x([0-9a-f]{4})")


class GoldenLine(NamedTuple):
    """A line of a golden: its number, its indentation, and its text without remarks and with its continuations."""

    number: int
    depth: int
    text: str


def parse_golden(text: str, name: str = "golden") -> Session:
    """Return the session that a golden describes. Raises GoldenError, which names the line."""
    return read_golden(text.split("\n"), name)


def read_golden(raw: Iterable[str], name: str) -> Session:
    """Return the session that lines of a golden (without their ends) describe. Raises GoldenError, which names the line."""
    lines = _lines(raw, name)
    first = next(lines, None)
    if first is None or first.text != FORMAT:
        beginning = first.text if first is not None else ""
        if beginning.startswith(MAGIC):
            message = f"{name}: format {beginning.removeprefix(MAGIC)[:80]!r} is unknown; this version reads {FORMAT!r}"
        else:
            message = f"{name}: not a golden: the first line is not {FORMAT!r}"
        raise GoldenError(message)
    reader = _Reader(Session(name))
    for head, below in _blocks(lines):
        try:
            reader.block(head, below)
        except _LineError as wrong:
            raise GoldenError(f"{name}: line {wrong.line.number}: {wrong}") from None
        except ValueError as error:
            raise GoldenError(f"{name}: line {head.number}: {error}") from None
    return reader.finish()


def _blocks(lines: Iterator[GoldenLine]) -> Iterator[tuple[GoldenLine, list[GoldenLine]]]:
    """Yield each first line of a block together with the lines indented below it."""
    head: GoldenLine | None = None
    below: list[GoldenLine] = []
    for line in lines:
        if head is not None and line.depth > 0:
            below.append(line)
            continue
        if head is not None:
            yield head, below
        head, below = line, []
    if head is not None:
        yield head, below


def _lines(raw_lines: Iterable[str], name: str) -> Iterator[GoldenLine]:
    """Yield the lines with content, each joined with its continuations. Raises GoldenError for a line that is too long."""
    number = depth = size = 0
    held: list[str] = []
    for count, raw in enumerate(raw_lines, 1):
        content = raw.partition("#")[0].rstrip()
        if not content:
            continue
        bare = content.lstrip(" ")
        indent = len(content) - len(bare)
        if indent < _CONTINUED or not held:
            if held:
                yield GoldenLine(number, depth, " ".join(held))
            number, depth, size, held = count, indent, 0, []
        held.append(bare)
        size += len(bare)
        if size > MAX_LINE:
            raise GoldenError(f"{name}: line {number}: longer than {MAX_LINE >> 10} KiB: not a line of a golden")
    if held:
        yield GoldenLine(number, depth, " ".join(held))


class _LineError(Exception):
    """A wrong line, and what is wrong with it."""

    def __init__(self, line: GoldenLine, message: str) -> None:
        super().__init__(message)
        self.line = line


class _Reader:
    """Takes one block after another."""

    def __init__(self, session: Session) -> None:
        self._session = session
        self._links: list[Link] = []
        self._numbers: dict[
            int, Transaction
        ] = {}  # transactions of the current connection, by their numbers in the text
        self._known: dict[tuple[str, ...], _Draft] = {}  # parsed blocks, by their text: polling repeats them

    def block(self, head: GoldenLine, below: list[GoldenLine]) -> None:
        """Take a block: its first line, and the lines indented below it."""
        if head.depth:
            raise _LineError(head, "indented, but there is no line above that it belongs to")
        if _CONNECTION.fullmatch(head.text):
            link = Link()
            link.begun = True
            for line in below:
                _read(line, partial(_link_fact, link))
            link.begun = link.begun and link.carrier != "udp"
            self._links.append(link)
            self._numbers = {}
            return
        match = _HEAD.fullmatch(head.text)
        if match is None:
            raise _LineError(
                head, f"{head.text!r} starts neither a connection nor a transaction such as '1 client READ'"
            )
        if not self._links:
            raise _LineError(head, "a transaction before the first connection")
        link = self._links[-1]
        key = (match[3], *[line.text for line in below])
        draft = self._known.get(key)
        if draft is None:
            draft = _Draft(match[3])
            for line in below:
                _read(line, draft.take)
            draft.made = draft.exchange()
            self._known[key] = draft
        assert draft.made is not None
        exchange = draft.made
        if draft.job:
            source = self._numbers.get(draft.job)
            if source is None:
                raise _LineError(head, f"'job of {draft.job}', but no transaction {draft.job} precedes it here")
            exchange = exchange.of(source.exchange.request)
        exchange = self._session.share(exchange)
        outcome = draft.outcome or ("answered" if exchange.request_seen and exchange.response_seen else "")
        if not outcome:
            raise _LineError(
                head,
                "request or answer is missing, and no line gives the reason, such as 'no answer: connection_closed'",
            )
        transaction = Transaction(link, match[2], exchange, outcome, draft.reason)
        if draft.doubt and outcome not in {"answered", "unsolicited"}:
            raise _LineError(head, "'likely' belongs to a request with its answer, or to a push of a job")
        if draft.doubt or draft.perhaps:
            transaction.certainty, transaction.doubt = LIKELY, draft.doubt
        if pushed(transaction):
            transaction.asked_by = OTHER_ROLE[match[2]]
        transaction.time_ns, transaction.latency_ns, transaction.pdu_ref = (
            draft.time_ns,
            draft.latency_ns,
            draft.pdu_ref,
        )
        link.transactions.append(transaction)
        self._numbers[int(match[1])] = transaction

    def finish(self) -> Session:
        """Return the session, in the order of the text."""
        self._session.arrange(self._links)
        return self._session


def _read(line: GoldenLine, take: Callable[[GoldenLine], None]) -> None:
    """Let ``take`` parse a line; its errors get the number of the line."""
    try:
        take(line)
    except ValueError as error:
        raise _LineError(line, str(error)) from None


def _link_fact(link: Link, line: GoldenLine) -> None:
    text = line.text
    if match := _TSAP.fullmatch(text):
        octets = hex_octets(match[2])
        if match[1] == "client":
            link.calling = octets
        else:
            link.called = octets
    elif match := _ADDRESS.fullmatch(text):
        client, server = link.addresses
        link.addresses = (match[2], server) if match[1] == "client" else (client, match[2])
    elif match := _SIZES.fullmatch(text):
        link.tpdu_size, link.tpdu_size_asked = int(match[1]), int(match[2])
    elif match := _ENDS.fullmatch(text):
        link.ended, link.ended_by = match[1], match[2] or ""
        link.farewell = unquoted(match[3]) if match[3] else ""
    elif text == "begins before the capture":
        link.begun = False
    elif match := _SPOKEN.fullmatch(text):
        setattr(link, match[1], printable(match[2]))  # in the notation of the text
    elif text.startswith("refused "):
        link.refused = unquoted(text.removeprefix("refused "))
    else:
        raise ValueError(f"{text!r} does not apply to a connection")


class _Half:
    """A request or an answer in blocks, while its lines are read."""

    def __init__(self, kind: str, octets: bytes | None) -> None:
        self.kind = kind
        self.octets = octets
        self.error = 0
        self.parameters = b""
        self.data = b""

    def take(self, text: str) -> None:
        """Take a line below the head."""
        if match := _ERROR.fullmatch(text):
            self.error = int(match[1], 16)
        elif text.startswith("parameters "):
            self.parameters = hex_octets(text.removeprefix("parameters "))
        elif text.startswith("data "):
            self.data = hex_octets(text.removeprefix("data "))
        else:
            raise ValueError(f"{text!r} is neither refused, parameters nor data")

    def pdu(self) -> bytes:
        """Return the PDU."""
        if self.octets is not None:
            return self.octets
        return join_blocks(Blocks(self.kind, self.error, self.parameters, self.data))


class _Draft:
    """A transaction while its lines are read."""

    def __init__(self, head: str) -> None:
        self._function = _FUNCTIONS.get(head, -1)
        self._items: list[ItemLine] = []
        self._request: bytes = b""
        self._response: bytes = b""
        self._halves: dict[str, _Half] = {}
        self._last: _Half | None = None
        self._scd: list[str] = []
        self.outcome = ""
        self.reason = ""
        self.doubt = ""  # why the pair is only likely
        self.perhaps = False  # for an unanswered request: perhaps it was answered
        self.time_ns: int | None = None
        self.latency_ns: int | None = None
        self.pdu_ref: int | None = None
        self.job = 0  # for a push: the number of the transaction that requested it
        self.made: Exchange | None = None  # set once all lines are read

    def take(self, line: GoldenLine) -> None:
        """Take a line. Raises ValueError."""
        if line.depth == _BLOCK and self._last is not None:
            self._last.take(line.text)
        elif line.depth != _FACT:
            raise ValueError(f"indented by {line.depth}; facts need {_FACT} spaces, blocks {_BLOCK}")
        else:
            self._last = None
            if not self._outcome(line.text) and not self._recorded(line.text):
                self._fact(line.text)

    def _outcome(self, text: str) -> bool:
        if text == BEHIND_HEADER:
            self.reason = MALFORMED_HEADER
            return True
        keyword, _, reason = text.partition(": ")
        if keyword == "likely":
            if reason not in DOUBT_TEXTS:
                raise ValueError(f"{reason} is not a doubt; known doubts: {', '.join(DOUBT_TEXTS)}")
            self.doubt = reason
            return True
        if keyword == "no answer" and reason == f"{HOLE}{PERHAPS}":
            reason, self.perhaps = HOLE, True
        outcomes = {
            "no answer": "unanswered",
            "answer without request": "orphan_answer",
            "wants no answer": "unsolicited",
        }
        if keyword not in outcomes:
            return False
        if reason and reason not in REASON_TEXTS:
            raise ValueError(f"{reason} is not a reason; known reasons: {', '.join(REASON_TEXTS)}")
        self.outcome, self.reason = ALONE if reason == MALFORMED_HEADER else outcomes[keyword], reason
        return True

    def _recorded(self, text: str) -> bool:
        """Parse a line that belongs to one recording; return False if it is a different line."""
        if match := _LATENCY.fullmatch(text):
            self.latency_ns = int(match[1])
        elif match := _JOB.fullmatch(text):
            self.job = int(match[1])
        elif match := _REFERENCE.fullmatch(text):
            self.pdu_ref = int(match[1], 16)
        elif match := _TIME.fullmatch(text):
            second = datetime.fromisoformat(match[1]).replace(tzinfo=UTC)
            self.time_ns = int((second - datetime(1970, 1, 1, tzinfo=UTC)).total_seconds()) * 1_000_000_000 + int(
                match[2]
            )
        else:
            return False
        return True

    def _fact(self, text: str) -> None:
        if text.startswith("scd "):
            message = unquoted(text.removeprefix("scd "))
            self._scd.append(f"answer {message.removeprefix('says ')}" if message.startswith("says ") else message)
        elif match := _HALF.fullmatch(text):
            raw = match[2] in {PLUS, SCD, "octets"}
            if raw == (match[3] is None) and match[2] != SCD:
                raise ValueError(
                    f"{match[2]} bytes of a PDU must be in angle brackets"
                    if raw
                    else f"unexpected bytes after {match[2]}"
                )
            half = _Half(match[2], hex_octets(match[3] or "<>") if raw else None)
            if (match[1] == "says") != (self.outcome == "unsolicited" and match[1] != "request"):
                raise ValueError("use 'says' below 'wants no answer', and 'answer' after a request")
            self._halves["answer" if match[1] == "says" else match[1]] = half
            self._last = half
        elif self._function == SETUP_COMMUNICATION and text.startswith("asks "):
            self._request = build_setup(JOB, parse_setup(text.removeprefix("asks ")))
        elif self._function == SETUP_COMMUNICATION and text.startswith("gets "):
            self._response = build_setup(ACK_DATA, parse_setup(text.removeprefix("gets ")))
        elif self._function in _FUNCTIONS.values() and self._function != SETUP_COMMUNICATION:
            self._items.append(parse_item_text(text))
        else:
            raise ValueError(f"{text!r} does not apply to this kind of transaction")

    def exchange(self) -> Exchange:
        """Return the exchange. Raises ValueError if the lines contradict each other."""
        kinds = {half.kind for half in self._halves.values()} & {PLUS, SCD}
        kind = kinds.pop() if kinds else S7
        request_half, answer_half = self._halves.get("request"), self._halves.get("answer")
        if kind == SCD:
            return Exchange(SCD, b"", b"", tuple(self._scd), (request_half is not None, answer_half is not None))
        request = request_half.pdu() if request_half is not None else self._request
        response = answer_half.pdu() if answer_half is not None else self._response
        if self._function in _FUNCTIONS.values() and self._function != SETUP_COMMUNICATION:
            request = build_request(self._function, self._items)
            if answer_half is None and self.outcome not in {"unanswered", ALONE}:
                self._hold_to_answer()
                response = build_answer(self._function, self._items)
        return Exchange(kind, request, response, tuple(self._scd))

    def _hold_to_answer(self) -> None:
        for line in self._items:
            if self._function == READ_VAR and line.data is None and line.code < 0:
                raise ValueError("an item of an answered READ has neither a value nor 'refused'")
