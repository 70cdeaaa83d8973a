"""The table of items, collected by column, compiled: it has most rows of an export, so no tuple is made for each row.

Most items repeat, with other values. The columns for a request item, for a return code, and for the two ends are stored once;
each row only has an index into these. Columns that all items of a transaction share are stored once for the transaction, with
the row at which its items end.
"""

from __future__ import annotations

from array import array
from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.good_items import good_octets
from dissect.engine.transactions.naming import Naming
from dissect.engine.transactions.transaction import ANSWERED, CERTAINTIES, PUSH, Transaction
from dissect.meaning.report.item_json import decoded_json
from dissect.output.export.transaction_rows import (
    MOST_KNOWN,
    Row,
    Shared,
    TransactionColumns,
    TransactionRows,
    directed,
)
from dissect.protocols.s7.items import Item, ItemResult
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.singles import real
from dissect.protocols.s7.tables import (
    AREA_LETTERS,
    AREAS,
    BIT,
    BYTE,
    INT,
    NUMBERED_AREAS,
    REAL,
    RETURN_CODES,
    SUCCESS,
    TRANSPORT_SIZES,
    WORD,
    WRITE_VAR,
)
from dissect.protocols.s7.values import Value, decode_value, number_texts, spelled
from dissect.protocols.s7plus.items import WRITES
from dissect.protocols.s7plus.parameters import PLUS, PlusParameters
from dissect.wire.octets import u16
from dissect.wire.text import encodable

#: Groups of columns: `BEGIN` and `ROUTE` are shared by the items of a transaction, and those of `ROUTE` repeat; then the
#: columns of the request item, and those of the return code.
BEGIN: Final = ("transaction", "ts_ns", "request_frame", "response_frame")
ROUTE: Final = ("connection", "server_host", "client_host", "operation", "certainty")
ASKED: Final = ("area", "db", "byte", "bit", "address", "type", "count")
CODE: Final = ("return_code", "return_name", "refused")

_NO_ITEM: Final[Row] = (None,) * len(ASKED)
#: Return code, its name, and whether it means a refusal, for each code; and the same for no answer.
_CODES: Final[list[Row]] = [(code, RETURN_CODES.name(code), code != SUCCESS) for code in range(256)]
_NO_CODE: Final[Row] = (None, None, False)
_NO_CODE_AT: Final = 256
#: The same for an item without a code, in an answer that refuses the whole request.
_WHOLE: Final[Row] = (None, None, True)
_WHOLE_AT: Final = 257
#: Transport sizes whose elements have two bytes.
_SHORT: Final = frozenset((WORD, INT))
#: By number of items of a request: the numbers of the items, and their return codes without errors.
_NUMBERS: Final[list[array[int]]] = [array("q", range(1, count + 1)) for count in range(256)]
_GOOD: Final[list[array[int]]] = [array("i", [SUCCESS] * count) for count in range(256)]
#: Up to this, a floating-point number represents every integer exactly.
_MOST_EXACT: Final = 2**53
_NO_NAME: Final[list[str | None]] = [None]
#: The operation of a transaction on its items: an index into `_OPERATIONS`.
_READ: Final = 0
_WRITE: Final = 1
_NOTIFY: Final = 2
_OPERATIONS: Final[list[str]] = ["read", "write", "notify"]
#: The possible values of `Transaction.certainty`.
_CERTAIN: Final[list[str]] = ["", *CERTAINTIES]


