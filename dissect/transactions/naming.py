"""Names for what stands at an address: the seam between what is read or written and those who know what it is called.

Tags (`dissect.tags`) and SCD (`dissect.bindings`) answer the same question: which values with which names a transaction
carries. Both answer it with `NamedValue`: outputs ask `named_values` and do not care who knew.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64, mypyc_attr

from dissect.s7.tables import WRITE_VAR
from dissect.s7.values import Value
from dissect.s7plus.program import Program

if TYPE_CHECKING:
    from dissect.s7.items import ItemResult
    from dissect.transactions.connection import Connection
    from dissect.transactions.transaction import Transaction

#: Who knew the name.
TAG: Final = "tag"
SCD: Final = "scd"


class NamedValue:
    """A value with its name, as a file of tags or an SCD dictionary knows them.

    ``address`` is where the value stands ("DB10.DBD4", "0x6041:0"), ``offset`` its first octet within the item. ``type`` is
    the declared type ("REAL"), ``origin`` who knew the name. ``value`` is the value in ``unit``, scaled where the file gives a
    scale, and ``raw`` the one on the wire; None where there is none: then ``data`` has the octets and ``remark`` says why.
    ``text`` is what a dictionary calls the value. ``whole`` is False for a part of a variable. ``name`` is empty for octets of
    an item that no name stands for. Texts are as in the file or on the wire, not escaped.
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
    """Who knows names for addresses of the CPUs of one connection; `of` chooses them when the connection is recognised."""

    def of(self, connection: Connection) -> Naming | None:
        """Return who knows names on a connection, None when nobody does."""
        return self

    def program(self, host: str) -> Program | None:
        """Return the variables that are known of the CPU at ``host`` for S7comm-plus, None for none."""
        return None

    def named(self, result: ItemResult) -> list[NamedValue]:
        """Return the values of an item in the order of its octets, those without a name included; empty for no name at all."""
        return []


#: Items and tags that a subject names, octets of a value without a name, and characters of a text.
_NAMED: Final = 3
_OCTETS: Final = 8
_TEXT: Final = 32


def subject(transaction: Transaction) -> str:
    """Return what is asked, for a person: the function and what its items are about; of a write with the values.

    Without tags it is `Parameters.subject`. Texts of the file and the wire are not escaped.
    """
    parameters = transaction.parameters
    if transaction.connection.naming is None or not parameters.items:
        return parameters.subject
    writes = parameters.function == WRITE_VAR
    said: list[str] = []
    for result, named in zip(transaction.results(), named_items(transaction), strict=True):
        names = [value for value in named if value.name]
        item = result.item
        if names:
            said.extend([_said(value, writes) for value in names])
        elif item is not None:
            said.append(item.address)
    more = f" and {len(said) - _NAMED} more" if len(said) > _NAMED else ""
    return f"{parameters.function_name} {', '.join(said[:_NAMED])}{more}"


def item_subject(transaction: Transaction, number: int, address: str) -> str:
    """Return what an item is about, for a person: its tags where it has some, of a write with the values, else ``address``.

    ``number`` is that of the item in ``transaction.results()``, counted from 1. Texts are not escaped.
    """
    naming = transaction.connection.naming
    results = transaction.results() if naming is not None else []
    if naming is None or not 0 < number <= len(results):
        return address
    writes = transaction.parameters.function == WRITE_VAR
    names = [value for value in naming.named(results[number - 1]) if value.name]
    if not names:
        return address
    more = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join([_said(value, writes) for value in names[:_NAMED]]) + more


def _said(named: NamedValue, writes: bool) -> str:
    return written(named) if writes else f"{named.name} ({named.address})"


def written(named: NamedValue) -> str:
    """Return a tag with the value that is written to it: ``Tank.Setpoint = 80.0 °C (DB1.DBD4)``."""
    value = named.value
    if value is None or isinstance(value, list):
        text = named.data[:_OCTETS].hex(" ") + (" …" if len(named.data) > _OCTETS else "")
    elif isinstance(value, bool):
        text = "true" if value else "false"
    elif isinstance(value, str):
        text = f"'{value[:_TEXT]}{'…' if len(value) > _TEXT else ''}'"
    else:
        text = str(value)
    unit = f" {named.unit}" if named.unit and value is not None else ""
    return f"{named.name} = {text}{unit} ({named.address})" if text else f"{named.name} ({named.address})"


def named_items(transaction: Transaction) -> list[list[NamedValue]]:
    """Return what tags make of each item of ``transaction.results()``, in its order; empty without tags."""
    naming = transaction.connection.naming
    if naming is None:
        return []
    return [naming.named(result) for result in transaction.results()]


def plain(value: object) -> Value:
    """Return a value of SCD as the values of S7 are: what is no number, truth value or text becomes a text."""
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return value.hex(" ") if isinstance(value, bytes) else str(value)


def named_values(transaction: Transaction) -> list[tuple[int, NamedValue]]:
    """Return every value of a transaction that has a name: by tags, item by item, then those of SCD.

    In front of each is the number of its item, counted from 1, or 0 for SCD.
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
