"""Transactions as CSV (docs/json.md): a row per item, values in full, no cell that a spreadsheet runs as a formula."""

from __future__ import annotations

import csv
import json
import math
from typing import Any, Final

from mypy_extensions import i64

from dissect.report import words
from dissect.report.facets import facet_of
from dissect.report.words import Places
from dissect.report.writer import Writer
from dissect.report.writers.jsonl import SMALL
from dissect.s7.tables import BYTE, RETURN_CODES, USERDATA
from dissect.s7.values import Value, spelled
from dissect.transactions.connection import Connection
from dissect.transactions.naming import NamedValue
from dissect.transactions.results import ItemResult
from dissect.transactions.transaction import Transaction, TransactionError
from dissect.wire.text import Clock, cell

#: Of the transaction, the same in all of its rows; with several files `FILE_COLUMNS` stand behind ``response_frame``.
_COLUMNS: Final[list[str]] = [
    "number",
    "connection",
    "asked_by",
    "answered_by",
    "pdu_ref",
    "rosctr",
    "function",
    "function_name",
    "request_frame",
    "response_frame",
    "request_time",
    "response_time",
    "latency_ns",
    "outcome",
    "reason",
]
FILE_COLUMNS: Final[list[str]] = ["request_file", "response_file"]
_FILES_AT: Final = 10  # in `_COLUMNS`, behind "response_frame"
#: Of one item, or of a transaction that has none.
_ITEM_COLUMNS: Final[list[str]] = [
    "item",
    "address",
    "name",
    "return_code",
    "result",
    "value",
    "value_text",
    "unit",
    "octets",
    "errors",
    "subject",
]
CSV_COLUMNS: Final[list[str]] = _COLUMNS + _ITEM_COLUMNS

#: Where an error is that belongs to an item.
_ITEM: Final = "item"
#: Cached cells are forgotten together when there are this many.
_MAX_CACHED: Final = 8192
#: One encoder for all values: to make one takes longer than to use it.
_JSON: Final = json.JSONEncoder(ensure_ascii=False, default=str)


class CsvRows:
    """Makes rows of transactions: cells in the order of `columns`, safe for spreadsheets."""

    def __init__(self, places: Places) -> None:
        self._places: Places = places
        self._clock: Clock = Clock()
        self._ends: dict[int, list[str]] = {}
        self._cells: dict[str, str] = {}

    def columns(self) -> list[str]:
        """Return the names of the columns."""
        if not self._places.several:
            return list(CSV_COLUMNS)
        return CSV_COLUMNS[:_FILES_AT] + FILE_COLUMNS + CSV_COLUMNS[_FILES_AT:]

    def rows(self, transaction: Transaction) -> list[list[str]]:
        """Return the rows of a transaction, one at least: of the items of a read or write, then of the values of SCD.

        An item with tags has a row for each of them, and for the octets between them. What is in neither is the subject of a
        row of its own.
        """
        own = self._own(transaction)
        rows: list[list[str]] = []
        results = transaction.results()
        naming = transaction.connection.naming
        errors = transaction.errors
        whole = "; ".join([_error(error) for error in errors if not error.where.startswith(_ITEM)]) if errors else ""
        for index, result in enumerate(results):
            said = _errors_of(errors, index + 1, whole) if errors else ""
            known = naming.named(result) if naming is not None else []
            rows += [own + self._named(str(index + 1), result, value, said) for value in known]
            if known:
                continue
            rows.append(own + self._result(str(index + 1), result, said))
        for found in transaction.scd:
            for row in found.values:
                rows.append(
                    [
                        *own,
                        str(len(rows) + 1),
                        cell(row.address),
                        cell(row.name),
                        "",
                        cell(", ".join(row.flags)),
                        cell(_text(row.physical)),
                        cell(row.text),
                        cell(row.unit),
                        "",
                        cell(whole),
                        cell(found.subject),
                    ]
                )
        if not rows:
            about = facet_of(transaction).subject_whole(transaction)
            rows.append([*own, "", "", "", "", "", "", "", "", "", cell(whole), cell(about)])
        return rows

    def _own(self, transaction: Transaction) -> list[str]:
        """Return the cells that all rows of a transaction share. Numbers and times are safe as they are."""
        facet = facet_of(transaction)
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        several = self._places.several
        asked_by, answered_by = self._both(transaction.connection, transaction.asked_by)
        latency = transaction.latency_ns
        cells = [
            str(transaction.number),
            str(transaction.connection.number),
            asked_by,
            answered_by,
            facet.reference(transaction),
            str(transaction.rosctr) if transaction.rosctr <= USERDATA else "",
            facet.function_number(transaction),
            self._cell(transaction.function_name),
            str(self._places.number(int(asked))) if asked else "",
            str(self._places.number(int(told))) if told else "",
        ]
        if several:
            cells.append(self._cell(self._places.locate(int(asked))[0]) if asked else "")
            cells.append(self._cell(self._places.locate(int(told))[0]) if told else "")
        cells.append(self._clock.iso(transaction.request_ns) if asked else "")
        cells.append(self._clock.iso(transaction.response_ns) if told else "")
        cells.append(str(latency) if latency is not None else "")
        cells.append(transaction.outcome_name)
        cells.append(transaction.reason)
        return cells

    def _both(self, connection: Connection, asked_by: i64) -> list[str]:
        """Return who asked and who answered."""
        key: i64 = connection.number * 2 + asked_by
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MAX_CACHED:
                self._ends.clear()
            ends = connection.tcp.ends
            found = [cell(str(ends[asked_by])), cell(str(ends[1 - asked_by]))]
            self._ends[key] = found
        return found

    def _cell(self, text: str) -> str:
        """Return the cell of a text that comes again and again."""
        found = self._cells.get(text)
        if found is None:
            if len(self._cells) >= _MAX_CACHED:
                self._cells.clear()
            found = cell(text)
            self._cells[text] = found
        return found

    def _result(self, number: str, result: ItemResult, errors: str) -> list[str]:
        """Return the cells of an item of a read or write."""
        item = result.item
        code: i64 = result.return_code
        data = result.data
        return [
            number,
            self._cell(item.label) if item is not None else "",
            "",
            SMALL[code] if code >= 0 else "",
            self._cell(RETURN_CODES.name(int(code))) if code >= 0 else "",
            _value_cell(result),
            _text_cell(result),
            "",
            data.hex() if data is not None else "",
            cell(errors) if errors else "",
            "",
        ]

    def _named(self, number: str, result: ItemResult, known: NamedValue, errors: str) -> list[str]:
        """Return the cells of a tag in an item, or of octets without one."""
        code: i64 = result.return_code
        return [
            number,
            self._cell(known.address),
            self._cell(known.name),
            SMALL[code] if code >= 0 else "",
            self._cell(RETURN_CODES.name(int(code))) if code >= 0 else "",
            plain_cell(known.value),
            cell(known.remark),
            self._cell(known.unit),
            known.data.hex(),
            cell(errors) if errors else "",
            "",
        ]


