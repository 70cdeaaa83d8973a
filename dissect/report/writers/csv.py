"""Transactions as CSV (docs/json.md): a row per item, values in full, no cell that a spreadsheet runs as a formula."""

from __future__ import annotations

import json
import math
from typing import Final

from mypy_extensions import i64

from dissect.report import words
from dissect.report.facets import facet_of
from dissect.report.words import Places
from dissect.report.writer import Writer
from dissect.report.writers.jsonl import SMALL
from dissect.s7.tables import BYTE, RETURN_CODES, USERDATA
from dissect.s7.values import Value, real_text, spelled
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
_REAL: Final = 0x08
#: One encoder for all values: to make one takes longer than to use it.
_JSON: Final = json.JSONEncoder(ensure_ascii=False, default=str)
#: A row's end where a transaction has no items: the cells between its own and those of errors and subject.
_NO_ITEM: Final = "," * 9


def quoted(text: str) -> str:
    """Return a cell as RFC 4180 writes it: in quotes where it holds a comma, a quote or a line end."""
    if "," in text or '"' in text or "\n" in text or "\r" in text:
        doubled = text.replace('"', '""')
        return f'"{doubled}"'
    return text


class CsvRows:
    """Makes rows of transactions: cells in the order of `columns`, safe for spreadsheets.

    Rows are put together from cached texts instead of by `csv`, which looks at every character of every cell again.
    """

    def __init__(self, places: Places) -> None:
        self._places: Places = places
        self._clock: Clock = Clock()
        self._ends: dict[int, str] = {}
        self._cells: dict[str, str] = {}

    def columns(self) -> list[str]:
        """Return the names of the columns."""
        if not self._places.several:
            return list(CSV_COLUMNS)
        return CSV_COLUMNS[:_FILES_AT] + FILE_COLUMNS + CSV_COLUMNS[_FILES_AT:]

    def lines(self, transaction: Transaction) -> list[str]:
        """Return the rows of a transaction, one at least: of the items of a read or write, then of the values of SCD.

        An item with tags has a row for each of them, and for the octets between them. What is in neither is the subject of a
        row of its own. No row has a line end.
        """
        own = self._own(transaction)
        lines: list[str] = []
        naming = transaction.connection.naming
        errors = transaction.errors if transaction.has_errors else []
        whole = "; ".join([_error(error) for error in errors if not error.where.startswith(_ITEM)]) if errors else ""
        for number, result in enumerate(transaction.results(), 1):
            said = _errors_of(errors, number, whole) if errors else ""
            known = naming.named(result) if naming is not None else []
            if known:
                lines += [f"{own},{number},{self._named(result, value)},{said}," for value in known]
            else:
                lines.append(f"{own},{number},{self._result(result)},{said},")
        for found in transaction.scd:
            for row in found.values:
                cells = [row.address, row.name, "", ", ".join(row.flags), _text(row.physical), row.text, row.unit, ""]
                cells += [whole, found.subject]
                lines.append(f"{own},{len(lines) + 1},{','.join([quoted(cell(text)) for text in cells])}")
        if not lines:
            about = facet_of(transaction).subject_whole(transaction)
            lines.append(f"{own}{_NO_ITEM},{quoted(cell(whole))},{quoted(cell(about))}")
        return lines

    def _own(self, transaction: Transaction) -> str:
        """Return the cells that all rows of a transaction share. Numbers and times are safe as they are."""
        facet = facet_of(transaction)
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        rosctr = str(transaction.rosctr) if transaction.rosctr <= USERDATA else ""
        latency = transaction.latency_ns
        frames = (
            f"{self._places.number(int(asked)) if asked else ''},{self._places.number(int(told)) if told else ''}"
            if self._places.several
            else f"{asked or ''},{told or ''}"
        )
        if self._places.several:
            names = [self._cell(self._places.locate(int(frame))[0]) if frame else "" for frame in (asked, told)]
            frames += f",{names[0]},{names[1]}"
        return (
            f"{transaction.number},{self._both(transaction.connection, transaction.asked_by)}"
            f",{facet.reference(transaction)},{rosctr},{facet.function_number(transaction)}"
            f",{self._cell(transaction.function_name)},{frames}"
            f",{self._clock.iso(transaction.request_ns) if asked else ''}"
            f",{self._clock.iso(transaction.response_ns) if told else ''}"
            f",{'' if latency is None else latency},{transaction.outcome_name},{transaction.reason}"
        )

    def _both(self, connection: Connection, asked_by: i64) -> str:
        """Return the connection, who asked and who answered."""
        key: i64 = connection.number * 2 + asked_by
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MAX_CACHED:
                self._ends.clear()
            ends = connection.tcp.ends
            found = ",".join(
                [str(connection.number)] + [quoted(cell(str(ends[side]))) for side in (asked_by, 1 - asked_by)]
            )
            self._ends[key] = found
        return found

    def _cell(self, text: str) -> str:
        """Return the cell of a text that comes again and again."""
        found = self._cells.get(text)
        if found is None:
            if len(self._cells) >= _MAX_CACHED:
                self._cells.clear()
            found = quoted(cell(text))
            self._cells[text] = found
        return found

    def _code(self, code: i64) -> str:
        """Return the cells of a return code, -1 for none."""
        return f"{SMALL[code]},{self._cell(RETURN_CODES.name(int(code)))}" if code >= 0 else ","

    def _result(self, result: ItemResult) -> str:
        """Return the cells of an item of a read or write, from its address to its octets."""
        item = result.item
        data = result.data
        label = self._cell(item.label) if item is not None else ""
        code = self._code(result.return_code)
        if data is None:
            return f"{label},,{code},,,,"
        if item is None or not result.decodable:
            return f"{label},,{code},,,,{data.hex()}"
        if item.transport_size == BYTE:
            value = SMALL[data[0]] if len(data) == 1 else data.hex(" ")
            return f"{label},,{code},{value},{quoted(cell(spelled(data)))},,{data.hex()}"
        size: i64 = len(data)
        singles: bool = item.transport_size == _REAL and size > 0 and size % 4 == 0
        value = _reals(data) if singles else quoted(plain_cell(result.value))
        return f"{label},,{code},{value},,,{data.hex()}"

    def _named(self, result: ItemResult, known: NamedValue) -> str:
        """Return the cells of a tag in an item, or of octets without one, from its address to its octets."""
        return (
            f"{self._cell(known.address)},{self._cell(known.name)},{self._code(result.return_code)}"
            f",{quoted(plain_cell(known.value))},{quoted(cell(known.remark))},{self._cell(known.unit)},{known.data.hex()}"
        )