class ItemColumns:
    """Collects the items of transactions in columns.

    A column has an entry for each item; ``…_at`` has an index into a list of shared rows instead. `begins` and ``routes_at``
    have an entry for each transaction, and ``ends`` the row after its last item. ``others`` returns the items of other
    protocols: for each its name, the columns `ASKED` and `CODE`, value, text, bytes, and its own number if it has one. The
    columns are `full` with ``most`` items, or with items from ``most_octets`` octets of PDUs.
    """

    def __init__(
        self, rows: TransactionRows, others: Callable[[Transaction], list[Row]], most: int, most_octets: int
    ) -> None:
        self._rows: TransactionRows = rows
        self._others: Callable[[Transaction], list[Row]] = others
        self._most: i64 = most
        self._most_octets: i64 = most_octets
        self._octets: i64 = 0
        self.begins: list[Row] = []
        self.routes: Shared = Shared([])
        self.routes_at: list[int] = []
        self.ends: list[int] = []
        self.numbers: array[int] = array("q")
        self._names: list[str | None] = []
        self._spelled: list[str | None] = []
        self.asked: Shared = Shared([_NO_ITEM])
        self.asked_at: array[int] = array("i")
        self.codes: Shared = Shared([*_CODES, _NO_CODE, _WHOLE])
        self.codes_at: array[int] = array("i")
        self.values: list[float | None] = []
        self.texts: list[str | None] = []
        self.data: list[bytes | None] = []
        self._route_at: dict[int, int] = {}
        self._item_at: dict[Item, int] = {}
        self._request_at: dict[Parameters, array[int]] = {}

    @property
    def full(self) -> bool:
        """Whether it is time to pass on the collected items, and to `clear`."""
        return len(self.data) >= self._most or self._octets >= self._most_octets

    @property
    def names(self) -> list[str | None]:
        """The name of each item."""
        return self._names + _NO_NAME * (len(self.data) - len(self._names))

    @property
    def spelled(self) -> list[str | None]:
        """The text that the bytes of each item spell."""
        return self._spelled + _NO_NAME * (len(self.data) - len(self._spelled))

    def clear(self) -> None:
        """Begin new columns; the old ones belong to the code that took them."""
        self._octets = 0
        self.begins = []
        self.routes_at = []
        self.ends = []
        self.numbers = array("q")
        self._names = []
        self._spelled = []
        self.asked_at = array("i")
        self.codes_at = array("i")
        self.values = []
        self.texts = []
        self.data = []
        self.codes.bounded()
        if self.routes.bounded():
            self._route_at = {}
        if self.asked.bounded():
            self._item_at = {}
            self._request_at = {}

    def add(self, transaction: Transaction) -> int:
        """Add the items of a transaction in wire order, those of S7comm first; return their number."""
        others: list[Row] | None = None
        if transaction._carried is not None or transaction.rosctr >= PLUS:
            others = self._others(transaction)
        else:
            answers = good_octets(transaction)
            if answers is not None:
                return self._read(transaction, answers)
        results = transaction.s7_results
        count = len(results) + (len(others) if others is not None else 0)
        if not count:
            return 0
        self._begin(transaction, count)
        naming = transaction.connection.naming
        whole = transaction.has_errors and transaction._outcome == ANSWERED and transaction.refused
        no_code = _WHOLE_AT if whole else _NO_CODE_AT
        for result in results:
            item = result.item
            data = result.data
            self.asked_at.append(self._asked(item) if item is not None else 0)
            self.codes_at.append(self._code(result, no_code))
            self.data.append(data)
            if naming is not None:
                self._named(naming, result)
            else:
                self._value(item, data)
        if others is not None:
            at = len(self.numbers) - len(others)
            for index in range(len(others)):
                row = others[index]
                if row[14] is not None:
                    self.numbers[at + index] = row[14]
                self.asked_at.append(self.asked.at(row[1:8]))
                self.codes_at.append(self.codes.at(row[8:11]))
                self._add(row[11], row[12])
                self.data.append(row[13])
                self._name(row[0])
        return count

    def _begin(self, transaction: Transaction, count: int) -> None:
        """Add the columns that the next ``count`` items share."""
        self._octets += transaction.request_size + transaction.response_size
        self.routes_at.append(self._route(transaction))
        asked: bool = transaction.request_frame != 0
        time_ns = transaction.request_ns if asked else transaction.response_ns
        files = self._rows.files
        told = files.number(transaction.response_frame)
        self.begins.append((int(transaction.number), int(time_ns), files.number(transaction.request_frame), told))
        self.ends.append(len(self.data) + count)
        self.numbers.extend(_NUMBERS[count] if count < len(_NUMBERS) else array("q", range(1, count + 1)))

    def _route(self, transaction: Transaction) -> int:
        """Return the index of the row with connection, hosts, operation and certainty of a transaction."""
        connection = transaction.connection
        does = _operation(transaction)
        certainty = transaction.certainty
        key: int = (directed(connection) * len(_OPERATIONS) + does) * len(_CERTAIN) + _CERTAIN.index(certainty)
        known = self._route_at
        found = known.get(key)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            ends = self._rows.ends(connection)
            row: Row = (int(connection.number), ends[2], ends[0], _OPERATIONS[does], certainty or None)
            found = known[key] = self.routes.at(row)
        return found

    def _read(self, transaction: Transaction, answers: list[bytes]) -> int:
        """Add the items of a read that was answered without errors, as most are."""
        count = len(answers)
        if not count:
            return 0
        self._begin(transaction, count)
        parameters = transaction.parameters
        items = parameters.items
        known = self._request_at
        found = known.get(parameters)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            found = known[parameters] = array("i", [self._asked(item) for item in items])
        self.asked_at.extend(found)
        self.codes_at.extend(_GOOD[count] if count < len(_GOOD) else array("i", [SUCCESS] * count))
        self.data.extend(answers)
        for index in range(count):
            self._value(items[index], answers[index])
        return count

    def _asked(self, item: Item) -> int:
        """Return the index of the row with the columns of a request item."""
        known = self._item_at
        found = known.get(item)
        if found is None:
            if len(known) >= MOST_KNOWN:
                known.clear()
            found = known[item] = self.asked.at(_asked(item))
        return found

    def _code(self, result: ItemResult, no_code: int) -> int:
        """Return the index of the row with the columns of a return code; ``no_code`` if there is none."""
        code: i64 = result.return_code
        if code < 0 or code >= _NO_CODE_AT:
            return no_code
        if result.unchanged:
            told = _CODES[code]
            return self.codes.at((told[0], told[1], False))
        return int(code)

    def _name(self, name: str | None) -> None:
        """Set the name of the item that was added last."""
        if name is not None:
            self._names.extend(_NO_NAME * (len(self.data) - 1 - len(self._names)))
            self._names.append(name)

    def _named(self, naming: Naming, result: ItemResult) -> None:
        """Add the names of the tags in an item, and its value: the tag's value if there is only one tag."""
        known = [named for named in naming.named(result) if named.name]
        self._name(", ".join([named.name for named in known]) if known else None)
        if len(known) == 1 and known[0].whole and known[0].value is not None:
            self._shown(known[0].value)
        else:
            self._value(result.item, result.data)

    def _value(self, item: Item | None, data: bytes | None) -> None:
        """Add the value of an item as a number, else as text."""
        if item is None or data is None:
            self._add(None, None)
            return
        kind: i64 = item.transport_size
        size: i64 = len(data)
        if kind == BYTE:
            if size == 1:
                self._add(float(data[0]), None)
            elif item.size == size or item.fits(size):
                text = spelled(data)
                self._add(None, f"[{','.join(number_texts(kind, data, size))}]")
                if text:
                    self._spelled.extend(_NO_NAME * (len(self.texts) - 1 - len(self._spelled)))
                    self._spelled.append(text)
            else:
                self._add(None, None)
            return
        if item.size != size and not item.fits(size):
            self._add(None, None)
            return
        if kind == REAL and size == 4:
            self._add(real(data), None)
            return
        if kind == BIT and size == 1:
            self._add(1.0 if data[0] & 1 else 0.0, None)
            return
        if kind == WORD and size == 2:
            self._add(float(u16(data, 0)), None)
            return
        if size > 4 or (size == 4 and kind in _SHORT):  # several
            text = ",".join(number_texts(kind, data, size))
            if text and "n" not in text:  # JSON has no numbers for NaN and infinities
                self._add(None, f"[{text}]")
                return
        self._shown(decode_value(kind, data))

    def _shown(self, value: Value) -> None:
        if value is None:
            self._add(None, None)
        elif isinstance(value, bool):
            self._add(1.0 if value else 0.0, None)
        elif isinstance(value, int):
            self._add(float(value), rounded(value))
        elif isinstance(value, float):
            self._add(value, None)
        elif isinstance(value, str):
            self._add(None, encodable(value))
        else:
            self._add(None, decoded_json(value))

    def _add(self, value: float | None, text: str | None) -> None:
        self.values.append(value)
        self.texts.append(text)


