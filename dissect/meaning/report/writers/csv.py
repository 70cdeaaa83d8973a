"""Transactions as CSV (docs/json.md): a row for each item, values in full, no cell that spreadsheets run as a formula."""

from __future__ import annotations

import json
import math
from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.good_items import GoodItems, good_octets
from dissect.engine.transactions.naming import NamedValue
from dissect.engine.transactions.results import TransactionError
from dissect.engine.transactions.transaction import ANSWERED, OUTCOMES, SURE, Transaction
from dissect.meaning.report.facets import error_text, facet_of
from dissect.meaning.report.item_octets import is_usual, step_of, write_elements, write_times, write_word
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import Writer
from dissect.protocols.s7.items import Item, ItemResult
from dissect.protocols.s7.tables import BYTE, JOB, REAL, RETURN_CODES, SUCCESS, USERDATA
from dissect.protocols.s7.values import Value, decode_value, number_texts, spelled
from dissect.protocols.s7plus.items import PlusItem
from dissect.protocols.s7plus.tables import CREATE_OBJECT
from dissect.scd.wording import json_value
from dissect.wire.build import COMPILED
from dissect.wire.digits import Times, write_decimal, write_hexadecimal
from dissect.wire.text import SHORT, Clock, cell, decimal, hexadecimal

#: Columns of the transaction, the same in all its rows; with several files `FILE_COLUMNS` follow ``response_frame``.
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
    "certainty",
    "doubt",
]
FILE_COLUMNS: Final[list[str]] = ["request_file", "response_file"]
_FILES_AT: Final = 10  # index in `_COLUMNS`, after "response_frame"
#: Columns of one item, or of a transaction that has none.
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

#: Beginning of `TransactionError.where` for an error that belongs to an item.
_ITEM: Final = "item"
#: A cache with this many entries is emptied.
_MAX_CACHED: Final = 8192
#: One encoder for all values: making an encoder takes longer than using it.
_JSON: Final = json.JSONEncoder(ensure_ascii=False, default=str)
#: How the json module writes numbers that JSON cannot represent.
_NO_NUMBERS: Final[dict[str, str]] = {"nan": "NaN", "inf": "Infinity", "-inf": "-Infinity"}
#: In the row of a transaction without items: the empty cells between those of the transaction and errors, subject.
_NO_ITEM: Final = "," * 9
#: The cells after the latency of an answered transaction: without a reason, sure, and so without a doubt.
_ANSWERED: Final = f",{OUTCOMES[ANSWERED]},,{SURE},,".encode("ascii")
#: How characters that UTF-8 cannot encode are written; the same for all outputs.
_ERRORS: Final = "backslashreplace"
_COMMA: Final = 0x2C
_QUOTE: Final = 0x22
#: A quote within quotes, and JSON's null.
_DOUBLED: Final = b'""'
_NULL: Final = b"null"
_LINE_FEED: Final = 0x0A


def quoted(text: str) -> str:
    """Return a cell in the form of RFC 4180: in quotes if it contains a comma, a quote or a line end."""
    if "," in text or '"' in text or "\n" in text or "\r" in text:
        doubled = text.replace('"', '""')
        return f'"{doubled}"'
    return text


