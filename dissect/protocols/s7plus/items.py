"""The items of a transaction, for all functions: address, value, and result."""

from __future__ import annotations

from typing import Final

from dissect.protocols.s7plus.contents import Contents, VariableAddress
from dissect.protocols.s7plus.ids import HIDDEN, is_secret
from dissect.protocols.s7plus.message import PlusPdu
from dissect.protocols.s7plus.objects import every_object
from dissect.protocols.s7plus.packed_values import misfit, packed_members
from dissect.protocols.s7plus.program import AddressMeaning, Program, symbol
from dissect.protocols.s7plus.program_times import long_date_text, long_duration
from dissect.protocols.s7plus.program_values import contradiction, program_value, program_values
from dissect.protocols.s7plus.session import REFERENCE_LIST, SUBSCRIPTION, PlusSession, parse_reference_list
from dissect.protocols.s7plus.summary import references_text, single_address
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    NOTIFICATION,
    NOTIFIED,
    RETURN_CODES,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_showing import as_json, in_line, meant, members_said, octets_text
from dissect.protocols.s7plus.value_tables import TIMESPAN, TIMESTAMP, WSTRING
from dissect.protocols.s7plus.values import Packed, Value
from dissect.wire.codes import CodeTable

READS: Final = frozenset((GET_MULTI_VARIABLES, GET_VARIABLE, GET_VAR_SUBSTREAMED))
WRITES: Final = frozenset((SET_MULTI_VARIABLES, SET_VARIABLE, SET_VAR_SUBSTREAMED))
_READS_OR_WRITES: Final = READS | WRITES

#: Number of elements of an array that are shown.
_SHOWN: Final = 8
_NO_VALUE: Final[list[Value | None]] = [None]
#: Return values from here on are refusals.
_NEGATIVE: Final = 0x8000


