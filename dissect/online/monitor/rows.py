"""Makes the rows of the lists for a given width, as pieces of text with styles; text from the wire is escaped here."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from rich.cells import cell_len, set_cell_size

from dissect.engine.findings.catalogue import ERROR, WARNING
from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import NO_FAILURES, Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report import facets, words
from dissect.meaning.report.certainty import mark
from dissect.meaning.report.operations import NAMES, operation_line, result
from dissect.meaning.report.scd import scd_summary
from dissect.meaning.report.words import Places
from dissect.meaning.report.writers.text import sender, transaction_line
from dissect.online.monitor.entries import Entry
from dissect.online.monitor.lists import ConnectionFacts, FindingFacts
from dissect.online.monitor.rate_history import SECONDS, level
from dissect.online.monitor.watched import WatchedFacts
from dissect.output.variables.summary import sparkline
from dissect.output.variables.writers import place_text, shown
from dissect.wire.text import Clock, printable, shortened

#: From this width on, rows show more.
WIDE: Final = 130
_ROOM_FOR_A_MINUTE: Final = 170
#: At most this many characters of a row are made.
_LONG: Final = 400
#: A value that changed less than this many nanoseconds ago is drawn bold.
_FRESH_NS: Final = 2_000_000_000

PLAIN: Final = ""
DIM: Final = "dim"
BAD: Final = "red"
ODD: Final = "yellow"
STRONG: Final = "bold"
#: Styles of findings by severity.
SEVERITY: Final = {ERROR: BAD, WARNING: ODD}

#: The beginning of the details of some findings.
_WHO_TO_WHOM: Final = re.compile(r"^\S+:\d+ to \S+:\d+: ")

PLACES: Final = Places([], False)

#: On terminals that cannot show all of Unicode, answer times are drawn as the digits 1 to 8.
_BLOCKS: Final = "▁▂▃▄▅▆▇█"
_DIGITS: Final = "12345678"
_PLAIN_TERMINALS: Final = frozenset(("dumb", "linux", "vt100", "vt102", "vt220", "ansi"))

Piece = tuple[str, str]


class Look(NamedTuple):
    """Settings for drawing rows: ``glyphs`` of sparklines from low to high, ``places`` with the names of hosts."""

    glyphs: str
    places: Places = PLACES


def sparks() -> str:
    """Return the glyphs for answer times: blocks, or digits if the terminal's font may lack blocks."""
    return _DIGITS if os.environ.get("TERM", "") in _PLAIN_TERMINALS else _BLOCKS


def fit(text: str, width: int, right: bool = False) -> str:
    """Return ``text`` in exactly ``width`` columns; what does not fit is cut, and ends in ``…``."""
    size = len(text) if text.isascii() else cell_len(text)
    if size > width:
        return set_cell_size(text, max(width - 1, 0)) + "…" * min(width, 1)
    return " " * (width - size) + text if right else text + " " * (width - size)


# ---- connections ----------------------------------------------------------------------------------------------------


class _Column(NamedTuple):
    head: str
    width: int  # 0: the remaining width
    right: bool
    cell: Callable[[ConnectionFacts, Look], Piece]


def _who(facts: ConnectionFacts, look: Look) -> Piece:
    return ends(facts.connection, look.places), DIM if facts.over else PLAIN


def _state(facts: ConnectionFacts, _: Look) -> Piece:
    return facts.state, BAD if facts.connection.refused else (DIM if facts.over else PLAIN)


def _number(count: int, style: str) -> Piece:
    text = str(count) if count < 100_000 else f"{count // 1000}k"
    return (text, style) if count else (".", DIM)


def _rate(rate: float) -> Piece:
    if not rate:
        return ".", DIM
    return (f"{rate:.1f}" if rate < 1000 else f"{rate:.0f}"), PLAIN


def _sparkline(count: int) -> Callable[[ConnectionFacts, Look], Piece]:
    def cell(facts: ConnectionFacts, look: Look) -> Piece:
        levels = [level(latency) for latency in facts.worst[-count:]]
        return "".join([look.glyphs[one] if one >= 0 else " " for one in levels]), PLAIN

    return cell


_NUMBER: Final = _Column("#", 4, True, lambda facts, _: (str(facts.key), PLAIN))
_WHO: Final = _Column("", 0, False, _who)
_STATE: Final = _Column("state", 8, False, _state)
_RATE: Final = _Column("per s", 6, True, lambda facts, _: _rate(facts.rate))
_LATEST: Final = _Column("answer", 8, True, lambda facts, _: (words.answer_time(facts.latency_ns), PLAIN))
_FAILED: Final = _Column("fail", 4, True, lambda facts, _: _number(facts.failed, BAD))