def rounded(value: int) -> str | None:
    """Return an integer as text if its floating-point number in the table may not be exact, else None."""
    return str(value) if not -_MOST_EXACT <= value <= _MOST_EXACT else None


class Collected:
    """Collects transactions for the tables of transactions and items, if wanted.

    ``counted`` returns the number of items if their table is not wanted.
    """

    def __init__(
        self,
        transactions: TransactionColumns | None,
        items: ItemColumns | None,
        counted: Callable[[Transaction], int],
        most: int,
    ) -> None:
        self._transactions: TransactionColumns | None = transactions
        self._items: ItemColumns | None = items
        self._counted: Callable[[Transaction], int] = counted
        self._most: i64 = most

    def add(self, transaction: Transaction) -> bool:
        """Add a transaction; return whether it is time to pass on the collected ones."""
        items = self._items
        count = items.add(transaction) if items is not None else self._counted(transaction)
        transactions = self._transactions
        if transactions is not None and transactions.add(transaction, count) >= self._most:
            return True
        return items is not None and items.full


def _operation(transaction: Transaction) -> int:
    """Return the operation of a transaction on its items."""
    if transaction._outcome == PUSH:
        return _NOTIFY
    parameters = transaction.parameters
    if isinstance(parameters, PlusParameters):
        return _WRITE if int(parameters.code) in WRITES else _READ
    return _WRITE if transaction.function == WRITE_VAR else _READ


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
