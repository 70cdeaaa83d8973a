"""Names for the values in a transaction, from tags (`dissect.meaning.tags`) or from SCD (`dissect.meaning.bindings`).

Both produce a `NamedValue`; `named_values` returns those of a transaction, from any source.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7.tables import BYTE, WRITE_VAR
from dissect.protocols.s7.values import Value
from dissect.protocols.s7plus.program import Program
from dissect.wire.text import some

if TYPE_CHECKING:
    from dissect.engine.transactions.connection import Connection
    from dissect.engine.transactions.transaction import Transaction
    from dissect.protocols.s7.items import ItemResult

#: The origin of a name (`NamedValue.origin`).
TAG: Final = "tag"
SCD: Final = "scd"


class NamedValue:
    """A value with its name, from a file of tags or an SCD dictionary.

    ``address`` is where the value is ("DB10.DBD4", "0x6041:0"), ``offset`` its first octet within the item. ``type`` is the
    declared type ("REAL"), ``origin`` is `TAG` or `SCD`. ``value`` is the value in ``unit``, scaled if the file gives a scale,
    and ``raw`` the value on the wire; both are None if there is no value: then ``data`` has the octets and ``remark`` says why.
    ``text`` is the dictionary's text for the value. ``whole`` is False for a part of a variable. ``name`` is empty for octets
    of an item without a name. Texts are as in the file or on the wire, not escaped.
    """

    __slots__ = (
        "address",
        "comment",
        "data",
        "name",
        "offset",
        "origin",
        "raw",
        "remark",
        "text",
        "type",
        "unit",
        "value",
        "whole",
    )

    def __init__(self, name: str, address: str, type_: str, origin: str = TAG) -> None:
        self.origin: str = origin
        self.name: str = name
        self.address: str = address
        self.offset: i64 = 0
        self.type: str = type_
        self.value: Value = None
        self.raw: Value = None
        self.unit: str = ""
        self.text: str = ""
        self.comment: str = ""
        self.remark: str = ""
        self.data: bytes = b""
        self.whole: bool = True

    def __repr__(self) -> str:
        return f"NamedValue({self.name!r}, {self.value!r}, {self.unit!r})"


@mypyc_attr(allow_interpreted_subclasses=True)
class Naming:
    """Gives names for the addresses of CPUs; `of` chooses the names for a connection when that is recognised."""

    def of(self, connection: Connection) -> Naming | None:
        """Return the object with the names for a connection, None if there are no names."""
        return self

    def program(self, host: str) -> Program | None:
        """Return the variables known for the CPU at ``host``, for S7comm-plus; None if there are none."""
        return None

    def named(self, result: ItemResult) -> list[NamedValue]:
        """Return the values of an item in the order of their octets, with and without names; empty if none has a name."""
        return []


#: Limits of a subject: items and tags that it names, and octets, elements and characters that it shows of a value.
_NAMED: Final = 3
_OCTETS: Final = 8
_ELEMENTS: Final = 8
_TEXT: Final = 32


def subject(transaction: Transaction) -> str:
    """Return the request as text: the function and its items, with values for a write.

    For a read without tags this is `Parameters.subject`. Texts of the file and the wire are not escaped.
    """
    parameters = transaction.parameters
    writes = parameters.function == WRITE_VAR
    if not parameters.items or (transaction.connection.naming is None and not writes):
        return parameters.subject
    return f"{parameters.function_name} {items_said(transaction.connection.naming, transaction.s7_results, writes)}"


def items_said(naming: Naming | None, results: list[ItemResult], writes: bool, most: int = _NAMED) -> str:
    """Return the first ``most`` items as text, each by its tags or its address and length; with values if ``writes`` is set."""
    said: list[str] = []
    for result in results:
        said += _item_said(naming, result, writes)
    return some(said, most)


def item_subject(transaction: Transaction, number: int, address: str) -> str:
    """Return an item as text, as in `subject`; return ``address`` if ``transaction.s7_results`` does not contain it.

    ``number`` is its place in ``transaction.s7_results``, counted from 1. Texts are not escaped.
    """
    results = transaction.s7_results
    if not 0 < number <= len(results):
        return address
    writes = transaction.parameters.function == WRITE_VAR
    return items_said(transaction.connection.naming, results[number - 1 : number], writes) or address


def _item_said(naming: Naming | None, result: ItemResult, writes: bool) -> list[str]:
    """Return an item as texts: each of its tags, or its address and length; with the value for a write."""
    names = [value for value in naming.named(result) if value.name] if naming is not None else []
    if names:
        return [_said(value, writes) for value in names]
    item = result.item
    if item is None:
        return []
    data = result.data
    if not writes or data is None:
        return [item.label]
    value = None if item.transport_size == BYTE and len(data) != 1 else result.value
    text = _value_said(value, data)
    return [f"{item.label} = {text}" if text else item.label]


def _said(named: NamedValue, writes: bool) -> str:
    return written(named) if writes else f"{named.name} ({named.address})"


def written(named: NamedValue) -> str:
    """Return a tag with its written value as text: ``Tank.Setpoint = 80.0 °C (DB1.DBD4)``."""
    text = _value_said(None if isinstance(named.value, list) else named.value, named.data)
    unit = f" {named.unit}" if named.unit and named.value is not None else ""
    return f"{named.name} = {text}{unit} ({named.address})" if text else f"{named.name} ({named.address})"


def _value_said(value: Value, data: bytes) -> str:
    """Return a value as short text: ``data`` in hexadecimal if it is None, the beginning of a text or a list."""
    if value is None:
        return data[:_OCTETS].hex(" ") + (" …" if len(data) > _OCTETS else "")
    if isinstance(value, list):
        more = ", …" if len(value) > _ELEMENTS else ""
        size = len(data) // len(value) if value else 0
        said = [_value_said(one, data[at * size : (at + 1) * size]) for at, one in enumerate(value[:_ELEMENTS])]
        return f"[{', '.join(said)}{more}]"
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return f"'{value[:_TEXT]}{'…' if len(value) > _TEXT else ''}'"
    return str(value)


def named_items(transaction: Transaction) -> list[list[NamedValue]]:
    """Return the named values of each item of ``transaction.s7_results``, in its order; empty without tags."""
    naming = transaction.connection.naming
    if naming is None:
        return []
    return [naming.named(result) for result in transaction.s7_results]


def plain(value: object) -> Value:
    """Return an SCD value as an S7 value: numbers, booleans and texts stay, everything else becomes a text."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return value.hex(" ") if isinstance(value, bytes) else str(value)


def named_values(transaction: Transaction) -> list[tuple[int, NamedValue]]:
    """Return every value of a transaction that has a name: first those with tags, item by item, then those of SCD.

    Each is a pair with the number of its item, counted from 1, or 0 for SCD.
    """
    found: list[tuple[int, NamedValue]] = []
    for number, values in enumerate(named_items(transaction), 1):
        found += [(number, named) for named in values if named.name]
    for message in transaction.scd:
        for row in message.values:
            value = NamedValue(row.name, row.address, "", SCD)
            value.value = plain(row.physical)
            value.raw = plain(row.value)
            value.unit = row.unit
            value.text = row.text
            value.remark = ", ".join(row.flags)
            found.append((0, value))
    return found
