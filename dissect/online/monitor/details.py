"""The details of a row: a transaction with field tree and octets of its PDUs, a connection, the findings of a rule."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import islice
from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import DOUBT_TEXTS, PUSH, Transaction
from dissect.meaning.report import facets, words
from dissect.meaning.report.certainty import left_out
from dissect.meaning.report.finding_lines import finding_lines
from dissect.meaning.report.plus import item_text
from dissect.meaning.report.scd_tree import scd_tree_lines
from dissect.meaning.report.styled import DIM, HEADING, PLAIN, Line
from dissect.meaning.report.text import connection_lines
from dissect.meaning.report.tree import plus_tree_lines, tree_lines
from dissect.meaning.report.words import Places
from dissect.meaning.report.writers.text import pdu_line, plus_line
from dissect.online.monitor.entries import Entry
from dissect.online.monitor.lists import ConnectionFacts, FindingFacts
from dissect.online.monitor.rows import PLACES, entry_line
from dissect.online.monitor.watched import WatchedFacts
from dissect.output.variables.writers import place_text, shown, value_line
from dissect.protocols.ibh.tables import IBH_NETLINK
from dissect.protocols.s7plus.hiding import shown_answer
from dissect.wire.text import Clock, printable, shortened

#: At most this many lines of details are shown.
MAX_LINES: Final = 20_000
#: At most this many transactions are listed with their connection, and this many characters of each shown.
_LAST: Final = 20
_LONG: Final = 1000
_NOTES: Final = 200


def entry_lines(entry: Entry, clock: Clock | None = None, places: Places = PLACES) -> list[Line]:
    """Return the details of an entry; ``clock`` writes times."""
    return list(islice(_entry(entry, clock or Clock(), places), MAX_LINES))


def _entry(entry: Entry, clock: Clock, places: Places) -> Iterator[Line]:
    yield Line(shortened(entry_line(entry, clock, places), _LONG), HEADING, 4)
    what = entry.what
    if isinstance(what, tuple):
        yield Line("")
        yield from _plain(scd_tree_lines(what[0]))
    elif isinstance(what, Operation):
        yield Line(f"  {words.count(what.parts, 'transaction')}: {_numbers(what)}", PLAIN, 4)
        for part in what.content_parts()[:_NOTES]:
            if part.note:
                yield Line(f"  {shortened(part.note, _LONG)}", PLAIN, 4)
    else:
        yield from _transaction(what, clock, places)


def _numbers(operation: Operation) -> str:
    shown = [f"#{number}" for number in operation.transactions[:_NOTES]]
    return ", ".join(shown) + (", …" if operation.parts > len(shown) else "")


def _transaction(transaction: Transaction, clock: Clock, places: Places) -> Iterator[Line]:
    if transaction.plus_request is not None or transaction.plus_response is not None:  # items with numbers of their own
        numbered = [(item.number, item_text(item)) for item in transaction.plus_results]
    else:
        numbered = list(enumerate(facets.items(transaction), 1))
    for number, text in numbered:
        yield Line(f"  item {number}  {text}", PLAIN, 4)
    if transaction.doubt:
        yield Line(f"  only likely: {DOUBT_TEXTS[transaction.doubt]}", "warning", 4)
    for error in transaction.errors:
        said = f"  {error.where}: {facets.error_text(error)}. {error.text}" if error.text else ""
        yield Line(printable(said or f"  {error.where}: {facets.error_text(error)}"), "error", 4)
    if transaction.scd:
        for found in transaction.scd:
            yield Line("")
            yield from _plain(scd_tree_lines(found))
    yield from _halves(transaction, clock, places)


def _halves(transaction: Transaction, clock: Clock, places: Places) -> Iterator[Line]:
    connection = transaction.connection
    # `entries.detached` keeps the packet headers before a PDU if one packet carries all of it.
    asked = transaction._request_buf if transaction._request_offset else b""
    told = transaction._response_buf if transaction._response_offset else b""
    given = "Push" if transaction._outcome == PUSH else "Answer"
    for title, pdu, packet in (("Request", transaction.request, asked), (given, transaction.response, told)):
        if pdu is not None:
            yield from _heading(title, pdu_line(pdu, connection, clock, places))
            yield from _plain(tree_lines(pdu, packet, connection.protocol == IBH_NETLINK))
    request = transaction.plus_request
    for title, plus, answers in (("Request", request, None), (given, transaction.plus_response, request)):
        if plus is not None:
            contents = shown_answer(plus, answers)
            yield from _heading(title, plus_line(plus, connection, clock, places, contents))
            yield from _plain(plus_tree_lines(plus, b"", "", contents))


def _heading(title: str, text: str) -> Iterator[Line]:
    yield Line("")
    yield Line(f"{title}: packet {shortened(text.strip(), _LONG)}", HEADING, 4)


def _plain(lines: Iterable[str]) -> Iterator[Line]:
    """Yield lines of a tree, indented by two columns less than in a report, where they are below a line."""
    for text in lines:
        yield Line(text.removeprefix("  "), PLAIN, 27)


def connection_details(
    facts: ConnectionFacts, entries: Iterable[Entry], clock: Clock | None = None, places: Places = PLACES
) -> list[Line]:
    """Return the details of a connection, and the last of ``entries`` that are on it."""
    clock = clock or Clock()
    lines = list(connection_lines(facts.connection, places))
    if facts.waiting:
        lines.append(Line(f"     {words.count(facts.waiting, 'request')} pending now", PLAIN, 5))
    if facts.doubts:
        lines.append(Line(f"     {left_out(facts.doubts)}", "warning", 5))
    if facts.failed and facts.connection.last_error is not None:
        when = clock.moment(facts.connection.last_error_ns)
        lines.append(
            Line(f"     last refusal {when}: {shortened(facts.connection.last_error.subject, _LONG)}", "error", 5)
        )
    mine = [entry for entry in entries if _same(entry.connection, facts.connection)][-_LAST:]
    if mine:
        lines += [Line(""), Line(f"Its latest transactions (the filter c{facts.key} shows only these)", HEADING)]
        lines += [Line(f"  {shortened(entry_line(entry, clock, places), _LONG)}", PLAIN, 4) for entry in mine]
    return lines


def _same(one: Connection, other: Connection) -> bool:
    return one.number == other.number


def finding_details(facts: FindingFacts, places: Places = PLACES, said: str = "") -> list[Line]:
    """Return the details of the findings of a rule, the newest first; ``said`` are the facts of the rule in words."""
    details = list(reversed(facts.details))
    lines = list(finding_lines(facts.rule, facts.times, details, places, len(details), facts=said))
    if details and len(details) < facts.times:
        lines.append(Line("      newest first; findings without detail were only counted", DIM, 8))
    return lines


def watched_details(facts: WatchedFacts, clock: Clock | None = None, places: Places = PLACES) -> list[Line]:
    """Return the details of a watched variable, and its latest changes, the newest first."""
    clock = clock or Clock()
    variable = facts.variable
    title = f"{place_text(variable)} {printable(variable.type)}".rstrip()
    lines = [Line(f"{title}  of {places.end(variable.plc)}", HEADING, 4)]
    if variable.comment:
        lines.append(Line(f"  {shortened(variable.comment, _NOTES)}", PLAIN, 4))
    row = facts.latest
    lines.append(Line(f"  {shown(variable, row.value, row.data, row.text)}", PLAIN, 4))
    lines.append(Line(f"  {words.count(facts.count, 'value')}, {words.count(facts.changes, 'change')}", PLAIN, 4))
    if variable.likely:
        lines.append(Line(f"  {words.count(int(variable.likely), 'value')} only likely, left out", "warning", 4))
    refused = variable.refused_reads + variable.refused_writes
    if refused or variable.unconfirmed:
        lines.append(
            Line(
                f"  refused: {words.count(int(variable.refused_reads), 'read')}, "
                f"{words.count(int(variable.refused_writes), 'write')}; "
                f"{words.count(int(variable.unconfirmed), 'write')} unconfirmed",
                "error",
                4,
            )
        )
    title = "Its latest changes, the newest first" if facts.changes else "Where it was seen first"
    lines += [Line(""), Line(title, HEADING)]
    lines += [Line(f"  {value_line(row, clock, places)}", PLAIN, 4) for row in reversed(facts.rows)]
    return lines