class CsvRows:
    """Makes the rows of transactions: cells in the order of `columns`, safe for spreadsheets.

    Rows are put together from cached texts. The csv module would examine every character of every cell again.
    """

    def __init__(self, places: Places) -> None:
        self._places: Places = places
        self._clock: Clock = Clock()
        self._times: Times = Times()
        self._ends: dict[int, str] = {}
        self._cells: dict[str, str] = {}
        self._good: str = self._code(SUCCESS)
        self._polled: bytes = b""  # the cells of a read between its reference and its packets
        self._begun: dict[int, bytes] = {}  # `_ends` in octets
        self._out: BytesWriter = BytesWriter()
        self._step: GoodItems = GoodItems()

    def columns(self) -> list[str]:
        """Return the names of the columns."""
        if not self._places.several:
            return list(CSV_COLUMNS)
        return CSV_COLUMNS[:_FILES_AT] + FILE_COLUMNS + CSV_COLUMNS[_FILES_AT:]

    def octets(self, transaction: Transaction) -> bytes:
        """Return the rows of a transaction (`lines`) in UTF-8, separated by line feeds."""
        if COMPILED and self._step.begin(transaction) and is_usual(transaction, self._places):
            rows = self._usual(transaction)
            if self._step.whole:
                return rows
        return "\n".join(self.lines(transaction)).encode("utf-8", _ERRORS)

    def _usual(self, transaction: Transaction) -> bytes:
        """Return the rows of an ordinary read, written straight as octets; ``_step.whole`` says whether they are complete."""
        out = self._out
        out.truncate(0)
        if len(self._polled) == 0:
            facet = facet_of(transaction)
            name = self._cell(transaction.function_name)
            self._polled = f",{JOB},{facet.function_number(transaction)},{name},".encode("utf-8", _ERRORS)
        write_decimal(out, transaction.number)
        out.append(_COMMA)
        out.write(self._both_octets(transaction.connection, transaction.asked_by))
        out.append(_COMMA)
        write_decimal(out, transaction.pdu_ref)
        out.write(self._polled)
        write_decimal(out, transaction.request_frame)
        out.append(_COMMA)
        write_decimal(out, transaction.response_frame)
        out.append(_COMMA)
        self._times.write(out, transaction.request_ns)
        out.append(_COMMA)
        self._times.write(out, transaction.response_ns)
        out.append(_COMMA)
        write_decimal(out, transaction.response_ns - transaction.request_ns)
        out.write(_ANSWERED)
        items = transaction.parameters.items
        own = out.getvalue() if len(items) > 1 else b""
        step = self._step
        while step.step():
            if step.index:
                out.append(_LINE_FEED)
                out.write(own)
            write_decimal(out, step.index + 1)
            out.append(_COMMA)
            item = items[step.index]
            row = len(out)
            if not self._write_item(out, item, step.buf, step.at, step.size):
                out.truncate(row)
                data = step.buf[step.at : step.at + step.size]
                out.write(self._item(item, self._good, data).encode("utf-8", _ERRORS))
            out.write(b",,")
        return out.getvalue()

    def _write_item(self, out: BytesWriter, item: Item, octets: bytes, at: i64, size: i64) -> bool:
        """Write the cells of `_item` without a str in between. Return False if it cannot; then part of them may be written."""
        if len(item.cell) == 0:  # quicker than the truth of bytes (mypyc)
            item.cell = f"{self._cell(item.label)},,{self._good},".encode("utf-8", _ERRORS)
        out.write(item.cell)
        if not _write_value(out, item, octets, at, size):
            return False
        out.write(b",,,")
        write_hexadecimal(out, octets, at, at + size)
        return True

    def _both_octets(self, connection: Connection, asked_by: i64) -> bytes:
        """Return `_both` as octets."""
        key: i64 = connection.number * 2 + asked_by
        found = self._begun.get(key)
        if found is None:
            if len(self._begun) >= _MAX_CACHED:
                self._begun.clear()
            found = self._both(connection, asked_by).encode("utf-8", _ERRORS)
            self._begun[key] = found
        return found

    def lines(self, transaction: Transaction) -> list[str]:
        """Return the rows of a transaction, at least one: for the items of a read or write, then for the values of SCD.

        An item with tags has a row for each tag, and for octets that no tag covers. A transaction with neither items nor values
        has one row with its subject. No row has a line end.
        """
        own = self._own(transaction)
        lines: list[str] = []
        good = good_octets(transaction) if transaction._carried is None else None
        if good:  # nearly always: then no `ItemResult` has to be made
            items = transaction.parameters.items
            return [
                f"{own},{SHORT[index + 1]},{self._item(items[index], self._good, good[index])},,"
                for index in range(len(good))
            ]
        naming = transaction.connection.naming
        errors = transaction.errors if transaction.has_errors else []
        whole = "; ".join([_error(error) for error in errors if not error.where.startswith(_ITEM)]) if errors else ""
        if transaction.is_plus:
            lines = self._plus_rows(transaction, own, errors, whole)
        for number, result in enumerate(transaction.s7_results, 1):
            said = _errors_of(errors, number, whole) if errors else ""
            known = naming.named(result) if naming is not None else []
            if known:
                lines += [f"{own},{number},{self._named(result, value)},{said}," for value in known]
            else:
                lines.append(f"{own},{number},{self._result(result)},{said},")
        for found in transaction.scd:
            for row in found.values:
                cells = [row.address, row.name, "", ", ".join(row.flags), _text(json_value(row.physical))]
                cells += [row.text, row.unit, "", whole, found.subject]
                lines.append(f"{own},{len(lines) + 1},{','.join([quoted(cell(text)) for text in cells])}")
        if not lines:
            about = facet_of(transaction).subject_whole(transaction)
            lines.append(f"{own}{_NO_ITEM},{quoted(cell(whole))},{quoted(cell(about))}")
        return lines

    def _own(self, transaction: Transaction) -> str:
        """Return the cells that all rows of a transaction share. Numbers and times need no quotes."""
        facet = facet_of(transaction)
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        asked_ns: i64 = transaction.request_ns
        told_ns: i64 = transaction.response_ns
        rosctr = SHORT[transaction.rosctr] if transaction.rosctr <= USERDATA else ""
        latency = ""
        if transaction._outcome == ANSWERED and not transaction.is_likely:
            latency = decimal(told_ns - asked_ns)
        frames = (
            f"{self._places.number(int(asked)) if asked else ''},{self._places.number(int(told)) if told else ''}"
            if self._places.several
            else f"{decimal(asked) if asked else ''},{decimal(told) if told else ''}"
        )
        if self._places.several:
            names = [self._cell(self._places.locate(int(frame))[0]) if frame else "" for frame in (asked, told)]
            frames += f",{names[0]},{names[1]}"
        return (
            f"{decimal(transaction.number)},{self._both(transaction.connection, transaction.asked_by)}"
            f",{facet.reference(transaction)},{rosctr},{facet.function_number(transaction)}"
            f",{self._cell(_function_name(transaction))},{frames}"
            f",{self._clock.iso(asked_ns) if asked else ''},{self._clock.iso(told_ns) if told else ''}"
            f",{latency},{OUTCOMES[transaction._outcome]},{transaction.reason},{transaction.certainty},{transaction.doubt}"
        )

    def _both(self, connection: Connection, asked_by: i64) -> str:
        """Return the cells for the connection, the sender of the request and the sender of the answer."""
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
        """Return the cell of a text that repeats, from a cache."""
        found = self._cells.get(text)
        if found is None:
            if len(self._cells) >= _MAX_CACHED:
                self._cells.clear()
            found = quoted(cell(text))
            self._cells[text] = found
        return found

    def _code(self, code: i64) -> str:
        """Return the cells of a return code, -1 for none."""
        return f"{SHORT[code]},{self._cell(RETURN_CODES.name(int(code)))}" if code >= 0 else ","

    def _result(self, result: ItemResult) -> str:
        """Return the cells of an item of a read or write, from its address to its octets."""
        item = result.item
        data = result.data
        code = self._code(result.return_code)
        if data is None:
            return f"{self._cell(item.label) if item is not None else ''},,{code},,,,"
        return self._item(item, code, data) if item is not None else f",,{code},,,,{data.hex()}"

    def _item(self, item: Item, code: str, data: bytes) -> str:
        """Return the cells of an item with octets, from its address to its octets; ``code`` has those of its return code."""
        label = self._cell(item.label)
        size: i64 = len(data)
        if item.size != size and not item.fits(size):
            return f"{label},,{code},,,,{data.hex()}"
        if item.transport_size == BYTE:
            value = SHORT[data[0]] if size == 1 else data.hex(" ")
            text = spelled(data)
            return f"{label},,{code},{value},{quoted(cell(text)) if text else ''},,{hexadecimal(data)}"
        texts = number_texts(item.transport_size, data, size)
        if not texts:
            value = _any_value(item, data)
        else:
            if item.transport_size == REAL:
                texts = [_NO_NUMBERS.get(text, text) for text in texts]
            value = texts[0] if len(texts) == 1 else f'"[{", ".join(texts)}]"'
        return f"{label},,{code},{value},,,{hexadecimal(data)}"

    def _plus_rows(self, transaction: Transaction, own: str, errors: list[TransactionError], whole: str) -> list[str]:
        """Return the rows of S7comm-plus items, with a subject too if the request creates a subscription or another object."""
        items = transaction.plus_results
        about = ""
        if items and transaction.function == CREATE_OBJECT:
            about = quoted(cell(facet_of(transaction).subject_whole(transaction)))
        return [
            f"{own},{item.number},{self._plus(item)},{_errors_of(errors, item.number, whole)},{about}" for item in items
        ]

    def _plus(self, item: PlusItem) -> str:
        """Return the cells of an item of S7comm-plus, from its address to its octets."""
        known = item.address is not None or item.found is not None
        address = quoted(cell(item.label)) if known else ""
        refused = item.return_code > 0
        code = f"{item.return_code},{self._cell(item.codes.name(item.return_code))}" if refused else ","
        if not item.return_code:
            code = self._good
        value = quoted(json_cell(item.json_value))
        return (
            f"{address},,{code},{value},{quoted(cell(item.note))},,{item.data.hex() if item.data is not None else ''}"
        )

    def _named(self, result: ItemResult, known: NamedValue) -> str:
        """Return the cells of a tag in an item, or of octets without one, from its address to its octets."""
        return (
            f"{self._cell(known.address)},{self._cell(known.name)},{self._code(result.return_code)}"
            f",{quoted(plain_cell(known.value))},{quoted(cell(known.remark))},{self._cell(known.unit)},{known.data.hex()}"
        )


