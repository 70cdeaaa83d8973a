"""Makes the rows of every table: tuples of the values of its stored columns (`dissect.output.export.tables`)."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, Final

from dissect.engine.acts.act import Act
from dissect.engine.findings.ledger import Ledger
from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.good_items import good_octets
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.facts import fact as kinds
from dissect.meaning.facts.counted import counted
from dissect.meaning.facts.transaction import ITEM
from dissect.meaning.inventory.model import Device
from dissect.meaning.select.items import ItemFacts, plus_facts, scd_facts
from dissect.output.export.tables import ACTS, CONNECTIONS, DEVICES, FINDING_COUNTS, FINDINGS, ITEMS, OPERATIONS, Table
from dissect.output.export.transaction_rows import Row, TransactionRows
from dissect.output.export.value_columns import shown
from dissect.packets.source.packet import SourceFile
from dissect.protocols.s7plus.items import PlusItem
from dissect.wire.text import encodable

_NOTHING: Final[Mapping[str, Any]] = {}


class Rows:
    """Makes the rows of a run; ``files`` are its files, to which more may be added while it runs."""

    def __init__(self, files: Sequence[SourceFile]) -> None:
        self._hot = TransactionRows(files)
        self._before = 0
        at = self._hot.files
        #: The cells of a value by kind of fact; for other kinds the cell is the value itself.
        self._cells: Mapping[str, Callable[[Any], Sequence[Any]]] = {
            kinds.END: lambda end: (end.host, end.port if end.port >= 0 else None),
            kinds.TSAP: lambda tsap: (str(tsap),),
            kinds.TEXT: lambda text: (encodable(text),),
            kinds.FRAME: lambda frame: (at.number(frame),),
            kinds.FRAMES: lambda frames: ([at.number(frame) for frame in frames],),
            kinds.SERIAL: lambda number: (self._before + number,),
            kinds.FILE: lambda frame: (at.name(frame),),
        }

    def count_from(self, before: int) -> None:
        """Begin to number findings after ``before``."""
        self._before = before

    # ---- connections ------------------------------------------------------------------------------------------------

    def connection(self, connection: Connection) -> Row:
        """Return the row of a connection."""
        return self._row(CONNECTIONS, connection)

    def _row(self, table: Table, record: object, owned: Mapping[str, Any] = _NOTHING) -> Row:
        """Return the row of a record whose table is made of facts; ``owned`` has the values that are not its own."""
        row: list[Any] = []
        for fact in table.facts:
            value = fact.get(record) if fact.get is not None else owned.get(fact.name)
            cells = self._cells.get(fact.kind)
            if cells is None or value is None:
                row.append(value)
            else:
                row += cells(value)
        return tuple(row)

    # ---- transactions and items -------------------------------------------------------------------------------------

    @property
    def transactions(self) -> TransactionRows:
        """The object that makes the columns of transactions."""
        return self._hot

    @staticmethod
    def item_count(transaction: Transaction) -> int:
        """Return the number of rows for the items of a transaction."""
        good = good_octets(transaction)
        if good is not None:
            count = len(good)
        else:
            count = len(transaction.plus_results if transaction.is_plus else transaction.s7_results)
        return count + sum([len(found.values) for found in transaction.scd])

    def other_items(self, transaction: Transaction) -> list[Row]:
        """Return the columns, from the name on, of each S7comm-plus item or SCD value."""
        facts = [plus_facts(item) for item in transaction.plus_results] if transaction.is_plus else []
        facts += [scd_facts(row) for found in transaction.scd for row in found.values]
        return [_facts(fact) for fact in facts]

    # ---- operations, findings ---------------------------------------------------------------------------------------

    def operation(self, operation: Operation) -> Row:
        """Return the row of an operation."""
        return self._row(OPERATIONS, operation)

    def act(self, act: Act) -> Row:
        """Return the row of an act."""
        return self._row(ACTS, act)

    def finding(self, finding: Finding, connection: Connection | None) -> Row:
        """Return the row of a finding; ``connection`` is the connection that it is about, None if unknown."""
        client, server = finding.client.partition(" ")[0] or None, finding.server.partition(" ")[0] or None
        if connection is not None:
            client, server = connection.client.host, connection.server.host
        return self._row(FINDINGS, finding, {"client_host": client, "server_host": server})

    def finding_counts(self, ledger: Ledger, begin_ns: int, end_ns: int) -> Iterator[Row]:
        """Yield the rows of the facts of rules, in a capture of this time."""
        for one in counted(ledger, begin_ns, end_ns):
            yield self._row(FINDING_COUNTS, one)

    def device(self, device: Device) -> Row:
        """Return the row of a device."""
        return self._row(DEVICES, device)


#: The facts of an item of another protocol, in the order in which `ItemColumns` expects them.
_OTHER: Final = [
    fact.get
    for fact in ITEMS.facts[ITEMS.facts.index(ITEM["name"]) : ITEMS.facts.index(ITEM["number_value"])]
    if fact.get is not None
]


def _facts(facts: ItemFacts) -> Row:
    """Return the columns of an item of another protocol, from its name on."""
    number = facts.source.number if isinstance(facts.source, PlusItem) else None
    return (*[get(facts) for get in _OTHER], *shown(_value(facts)), facts.data, number)


def _value(facts: ItemFacts) -> object:
    """Return the value of an item; for S7comm-plus in the form of the JSON lines."""
    source = facts.source
    if isinstance(source, PlusItem):
        return source.json_value
    found = facts.values
    return found[0] if len(found) == 1 else found or None
