"""Rows of transactions; with the items (`dissect.output.export.item_columns`) they are the bulk of every export. Compiled.

Columns that repeat are made once and kept once: the ends of a connection, the names of a function. A row has only an index into
them (`Shared`). All these memories are bounded.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.results import TransactionError
from dissect.engine.transactions.transaction import OUTCOMES, Transaction
from dissect.meaning.report.facets import facet_of
from dissect.packets.source.packet import SourceFile
from dissect.protocols.iso.upper import S7COMM, S7COMM_PLUS, SCD, UPPER_NAMES
from dissect.protocols.s7.tables import ROSCTR, SETUP_COMMUNICATION
from dissect.wire.text import encodable

Row = tuple[Any, ...]

#: Greatest number of entries of each memory.
MOST_KNOWN: Final = 8192
_FAR: Final = 1 << 62

#: The columns that `TransactionRows.own`, `ends`, `state` and `function` return.
OWN: Final = (
    "transaction",
    "connection",
    "request_frame",
    "response_frame",
    "ts_ns",
    "response_ns",
    "latency_ns",
    "pdu_ref",
    "about",
    "errors",
    "item_count",
    "request_bytes",
    "response_bytes",
)
ENDS: Final = ("client_host", "client_port", "server_host", "server_port")
STATE: Final = (
    "file",
    "response_file",
    "from_client",
    "outcome",
    "reason",
    "certainty",
    "doubt",
    "failed",
    "error_code",
)
FUNCTION: Final = ("protocol", "rosctr", "function", "function_name", "userdata_group", "subfunction")


class Shared:
    """Rows that repeat, each kept once in ``rows``; others refer to a row by its index there."""

    def __init__(self, first: list[Row]) -> None:
        self._first: list[Row] = first
        self.rows: list[Row] = list(first)
        self._known: dict[Row, int] = {row: at for at, row in enumerate(first)}

    def at(self, row: Row) -> int:
        """Return the index of a row in ``rows``; add the row if it is new."""
        known = self._known
        found = known.get(row)
        if found is None:
            found = known[row] = len(self.rows)
            self.rows.append(row)
        return found

    def bounded(self) -> bool:
        """Begin a new list if there are too many rows; return whether that was done."""
        if len(self.rows) < len(self._first) + MOST_KNOWN:
            return False
        self.rows = list(self._first)
        self._known = {row: at for at, row in enumerate(self._first)}
        return True


class Files:
    """Finds the file of a packet of the run, and its number in that file."""

    def __init__(self, files: Sequence[SourceFile]) -> None:
        self._files: Sequence[SourceFile] = files
        self._count: i64 = 0
        self._name: str | None = None
        self._first: i64 = 0
        self._end: i64 = 0

    def locate(self, frame: int) -> tuple[str | None, int | None]:
        """Return (file, number in it) of packet ``frame`` of the run; (None, None) for 0, which means no packet."""
        return self.name(frame), self.number(frame)

    def name(self, frame: i64) -> str | None:
        """Return the name of the file of packet ``frame`` of the run, None for 0."""
        if not frame:
            return None
        if self._count != len(self._files) or frame < self._first or frame >= self._end:
            self._find(frame)
        return self._name

    def number(self, frame: i64) -> int | None:
        """Return the number of packet ``frame`` of the run in its file, None for 0."""
        if not frame:
            return None
        if self._count != len(self._files) or frame < self._first or frame >= self._end:
            self._find(frame)
        return frame - self._first + 1

    def _find(self, frame: i64) -> None:
        files = self._files
        self._count = len(files)
        self._name, self._first, self._end = None, 1, _FAR
        for file in reversed(files):
            if int(file.first_frame) <= frame:
                self._name, self._first = encodable(file.name), int(file.first_frame)
                break
            self._end = int(file.first_frame)


#: The column of `Packets.files`.
FILE: Final = ("file",)


class Packets:
    """Collects packets: ``files`` are names of files, ``files_at`` the index there of each packet, ``frames`` its number."""

    def __init__(self, files: Files) -> None:
        self._files: Files = files
        self._name: str | None = None  # of the file of the latest packet, and its index
        self._at: int = -1
        self.files: Shared = Shared([])
        self.files_at: list[int] = []
        self.frames: list[int] = []

    def add(self, frame: i64) -> None:
        """Add packet ``frame`` of the run, which is not 0."""
        name = self._files.name(frame)
        if name is not self._name or self._at < 0:
            self._name = name
            self._at = self.files.at((name,))
        self.files_at.append(self._at)
        self.frames.append(self._files.number(frame) or 0)

    def clear(self) -> None:
        """Begin new lists; the old ones belong to the code that took them."""
        self.files_at = []
        self.frames = []
        if self.files.bounded():
            self._at = -1


class TransactionRows:
    """Makes the columns of transactions; ``files`` are those of the run, to which more may be added while it runs."""

    def __init__(self, files: Sequence[SourceFile]) -> None:
        self.files: Files = Files(files)
        self._ends: dict[int, Row] = {}

    def ends(self, connection: Connection) -> Row:
        """Return host and port of the client, then of the server."""
        key: int = directed(connection)
        found = self._ends.get(key)
        if found is None:
            if len(self._ends) >= MOST_KNOWN:
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

    def own(self, transaction: Transaction, item_count: int) -> Row:
        """Return the columns `OWN` of a transaction with ``item_count`` items."""
        asked: i64 = transaction.request_frame
        told: i64 = transaction.response_frame
        connection = transaction.connection
        return (
            int(transaction.number),
            int(connection.number),
            self.files.number(asked),
            self.files.number(told),
            int(transaction.request_ns if asked else transaction.response_ns),
            int(transaction.response_ns) if told else None,
            transaction.latency_ns,
            _reference(transaction),
            None if item_count or transaction.function == SETUP_COMMUNICATION else _about(transaction),
            [_error(error) for error in transaction.errors] if transaction.has_errors else [],
            item_count,
            int(transaction.request_size) if asked else None,
            int(transaction.response_size) if told else None,
        )

    def state(self, transaction: Transaction) -> Row:
        """Return the columns `STATE` of a transaction."""
        told_file = self.files.name(transaction.response_frame)
        return (
            self.files.name(transaction.request_frame) if transaction.request_frame else told_file,
            told_file,
            transaction.asked_by == transaction.connection.client_side,
            OUTCOMES[transaction._outcome],
            transaction.reason or None,
            transaction.certainty or None,
            transaction.doubt or None,
            transaction.failed,
            int(transaction.error_code),
        )

    def function(self, transaction: Transaction) -> Row:
        """Return the columns `FUNCTION` of a transaction."""
        code = int(transaction.function)
        if transaction.is_plus or transaction.is_scd:
            name = UPPER_NAMES[S7COMM_PLUS if transaction.is_plus else SCD]
            plus = code if code >= 0 and transaction.is_plus else None
            return (name, None, plus, transaction.function_name, None, None)
        head = transaction.parameters.userdata
        return (
            UPPER_NAMES[S7COMM],
            ROSCTR.name(int(transaction.rosctr)),
            code if code >= 0 else None,
            transaction.function_name if code >= 0 else None,
            int(head.group) if head is not None else None,
            int(head.subfunction) if head is not None else None,
        )

    def row(self, transaction: Transaction, item_count: int) -> dict[str, Any]:
        """Return the columns of a transaction by their names."""
        row: dict[str, Any] = dict(zip(OWN, self.own(transaction, item_count), strict=True))
        row.update(zip(ENDS, self.ends(transaction.connection), strict=True))
        row.update(zip(STATE, self.state(transaction), strict=True))
        row.update(zip(FUNCTION, self.function(transaction), strict=True))
        return row


class TransactionColumns:
    """Collects transactions: the columns `OWN` of each, and the indexes of its ends, function and state (`Shared`)."""

    def __init__(self, rows: TransactionRows) -> None:
        self._rows: TransactionRows = rows
        self.own: list[Row] = []
        self.ends: Shared = Shared([])
        self.ends_at: list[int] = []
        self.functions: Shared = Shared([])
        self.functions_at: list[int] = []
        self.states: Shared = Shared([])
        self.states_at: list[int] = []
        self._function_of: dict[Any, int] = {}
        self._ends_of: dict[int, int] = {}

    def add(self, transaction: Transaction, item_count: int) -> int:
        """Add a transaction with ``item_count`` items; return the new number of transactions."""
        rows = self._rows
        self.own.append(rows.own(transaction, item_count))
        self.ends_at.append(self._ends(transaction.connection))
        self.states_at.append(self.states.at(rows.state(transaction)))
        key = (transaction.parameters, int(transaction.rosctr))
        known = self._function_of
        found = known.get(key)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            found = known[key] = self.functions.at(rows.function(transaction))
        self.functions_at.append(found)
        return len(self.own)

    def _ends(self, connection: Connection) -> int:
        """Return the index of the ends of a connection."""
        key: int = directed(connection)
        known = self._ends_of
        found = known.get(key)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            found = known[key] = self.ends.at(self._rows.ends(connection))
        return found

    def clear(self) -> None:
        """Begin new lists; the old ones belong to the code that took them."""
        self.own = []
        self.ends_at = []
        self.functions_at = []
        self.states_at = []
        if self.ends.bounded():
            self._ends_of = {}
        self.states.bounded()
        if self.functions.bounded():
            self._function_of = {}


def directed(connection: Connection) -> int:
    """Return a number for a connection and its client side, which may become known only later."""
    return int(connection.number) * 2 + int(connection.client_side)


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