def _write_value(out: BytesWriter, item: Item, octets: bytes, at: i64, size: i64) -> bool:
    """Write the cell of a value without ``value_text``. Return False if it cannot; then part of it may be written."""
    step = step_of(item, octets, at, size)
    if step == 0:
        return write_word(out, item, octets, at, size, b"", size) or _write_others(out, item, octets, at, size)
    several = size > step > 1
    if several:
        out.write(b'"[')
    if not write_elements(out, item.transport_size, step, octets, at, at + size, True):
        return False
    if several:
        out.write(b']"')
    return True


def _write_others(out: BytesWriter, item: Item, octets: bytes, at: i64, size: i64) -> bool:
    """Write the cell of an array of times or, in the slow way, of another value; False for bytes and data that do not fit."""
    if item.transport_size == BYTE or (item.size != size and not item.fits(size)):
        return False
    begin = len(out)
    out.append(_QUOTE)
    if write_times(out, item, octets, at, size, _DOUBLED, _NULL):
        out.append(_QUOTE)
    else:
        out.truncate(begin)
        out.write(_any_value(item, octets[at : at + size]).encode("utf-8", _ERRORS))
    return True


def _any_value(item: Item, data: bytes) -> str:
    """Return the cell of a value of any type, in the slow way."""
    return quoted(plain_cell(decode_value(item.transport_size, data)))


