"""`ValueCollector`: makes rows of values from transactions, each with its variable and the value before it.

At most `MAX_VARIABLES` variables (`dissect.output.variables.tracker`) are remembered. Values of further variables still make
rows, but without the value before, and they are not in summaries; ``untracked`` counts them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from mypy_extensions import i64

from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.good_items import good_octets
from dissect.engine.transactions.naming import NamedValue
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.results import DOUBTS, TEST_WRITES, has_items
from dissect.engine.transactions.transaction import ANSWERED, Transaction
from dissect.engine.transactions.transaction import PUSH as OUTCOME_PUSH
from dissect.meaning.tags.model import NUMBERED_BITS
from dissect.meaning.tags.naming import TagNaming
from dissect.output.variables.model import (
    FORCE,
    MODIFY,
    NOTIFICATION,
    PDO,
    PUSH,
    READ,
    WRITE,
    SharedValue,
    ValueRow,
    Variable,
)
from dissect.output.variables.tracker import MAX_VARIABLES, NO_ANSWER, ItemPlan, PlcVariables, Tracker
from dissect.output.variables.wanted import Image, WantedSet
from dissect.protocols.s7.items import Item, ItemResult
from dissect.protocols.s7.tables import (
    BIT,
    BYTE,
    FORCE_VARIABLES,
    GROUP_TEST,
    JOB,
    NUMBERED_AREAS,
    READ_VAR,
    RETURN_CODES,
    SUCCESS,
    TRANSPORT_SIZES,
    USERDATA,
    WRITE_VAR,
)
from dissect.protocols.s7.values import decode_value
from dissect.protocols.s7plus.items import WRITES, PlusItem
from dissect.protocols.s7plus.parameters import PlusParameters
from dissect.protocols.s7plus.tables import NOTIFICATION as PLUS_NOTIFICATION
from dissect.scd.layout import address_text
from dissect.scd.wording import Row, described, json_value

#: At most this many plans of items are remembered; polling repeats the same items.
MAX_PLANS: Final = 16_384

#: Returns whether a transaction is wanted.
Choice = Callable[[Transaction], bool]


class ValueCollector(Observer):
    """Collects rows of values from transactions until `take`; with ``sums`` it only adds them up for summaries.

    ``wanted`` are the wanted places and names, None for everything. ``changes`` leaves out values equal to the one before.
    ``every_ns`` keeps only the first value of a variable in each interval of this many nanoseconds (counted from 1970); other
    values are ignored. ``choose`` returns which transactions are wanted; ``most`` is the maximum number of remembered
    variables. Transactions that are only likely are left out and counted in ``doubts``, by `Transaction.doubt`. With ``likely``
    their values make rows as well, each with its ``doubt``; they are never the value before another one, and are not added up.
    With ``refusals`` each item that the PLC refused makes a row as well (`RefusedRow`).
    """

    def __init__(
        self,
        wanted: WantedSet | None = None,
        changes: bool = False,
        every_ns: i64 = 0,
        sums: bool = False,
        choose: Choice | None = None,
        most: i64 = MAX_VARIABLES,
        likely: bool = False,
        refusals: bool = False,
    ) -> None:
        super().__init__()
        self.found: set[str] = set()  # texts of the wanted places for which a value or a refusal was seen
        self.doubts: dict[str, int] = {}
        self._store: Tracker = Tracker(changes, every_ns, sums, most, likely, refusals)
        self._wanted: WantedSet | None = wanted
        self._choose: Choice | None = choose
        self._plans: i64 = 0

    def take(self) -> list[ValueRow]:
        """Return the rows collected since the last call."""
        rows = self._store.rows
        self._store.rows = []
        return rows

    @property
    def variables(self) -> list[Variable]:
        """All remembered variables, PLC by PLC, in the order in which they were first seen."""
        return [variable for plc in self._store.plcs.values() for variable in plc.variables.values()]

    @property
    def plcs(self) -> list[str]:
        """The ends that have variables, in the order in which they were first seen."""
        return list(self._store.plcs)

    @property
    def known(self) -> int:
        """Number of variables that are remembered so far."""
        return self._store.count

    @property
    def kept(self) -> int:
        """The octets of all remembered values."""
        return self._store.kept

    @property
    def untracked(self) -> int:
        """The number of values of variables that are not remembered."""
        return self._store.untracked

    @property
    def most(self) -> int:
        """Maximum number of variables that are remembered."""
        return self._store.most

    @property
    def refused(self) -> int:
        """The number of items that the PLC refused to read or write."""
        return self._store.refused

    @property
    def unconfirmed(self) -> int:
        """The number of written items whose result was not captured."""
        return self._store.unconfirmed

    def connection_closed(self, connection: Connection) -> None:
        """Forget which PLC a closed connection was to."""
        self._store.forget(connection)

    def transaction(self, transaction: Transaction) -> None:
        """Take the values of a transaction."""
        choose = self._choose
        if choose is not None and not choose(transaction):
            return
        if transaction._flags & DOUBTS and transaction.doubt:
            self._take_likely(transaction)
        else:
            self._take(transaction)

    def _take_likely(self, transaction: Transaction) -> None:
        """Take the values of a pair that is only likely, or of a push whose items are only likely."""
        store = self._store
        store.doubt = transaction.doubt
        store.aside, store.left_out = True, False
        self._take(transaction)
        store.doubt, store.aside = "", False
        if store.left_out:
            self.doubts[transaction.doubt] = self.doubts.get(transaction.doubt, 0) + 1

    def _take(self, transaction: Transaction) -> None:
        kind: i64 = transaction.rosctr
        if kind == JOB:
            function: i64 = transaction.parameters.function
            if function == READ_VAR:
                self._read(transaction)
            elif function == WRITE_VAR:
                self._written(transaction)
        elif kind == USERDATA:
            head = transaction.parameters.userdata
            if head is not None and has_items(head):
                if head.group == GROUP_TEST and head.subfunction in TEST_WRITES:
                    self._modified(transaction, FORCE if head.subfunction == FORCE_VARIABLES else MODIFY)
                elif transaction.response_size:
                    self._sent(transaction)
        elif transaction.is_plus:
            self._plus(transaction)
        if transaction._carried is not None or transaction.is_scd:
            self._scd(transaction)

    # ---- S7comm -----------------------------------------------------------------------------------------------------

    def _read(self, transaction: Transaction) -> None:
        if transaction._outcome != ANSWERED:
            return
        plc = self._store.plc(transaction, 1 - transaction.asked_by)
        answers = good_octets(transaction)
        if answers is not None:  # nearly always: then no `ItemResult` is needed
            self._answers(transaction, plc, answers)
            return
        whole: bool = transaction.error_code != 0
        for result in transaction.s7_results:
            code: i64 = result.return_code
            if code == NO_ANSWER and whole:
                code = 0
            self._result(transaction, plc, result, code, READ, False)

    def _answers(self, transaction: Transaction, plc: PlcVariables, answers: list[bytes]) -> None:
        """Take the values of a read without errors."""
        store = self._store
        for index, plan in enumerate(self._planned(transaction, plc)):
            variable = plan.variable
            if variable is not None:
                store.item(transaction, variable, plan.item, READ, False, answers[index])
            elif plan.wanted:
                self._places(transaction, plc, plan.item, plan, SUCCESS, answers[index], READ, False)

    def _written(self, transaction: Transaction) -> None:
        if not transaction.request_size:
            return
        plc = self._store.plc(transaction, 1 - transaction.asked_by)
        whole: bool = transaction._outcome == ANSWERED and transaction.error_code != 0
        for result in transaction.s7_results:
            code: i64 = result.return_code
            if code == NO_ANSWER and whole:
                code = 0
            self._result(transaction, plc, result, code, WRITE, True)

    def _sent(self, transaction: Transaction) -> None:
        """Take the values that a cyclic service or a variable table sends, in its first answer or in a push."""
        plc = self._store.plc(transaction, 1 - transaction.asked_by)
        for result in transaction.s7_results:
            if result.unchanged:
                continue
            code: i64 = result.return_code
            if code != NO_ANSWER:
                self._result(transaction, plc, result, code, PUSH, False)

    def _modified(self, transaction: Transaction, how: str) -> None:
        """Take values that were modified or forced, once the PLC reports the result; the values are in the request."""
        plc = self._store.plc(transaction, 1 - transaction.asked_by)
        asked = transaction.subscribed
        if transaction._outcome != OUTCOME_PUSH:
            if transaction.has_errors:
                for result in transaction.s7_results:
                    self._result(transaction, plc, result, 0, how, True)
            return
        if asked is None:
            return
        given = asked.written
        for index, result in enumerate(transaction.s7_results):
            if index < len(given) and result.return_code != NO_ANSWER:
                told = ItemResult(result.item, result.return_code, given[index].data, given[index])
                self._result(transaction, plc, told, result.return_code, how, True)

    def _result(
        self, transaction: Transaction, plc: PlcVariables, result: ItemResult, code: i64, how: str, writes: bool
    ) -> None:
        """Take an item with its result: by its tags if it has any, else by its address."""
        item = result.item
        if item is None:
            return
        naming = transaction.connection.naming
        if naming is not None and self._wanted is None:
            named = naming.named(result)
            if named:
                for value in named:
                    self._named(transaction, plc, value, code, how, writes)
                return
        data = result.data
        if data is None:
            if code == SUCCESS:
                return
            data = b""
        self._item(transaction, plc, item, code, data, how, writes)

    def _named(
        self, transaction: Transaction, plc: PlcVariables, named: NamedValue, code: i64, how: str, writes: bool
    ) -> None:
        """Take the value of a tag, or octets between tags."""
        type_ = named.type or ("BYTE" if len(named.data) == 1 else f"{len(named.data)} x BYTE")
        key = f"{named.address}|{type_}|{named.name}"
        if not named.whole:
            key = f"{key}|{named.remark}"
        variable = plc.variables.get(key)
        if variable is None:
            variable = self._store.variable(plc, key, named.address, type_, named.name, named.unit)
            variable.comment = named.comment
            variable.bytes_only = not named.type and len(named.data) > 1
        if code != SUCCESS:
            self._store.refuse(transaction, variable, code, how, writes, RETURN_CODES)
            return
        data = _own_octets(named)
        row = self._store.row(transaction, variable, how, writes, data)
        if row is not None:
            value: object = named.value
            if not named.name and not named.remark:
                value = decode_value(BYTE, named.data)
            row._told = SharedValue(data, -1, value)
            row.remark = named.remark
            self._store.finish(row)

    def _item(
        self, transaction: Transaction, plc: PlcVariables, item: Item, code: i64, data: bytes, how: str, writes: bool
    ) -> None:
        """Take an item of S7comm by its address; if ``code`` is not success, only count the refusal."""
        plan = plc.plans.get(item)
        if plan is None:
            plan = self._plan(transaction, plc, item)
        variable = plan.variable
        if variable is None:
            if plan.wanted:
                self._places(transaction, plc, item, plan, code, data, how, writes)
            return
        if code != SUCCESS:
            self._store.refuse(transaction, variable, code, how, writes, RETURN_CODES)
            return
        self._store.item(transaction, variable, item, how, writes, data)

    def _planned(self, transaction: Transaction, plc: PlcVariables) -> list[ItemPlan]:
        """Return the plans of the items of a read request, from the cache if it is known."""
        parameters = transaction.parameters
        plans = plc.reads.get(parameters)
        if plans is None:
            plans = []
            for item in parameters.items:
                plan = plc.plans.get(item)
                plans.append(plan if plan is not None else self._plan(transaction, plc, item))
            self._make_room()
            self._plans += len(plans) + 1
            plc.reads[parameters] = plans
        return plans

    def _make_room(self) -> None:
        """Forget all plans if there are too many."""
        if self._plans >= MAX_PLANS:
            self._plans = 0
            for plc in self._store.plcs.values():
                plc.plans.clear()
                plc.reads.clear()

    def _plan(self, transaction: Transaction, plc: PlcVariables, item: Item) -> ItemPlan:
        """Make and remember the plan of an item: its variable, or the wanted places that it touches."""
        self._make_room()
        plan = ItemPlan(item)
        wanted = self._wanted
        if wanted is None:
            plan.variable = self._own(plc, item)
        elif item.size > 0:
            numbered: bool = item.area in NUMBERED_AREAS
            plan.start = item.start_bit * NUMBERED_BITS if numbered else item.start_bit
            plan.bits = 1 if item.transport_size == BIT else 8 * item.size
            if plan.bits == 1 or plan.start % 8 == 0:
                naming = transaction.connection.naming
                tags = naming if isinstance(naming, TagNaming) else None
                plan.wanted = wanted.touched(item.area, item.db, plan.start, plan.bits, tags)
        if wanted is not None and not plan.wanted and item.address.lower() in wanted.words:
            plan.variable = self._own(plc, item)
            self.found.add(wanted.words[item.address.lower()].text)
        plc.plans[item] = plan
        self._plans += 1
        return plan

    def _own(self, plc: PlcVariables, item: Item) -> Variable:
        """Return the variable whose address and type are exactly those of an item."""
        type_ = item_type(item)
        key = f"{item.address}|{type_}|"
        variable = plc.variables.get(key)
        if variable is None:
            variable = self._store.variable(plc, key, item.address, type_, "", "")
            variable.bytes_only = item.transport_size == BYTE and item.count != 1
        return variable

    def _places(
        self,
        transaction: Transaction,
        plc: PlcVariables,
        item: Item,
        plan: ItemPlan,
        code: i64,
        data: bytes,
        how: str,
        writes: bool,
    ) -> None:
        """Take the wanted places that an item touches. If other octets of a place are not known yet, take the item itself."""
        sound: bool = code == SUCCESS and len(data) == item.size
        alone: bool = False
        for wanted in plan.wanted:
            self.found.add(wanted.text)
            image = plc.images.get(wanted)
            if image is None:
                if self._store.count >= self._store.most:
                    alone = True
                    continue
                naming = transaction.connection.naming
                image = Image(wanted, naming if isinstance(naming, TagNaming) else None)
                plc.images[wanted] = image
            if self._store.aside:
                image = image.copy()
            exact: bool = plan.start == wanted.start and plan.bits == wanted.bits
            if exact and image.part is None and image.transport_size != item.transport_size:
                image.transport_size = item.transport_size
                image.variable = None
            variable = image.variable
            if variable is None:
                typed = item_type(item) if image.transport_size >= 0 and exact else ""
                address, type_, tag, unit = image.names(typed)
                key = f"{address}|{type_}|{tag}"
                known = plc.variables.get(key)
                variable = known if known is not None else self._store.variable(plc, key, address, type_, tag, unit)
                variable.bytes_only = image.bytes_only
                image.variable = variable
            if not sound:
                if code != SUCCESS:
                    self._store.refuse(transaction, variable, code, how, writes, RETURN_CODES)
                else:
                    alone = True
                continue
            all_of_it = image.take(data, plan.start, plan.bits)
            if image.missing:
                alone = True
                continue
            octets = image.data()
            row = self._store.row(transaction, variable, how, writes, octets)
            if row is not None:
                row.pieced = not all_of_it
                row._told = variable._told if not row.changed else SharedValue(octets, -1, image.value(octets))
                self._store.finish(row)
        if alone:
            own = self._own(plc, item)
            self._store.item(transaction, own, item, how, writes, data)

    # ---- S7comm-plus and SCD ----------------------------------------------------------------------------------------

    def _plus(self, transaction: Transaction) -> None:
        parameters = transaction.parameters
        if not isinstance(parameters, PlusParameters):
            return
        items = transaction.plus_results
        if not items:
            return
        plc = self._store.plc(transaction, 1 - transaction.asked_by)
        writes: bool = parameters.code in WRITES
        how = WRITE if writes else READ
        asked = transaction.plus_request if transaction.request_size else None
        if asked is None:
            told = transaction.plus_response
            if told is None or told.opcode != PLUS_NOTIFICATION:
                return
            how = NOTIFICATION
        session = transaction.connection.plus
        for item in items:
            if session is None or item.address is None or item.address.area not in session.given:
                self._plus_item(transaction, plc, item, how, writes)

    def _plus_item(self, transaction: Transaction, plc: PlcVariables, item: PlusItem, how: str, writes: bool) -> None:
        address = item.label
        wanted = self._wanted
        if wanted is not None:
            one = wanted.words.get(address.lower())
            if one is None:
                return
            self.found.add(one.text)
        variable = plc.variables.get(address)
        if variable is None:
            variable = self._store.variable(plc, address, address, "", "", "")
        if not variable.type:
            variable.type = _plus_type(item)
        if item.return_code > 0 or (writes and item.return_code == NO_ANSWER):
            self._store.refuse(transaction, variable, item.return_code, how, writes, item.codes)
            return
        if item.value is None:
            return
        value = item.json_value
        row = self._store.row(transaction, variable, how, writes, item.data, value)
        if row is not None:
            row._told = SharedValue(item.data, -1, value, item.meaning)
            row.remark = item.note
            self._store.finish(row)

    def _scd(self, transaction: Transaction) -> None:
        carried: bool = transaction._carried is not None
        if carried and transaction.has_errors:
            return  # a refused item does not show which SCD values were refused
        writes: bool = carried and transaction.parameters.function == WRITE_VAR
        for found in transaction.scd:
            self._scd_message(transaction, found, carried, writes)

    def _scd_message(self, transaction: Transaction, found: ScdMessage, carried: bool, writes: bool) -> None:
        """Take an SCD message with values: the response of a read, the request of a write, or an unsolicited message."""
        side: i64 = 1 - transaction.asked_by
        how = WRITE if writes else READ
        refused: bool = False
        service = found.message.service
        if service == "pdo":
            how = PDO
            # A TPDO is sent by the device, an RPDO is sent to it.
            if not carried:
                side = 1 - found.side if found.message.pdo.startswith("R") else found.side
                writes = side != found.side
        elif not carried:
            if service not in ("read", "write"):
                return
            writes = service == "write"
            how = WRITE if writes else READ
            if writes != (found.side == transaction.asked_by):
                return
            refused = transaction.has_errors
        unsure: bool = writes and how == WRITE and not carried and transaction._outcome != ANSWERED
        plc = self._store.plc(transaction, side)
        for row in found.values or (_refused_rows(found) if refused else []):
            wanted = self._wanted
            if wanted is not None:
                one = wanted.words.get(row.address.lower())
                if one is None:
                    one = wanted.words.get(row.name.lower())
                if one is None:
                    continue
                self.found.add(one.text)
            variable = self._store.named(plc, row.address, "", row.name, row.unit)
            if refused or unsure:
                self._store.refuse(transaction, variable, 0 if refused else NO_ANSWER, how, writes, None)
                continue
            value = json_value(row.physical)
            made = self._store.row(transaction, variable, how, writes, None, value)
            if made is not None:
                made.frame = found.frame
                made.time_ns = found.time_ns
                made.side = 1 - side
                made._told = SharedValue(None, -1, value, row.text)
                made.remark = ", ".join(row.flags)
                self._store.finish(made)


def _refused_rows(found: ScdMessage) -> list[Row]:
    """Return the variable that a refusal without a value names; none for a message without an address."""
    message = found.message
    if "index" not in message.numbers:
        return []
    address = (message.index, message.sub)
    name, type_, unit = described(found.dictionary, address)
    return [Row(address_text(address), name, 0, 0, unit, "", (), type_)]


def _own_octets(named: NamedValue) -> bytes:
    """Return the octets of a tag; for BOOLs an octet each, because their octets on the wire also hold other variables."""
    value = named.value
    if isinstance(value, bool):
        return b"\1" if value else b"\0"
    if isinstance(value, list) and named.type.endswith("BOOL"):
        return bytes([1 if one else 0 for one in value])
    return named.data


def item_type(item: Item) -> str:
    """Return the type of an S7comm item in the form of a tag's type: ``REAL``, ``BOOL``, ``10 x BYTE``."""
    if item.transport_size < 0:
        return ""
    name = "BOOL" if item.transport_size == BIT else TRANSPORT_SIZES.name(item.transport_size)
    return name if item.count == 1 else f"{item.count} x {name}"


def _plus_type(item: PlusItem) -> str:
    found = item.found
    if found is not None and found.variable is not None:
        return found.variable.datatype_name
    return item.value.type_name if item.value is not None else ""