def _errors_of(errors: list[TransactionError], number: int, whole: str) -> str:
    """Return the cell of the errors of an item: its own, then those of the whole transaction."""
    where = f"{_ITEM} {number}"
    mine = [_error(error) for error in errors if error.where == where]
    return quoted(cell("; ".join([text for text in [*mine, whole] if text])))


def _error(error: TransactionError) -> str:
    return f"{error.where}: {words.error_text(error)}"


def _reals(octets: bytes) -> str:
    """Return the cell of singles: a number, or several in the brackets of JSON; ``octets`` hold one at least."""
    if len(octets) == 4:
        return _real(octets)
    return f'"[{", ".join([_real(octets[at : at + 4]) for at in range(0, len(octets), 4)])}]"'


def _real(octets: bytes) -> str:
    """Return a single as `_number` writes it."""
    text = real_text(octets)
    if "e" in text or "n" in text:
        return _JSON.encode(float(text))
    return text if "." in text else f"{text}.0"


def plain_cell(value: Value) -> str:
    """Return the cell of a value, not in quotes; only text can hold what a spreadsheet would take for a formula."""
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

    def begin(self, places: Places) -> None:
        """Name packets with ``places``, and begin with the names of the columns."""
        super().begin(places)
        self._rows = CsvRows(places)
        self.lines.append(",".join(self._rows.columns()))

    def transaction(self, transaction: Transaction) -> None:
        """Add the rows of a transaction."""
        self.lines += self._rows.lines(transaction)
