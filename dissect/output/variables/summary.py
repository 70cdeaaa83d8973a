"""A summary of values: one row for each variable, as text, JSON lines and CSV (docs/values.md)."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

from dissect.meaning.facts.value import VARIABLE
from dissect.meaning.facts.written import written
from dissect.meaning.report import words
from dissect.meaning.report.styled import DIM, HEADING, PLAIN, Line
from dissect.meaning.report.words import Places
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import Variable
from dissect.output.variables.statistics import MAX_DISTINCT, Pace, Statistics
from dissect.output.variables.writers import any_text, place_text, shown, value_cell
from dissect.packets.tcp.link import within
from dissect.wire.text import Clock, cell, duration_text, printable

VARIABLE_SCHEMA: Final = "s7dissect.variable/1"
#: Levels of a sparkline, from low to high.
LEVELS: Final = "▁▂▃▄▅▆▇█"
_COLUMN: Final = 36
#: Digits of a mean, and maximum number of digits if it needs more; a double has no more than `_EXACT`.
_DIGITS: Final = 9
_EXACT: Final = 17
CSV_COLUMNS: Final = tuple([key for key in VARIABLE if key != "vlan"])


class Summary:
    """The variables of a collector with ``sums``; ``spark`` asks for sparklines."""

    def __init__(self, collector: ValueCollector, spark: bool = False) -> None:
        self.variables = [row for row in collector.variables if _told(row)]
        self.untracked = int(collector.untracked)
        self.most = int(collector.most)
        self.spark = spark


def _told(variable: Variable) -> bool:
    statistics = variable.statistics
    counted = variable.refused_reads + variable.refused_writes + variable.unconfirmed + variable.likely
    return (statistics is not None and statistics.count > 0) or counted > 0


def _statistics(variable: Variable) -> Statistics:
    return variable.statistics if variable.statistics is not None else Statistics()


def sparkline(points: Sequence[float], levels: str = LEVELS) -> str:
    """Return numbers as characters of ``levels``. NaN repeats the number before it; a blank if there is none."""
    known = [point for point in points if not math.isnan(point)]
    if not known:
        return ""
    least, most = min(known), max(known)
    line, last = "", math.nan
    for point in points:
        last = last if math.isnan(point) else point
        if math.isnan(last):
            line += " "
            continue
        # Halved first: the difference of two large doubles may overflow.
        share = 0.5 if most == least else (last / 2 - least / 2) / (most / 2 - least / 2)
        line += levels[min(int(share * len(levels)), len(levels) - 1)]
    return line


# ---- text -----------------------------------------------------------------------------------------------------------

_HEADS: Final = (
    "variable", "type", "count", "first", "last", "min", "max", "mean", "period", "distinct", "read by", "written by",
    "refused", "only likely",
)  # fmt: skip
_RIGHT: Final = frozenset(("count", "min", "max", "mean", "distinct", "only likely"))


def text_lines(summary: Summary, _clock: Clock, places: Places) -> list[Line]:
    """Return a table for each PLC, with a line for each variable."""
    lines: list[Line] = []
    by_plc: dict[str, list[Variable]] = {}
    for variable in summary.variables:
        by_plc.setdefault(within(places.end(variable.plc), variable.vlan), []).append(variable)
    for plc, variables in by_plc.items():
        if lines:
            lines.append(Line(""))
        lines.append(Line(f"{plc}: {words.count(len(variables), 'variable')}", HEADING))
        heads = [*_HEADS, "trend"] if summary.spark else list(_HEADS)
        rows = [_cells(variable, places, summary.spark) for variable in variables]
        used = [at for at in range(len(heads)) if any([row[at] for row in rows])]
        widths = {at: max(len(heads[at]), *[len(row[at]) for row in rows]) for at in used}
        for row in (heads, *rows):
            text = "  ".join(
                [row[at].rjust(widths[at]) if heads[at] in _RIGHT else row[at].ljust(widths[at]) for at in used]
            )
            lines.append(Line(f"  {text.rstrip()}", DIM if row is heads else PLAIN, 6))
    return lines


def _cells(variable: Variable, places: Places, spark: bool) -> list[str]:
    """Return the cells of a variable for a person."""
    found = _statistics(variable)
    counted = found.count > 0
    numbers = found.numbers > 0 and variable.type != "BOOL"
    cells = [
        place_text(variable),
        printable(variable.type),
        str(found.count),
        _short(variable, found.first) if counted else "",
        _short(variable, found.last) if counted and found.distinct_count > 1 else "=" if found.count > 1 else "",
        str(found.least) if numbers else "",
        str(found.most) if numbers else "",
        mean_text(found.mean, found.least, found.most) if numbers and found.mean is not None else "",
        _pace(found.pace),
        f"{MAX_DISTINCT}+" if found.more_distinct else str(found.distinct_count) if counted else "",
        _clients(found.readers, places),
        _clients(found.writers, places),
        _refused(variable),
        str(variable.likely) if variable.likely else "",
    ]
    return [*cells, sparkline(found.trend) if found.numbers > 1 else ""] if spark else cells


def _short(variable: Variable, value: object) -> str:
    text = shown(variable, None if isinstance(value, bytes) else value, _octets(variable, value))
    return text if len(text) <= _COLUMN else f"{text[: _COLUMN - 1].rstrip('…')}…"


def _octets(variable: Variable, value: object) -> bytes | None:
    """Return the octets of a value in statistics if they must be shown, None if the value is sufficient."""
    if isinstance(value, bytes):
        return value
    return bytes(value) if variable.bytes_only and isinstance(value, list) else None


def mean_text(mean: float, least: float, most: float) -> str:
    """Return a mean with as many digits as are needed to place it between the extremes, without an exponent if possible."""
    if isinstance(mean, int) or not math.isfinite(mean):
        return str(mean)
    whole = len(str(int(abs(mean))))
    for digits in range(max(_DIGITS, whole if whole < _EXACT else 0), _EXACT + 1):
        text = f"{mean:.{digits}g}"
        if least <= float(text) <= most:
            return text
    return str(least if mean < least else most)


def _pace(pace: Pace | None) -> str:
    if pace is None or pace.period_ns is None:
        return ""
    jitter = f" ± {duration_text(pace.jitter_ns)}" if pace.jitter_ns is not None else ""
    return f"{duration_text(pace.period_ns)}{jitter}"


def _clients(clients: dict[str, Pace], places: Places) -> str:
    return ", ".join([f"{places.name(host)} ({pace.count})" for host, pace in clients.items()])


def _refused(variable: Variable) -> str:
    parts = (
        (variable.refused_reads, words.count(int(variable.refused_reads), "read")),
        (variable.refused_writes, words.count(int(variable.refused_writes), "write")),
        (variable.unconfirmed, f"{words.count(int(variable.unconfirmed), 'write')} unconfirmed"),
    )
    return ", ".join([text for number, text in parts if number])


# ---- JSON and CSV ---------------------------------------------------------------------------------------------------


def json_lines(summary: Summary) -> list[str]:
    """Return a line with a JSON object for each variable."""
    clock = Clock()
    return [
        json.dumps(variable_json(variable, clock), separators=(",", ":")).replace("\x7f", "\\u007f")
        for variable in summary.variables
    ]


def variable_json(variable: Variable, clock: Clock) -> dict[str, Any]:
    """Return the summary of a variable as values for JSON (docs/json.md)."""
    found = _statistics(variable)
    owned = {"first": _json(found.first), "last": _json(found.last)}
    return {"schema": VARIABLE_SCHEMA, **written(VARIABLE, variable, Places([], False), clock, owned)}


def _json(value: object) -> object:
    """Return a value for JSON; None for octets that have no value."""
    return None if isinstance(value, bytes) else json.loads(any_text(value))


def csv_rows(summary: Summary) -> Iterable[list[str]]:
    """Return the names of the columns, then a row for each variable."""
    clock = Clock()
    yield list(CSV_COLUMNS)
    for variable in summary.variables:
        found = variable_json(variable, clock)
        statistics = _statistics(variable)
        row = []
        for name in CSV_COLUMNS:
            value = found.get(name, 0)
            if name in {"first", "last"}:
                given = statistics.first if name == "first" else statistics.last
                row.append(
                    given.hex(" ")
                    if isinstance(given, bytes)
                    else value_cell(variable, given, _octets(variable, given))
                )
            elif name in {"readers", "writers"}:
                row.append("; ".join([f"{one['client']} {one['count']}" for one in value]))
            elif isinstance(value, bool):
                row.append("true" if value else "false")
            else:
                row.append("" if value is None else cell(str(value)))
        yield row


def limits_text(summary: Summary) -> str:
    """Return a sentence about the values that are missing from a summary, empty if none are."""
    if not summary.untracked:
        return ""
    return (
        f"{words.count(summary.untracked, 'value')} of variables beyond the first {summary.most} (or 8 MiB of values) "
        "are not in the summary; name variables, or select with -Y"
    )
