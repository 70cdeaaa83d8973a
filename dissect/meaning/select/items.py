"""Items for selections: address, type, value and return code of S7comm, S7comm-plus and SCD items in one form."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Final

from dissect.engine.transactions.naming import NamedValue, Naming
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.plus import DB_AREA, S7_AREAS
from dissect.meaning.select.literals import CodeValue, ItemPlace, place_of
from dissect.protocols.s7.items import Item, ItemResult
from dissect.protocols.s7.tables import (
    AREA_LETTERS,
    AREAS,
    BIT,
    DB_AREAS,
    ELEMENT_OCTETS,
    NUMBERED_AREAS,
    RECORD_AREA,
    RETURN_CODES,
    SUCCESS,
    TRANSPORT_SIZES,
)
from dissect.protocols.s7plus.ids import DATA_BLOCK
from dissect.protocols.s7plus.items import PlusItem
from dissect.scd.wording import Row, json_value

#: Maximum number of request items whose facts are remembered: polling repeats the same ones.
_MOST_KNOWN: Final = 8192
_UNKNOWN_ELEMENT: Final = 1
#: The name of an element of an array of one dimension. If an item covers all elements, the lowest index is in the tag's type
#: (`_ALL`); if it covers some, in the tag's name (`_SOME`).
_ELEMENT: Final = re.compile(r"(.+)\[(-?[0-9]{1,9})\]", re.DOTALL)
_ALL: Final = re.compile(r"Array\[(?P<low>-?[0-9]{1,9})\.\.-?[0-9]{1,9}\] of ")
_SOME: Final = re.compile(r"(?P<name>.+)\[(?P<low>-?[0-9]{1,9})\.\.-?[0-9]{1,9}\]", re.DOTALL)


class ItemFacts:
    """One item; attributes that it does not have are None.

    ``source`` is the `ItemResult`, `PlusItem`, SCD row or `NamedValue` that it was made from. ``naming`` knows the tags of its
    connection.
    """

    __slots__ = ("area", "count", "data", "db", "name", "naming", "place", "return_code", "source", "type", "unit")

    def __init__(self, source: ItemResult | PlusItem | Row | NamedValue, naming: Naming | None = None) -> None:
        self.source = source
        self.naming = naming
        self.place: ItemPlace | None = None
        self.area: CodeValue | None = None
        self.db: int | None = None
        self.type: CodeValue | None = None
        self.count: int | None = None
        self.return_code: CodeValue | None = None
        self.data: bytes | None = None
        self.name: str | None = None
        self.unit: str | None = None

    @property
    def values(self) -> list[object]:
        """Its value in the form of the JSON contract: one element, or those of an array; empty if it cannot be decoded."""
        source = self.source
        if isinstance(source, ItemResult):
            value: object = source.value
        elif isinstance(source, PlusItem):
            value = source.json_value
        elif isinstance(source, NamedValue):
            value = source.value
        else:
            value = json_value(source.physical)
        found: list[object] = []
        _flatten(value, found)
        return found

    @property
    def tags(self) -> list[NamedValue]:
        """The tags that the item covers, wholly or in part; empty if no tags are loaded."""
        if self.naming is None or not isinstance(self.source, ItemResult):
            return []
        return [named for named in self.naming.named(self.source) if named.name]

    def of_tag(self, name: str) -> ItemFacts | None:
        """Return the tag ``name`` that this item covers, or an element of an array, as an item; None if it is not covered."""
        tags = self.tags
        for named in tags:
            if named.name == name:
                return self._of(named)
        wanted = _ELEMENT.fullmatch(name)
        for named in tags if wanted is not None else ():
            element = _element(named, wanted[1], int(wanted[2])) if wanted is not None else None
            if element is not None:
                return self._of(element)
        return None

    def _of(self, named: NamedValue) -> ItemFacts:
        facts = ItemFacts(named)
        facts.area, facts.db, facts.return_code = self.area, self.db, self.return_code
        facts.place = place_of(named.address) or self.place
        facts.type = CodeValue(None, (named.type,)) if named.type else None
        facts.data = named.data or None
        facts.name, facts.unit = named.name, named.unit or None
        return facts


def _element(named: NamedValue, array: str, index: int) -> NamedValue | None:
    """Return element ``index`` of ``array`` if ``named`` contains it, else None."""
    whole = named.name == array
    covered = _ALL.match(named.type) if whole else _SOME.fullmatch(named.name)
    if covered is None or not isinstance(named.value, list) or not (whole or covered["name"] == array):
        return None
    at = index - int(covered["low"])
    if not 0 <= at < len(named.value):
        return None
    found = NamedValue(f"{array}[{index}]", "", named.type.rpartition(" ")[2])
    found.value, found.unit = named.value[at], named.unit
    return found


def _flatten(value: object, into: list[object]) -> None:
    if isinstance(value, list):
        for element in value:
            _flatten(element, into)
    elif isinstance(value, dict):
        for element in value.values():
            _flatten(element, into)
    elif value is not None:
        into.append(value)


class ItemReader:
    """Makes the items of transactions; remembers the facts of request items, and the items of the latest transaction."""

    def __init__(self) -> None:
        self._known: dict[Item, ItemFacts] = {}
        self._latest: Transaction | None = None
        self._facts: list[ItemFacts] = []

    def items(self, transaction: Transaction) -> list[ItemFacts]:
        """Return the items of a transaction: those of S7, then those of SCD."""
        if transaction is self._latest:
            return self._facts
        if transaction.is_plus:
            facts = [plus_facts(item) for item in transaction.plus_results]
        else:
            naming = transaction.connection.naming
            facts = [self.s7(result, naming) for result in transaction.s7_results]
        if transaction.is_scd or transaction._carried is not None:
            facts += [scd_facts(row) for found in transaction.scd for row in found.values]
        # A transaction without an outcome may still change, so its items are not remembered.
        self._latest = transaction if transaction._outcome else None
        self._facts = facts
        return facts

    def requested(self, items: Iterable[Item], naming: Naming | None) -> list[ItemFacts]:
        """Return the facts of the items of a request, without values."""
        if naming is None:
            return [self.asked(item) for item in items]
        return [self.s7(ItemResult(item, -1, None, None), naming) for item in items]

    def s7(self, result: ItemResult, naming: Naming | None = None) -> ItemFacts:
        """Return the facts of an item of S7comm."""
        facts = ItemFacts(result, naming)
        facts.data = result.data
        if result.return_code >= 0:
            code = int(result.return_code)
            facts.return_code = CodeValue(code, (RETURN_CODES.name(code),))
        item = result.item
        if item is not None:
            asked = self.asked(item)
            facts.place, facts.area, facts.db = asked.place, asked.area, asked.db
            facts.type, facts.count = asked.type, asked.count
        return facts

    def asked(self, item: Item) -> ItemFacts:
        """Return the facts of a request item; the same object for the same item."""
        facts = self._known.get(item)
        if facts is None:
            if len(self._known) >= _MOST_KNOWN:
                self._known.clear()
            facts = self._known[item] = _asked(item)
        return facts


def _asked(item: Item) -> ItemFacts:
    facts = ItemFacts(ItemResult(item, -1, None, None))
    area, size = int(item.area), int(item.transport_size)
    if size < 0:  # another syntax than S7ANY
        facts.place = ItemPlace(item.address, item.label)
        return facts
    count = int(item.count)
    bits = count
    if item.size >= 0:
        bits = int(item.size) * 8 if size != BIT else count
    elif size != BIT:
        bits = ELEMENT_OCTETS.get(size, _UNKNOWN_ELEMENT) * 8 * count
    if area in NUMBERED_AREAS:
        bits = count
    db = int(item.db) if area in DB_AREAS or area == RECORD_AREA else 0
    facts.place = ItemPlace(item.address, item.label, area, db, int(item.start_bit), bits)
    facts.area = area_code(area)
    facts.db = int(item.db) if area in DB_AREAS else None
    facts.type = CodeValue(size, (TRANSPORT_SIZES.name(size),))
    facts.count = count
    return facts


def area_code(area: int) -> CodeValue:
    """Return an area with its letters and its name."""
    letters = AREA_LETTERS.get(area)
    return CodeValue(area, (letters, AREAS.name(area)) if letters is not None else (AREAS.name(area),))


def plus_facts(item: PlusItem) -> ItemFacts:
    """Return the facts of an item of S7comm-plus."""
    facts = ItemFacts(item)
    facts.data = item.data
    if item.return_code == 0:
        facts.return_code = CodeValue(SUCCESS, (RETURN_CODES.name(SUCCESS),))
    elif item.return_code > 0:
        facts.return_code = CodeValue(item.return_code, (item.codes.name(item.return_code),))
    if item.value is not None:
        facts.type = CodeValue(None, (item.value.type_name,))
    address = item.address
    if address is None:
        return facts
    label = item.label
    db = address.area & 0xFFFF if address.area >> 16 == DATA_BLOCK else None
    area = DB_AREA if db is not None else S7_AREAS.get(address.area)
    facts.db = db
    facts.area = area_code(area) if area is not None else None
    facts.place = ItemPlace(label, label)
    if area is not None and address.start_bit >= 0:
        facts.place = ItemPlace(label, label, area, db or 0, address.start_bit, 8 * len(item.data) if item.data else 1)
    return facts


def scd_facts(row: Row) -> ItemFacts:
    """Return the facts of a value of SCD."""
    facts = ItemFacts(row)
    facts.place = ItemPlace(row.address, row.address)
    facts.name = row.name or None
    facts.unit = row.unit or None
    return facts