def _errors_of(errors: list[TransactionError], number: int, whole: str) -> str:
    """Return the cell of the errors of an item: its own, then those of the whole transaction."""
    where = f"{_ITEM} {number}"
    mine = [_error(error) for error in errors if error.where == where]
    return quoted(cell("; ".join([text for text in [*mine, whole] if text])))


def _error(error: TransactionError) -> str:
    return f"{error.where}: {error_text(error)}"


def plain_cell(value: Value) -> str:
    """Return the cell of a value, not quoted. Only text needs `cell`: nothing else can look like a formula."""
    if value is None:
        return ""
    if isinstance(value, str):
        return cell(value)
    if isinstance(value, list):
        if all([isinstance(element, (int, float)) for element in value]):
            return f"[{', '.join([_number(element) for element in value])}]"
        return cell(_JSON.encode(value))
    return _number(value)


def json_cell(value: object) -> str:
    """Return the cell of a value in the form of JSON outputs, not quoted; a structure as JSON."""
    if value is None or isinstance(value, (str, list, bool, int, float)):
        return plain_cell(value)
    return cell(_JSON.encode(value))


def _number(value: Value) -> str:
    """Return a number or truth value as JSON writes it."""
    if value is True:
        return "true"
    if value is False:
        return "false"
    if isinstance(value, float) and math.isfinite(value):
        return repr(value)  # the same text as the encoder's, in a fraction of the time
    return str(value) if isinstance(value, int) else _JSON.encode(value)


def _function_name(transaction: Transaction) -> str:
    """Return the name of its function, empty for an answer of S7comm without parameters."""
    none: bool = transaction.function < 0 and transaction.rosctr <= USERDATA
    return "" if none else transaction.function_name


def _text(value: object) -> str:
    """Return a value in full: text unchanged, everything else as JSON."""
    return value if isinstance(value, str) else _JSON.encode(value)


class CsvWriter(Writer):
    """Writes the heading, then a row for each item of each transaction."""

    def __init__(self, clock: Clock | None = None, verbose: bool = False) -> None:
        super().__init__(clock, verbose)
        self.joint = b","
        self._rows: CsvRows = CsvRows(self.places)

    def begin(self, places: Places) -> None:
        """Take ``places`` for the names of packets, and write the heading."""
        super().begin(places)
        self._rows = CsvRows(places)
        self.lines.append(",".join(self._rows.columns()).encode("ascii"))

    def transaction(self, transaction: Transaction) -> None:
        """Add the rows of a transaction."""
        self.lines.append(self._rows.octets(transaction))