def _errors_of(errors: list[TransactionError], number: int, whole: str) -> str:
    where = f"{_ITEM} {number}"
    mine = [_error(error) for error in errors if error.where == where]
    return "; ".join([text for text in [*mine, whole] if text])


def _error(error: TransactionError) -> str:
    return f"{error.where}: {words.error_text(error)}"


def _value_cell(result: ItemResult) -> str:
    """Return the cell of a value; only text can hold what a spreadsheet would take for a formula."""
    item = result.item
    data = result.data
    if item is not None and data and item.transport_size == BYTE and result.decodable:
        return SMALL[data[0]] if len(data) == 1 else data.hex(" ")
    return plain_cell(result.value)


def _text_cell(result: ItemResult) -> str:
    """Return the cell of the text that an array of bytes spells."""
    item = result.item
    data = result.data
    if item is None or data is None or item.transport_size != BYTE or not result.decodable:
        return ""
    return cell(spelled(data))


def plain_cell(value: Value) -> str:
    """Return the cell of a decoded value."""
    if value is None:
        return ""
    if isinstance(value, str):
        return cell(value)
    if isinstance(value, list):
        if all([isinstance(element, (int, float)) for element in value]):
            return f"[{', '.join([_number(element) for element in value])}]"
        return cell(_JSON.encode(value))
    return _number(value)


def _number(value: Value) -> str:
    """Return a number or truth value as JSON writes it."""
    if value is True:
        return "true"
    if value is False:
        return "false"
    if isinstance(value, float) and math.isfinite(value):
        return repr(value)  # what the encoder does, in a fraction of the time
    return str(value) if isinstance(value, int) else _JSON.encode(value)


def _text(value: object) -> str:
    """Return a value whole: text as it is, everything else as JSON writes it."""
    return value if isinstance(value, str) else _JSON.encode(value)


class CsvWriter(Writer):
    """Writes the names of the columns, then a row for each item of each transaction."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self._rows: CsvRows = CsvRows(self.places)
        self._csv: Any = csv.writer(_Sink(self), lineterminator="")

    def begin(self, places: Places) -> None:
        """Name packets with ``places``, and begin with the names of the columns."""
        super().begin(places)
        self._rows = CsvRows(places)
        self._csv.writerow(self._rows.columns())

    def transaction(self, transaction: Transaction) -> None:
        """Add the rows of a transaction."""
        self._csv.writerows(self._rows.rows(transaction))


class _Sink:
    """The file of `csv`, which writes a row at once."""

    def __init__(self, writer: CsvWriter) -> None:
        self._writer: CsvWriter = writer

    def write(self, line: str) -> None:
        """Take a row."""
        self._writer.lines.append(line)
