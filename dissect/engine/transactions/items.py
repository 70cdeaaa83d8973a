"""`TransactionItem`: an item of a transaction in one form for S7comm, S7comm-plus and SCD, for programs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final, NamedTuple

from dissect.protocols.s7.tables import RETURN_CODES, SUCCESS, TRANSPORT_SIZES, WRITE_VAR

if TYPE_CHECKING:
    from dissect.engine.transactions.naming import NamedValue
    from dissect.engine.transactions.transaction import Transaction
    from dissect.protocols.s7.items import ItemResult
    from dissect.protocols.s7plus.items import PlusItem

#: `TransactionItem.result` of a successful item, and of one whose answer does not state a result.
OK: Final = "ok"
NOT_ANSWERED: Final = "not answered"
NOT_CAPTURED: Final = "answer not captured"
UNCHANGED: Final = "unchanged"


class TransactionItem(NamedTuple):
    """An item that was read, written or pushed: a variable of the PLC, or, with tags, a part of such a variable.

    ``address`` is its address as people write it ("DB10.DBD4", "0x6041:0"); ``tag`` is its name from a file of tags, a program
    or an SCD dictionary, empty for none. ``type`` is its type, empty if unknown. ``value`` is the value in ``unit``, or None if
    there is none; then ``data`` has the octets, or None. ``result`` is "ok", the name of the refusal ("Object does not exist"),
    "not answered", "answer not captured", or "unchanged" (a push without a new value). Texts are as on the wire, not escaped.
    """

    address: str
    tag: str
    type: str
    value: object
    unit: str
    result: str
    data: bytes | None

    @property
    def ok(self) -> bool:
        """True if the item succeeded."""
        return self.result in {OK, UNCHANGED}

    @property
    def name(self) -> str:
        """The tag, or the address if there is no tag."""
        return self.tag or self.address


def items_of(transaction: Transaction) -> list[TransactionItem]:
    """Return the items of a transaction in the order of the wire, refused ones included."""
    if transaction.is_plus:
        return [_plus_item(transaction, item) for item in transaction.plus_results]
    if transaction.is_scd:
        return _scd_items(transaction)
    found: list[TransactionItem] = []
    naming = transaction.connection.naming
    writes = transaction.function == WRITE_VAR
    for result in transaction.s7_results:
        said = _result(transaction, result)
        named = naming.named(result) if naming is not None else []
        if any(one.name for one in named):
            found += [_named(one, said) for one in named]
        else:
            found.append(_item(result, said, writes))
    return found


def _unanswered(transaction: Transaction) -> str:
    """Return the text for an item without an answer: the whole request was refused, or there is no answer."""
    errors = transaction.errors
    if errors:
        return str(errors[0].name)
    return NOT_CAPTURED if transaction.unseen or transaction.request_size == 0 else NOT_ANSWERED


def _result(transaction: Transaction, result: ItemResult) -> str:
    code = int(result.return_code)
    if result.unchanged:
        return UNCHANGED
    if code < 0:
        return _unanswered(transaction)
    return OK if code == SUCCESS else RETURN_CODES.name(code)


def _item(result: ItemResult, said: str, writes: bool) -> TransactionItem:
    item = result.item
    if item is None:
        return TransactionItem("", "", "", None, "", said, result.data)
    kind = TRANSPORT_SIZES.name(item.transport_size) if item.transport_size >= 0 else ""
    kind = f"{item.count} x {kind}" if kind and item.count > 1 else kind
    value = result.value if writes or said in {OK, UNCHANGED} else None
    return TransactionItem(item.address, "", kind, value, "", said, result.data)


def _named(named: NamedValue, said: str) -> TransactionItem:
    return TransactionItem(named.address, named.name, named.type, named.value, named.unit, said, named.data or None)


def _plus_item(transaction: Transaction, item: PlusItem) -> TransactionItem:
    variable = item.found.variable if item.found is not None else None
    kind = variable.datatype_name if variable is not None else item.value.type_name if item.value is not None else ""
    said = item.codes.name(item.return_code) if item.return_code > 0 else OK
    if item.return_code < 0:
        said = _unanswered(transaction)
    address = item.address.label if item.address is not None else item.label
    tag = item.label if item.found is not None else ""
    return TransactionItem(address, tag, kind, item.json_value, "", said, item.data)


def _scd_items(transaction: Transaction) -> list[TransactionItem]:
    """Return the values of the answer, or of the request, or the requested object if neither has values."""
    said = OK if transaction.outcome in {"answered", "unsolicited"} else _unanswered(transaction)
    if transaction.has_errors:
        said = _unanswered(transaction)
    messages = transaction.scd
    for message in reversed(messages):
        if message.values:
            return [
                TransactionItem(row.address, row.name, row.type, row.physical, row.unit, said, None)
                for row in message.values
            ]
    if not messages:
        return []
    from dissect.scd.wording import described

    asked = messages[0].message
    name, kind, unit = described(messages[0].dictionary, (asked.index, asked.sub))
    return [TransactionItem(f"0x{asked.index:04x}:{asked.sub}", name, kind, None, unit, said, None)]
