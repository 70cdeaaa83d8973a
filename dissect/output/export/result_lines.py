"""The result of a query as text, JSON lines and CSV."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Mapping
from io import StringIO
from typing import Any, Final

from dissect.meaning.report.outcome import Outcome
from dissect.output.export.sql import Result
from dissect.wire.text import cell, printable, shortened

#: Maximum number of characters of a text in a table.
_WIDEST: Final = 120


class QueryOutcome(Outcome):
    """The result of a query, as an outcome. Only one format can read it, once.

    ``none`` is the text for a table without rows.
    """

    def __init__(self, result: Result, none: str = "") -> None:
        self.result = result
        self.none = none

    def text(self) -> Iterator[str]:
        """Return a table with a heading; columns of numbers are aligned to the right."""
        columns = self.result.columns
        rows = list(self.result.rows())
        if self.none and not rows:
            yield self.none
            return
        cells = [[printable(name) for name in columns], *[[_shown(value) for value in row] for row in rows]]
        widths = [max([len(line[at]) for line in cells]) for at in range(len(columns))]
        numbers = [
            all([isinstance(row[at], (int, float)) or row[at] is None for row in rows]) for at in range(len(columns))
        ]
        for line in cells:
            parts = [
                text.rjust(width) if number and rows else text.ljust(width)
                for text, width, number in zip(line, widths, numbers, strict=True)
            ]
            yield "  ".join(parts).rstrip()

    def as_dict(self) -> Mapping[str, object]:
        """Return the names of the columns, and the rows."""
        return {"columns": self.result.columns, "rows": list(self.result.rows())}


def _shown(value: Any) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return shortened(value, _WIDEST)
    if isinstance(value, list):
        return shortened(", ".join([_shown(one) for one in value]), _WIDEST)
    return str(value)


def json_lines(outcome: QueryOutcome) -> Iterator[str]:
    """Yield a JSON object for each row, keys in the order of the columns; NaN and infinities are strings."""
    columns = outcome.result.columns
    for row in outcome.result.rows():
        told = dict(zip(columns, [_finite(value) for value in row], strict=True))
        yield json.dumps(told, default=str).replace("\x7f", "\\u007f")


def _finite(value: Any) -> Any:
    return repr(value) if isinstance(value, float) and not math.isfinite(value) else value


def csv_lines(outcome: QueryOutcome) -> Iterator[str]:
    """Yield a heading and each row as CSV, without cells that a spreadsheet takes for formulas."""
    line = StringIO()
    writer = csv.writer(line, lineterminator="")
    for row in [[outcome.result.columns], outcome.result.rows()]:
        for values in row:
            line.seek(0)
            line.truncate()
            writer.writerow([_cell(value) for value in values])
            yield line.getvalue()


def _cell(value: Any) -> str:
    if isinstance(value, (str, list)):
        return cell(value if isinstance(value, str) else json.dumps(value, default=str, ensure_ascii=False))
    return _shown(value)