class PlusItem:
    """One item. ``number`` counts from 1; in a notification it is the reference.

    ``return_code`` is 0 if all is well, -1 if there is no answer for it; else the lower 16 bits of a return value, or in a
    notification 0x13 or 0x03. ``codes`` names it. ``found`` is the name in the program, if that was captured. A value that
    contradicts its declaration is shown as octets: then ``fits`` is False, and ``note`` describes the contradiction. ``note``
    also states that the checksum of the symbol differs, or that the answer lacks the item, or has it although it was not
    requested. A number that occurs several times gives several items.
    """

    __slots__ = ("address", "codes", "data", "fits", "found", "note", "number", "program", "return_code", "value")

    def __init__(self, number: int, address: VariableAddress | None, value: Value | None, return_code: int) -> None:
        self.number = number
        self.address = address
        self.value = value
        self.return_code = return_code
        self.codes: CodeTable = RETURN_CODES
        self.data: bytes | None = None
        self.fits = True
        self.found: AddressMeaning | None = None
        self.program: Program | None = None
        self.note = ""

    @property
    def label(self) -> str:
        """The address as people write it; text from the wire is not escaped."""
        address = self.address
        if address is None:
            return f"item {self.number}"
        return symbol(address, self.found) if self.found is not None else address.label

    @property
    def text(self) -> str:
        """The value as a short text, empty if there is none."""
        if self.value is None:
            return ""
        if not self.fits:
            return octets_text(self.data) if self.data is not None else ""
        if self.is_plain:
            return self._references() or in_line(self.value, self._last_id)
        text = self._program_value()
        if text is not None:
            variable = self.found.variable if self.found is not None else None
            return f"{variable.datatype_name if variable is not None else 'DTL'} {text!r}"
        members = self._members()
        if members is not None:
            return f"Struct {members_said(members)}"
        elements = self._elements()
        if elements is not None and self.found is not None and self.found.variable is not None:
            shown = [str(one) for one in elements[:_SHOWN]]
            more = " …" if len(elements) > _SHOWN else ""
            return f"{self.found.variable.datatype_name}[{len(elements)}] {', '.join(shown)}{more}"
        return in_line(self.value, self._last_id)

    @property
    def meaning(self) -> str:
        """The meaning of a value that is a code or a time; empty if it has none."""
        value = self.value
        if value is None or not self.is_plain:
            return ""
        content = value.content
        if isinstance(content, int):
            if value.type == TIMESTAMP:
                return long_date_text(content) or ""
            if value.type == TIMESPAN:
                return long_duration(content)
        return meant(content, self._last_id)

    @property
    def json_value(self) -> object:
        """The value as JSON-ready data; None if there is none or it contradicts its declaration."""
        if not self.fits:
            return None
        if self.value is not None and self.is_plain:
            return as_json(self.value)
        text = self._program_value()
        if text is not None:
            return text
        if self.value is None:
            return None
        members = self._members()
        content = self.value.content
        if members is not None and isinstance(content, Packed):
            return {"id": content.id, "time": content.time, "octets": content.octets.hex(), "members": members}
        elements = self._elements()
        return elements if elements is not None else as_json(self.value)

    @property
    def is_plain(self) -> bool:
        """True if the program has no information about the value."""
        return self.found is None and self.value is not None and not isinstance(self.value.content, Packed)

    def _references(self) -> str:
        """Return what a subscription gets or loses by its new reference list; empty for any other value."""
        listed = self.value is not None and self._last_id == REFERENCE_LIST
        return references_text(self.value, self._called) if self.value is not None and listed else ""

    def _called(self, address: VariableAddress) -> str:
        found = self.program.find(address) if self.program is not None else None
        return symbol(address, found) if found is not None else address.label

    @property
    def _last_id(self) -> int:
        """The id of the attribute or member that the item represents, 0 if unknown."""
        address = self.address
        if address is None:
            return 0
        return address.lids[-1] if address.lids else address.sub_area

    def _program_value(self) -> str | None:
        if self.value is None or self.program is None:
            return None
        return program_value(self.found, self.value)

    def _members(self) -> dict[str, object] | None:
        """Return the members of a structure of the program by name."""
        content = self.value.content if self.value is not None else None
        if self.program is None or not isinstance(content, Packed):
            return None
        return packed_members(content, self.program)

    def _elements(self) -> list[str | None] | None:
        """Return the elements of an array as they are declared."""
        return program_values(self.found, self.value) if self.value is not None else None

    def understand(self, program: Program) -> None:
        """Apply the declarations of the program: the name of the item, and whether its value fits."""
        address = self.address
        if address is None:
            return
        self.program = program
        self.found = program.find(address)
        if self.found is None:
            self.note = program.doubt(address) or self.note
        elif self.value is not None:
            content = self.value.content
            wrong = contradiction(self.found, self.value, program)
            if not wrong and isinstance(content, Packed) and misfit(content, program):
                wrong = "its bytes do not fit the declaration"
            if wrong:
                self.note = f"{wrong}; its address is that of {symbol(address, self.found)}"
                self.fits = False
                self.found = None


class Half:
    """A request, a response or a notification with its contents."""

    __slots__ = ("contents", "pdu")

    def __init__(self, pdu: PlusPdu, contents: Contents) -> None:
        self.pdu = pdu
        self.contents = contents


def join_items(asked: Half | None, told: Half | None, session: PlusSession | None) -> list[PlusItem]:
    """Join the items of a request with those of its response; empty for functions that neither read nor write."""
    items: list[PlusItem] = []
    if asked is None and told is not None and told.pdu.opcode == NOTIFICATION:
        items = _notified(told, session)
    elif asked is not None and asked.pdu.function == CREATE_OBJECT:
        items = _subscriptions(asked, told)
    elif asked is not None and asked.pdu.function in _READS_OR_WRITES:
        items = _joined(asked, told if told is not None and told.pdu.function == asked.pdu.function else None)
    for item in items:
        address = item.address
        if address is None:
            continue
        if session is not None:
            item.understand(session.program)
        if item.value is not None and is_secret(address.lids[-1] if address.lids else address.sub_area):
            item.value = Value(0, WSTRING, HIDDEN)  # the answer to a read does not name the attribute
            item.data = None
            item.note = ""
            item.fits = True
    return items


