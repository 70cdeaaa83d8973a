"""Transactions as CSV (docs/json.md): a row for each item, values whole, cells that a spreadsheet takes as they are."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Iterator
from typing import Final, NamedTuple

from dissect.engine.observer import Observer
from dissect.report import words
from dissect.report.jsonl import Choice
from dissect.report.lines import reference
from dissect.report.places import Places
from dissect.s7.tables import RETURN_CODES, USERDATA
from dissect.transactions.results import ItemResult
from dissect.transactions.transaction import ITEM, Transaction, TransactionError
from dissect.wire.clock import Clock
from dissect.wire.text import cell

#: Of the transaction, the same in all of its rows; with several files `FILE_COLUMNS` stand behind ``response_frame``.
_COLUMNS: Final = [
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
FILE_COLUMNS: Final = ["request_file", "response_file"]
_FILES_AT: Final = _COLUMNS.index("response_frame") + 1


class _Item(NamedTuple):
    """What a row says of one item, or of a transaction that has none."""

    item: str = ""
    address: str = ""
    name: str = ""
    return_code: str = ""
    result: str = ""
    value: str = ""
    value_text: str = ""
    unit: str = ""
    octets: str = ""
    errors: str = ""
    subject: str = ""


CSV_COLUMNS: Final = [*_COLUMNS, *_Item._fields]


class CsvRows(Observer):
    """Collects transactions as lines of CSV."""

    def __init__(self, choose: Choice | None = None) -> None:
        super().__init__()
        self._choose = choose
        self._clock = Clock()
        self._places = Places([], False)
        self._lines: list[str] = []

    def begin(self, places: Places) -> None:
        """Name packets with ``places``, and begin with the names of the columns."""
        self._places = places
        self._lines.append(_line(csv_columns(places)))

    def transaction(self, transaction: Transaction) -> None:
        """Add the rows of a transaction."""
        if self._choose is None or self._choose(transaction):
            self._lines += [_line(cells) for cells in csv_rows(transaction, self._clock, self._places)]

    def take(self) -> list[str]:
        """Return the lines collected since the last call."""
        lines = self._lines
        self._lines = []
        return lines


def _line(cells: list[str]) -> str:
    buffer = io.StringIO()
    csv.writer(buffer, lineterminator="").writerow(cells)
    return buffer.getvalue()


def csv_columns(places: Places) -> list[str]:
    """Return the names of the columns."""
    return _with_files(CSV_COLUMNS, FILE_COLUMNS) if places.several else list(CSV_COLUMNS)


def csv_rows(transaction: Transaction, clock: Clock, places: Places) -> Iterator[list[str]]:
    """Yield the rows of a transaction, one at least, as cells in the order of `csv_columns`, safe for spreadsheets."""
    own = _own(transaction, clock)
    asked, told = int(transaction.request_frame), int(transaction.response_frame)
    own[8:10] = [str(places.number(frame)) if frame else "" for frame in (asked, told)]
    if places.several:
        own = _with_files(own, [places.locate(frame)[0] if frame else "" for frame in (asked, told)])
    safe = [cell(text) for text in own]
    for item in _items(transaction):
        yield [*safe, *[cell(text) for text in item]]


def _own(transaction: Transaction, clock: Clock) -> list[str]:
    ends = transaction.connection.tcp.ends
    latency = transaction.latency_ns
    return [
        str(transaction.number),
        str(transaction.connection.number),
        str(ends[transaction.asked_by]),
        str(ends[1 - transaction.asked_by]),
        reference(transaction),
        str(transaction.rosctr) if transaction.rosctr <= USERDATA else "",
        str(transaction.function) if transaction.function >= 0 and not transaction.is_scd else "",
        transaction.function_name,
        "",
        "",
        clock.iso(transaction.request_ns) if transaction.request_frame else "",
        clock.iso(transaction.response_ns) if transaction.response_frame else "",
        str(latency) if latency is not None else "",
        transaction.outcome_name,
        transaction.reason,
    ]


def _with_files(values: list[str], names: list[str]) -> list[str]:
    return [*values[:_FILES_AT], *names, *values[_FILES_AT:]]


def _items(transaction: Transaction) -> Iterator[_Item]:
    """Yield the items of a read or write, then the values of SCD; what is in neither is the subject of a row of its own."""
    results = transaction.results()
    whole = "; ".join([_error(error) for error in transaction.errors if error.part != ITEM])
    for number, result in enumerate(results, 1):
        yield _result(number, result, _errors_of(transaction, number, whole))
    at = len(results)
    for found in transaction.scd:
        for row in found.values:
            at += 1
            yield _Item(
                item=str(at),
                address=row.address,
                name=row.name,
                result=", ".join(row.flags),
                value=_text(row.physical),
                value_text=row.text,
                unit=row.unit,
                errors=whole,
                subject=found.subject,
            )
    if not at:
        yield _Item(errors=whole, subject=words.subject_whole(transaction))


def _result(number: int, result: ItemResult, errors: str) -> _Item:
    item = result.item
    answered = result.return_code >= 0
    decoded = result.value
    return _Item(
        item=str(number),
        address=item.label if item is not None else "",
        return_code=str(result.return_code) if answered else "",
        result=RETURN_CODES.name(result.return_code) if answered else "",
        value=_text(decoded) if decoded is not None else "",
        octets=result.data.hex() if result.data is not None else "",
        errors=errors,
    )


def _errors_of(transaction: Transaction, number: int, whole: str) -> str:
    mine = [_error(error) for error in transaction.errors if error.part == ITEM and error.item == number]
    return "; ".join([text for text in (*mine, whole) if text])


def _error(error: TransactionError) -> str:
    return f"{error.where}: {words.error_text(error)}"


def _text(value: object) -> str:
    """Return a value whole: text as it is, everything else as JSON writes it."""
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, default=str)
