"""Rows of transactions and of their items in S7comm: the bulk of every export, compiled.

A row is a tuple of the stored columns of its table in `dissect.export.tables`. What comes again and again is worked out
once: the columns of an item that a request names, the ends of a connection, the names of a function. All of these memories are
bounded and forgotten whole when they are full.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from mypy_extensions import i64

from dissect.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES
from dissect.report.facets import facet_of
from dissect.report.writers.jsonl import value_text
from dissect.s7.items import Item
from dissect.s7.tables import (
    AREA_LETTERS,
    AREAS,
    BYTE,
    NUMBERED_AREAS,
    RETURN_CODES,
    ROSCTR,
    SETUP_COMMUNICATION,
    SUCCESS,
    TRANSPORT_SIZES,
    WRITE_VAR,
)
from dissect.s7.values import Value, decode_value, spelled
from dissect.s7plus.items import WRITES
from dissect.s7plus.parameters import PlusParameters
from dissect.source.packet import SourceFile
from dissect.transactions.connection import Connection
from dissect.transactions.naming import Naming
from dissect.transactions.results import ItemResult
from dissect.transactions.transaction import OUTCOMES, PUSH, Transaction, TransactionError
from dissect.wire.text import encodable

Row = tuple[Any, ...]

#: Entries of each memory.
_MOST_KNOWN: Final = 8192
_NO_ITEM: Final[Row] = (None,) * 7
#: Return code, its name, and whether it refuses, of each code; of no answer at the end.
_CODES: Final[list[Row]] = [(code, RETURN_CODES.name(code), code != SUCCESS) for code in range(256)]
_NO_CODE: Final[Row] = (None, None, False)
_FAR: Final = 1 << 62


class Files:
    """Names the file of a packet of the run, and its number within that file."""

    def __init__(self, files: Sequence[SourceFile]) -> None:
        self._files: Sequence[SourceFile] = files
        self._count: int = 0
        self._name: str | None = None
        self._first: int = 0
        self._end: int = 0

    def locate(self, frame: int) -> tuple[str | None, int | None]:
        """Return (file, number) of the packet that is number ``frame`` of the run; (None, None) for 0, no packet."""
        if not frame:
            return None, None
        if not (self._count == len(self._files) and self._first <= frame < self._end):
            self._find(frame)
        return self._name, frame - self._first + 1

    def _find(self, frame: int) -> None:
        files = self._files
        self._count = len(files)
        self._name, self._first, self._end = None, 1, _FAR
        for file in reversed(files):
            if int(file.first_frame) <= frame:
                self._name, self._first = encodable(file.name), int(file.first_frame)
                break
            self._end = int(file.first_frame)


class TransactionRows:
    """Makes rows of transactions and items of a run over ``files``, which may grow while it goes on."""

    def __init__(self, files: Sequence[SourceFile]) -> None:
        self.files: Files = Files(files)
        self._ends: dict[int, Row] = {}
        self._items: dict[Item, Row] = {}
        self._functions: dict[Any, Row] = {}

    def ends(self, connection: Connection) -> Row:
        """Return host and port of the client, then of the server."""
        key: int = int(connection.number) * 2 + int(connection.client_side)
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= _MOST_KNOWN:
                self._ends.clear()
            client, server = connection.client, connection.server
            found = (
                client.host,
                client.port if client.port >= 0 else None,
                server.host,
                server.port if server.port >= 0 else None,
            )
            self._ends[key] = found
        return found

    def transaction(self, transaction: Transaction, item_count: int) -> Row:
        """Return the row of a transaction that has so many items."""
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        file, asked_at = self.files.locate(int(asked))
        told_file, told_at = self.files.locate(int(told))
        connection = transaction.connection
        function = self._function(transaction)
        errors = [_error(error) for error in transaction.errors] if transaction.has_errors else []
        return (
            int(transaction.number),
            int(connection.number),
            file if asked else told_file,
            asked_at,
            told_at,
            told_file,
            int(transaction.request_ns if asked else transaction.response_ns),
            int(transaction.response_ns) if told else None,
            transaction.latency_ns,
            *self.ends(connection),
            transaction.asked_by == connection.client_side,
            function[0],
            function[1],
            _reference(transaction),
            function[2],
            function[3],
            function[4],
            function[5],
            None if item_count or transaction.function == SETUP_COMMUNICATION else _about(transaction),
            OUTCOMES[transaction.outcome],
            transaction.reason or None,
            transaction.failed,
            int(transaction.error_code),
            errors,
            item_count,
            int(transaction.request_size) if asked else None,
            int(transaction.response_size) if told else None,
        )

    def _function(self, transaction: Transaction) -> Row:
        """Return protocol, ROSCTR, code, name, group and subfunction."""
        key = (transaction.parameters, int(transaction.rosctr))
        found = self._functions.get(key)
        if found is not None:
            return found
        if len(self._functions) >= _MOST_KNOWN:
            self._functions.clear()
        code = int(transaction.function)
        if transaction.is_plus or transaction.is_scd:
            name = UPPER_NAMES[S7COMM_PLUS if transaction.is_plus else SCD]
            plus = code if code >= 0 and transaction.is_plus else None
            found = (name, None, plus, transaction.function_name, None, None)
        else:
            head = transaction.parameters.userdata
            found = (
                UPPER_NAMES[S7COMM],
                ROSCTR.name(int(transaction.rosctr)),
                code if code >= 0 else None,
                transaction.function_name or None,
                int(head.group) if head is not None else None,
                int(head.subfunction) if head is not None else None,
            )
        self._functions[key] = found
        return found

    def begin(self, transaction: Transaction) -> Row:
        """Return the columns of its items from the connection to the operation."""
        connection = transaction.connection
        ends = self.ends(connection)
        asked: bool = transaction.request_frame != 0
        return (
            int(connection.number),
            int(transaction.request_ns if asked else transaction.response_ns),
            ends[2],
            ends[0],
            _operation(transaction),
        )

    def items(self, transaction: Transaction) -> list[Row]:
        """Return a row for each item of S7comm, in wire order."""
        answers = transaction.good_octets()
        if answers is not None:
            return self._read(transaction, answers)
        naming = transaction.connection.naming
        rows: list[Row] = []
        results = transaction.results()
        if not results:
            return rows
        number = int(transaction.number)
        begin = self.begin(transaction)
        plain: Row = (*begin, None)
        for index, result in enumerate(results, 1):
            item = result.item
            asked = self._asked(item) if item is not None else _NO_ITEM
            code: i64 = result.return_code
            told = _CODES[code] if 0 <= code < 256 else _NO_CODE
            if result.unchanged:
                told = (told[0], told[1], False)
            row: Row = (number, index)
            if naming is None:
                rows.append(row + plain + asked + told + _value(result))
            else:
                name, value = _named(naming, result)
                rows.append(row + begin + name + asked + told + value)
        return rows

    def _read(self, transaction: Transaction, answers: list[bytes]) -> list[Row]:
        """Return the rows of a read that was answered as asked: most rows of an export."""
        rows: list[Row] = []
        number = int(transaction.number)
        begin = self.begin(transaction)
        code = _CODES[SUCCESS]
        for index, item in enumerate(transaction.parameters.items):
            asked = self._asked(item)
            value = _decoded(item, answers[index])
            rows.append((
                number, index + 1, begin[0], begin[1], begin[2], begin[3], begin[4], None,
                asked[0], asked[1], asked[2], asked[3], asked[4], asked[5], asked[6],
                code[0], code[1], code[2], value[0], value[1], value[2],
            ))  # fmt: skip
        return rows

    def _asked(self, item: Item) -> Row:
        """Return the columns of a request item, from its area to its count."""
        known = self._items
        found = known.get(item)
        if found is None:
            if len(known) >= _MOST_KNOWN:
                known.clear()
            found = _asked(item)
            known[item] = found
        return found


def _error(error: TransactionError) -> str:
    where = f"{error.where} {error.address}" if error.address else error.where
    return encodable(f"{where}: {error.name}")


def _reference(transaction: Transaction) -> int | None:
    if not (transaction.is_plus or transaction.is_scd):
        return int(transaction.pdu_ref)
    text = facet_of(transaction).reference(transaction)
    return int(text) if text else None


def _about(transaction: Transaction) -> str | None:
    return facet_of(transaction).subject_whole(transaction) or None


def _operation(transaction: Transaction) -> str:
    """Return what a transaction does with its items, in a word."""
    if transaction.outcome == PUSH:
        return "notify"
    parameters = transaction.parameters
    if isinstance(parameters, PlusParameters):
        return "write" if int(parameters.code) in WRITES else "read"
    return "write" if transaction.function == WRITE_VAR else "read"


def _asked(item: Item) -> Row:
    """Return the columns of a request item, from its area to its count."""
    area: i64 = item.area
    kind = TRANSPORT_SIZES.name(int(item.transport_size)) if item.transport_size >= 0 else None
    known = int(item.count) if item.count >= 0 else None
    address = encodable(item.address)
    if area < 0:
        return (None, None, None, None, address, kind, known)
    letters = AREA_LETTERS.get(int(area), AREAS.name(int(area)))
    db = int(item.db) if item.db > 0 else None
    start: i64 = item.start_bit
    if start < 0:
        return (letters, db, None, None, address, kind, known)
    if int(area) in NUMBERED_AREAS:
        return (letters, db, int(start), None, address, kind, known)
    return (letters, db, int(start >> 3), int(start & 7), address, kind, known)


def _named(naming: Naming, result: ItemResult) -> tuple[Row, Row]:
    """Return the column of the names of the tags in an item, and its value: that of the tag where there is only one."""
    known = [named for named in naming.named(result) if named.name]
    if not known:
        return (None,), _value(result)
    name: Row = (", ".join([named.name for named in known]),)
    if len(known) == 1 and known[0].whole and known[0].value is not None:
        return name, _shown(known[0].value, result.data)
    return name, _value(result)


def _value(result: ItemResult) -> Row:
    """Return a value as a number, else as text, and its bytes."""
    data = result.data
    item = result.item
    if data is None or item is None:
        return (None, None, data)
    return _decoded(item, data)


def _decoded(item: Item, data: bytes) -> Row:
    """Return the value of an item as a number, else as text, and its bytes."""
    fits: bool = item.size == len(data) or item.fits(len(data))
    if item.transport_size == BYTE:
        if len(data) == 1:
            return (float(data[0]), None, data)
        return (None, (spelled(data) or None) if fits else None, data)
    return _shown(decode_value(item.transport_size, data) if fits else None, data)


def _shown(value: Value, data: bytes | None) -> Row:
    if value is None:
        return (None, None, data)
    if isinstance(value, bool):
        return (1.0 if value else 0.0, None, data)
    if isinstance(value, int):
        return (float(value), None, data)
    if isinstance(value, float):
        return (value, None, data)
    if isinstance(value, str):
        return (None, encodable(value), data)
    return (None, value_text(value), data)