def _subscriptions(asked: Half, told: Half | None) -> list[PlusItem]:
    """Return the items of new subscriptions, by reference; they come without values."""
    code = told.pdu.return_code if told is not None and told.pdu.function == CREATE_OBJECT else -1
    if 0 < code < _NEGATIVE:
        code = 0
    items: list[PlusItem] = []
    for one in every_object(asked.contents.objects):
        if one.class_id == SUBSCRIPTION:
            _, _, added = parse_reference_list(one.numbers(REFERENCE_LIST))
            items += [PlusItem(reference, address, None, code) for reference, address in added]
    return items


def _joined(asked: Half, told: Half | None) -> list[PlusItem]:
    address = single_address(asked.contents)
    whole = told.pdu.return_code if told is not None else -1
    if 0 < whole < _NEGATIVE:
        whole = 0  # not a refusal of the whole request; some items may be refused
    writes = asked.pdu.function in WRITES
    if address is not None:
        item = PlusItem(1, address, asked.contents.value if writes else None, whole)
        if writes:
            item.data = _data(item.value, asked)
        elif told is not None and whole == 0:
            item.value = told.contents.value
            item.data = _data(item.value, told)
        return [item]
    source = asked if writes else (told if whole == 0 else None)
    known = asked.contents.addresses
    items: list[PlusItem] = []
    if (
        source is not None
        and _in_order(source.contents, len(known))
        and not (told is not None and told.contents.refusals)
    ):
        for number, one in source.contents.items:  # the usual case
            item = PlusItem(number, known[number - 1], one, whole)
            item.data = _data(one, source)
            items.append(item)
        return items
    values: dict[int, list[Value | None]] = {}
    for index, sent in source.contents.items if source is not None else []:
        values.setdefault(index, []).append(sent)  # an item that occurs twice is shown twice
    refusals = dict(told.contents.refusals) if told is not None else {}
    for number in sorted({*range(1, len(known) + 1), *values, *refusals}):
        code = refusals[number] & 0xFFFF if number in refusals else whole
        for value in values.get(number, _NO_VALUE):
            item = PlusItem(number, known[number - 1] if 0 < number <= len(known) else None, value, code)
            if not writes and value is None and code == 0:
                item.return_code = -1
                item.note = "the answer holds neither a value nor a refusal"
            if item.address is None:
                item.note = "the request has no such item"
            item.data = _data(value, source)
            items.append(item)
    return items


def _in_order(contents: Contents, count: int) -> bool:
    """Return whether there are ``count`` values, numbered from 1."""
    index = 0
    for number, _ in contents.items:
        index += 1
        if number != index:
            return False
    return index == count


def _notified(told: Half, session: PlusSession | None) -> list[PlusItem]:
    subscription = told.pdu.subscription_id
    items: list[PlusItem] = []
    for reference, value in told.contents.items:
        item = PlusItem(reference, _subscribed(session, subscription, reference), value, 0)
        item.data = _data(value, told)
        items.append(item)
    for reference, kind in told.contents.refusals:
        item = PlusItem(reference, _subscribed(session, subscription, reference), None, kind)
        item.codes = NOTIFIED
        items.append(item)
    return items


def _subscribed(session: PlusSession | None, subscription: int, reference: int) -> VariableAddress | None:
    return session.address_of(subscription, reference) if session is not None else None


def _data(value: Value | None, half: Half | None) -> bytes | None:
    """Return the octets of a value after its flags and type."""
    if value is None or half is None or value.end == 0:
        return None
    return half.pdu.data[value.offset + 2 : value.end]
