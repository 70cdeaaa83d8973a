"""`Tracker`: remembers variables and their latest values within bounds, and makes rows of new values."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.output.variables.model import RefusedRow, SharedValue, ValueRow, Variable
from dissect.output.variables.statistics import Statistics
from dissect.output.variables.wanted import Image, Wanted
from dissect.packets.tcp.link import within
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.values import decode_value
from dissect.wire.codes import CodeTable

MAX_VARIABLES: Final = 20_000
#: Maximum size of the latest values that are kept, for all variables together.
MAX_KEPT: Final = 8 << 20
#: Used as a return code if the result of an item was not captured.
NO_ANSWER: Final = -1


class ItemPlan:
    """The treatment of an item of a request: its variable, or the wanted places that it touches."""

    __slots__ = ("bits", "item", "start", "variable", "wanted")

    def __init__(self, item: Item) -> None:
        self.item: Item = item
        self.variable: Variable | None = None
        self.wanted: list[Wanted] = []
        self.start: i64 = 0
        self.bits: i64 = 0


class PlcVariables:
    """The variables of one end of connections, by address, type and tag, and the known octets of wanted places.

    ``plans`` has the plan of each item; ``reads`` the plans of the items of a read request, in their order.
    """

    __slots__ = ("end", "images", "plans", "reads", "variables", "vlan")

    def __init__(self, end: Endpoint, vlan: i64) -> None:
        self.end: Endpoint = end
        self.vlan: i64 = vlan
        self.variables: dict[str, Variable] = {}
        self.plans: dict[Item, ItemPlan] = {}
        self.reads: dict[Parameters, list[ItemPlan]] = {}
        self.images: dict[Wanted, Image] = {}


class Tracker:
    """Remembers variables, and makes ``rows`` of their values; with ``sums`` it only adds them up.

    ``untracked`` counts values of variables beyond ``most``, or beyond `MAX_KEPT`; ``refused`` and ``unconfirmed`` count items
    without a value. ``changes``, ``every_ns`` and ``likely`` as for `Collector`. While ``doubt`` is set, to that of a
    transaction that is only likely, values only make rows: they are not remembered, added up or compared with later values.
    """

    def __init__(self, changes: bool, every_ns: i64, sums: bool, most: i64, likely: bool, refusals: bool) -> None:
        self.rows: list[ValueRow] = []
        self.untracked: i64 = 0
        self.refused: i64 = 0
        self.unconfirmed: i64 = 0
        self.most: i64 = most
        self.doubt: str = ""
        self.aside: bool = False  # ``doubt`` is set
        self.left_out: bool = False  # a value was left out since ``doubt`` was set
        self._likely: bool = likely
        self._refusals: bool = refusals
        self.count: i64 = 0
        self.plcs: dict[str, PlcVariables] = {}
        self._changes: bool = changes
        self._every_ns: i64 = every_ns
        self._sums: bool = sums
        self._adds: bool = sums and not changes and every_ns == 0  # values can be added up without making rows
        self._ends: dict[int, PlcVariables] = {}
        self.kept: i64 = 0

    def forget(self, connection: Connection) -> None:
        """Forget which PLC a connection was to."""
        self._ends.pop(connection.number * 2, None)
        self._ends.pop(connection.number * 2 + 1, None)

    def named(self, plc: PlcVariables, address: str, type_: str, tag: str, unit: str) -> Variable:
        """Return the variable of an address, type and tag."""
        key = f"{address}|{type_}|{tag}"
        known = plc.variables.get(key)
        return known if known is not None else self.variable(plc, key, address, type_, tag, unit)

    def plc(self, transaction: Transaction, side: i64) -> PlcVariables:
        """Return the `PlcVariables` at a side of a transaction's connection."""
        connection = transaction.connection
        key: i64 = connection.number * 2 + side
        found = self._ends.get(key)
        if found is None:
            end = connection.tcp.ends[side]
            name = within(str(end), connection.tcp.vlan)
            found = self.plcs.get(name)
            if found is None:
                found = PlcVariables(end, connection.tcp.vlan)
                # No more PLCs are remembered than variables.
                if len(self.plcs) < self.most:
                    self.plcs[name] = found
            self._ends[key] = found
        return found

    def variable(self, plc: PlcVariables, key: str, address: str, type_: str, tag: str, unit: str) -> Variable:
        """Return a new variable; it is remembered if there is room."""
        variable = Variable(plc.end, plc.vlan, address, type_, tag, unit)
        if self.count < self.most and self.kept < MAX_KEPT:
            self.count += 1
            plc.variables[key] = variable
            if self._sums:
                variable.statistics = Statistics()
        else:
            variable.next_ns = -1  # not remembered
        return variable

    def refuse(
        self, transaction: Transaction, variable: Variable, code: i64, how: str, writes: bool, codes: CodeTable | None
    ) -> None:
        """Count an item without a value: refused or, if ``code`` is `NO_ANSWER`, a write whose result was not captured.

        ``codes`` names the return code; None for SCD, where it is that of the message. It is 0 if the answer refuses the whole
        request, and has the reason itself.
        """
        if self._refusals and code != NO_ANSWER and (self._likely or not self.aside):
            self._refused_row(transaction, variable, code, how, writes, codes)
        if self.aside:
            variable.likely += 1
            self.left_out = True
            return
        if code == NO_ANSWER:
            if writes:
                variable.unconfirmed += 1
                self.unconfirmed += 1
        elif writes:
            variable.refused_writes += 1
            self.refused += 1
        else:
            variable.refused_reads += 1
            self.refused += 1

    def _refused_row(
        self, transaction: Transaction, variable: Variable, code: i64, how: str, writes: bool, codes: CodeTable | None
    ) -> None:
        """Keep the row of a refusal, with the time of the answer that contains it."""
        row = RefusedRow(
            variable,
            transaction.connection,
            transaction.asked_by,
            how,
            transaction.response_ns,
            transaction.response_frame,
        )
        row.writes = writes
        row.changed = False
        row.doubt = self.doubt
        row.return_code, row.reason = _refusal(transaction, code, codes)
        self.rows.append(row)

    def item(
        self, transaction: Transaction, variable: Variable, item: Item, how: str, writes: bool, data: bytes
    ) -> None:
        """Take the octets of an S7comm item; they are only decoded if they are different from those before."""
        if self._adds and not self.aside:
            self._add(transaction, variable, item, writes, data)
            return
        row = self.row(transaction, variable, how, writes, data)
        if row is not None:
            told = variable._told
            if row.changed:
                told = SharedValue(data)
                if item.size == len(data) or item.fits(len(data)):
                    told.coded = item.transport_size
            row._told = told
            self.finish(row)

    def _add(self, transaction: Transaction, variable: Variable, item: Item, writes: bool, data: bytes) -> None:
        """Do what `item` does, but add the value to the statistics without making a row."""
        statistics = variable.statistics
        if statistics is None:
            self.untracked += 1
            return
        time_ns: i64 = transaction.request_ns if writes and transaction.request_frame else transaction.response_ns
        before = variable._told.data
        if before is not None and variable.seen and before == data:
            statistics.again(time_ns, transaction.connection, transaction.asked_by, writes)
            return
        first: bool = not variable.seen
        value = item_value(item, data)
        self._keep(variable, SharedValue(data, -1, value))
        statistics.different(
            value if value is not None else data,
            data,
            first,
            time_ns,
            transaction.connection,
            transaction.asked_by,
            writes,
        )

    def row(
        self,
        transaction: Transaction,
        variable: Variable,
        how: str,
        writes: bool,
        data: bytes | None,
        value: object = None,
    ) -> ValueRow | None:
        """Begin the row of a value, None if it is left out; the caller sets the transferred value.

        Values are compared by their octets ``data``, else by ``value``.
        """
        time_ns: i64 = transaction.response_ns
        frame: i64 = transaction.response_frame
        if writes and transaction.request_frame:
            time_ns = transaction.request_ns
            frame = transaction.request_frame
        if self.aside:
            variable.likely += 1
            if not self._likely or time_ns < variable.next_ns:
                self.left_out = True
                return None
        elif variable.next_ns < 0:
            self.untracked += 1
        elif self._every_ns:
            if time_ns < variable.next_ns:
                return None
            variable.next_ns = (time_ns // self._every_ns + 1) * self._every_ns
        changed: bool = True
        if variable.seen:
            changed = variable._told.data != data if data is not None else variable.value != value
            if not changed and self._changes:
                return None
        row = ValueRow(variable, transaction.connection, transaction.asked_by, how, time_ns, frame)
        row.writes = writes
        row.first = not variable.seen
        row.changed = changed
        row._was = variable._told
        row.doubt = self.doubt
        return row

    def finish(self, row: ValueRow) -> None:
        """Remember the value of a row as the latest one, and keep the row or add it up."""
        variable = row.variable
        if row.doubt:
            self.rows.append(row)
            return
        if variable.next_ns >= 0 and row.changed:
            self._keep(variable, row._told)
        statistics = variable.statistics
        if statistics is not None:
            statistics.add(row)
        elif not self._sums:
            self.rows.append(row)

    def _keep(self, variable: Variable, told: SharedValue) -> None:
        """Remember the latest value of a variable."""
        data = told.data
        if data is not None:
            before = variable._told.data
            if before is not None:
                self.kept -= len(before)
            self.kept += len(data)
        variable._told = told
        variable.seen = True


def _refusal(transaction: Transaction, code: int, codes: CodeTable | None) -> tuple[int, str]:
    """Return number and name of a refusal: that of the item, or of the answer if it refuses the whole request."""
    if codes is None or code == 0:
        for error in transaction.errors:
            if error.item == 0:
                return error.code, error.name if codes is not None else error.text or error.name
    return code, codes.name(code) if codes is not None else "refused"


def item_value(item: Item, data: bytes) -> object:
    """Return the value of an S7comm item, None if its octets have none."""
    return decode_value(item.transport_size, data) if item.size == len(data) or item.fits(len(data)) else None