_NARROW_COLUMNS: Final = (_NUMBER, _WHO, _STATE, _RATE, _LATEST, _Column("8 s", 8, False, _sparkline(8)), _FAILED)
_MINUTE: Final = _Column("worst of each second", SECONDS, False, _sparkline(SECONDS))
_HALF: Final = _Column("worst of each second", SECONDS // 2, False, _sparkline(SECONDS // 2))
_WIDE_COLUMNS: Final = (
    _NUMBER,
    _WHO,
    _STATE,
    _Column("open", 5, True, lambda facts, _: _number(facts.waiting, PLAIN)),
    _RATE,
    _Column("10 s", 6, True, lambda facts, _: _rate(facts.rate_10)),
    _LATEST,
    _HALF,
    _Column("answered", 8, True, lambda facts, _: _number(facts.answered, PLAIN)),
    _Column("errors", 6, True, lambda facts, _: _number(facts.errors, BAD)),
    _Column("no answer", 9, True, lambda facts, _: _number(facts.unanswered, BAD)),
)


def connection_row(facts: ConnectionFacts, width: int, look: Look) -> list[Piece]:
    """Return a connection in ``width`` columns."""
    pieces: list[Piece] = []
    for column, size in _columns(width):
        text, style = column.cell(facts, look)
        pieces.append((f"{fit(text, size, column.right)} ", style))
    return pieces


def connection_heads(title: str, width: int) -> str:
    """Return the headings of the columns, with the title in place of the first two."""
    columns = _columns(width)
    first = columns[0][1] + columns[1][1] + 1
    return " ".join([fit(title, first), *[fit(column.head, size, column.right) for column, size in columns[2:]]])


def _columns(width: int) -> list[tuple[_Column, int]]:
    columns: tuple[_Column, ...] = _WIDE_COLUMNS if width >= WIDE else _NARROW_COLUMNS
    if width >= _ROOM_FOR_A_MINUTE:
        columns = tuple([_MINUTE if column is _HALF else column for column in columns])
    left = width - sum([column.width + 1 for column in columns])
    return [(column, column.width or max(left, 8)) for column in columns]


def ends(connection: Connection, places: Places = PLACES) -> str:
    """Return both ends of a connection; port 102 of the server is left out."""
    arrow = "→" if connection.client_known else "↔"
    over = " UDP" if connection.udp else ""
    return f"{places.end(connection.client)} {arrow} {places.end(connection.server).removesuffix(':102')}{over}"


# ---- what rolls by --------------------------------------------------------------------------------------------------


def entry_row(entry: Entry, width: int, clock: Clock, places: Places = PLACES) -> list[Piece]:
    """Return a transaction, an operation or an SCD message in ``width`` columns.

    It begins with ``E`` for an answer with errors, ``U`` for a request unanswered, ``S`` for a slow answer.
    """
    what = entry.what
    mark, style = _mark(entry)
    time = clock.time_of_day(begun(entry))
    number = f"c{entry.connection.number}"
    if width < WIDE:
        head = f"{mark} {time[:12]} {fit(number, 4)} {fit(_took(entry), 8, True)}  "
        return [(head, style), (fit(_said(entry, True), max(width - len(head), 0)), style)]
    first = f"#{what.number}" if not isinstance(what, tuple) else ""
    head = f"{mark} {time[:15]} {fit(first, 9)} {fit(_frames(entry), 13)} {fit(number, 5)} "
    middle = f"{fit(_direction(entry, places), 41)} {fit(_took(entry), 8, True)}  "
    return [(head + middle, style), (fit(_said(entry), max(width - cell_len(head + middle), 0)), style)]


def entry_line(entry: Entry, clock: Clock, places: Places = PLACES) -> str:
    """Return the full line of an entry, in the form of the other commands."""
    what = entry.what
    if isinstance(what, Transaction):
        return transaction_line(what, clock, places)
    if isinstance(what, Operation):
        return operation_line(what, clock, places)
    found, connection = what
    side = int(found.side)
    who = f"{places.end(connection.tcp.ends[side])} → {places.end(connection.tcp.ends[1 - side])}"
    return f"{clock.moment(entry.time_ns)}  {found.frame}  {who}  {scd_summary(found)}"


def begun(entry: Entry) -> int:
    """Return the time at which an entry begins, in nanoseconds since 1970."""
    what = entry.what
    if isinstance(what, Transaction):
        return int(what.request_ns if what.request_frame else what.response_ns)
    return what.begin_ns if isinstance(what, Operation) else entry.time_ns


def _mark(entry: Entry) -> Piece:
    what = entry.what
    if isinstance(what, Operation):
        return ("=", DIM) if what.result in NO_FAILURES else ("=", ODD)
    if not isinstance(what, Transaction):
        return ("E", BAD) if what[0].message.error is not None else (" ", PLAIN)
    if what.has_errors:
        return "E", BAD
    if what.failed:
        return "U", BAD
    return ("S", ODD) if entry.slow else (" ", PLAIN)


def _took(entry: Entry) -> str:
    what = entry.what
    if isinstance(what, tuple):
        return "-"
    if isinstance(what, Transaction):
        return words.answer_time(what.latency_ns)
    return words.answer_time(what.duration_ns)


def _frames(entry: Entry) -> str:
    what = entry.what
    if isinstance(what, Transaction):
        return PLACES.pair(int(what.request_frame), int(what.response_frame))
    return PLACES.pair(what.first_frame, what.last_frame) if isinstance(what, Operation) else str(what[0].frame)


def _direction(entry: Entry, places: Places) -> str:
    what = entry.what
    if isinstance(what, Transaction):
        side = int(sender(what))
    else:
        side = int(what[0].side if isinstance(what, tuple) else what.asked_by)
    both = entry.connection.tcp.ends
    return f"{places.end(both[side])} → {places.end(both[1 - side])}"


def _said(entry: Entry, narrow: bool = False) -> str:
    """Return the subject of an entry; ``narrow`` leaves out the group of a function, which the details show."""
    what = entry.what
    if isinstance(what, Transaction):
        name = what.function_name
        head = what.parameters.userdata
        if narrow and head is not None and name == f"{head.group_name}: {head.subfunction_name}":
            name = head.subfunction_name if head.subfunction_name[:1].isalpha() else name
        about = facets.gist(what) if what.has_errors else facets.subject(what)  # refused items must not be cut off
        parts = [name, mark(what), facets.outcome(what), about]  # the mark first: the end of a row may be cut off
    elif isinstance(what, Operation):
        parts = [NAMES[what.kind], what.subject[:_LONG], result(what)]
    else:
        parts = [scd_summary(what[0])]
    return printable("  ".join([part for part in parts if part])[:_LONG])


# ---- findings -------------------------------------------------------------------------------------------------------


def finding_row(facts: FindingFacts, width: int, clock: Clock, places: Places = PLACES) -> list[Piece]:
    """Return the findings of a rule in ``width`` columns: how many there are, and the last of them."""
    rule = facts.rule
    times = f"{facts.times}x" if facts.times > 1 else ""
    wide = width >= WIDE
    head = f"{fit(rule.severity, 7)} {fit(rule.slug, 34 if wide else 27)} {fit(times, 7 if wide else 5, True)} "
    last = facts.details[-1] if facts.details else None
    said = rule.sentence if last is None else f"{clock.time_of_day(last.time_ns)[:8]} {_detail(last, wide, places)}"
    return [(head, SEVERITY.get(rule.severity, PLAIN)), (fit(said, max(width - cell_len(head), 0)), PLAIN)]


def _detail(finding: Finding, wide: bool, places: Places) -> str:
    where = f"c{finding.connection} " if finding.connection else ""
    said = shortened(finding.detail, _LONG) if finding.detail else finding.rule.sentence
    return where + places.named(said if wide or not where else _WHO_TO_WHOM.sub("", said))  # the connection says who


# ---- watched variables ----------------------------------------------------------------------------------------------

_VALUE: Final = 18
_WHEN: Final = 8
_BY: Final = 16


def watched_heads(title: str, width: int) -> str:
    """Return the headings of the columns; the title replaces the heading of the names."""
    name, trend = _watched_sizes(width)
    return " ".join([fit(title, name), fit("value", _VALUE), fit("since", _WHEN), fit("by", _BY), fit("trend", trend)])


def watched_row(facts: WatchedFacts, width: int, clock: Clock, look: Look, now_ns: int) -> list[Piece]:
    """Return a variable in ``width`` columns: value, time and client of its latest change, trend of the last seconds."""
    name, trend = _watched_sizes(width)
    row = facts.latest
    changed = facts.rows[-1]
    value = shown(facts.variable, row.value, row.data, row.text)
    fresh = now_ns - facts.changed_ns < _FRESH_NS and not changed.first
    by = f"{'W ' if changed.writes else '  '}{look.places.host(changed.client)}"
    return [
        (f"{fit(place_text(facts.variable), name)} ", PLAIN if facts.variable.tag else DIM),
        (f"{fit(value, _VALUE)} ", STRONG if fresh else PLAIN),
        (
            f"{fit(clock.time_of_day(facts.changed_ns)[:_WHEN], _WHEN)} {fit(by, _BY)} ",
            ODD if changed.writes else PLAIN,
        ),
        (fit(sparkline(facts.trend(now_ns, trend), look.glyphs), trend), PLAIN),
    ]


def _watched_sizes(width: int) -> tuple[int, int]:
    """Return the widths of the columns for the name and the trend."""
    trend = SECONDS if width >= _ROOM_FOR_A_MINUTE else SECONDS // 2 if width >= WIDE else 8
    return max(width - _VALUE - _WHEN - _BY - trend - 4, 8), trend


def joined(rows: Sequence[Piece]) -> str:
    """Return the text of pieces."""
    return "".join([text for text, _ in rows]).rstrip()


#: The meanings of the signs on the screen.
LEGEND: Final = (
    ("E U S", "a transaction with errors, without an answer, or with a slow answer"),
    ("=", "an operation of several transactions: a download, an upload, a long answer …"),
    ("c12", "connection 12"),
    ("per s, 10 s", "transactions in the last full second, and the average per second of the last ten"),
    ("answer", "the latest answer time"),
    (
        f"{_BLOCKS[0]}{_BLOCKS[3]}{_BLOCKS[7]} or 148",
        "the worst answer of each second: to 316 µs, 1 ms, 3.2 ms, 10 ms, 32 ms, 100 ms, 316 ms, longer; blank for none",
    ),
    ("fail", "transactions with errors or without answer"),
    ("W", "of a value: the client beside it wrote it; otherwise it read the value, or was sent it"),
)
