"""The writes in a request: variables, attributes of objects, orders to the CPU, lists of subscriptions.

For a sound request the check gives the places of addresses and values. Values are read, and texts made, when they are needed.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64, mypyc_attr

from dissect.protocols.s7plus.check import Check
from dissect.protocols.s7plus.contents import VariableAddress, known_address
from dissect.protocols.s7plus.cursor import Cursor, table
from dissect.protocols.s7plus.event import (
    CONFIRMED,
    LISTED,
    ORDERED,
    PASSWORD,
    RESET,
    START,
    STOP,
    STREAMED,
    WRITTEN,
    WRITTEN_OUTPUTS,
    Event,
)
from dissect.protocols.s7plus.ids import AREAS, BLOCK_KINDS, PASSWORDS, PROTECTIONS
from dissect.protocols.s7plus.loads import CONSISTENT, FIRMWARE_PACKAGE, HARDWARE, written_as
from dissect.protocols.s7plus.objects import Attribute, numbers_at
from dissect.protocols.s7plus.pieces import addresses_of, is_asked_for
from dissect.protocols.s7plus.plain import REQUEST_SIZE
from dissect.protocols.s7plus.program_tables import STATE_REQUESTS
from dissect.protocols.s7plus.session import (
    ASKED_OF_OBJECTS,
    CPU_EXEC_UNIT,
    REFERENCE_LIST,
    SESSION_KEY,
    STATE_REQUEST,
    PlusSession,
    parse_reference_list,
)
from dissect.protocols.s7plus.states import number_in
from dissect.protocols.s7plus.tables import REQUEST, SET_VARIABLE
from dissect.protocols.s7plus.value_showing import value_with_type
from dissect.protocols.s7plus.values import Value
from dissect.protocols.s7plus.walk import MAX_WORK

#: The attributes whose values are read if they are written.
WANTED: Final = table(ASKED_OF_OBJECTS)
#: For a write of one attribute: the highest id that is an area, the execution unit or the hardware configuration; the lowest
#: kind of block; and, by id, whether writing that attribute of any other object matters.
_LASTING_IDS: Final = PASSWORDS | PROTECTIONS | {REFERENCE_LIST}
_LAST_AREA: Final = max(*AREAS, CPU_EXEC_UNIT)
_SPECIAL: Final = frozenset((*AREAS, CPU_EXEC_UNIT, HARDWARE, FIRMWARE_PACKAGE))
_FIRST_KIND: Final = min(BLOCK_KINDS)
_LASTING: Final = bytes([id_ in _LASTING_IDS for id_ in range(8192)])
#: Meaning of a state request, unless it requests RUN.
_ORDERS: Final = {1: STOP, 2: RESET}
#: Writes to areas of the memory and to data blocks.
_WRITES: Final = frozenset((WRITTEN, WRITTEN_OUTPUTS))
#: Areas of the outputs.
OUTPUTS: Final = frozenset((81,))
#: Maximum number of variables that a text names.
NAMED: Final = 5
#: A request up to this size is always read within `MAX_WORK`.
SHORT: Final = MAX_WORK // 4


@mypyc_attr(acyclic=True)
class Write(Event):
    """A write of variables of one kind with one result. Its text names the first of them, and is made at the first access."""

    __slots__ = ("_items", "_session", "count")

    def __init__(self, kind: str, session: PlusSession, address: VariableAddress, value: Attribute | None) -> None:
        super().__init__(kind, "")
        self._session = session
        self._items: list[tuple[VariableAddress, Attribute | None]] = [(address, value)]
        self.count = 1

    @property
    def text(self) -> str:
        """The written variables, as text."""
        if not self._text:
            more = f" and {self.count - NAMED} more" if self.count > NAMED else ""
            self._text = f"{', '.join([self._said(address, value) for address, value in self._items])}{more}"
        return self._text

    def _said(self, address: VariableAddress, value: Attribute | None) -> str:
        label = self._session.label(address)
        return f"{label} = {value_with_type(value.value)}" if value is not None else label

    def add(self, other: Write) -> None:
        """Add the variables of ``other``."""
        self.count += 1
        if self.count <= NAMED:
            self._items += other._items


def matters(object_id: i64, first: i64) -> bool:
    """Return whether a write of one attribute of an object matters; ``first`` is the first of its ids."""
    if object_id <= _LAST_AREA and object_id in _SPECIAL:
        return True
    kind: i64 = object_id >> 16
    if kind >= _FIRST_KIND and kind in BLOCK_KINDS:
        return True
    return 0 <= first < len(_LASTING) and _LASTING[first] != 0


def first_id(asked: Check) -> i64:
    """Return the first id of the attribute that a sound SetVariable writes, -1 for none."""
    cursor = Cursor(asked.data, asked.place, asked.end)
    if cursor.number() <= 0:
        return -1
    return cursor.number()


def is_plain(asked: Check, function: i64) -> bool:
    """Return whether a SetVariable or SetMultiVariables is sound and not too long, so that `take_write` judges it."""
    return asked.sound and asked.function == function and asked.opcode == REQUEST and asked.end <= asked.begin + SHORT


def take_write(session: PlusSession, events: list[Event], asked: Check, answered: bool, good: bool) -> None:
    """Judge such a write; ``answered``: its answer is sound and refuses no single item; ``good``: nor the whole request."""
    if asked.function == SET_VARIABLE:
        ids = numbers_at(asked.data, asked.place, asked.end)
        if ids:
            value = Attribute(0, None, asked.data, int(asked.valued), int(asked.end))
            judge_write(session, events, int(asked.object_id), ids, value, False, good)
        return
    addresses = addresses_of(asked.data[asked.begin + REQUEST_SIZE : asked.place])
    values: dict[int, Attribute] = {}
    end = int(asked.end)
    places = asked.places()
    for at in range(0, len(places), 2):
        number = places[at]
        if 0 < number <= len(addresses) and is_asked_for(WANTED, addresses[number - 1]):
            values[number] = Attribute(0, None, asked.data, places[at + 1], end)
    judge_writes(session, events, addresses, values, {}, answered, good)


def judge_writes(
    session: PlusSession,
    events: list[Event],
    addresses: list[VariableAddress],
    values: dict[int, Attribute],
    refused: dict[int, int],
    answered: bool,
    good: bool,
) -> None:
    """Judge a write of several items, each by its own result; writes to one kind of area with one result are one event.

    ``values`` and ``refused`` (the codes of refusals) are by the number of the item.
    """
    writes: dict[tuple[str, int], Write] = {}
    for index, address in enumerate(addresses):  # with a second argument it would be called as an object (mypyc)
        number = index + 1
        before = len(events)
        refusal = refused.get(number, 0)
        _item_written(session, events, address, values.get(number), good and not refusal)
        if refusal or answered:
            for event in events[before:]:
                event.refusal = refusal
        if len(events) == before:
            continue
        last = events[-1]
        if isinstance(last, Write):
            first = writes.get((last.kind, last.refusal))
            if first is None:
                writes[last.kind, last.refusal] = last
            else:
                events.pop()
                first.add(last)


def _item_written(
    session: PlusSession, events: list[Event], address: VariableAddress, value: Attribute | None, good: bool
) -> None:
    last = address.lids[-1] if address.lids else address.sub_area
    if last in PASSWORDS:
        events.append(Event(PASSWORD, ""))
    elif last == SESSION_KEY:
        session.authenticated = session.authenticated or good
    elif last == REFERENCE_LIST and value is not None and good:
        _listed(session, events, address.area, value.numbers())
    elif last == STATE_REQUEST and address.area == CPU_EXEC_UNIT and value is not None:
        events.append(_state_requested(value.value))
    else:
        _write(session, events, address, value)


def _listed(session: PlusSession, events: list[Event], object_id: int, numbers: list[int]) -> None:
    """A subscription gets a new or longer list of variables: some tools create it first and fill it later."""
    told = parse_reference_list(numbers)
    session.change(object_id, told)
    labels = [session.label(address) for _, address in told[2][:NAMED]]
    if labels:
        events.append(Event(LISTED, ", ".join(labels), object_id))


def _write(session: PlusSession, events: list[Event], address: VariableAddress, value: Attribute | None) -> None:
    kind, text = written_as(address)
    if kind:
        events.append(Event(kind, text, address.area))
        return
    if address.area not in AREAS and address.area >> 16 not in BLOCK_KINDS:
        if (
            address.area == HARDWARE
            and address.sub_area == CONSISTENT
            and value is not None
            and value.value.content is True
        ):
            events.append(Event(CONFIRMED, "", address.area))
        return
    events.append(Write(WRITTEN_OUTPUTS if address.area in OUTPUTS else WRITTEN, session, address, value))


def judge_write(
    session: PlusSession,
    events: list[Event],
    object_id: int,
    ids: list[int],
    value: Attribute | None,
    streamed: bool,
    good: bool,
) -> None:
    """Judge a write of one variable or attribute; ``streamed``: as a stream."""
    if streamed:
        events.append(Event(STREAMED, session.label(VariableAddress(0, object_id, ids[0], ids[1:])), object_id))
    if ids[-1] in PASSWORDS:
        events.append(Event(PASSWORD, ""))
    elif ids[0] == REFERENCE_LIST and value is not None and good:
        _listed(session, events, object_id, value.numbers())
    elif object_id == CPU_EXEC_UNIT and ids == [STATE_REQUEST] and value is not None:
        events.append(_state_requested(value.value))
    else:
        _write(session, events, known_address(0, object_id, ids[0], ids[1:]), value)


def _state_requested(value: Value) -> Event:
    """Return the event for a requested operating state; a value without a name has a meaning only to the CPU."""
    number = number_in(value)
    row = STATE_REQUESTS.get(number)
    if row is None:
        return Event(ORDERED, f"operating state request {value_with_type(value)} (unknown)")
    return Event(_ORDERS.get(number, START), f"operating state request {number} {row.name}")
