"""Finds security events in requests and responses, and what these tell about client, CPU and subscriptions.

`take` gets all transactions except most reads. A few octets show whether there is anything to read; only then are the contents
parsed.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.protocols.s7plus import layouts
from dissect.protocols.s7plus.bodies import parse_contents
from dissect.protocols.s7plus.check import Check, check
from dissect.protocols.s7plus.contents import Contents, Made, VariableAddress
from dissect.protocols.s7plus.event import (
    DELETED,
    READ_OUT,
    REMOVED,
    REPLAYED,
    RUNNING,
    SEQUENCE_BEGUN,
    SEQUENCE_ENDED,
    SESSION,
    STOPPED,
    SUBSCRIBED,
    SUBSCRIBED_ALARMS,
    TEST_JOB,
    Event,
    Facts,
)
from dissect.protocols.s7plus.identification import IDENTIFICATION
from dissect.protocols.s7plus.ids import block_name
from dissect.protocols.s7plus.loads import (
    CONTAINERS,
    FIRMWARE,
    FIRMWARE_PACKAGE,
    LOADED,
    load_text,
    said,
)
from dissect.protocols.s7plus.message import PlusPdu, parse_plus
from dissect.protocols.s7plus.objects import Attribute, PlusObject, every_object
from dissect.protocols.s7plus.plain import REQUEST_SIZE, data_of
from dissect.protocols.s7plus.program import CODE
from dissect.protocols.s7plus.program_tables import OPERATING_STATES
from dissect.protocols.s7plus.read_objects import read_objects
from dissect.protocols.s7plus.reads import Reads
from dissect.protocols.s7plus.session import (
    CPU_PROXY,
    CYCLE,
    DIAGNOSIS,
    IN_VARIABLE,
    NAME,
    OPERATING_MODE,
    OPERATING_STATE,
    SERVER_SESSION,
    SUBSCRIPTION,
    PlusSession,
    is_state,
    reference_lists_of,
)
from dissect.protocols.s7plus.states import state_in
from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    FUNCTIONS,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    REQUEST,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
    V3,
)
from dissect.protocols.s7plus.value_reading import read_value
from dissect.protocols.s7plus.values import Blob, Value
from dissect.protocols.s7plus.walk import MAX_WORK, Walk, Wanted
from dissect.protocols.s7plus.writes import (
    NAMED,
    SHORT,
    WANTED,
    first_id,
    is_plain,
    judge_write,
    judge_writes,
    matters,
    take_write,
)
from dissect.wire.octets import u32
from dissect.wire.varint import VLQ, build_varint

_ALARM_SUBSCRIPTION: Final = 2662
#: Class of a job of the test functions, with which an engineering tool watches a running program. The classes of other jobs
#: (watch and force tables, breakpoints) are unknown.
_TEST_JOB: Final = 2709
_STATES: Final = {4: STOPPED, 8: RUNNING}
_STATE_NAMES: Final = {state: OPERATING_STATES.name(state) for state in _STATES}

# Marks of a read that may matter: the ids of the operating state and the identification record.
_READ_MARKS: Final = tuple([build_varint(id_, VLQ) for id_ in (OPERATING_STATE, DIAGNOSIS, IDENTIFICATION)])
#: Functions whose responses only state whether they were carried out.
_WRITING: Final = frozenset((DELETE_OBJECT, SET_VARIABLE, SET_MULTI_VARIABLES, SET_VAR_SUBSTREAMED))
#: The contents of a sound response of these functions.
_WRITTEN: Final = Contents(V3, -1, {})
_WRITTEN.whole = True
_BIT_7: Final = 0x80


def take(
    session: PlusSession,
    function: i64,
    request: bytes,
    response: bytes,
    told: Check | None = None,
    read: Reads | None = None,
) -> Facts | None:
    """Take a transaction: the octets of its halves (empty if missing) and its function, -1 for a notification. Never raises.

    ``told`` is the check of the response, ``read`` the result of the check of a read request; None if they were not checked.
    Returns None if nothing in the transaction matters.
    """
    if told is None and len(response) > 0:
        told = check(response)
    if function < 0:
        return _notified(session, told) if told is not None else None
    if len(request) == 0:
        return _told_alone(session, function, told) if told is not None else None
    if function == GET_MULTI_VARIABLES or function == GET_VAR_SUBSTREAMED:
        return _read_of(session, function, request, told, read)
    if told is None or not told.sound or told.function != function:
        return _read_all(session, function, request, None, told)
    if function == EXPLORE and not told.met:
        return _judge_contents(check(request), told)
    if function != DELETE_OBJECT and told.noted is None:
        return _read_all(session, function, request, None, told)
    asked = check(request)
    if not asked.sound or asked.function != function or asked.opcode != REQUEST:
        return _read_all(session, function, request, asked, told)
    facts = Facts()
    _judge_id(session, facts.events, function, asked.session_id, asked.sequence, asked.integrity_id)
    _judge_objects(session, facts.events, asked, told)
    return facts


def _judge_objects(session: PlusSession, events: list[Event], asked: Check, told: Check) -> None:
    """Judge a sound transaction that creates, shows or deletes objects."""
    good: bool = told.code < 0x8000
    if asked.function == DELETE_OBJECT:
        _gone(session, events, int(asked.object_id), int(asked.session_id), good)
        return
    if asked.function == CREATE_OBJECT:
        _created(session, events, read_objects(asked), read_objects(told), good)
    elif good:
        _explored(session, events, read_objects(told))


def _read_of(
    session: PlusSession, function: i64, request: bytes, told: Check | None, read: Reads | None
) -> Facts | None:
    """Judge a read, in which only the operating state and the identification of the CPU matter."""
    asked: Check | None = None
    if read is None or read.asks or not read.sound:
        asked = check(request)
        read = Reads(asked)
        if not _asks_what_matters(asked):
            return _judge_contents(asked, told)
    elif told is None or not told.odd:
        return None
    else:
        return _judge_contents(None, told)
    item: i64 = read.item
    plain: bool = told is not None and told.sound and told.function == function
    if told is None or not plain or not asked.sound or item <= 0 or told.numbered < item:
        return _read_all(session, function, request, asked, told)
    events: list[Event] = []
    _judge_id(session, events, function, asked.session_id, asked.sequence, asked.integrity_id)
    _state(session, events, _state_at(told, told.seek(item)))
    return _facts_of(events)


def _state_at(told: Check, place: i64) -> int:
    """Return the operating state in the value that begins at ``place`` in a sound PDU."""
    return state_in(read_value(Walk(told.data, int(place), int(told.end), False), layouts.VALUE, int(place)))


def _facts_of(events: list[Event]) -> Facts | None:
    if not events:
        return None
    facts = Facts()
    facts.events = events
    return facts


def _read_all(
    session: PlusSession, function: i64, request: bytes, asked: Check | None, told: Check | None
) -> Facts | None:
    """Judge a transaction whose relevant parts must be read; ``asked`` is the check of its request, if there was one.

    There was none for writes, and for functions that do not matter.
    """
    if not _may_matter(function, told):
        return _judge_contents(check(request), told)
    facts = Facts()
    if function != SET_VARIABLE and function != SET_MULTI_VARIABLES:
        return _read_in_full(session, function, asked.pdu() if asked is not None else parse_plus(request), told, facts)
    asked = check(request)
    if function == SET_VARIABLE and not _writes_what_matters(asked):
        return _judge_contents(asked, told)
    if is_plain(asked, function):
        if told is None or (told.sound and not told.refuses and told.function == function):
            good: bool = told is None or told.code < 0x8000
            _judge_id(session, facts.events, function, asked.session_id, asked.sequence, asked.integrity_id)
            take_write(session, facts.events, asked, told is not None, good)
            return facts
    return _read_in_full(session, function, asked.pdu(), told, facts)


def _read_in_full(session: PlusSession, function: i64, pdu: PlusPdu, told: Check | None, facts: Facts) -> Facts:
    """Judge a transaction whose contents are all read."""
    contents = _read(pdu, facts)
    _judge_id(session, facts.events, function, pdu.session_id, pdu.sequence, contents.integrity_id)
    answer: Contents | None = None
    good = True
    if told is not None and _says_no_more(function, told):
        answer = _WRITTEN
        good = told.code < 0x8000
    elif told is not None:
        found = _read(told.pdu(), facts, _state_items(function, contents))
        if told.pdu().function == function:
            answer = found
            good = told.pdu().return_code < 0x8000
    if function == DELETE_OBJECT:
        _gone(session, facts.events, contents.object_id, pdu.session_id, good)
    else:
        _judge(session, facts.events, function, contents, answer, good)
    return facts


def _told_alone(session: PlusSession, function: i64, told: Check) -> Facts | None:
    """Judge a response without its request: it may show blocks, or the CPU that opens a session."""
    if function != EXPLORE and function != CREATE_OBJECT:
        return _judge_contents(None, told)
    facts = Facts()
    pdu = told.pdu()
    found = _read(pdu, facts)
    good: bool = pdu.function == function and pdu.return_code < 0x8000
    if good and function == EXPLORE:
        _explored(session, facts.events, found)
    elif good and any([one.class_id == SERVER_SESSION for one in found.objects]):
        session.session_opened(found)
    return facts if facts.events or facts.malformed or facts.exhausted else None


def _says_no_more(function: i64, told: Check) -> bool:
    """Return whether a response to a write or deletion is sound and contains only its return value."""
    return told.sound and not told.refuses and told.function == function and function in _WRITING


def _judge_contents(asked: Check | None, told: Check | None) -> Facts | None:
    """Look for faults in contents that have no events."""
    asks: bool = asked is not None and asked.odd
    tells: bool = told is not None and told.odd
    if not asks and not tells:
        return None
    facts = Facts()
    if asked is not None and asks:
        _read(asked.pdu(), facts)
    if told is not None and tells:
        _read(told.pdu(), facts)
    return facts if facts.malformed or facts.exhausted else None


def _state_items(function: int, asked: Contents) -> frozenset[int] | None:
    """Return the numbers of the items that request the operating state; None (all) for other functions."""
    if function != GET_MULTI_VARIABLES:
        return None
    return frozenset([number for number, address in enumerate(asked.addresses, 1) if is_state(address)])


def _read(pdu: PlusPdu, facts: Facts, items: frozenset[int] | None = None) -> Contents:
    found = parse_contents(pdu, False, MAX_WORK, Wanted(WANTED, items))
    facts.exhausted = facts.exhausted or found.exhausted
    if pdu.whole and not pdu.malformed:
        for fact in found.malformed:
            facts.malformed.append(fact.at(pdu.place(fact.offset)))
        if pdu.opcode == REQUEST:
            facts.in_request += len(found.malformed)
    return found


def _judge_id(
    session: PlusSession, events: list[Event], function: i64, session_id: i64, sequence: i64, id_: i64
) -> None:
    """Judge the integrity id of a request; -1 if it has none."""
    if id_ < 0 or (session_id != session.latest and session_id not in session.given):
        return
    counted = session.writes if _is_change(function) else session.reads
    if counted.repeats(sequence, id_):
        text = f"{FUNCTIONS.name(int(function))} has integrity id {int(id_)} again, or a lower one than before"
        events.append(Event(REPLAYED, text))


def _is_change(function: i64) -> bool:
    """Return whether a client counts requests of a function apart from the others, for the integrity id."""
    if function == SET_VARIABLE or function == SET_MULTI_VARIABLES or function == SET_VAR_SUBSTREAMED:
        return True
    return (
        function == CREATE_OBJECT or function == DELETE_OBJECT or function == BEGIN_SEQUENCE or function == END_SEQUENCE
    )


def _asks_what_matters(asked: Check) -> bool:
    """Return False for a read that certainly requests neither the operating state nor the identification record."""
    if asked.sound:
        return asked.asks
    data = asked.data
    return any([data.find(mark, asked.begin + REQUEST_SIZE, asked.end) >= 0 for mark in _READ_MARKS])


def _may_matter(function: i64, told: Check | None) -> bool:
    if function == EXPLORE:
        return told is None or not told.sound or told.met  # an incomplete response may begin with blocks
    # reads that do not matter are not passed to this function
    return function == GET_MULTI_VARIABLES or function == GET_VAR_SUBSTREAMED or _is_change(function)


def _writes_what_matters(asked: Check) -> bool:
    """Return whether a SetVariable writes an attribute that matters."""
    if asked.sound:
        return matters(asked.object_id, first_id(asked))
    found = parse_contents(asked.pdu(), False, MAX_WORK, Wanted(WANTED))
    return not found.ids or matters(found.object_id, found.ids[0])


def _judge(
    session: PlusSession, events: list[Event], function: int, asked: Contents, told: Contents | None, good: bool
) -> None:
    if function == CREATE_OBJECT:
        _created(session, events, asked, told, good)
    elif function == BEGIN_SEQUENCE or function == END_SEQUENCE:
        _loaded(
            events, -1, asked.objects or asked.begun, asked.every or every_object(asked.begun), len(asked.begun) > 0
        )
        events.append(Event(SEQUENCE_BEGUN if function == BEGIN_SEQUENCE else SEQUENCE_ENDED, ""))
    elif function == EXPLORE:
        if told is not None and good:
            _explored(session, events, told)
    elif function == SET_MULTI_VARIABLES and asked.addresses:
        values = {number: Attribute(0, value) for number, value in asked.items}
        refused = {number: code & 0xFFFF for number, code in told.refusals} if told is not None else {}
        judge_writes(session, events, asked.addresses, values, refused, told is not None and told.whole, good)
    elif function == GET_MULTI_VARIABLES:
        _states(session, events, asked, told)
    elif asked.ids and function == GET_VAR_SUBSTREAMED:
        if told is not None and told.value is not None and good:
            _attribute_read(session, events, asked.object_id, asked.ids, told.value)
    elif asked.ids:
        written = Attribute(0, asked.value) if asked.value is not None else None
        judge_write(session, events, asked.object_id, asked.ids, written, len(asked.pieces) > 0, good)


def _attribute_read(session: PlusSession, events: list[Event], object_id: int, ids: list[int], value: Value) -> None:
    """Judge a value that was read from one attribute: the operating state, or the identification record."""
    if is_state(VariableAddress(0, object_id, ids[0], ids[1:])):
        _state(session, events, state_in(value))
    elif ids[0] == IDENTIFICATION and object_id == CPU_PROXY:
        record = value.content
        session.identified(record.octets if isinstance(record, Blob) else b"")


def _gone(session: PlusSession, events: list[Event], object_id: int, session_id: int, good: bool) -> None:
    """Judge the deletion of an object; object 0 is the session of the request, as s7commplus ends it (docs/s7plus.md)."""
    if object_id == 0:
        object_id = session_id
    block = block_name(object_id) or CONTAINERS.get(object_id, "")
    if block:
        events.append(Event(REMOVED, block, object_id))
    elif good:
        session.unsubscribe(object_id)
        events.append(Event(DELETED, "", object_id))


def _created(session: PlusSession, events: list[Event], asked: Made, told: Made | None, good: bool) -> None:
    made = told.ids if told is not None and good else []
    # The first objects show what is created, even if the PDU is too long to be read completely, or has a fault later.
    these = asked.objects or asked.begun
    every = asked.every or every_object(asked.begun)
    if any(one.class_id == SERVER_SESSION for one in asked.objects):
        session.open_session(asked)
        if told is not None and good:
            session.session_opened(told)
        events.append(Event(SESSION, "", made[0] if made else 0))
    _loaded(events, asked.object_id, these, every, len(asked.begun) > 0)
    lists = reference_lists_of(every)
    id_ = made[0] if made else 0
    jobs = [f"test job {one.text(NAME)}".rstrip() for one in every if one.class_id == _TEST_JOB]
    events += [Event(TEST_JOB, job, id_) for job in jobs]
    subscriptions = [one for one in these if one.class_id == SUBSCRIPTION]
    events += [_subscription(session, one, list(lists[one.offset].values()), id_) for one in subscriptions]
    session.program.learn(asked.every)
    if told is not None and good:
        session.subscribe(asked, told, lists)


def _loaded(events: list[Event], parent: int, these: list[PlusObject], every: list[PlusObject], unread: bool) -> None:
    """Judge objects that are created in ``parent``: whether they load a program, or a part of one."""
    text = load_text(parent, these, every, unread)
    if text:
        events.append(Event(LOADED, text))
    if parent == FIRMWARE_PACKAGE or any(one.rid == FIRMWARE_PACKAGE for one in every):
        events.append(Event(FIRMWARE, said(these)))


def _subscription(session: PlusSession, one: PlusObject, addresses: list[VariableAddress], id_: int) -> Event:
    """Return an event for a new subscription: its name, its cycle, and its subscribed items."""
    alarms = any(inner.class_id == _ALARM_SUBSCRIPTION for inner in one.objects)
    cycle = one.number(CYCLE)
    texts = [one.text(NAME), f"every {cycle} ms" if cycle > 0 else "on change"]
    labels = [session.label(address) for address in addresses[:NAMED]]
    if len(addresses) > NAMED:
        labels.append(f"and {len(addresses) - NAMED} more")
    kind = SUBSCRIBED_ALARMS if alarms else SUBSCRIBED
    return Event(kind, ", ".join([text for text in texts if text] + labels), id_)


def _explored(session: PlusSession, events: list[Event], told: Made) -> None:
    every = told.every or every_object(told.begun)
    session.program.learn([one for one in every if one.end])
    found = [one for one in every if one.holds_any(CODE)]
    if found:
        events.append(Event(READ_OUT, f"{'at least ' if told.begun else ''}{said(found)}"))


def _states(session: PlusSession, events: list[Event], asked: Contents, told: Contents | None) -> None:
    values = dict(told.items) if told is not None else {}
    for number, address in enumerate(asked.addresses, 1):
        value = values.get(number)
        if value is not None and is_state(address):
            _state(session, events, state_in(value))


def _state(session: PlusSession, events: list[Event], state: int) -> None:
    """Note the operating state of the CPU; a change is an event.

    A value that is not a state (-1) is ignored, so that it hides no change.
    """
    if state < 0:
        return
    before, session.identity.state = session.identity.state, state
    session.identity.tell(OPERATING_MODE, _STATE_NAMES.get(state, f"state {state}"), IN_VARIABLE)
    if state in _STATES and before >= 0 and state != before:
        events.append(Event(_STATES[state], f"operating state {OPERATING_STATES.name(state)}"))


def subscription_of(octets: bytes) -> i64:
    """Return the id of the subscription of a notification, read in place; -1 if the PDU is too short."""
    data, at, end = data_of(octets)
    return u32(data, at + 1) if at + 5 <= end else -1


def _state_place(told: Check, references: list[int]) -> i64:
    """Return where the only value of a notification begins that is the operating state.

    Return 0 if it certainly has none, -1 if it must be read in full.
    """
    if not told.sound or told.begin + SHORT < told.end:
        return -1
    place: i64 = 0
    for reference in references:
        found = told.seek(reference)
        if found != 0:
            if found < 0 or place > 0:
                return -1
            place = found
    return place


def _notified(session: PlusSession, told: Check) -> Facts | None:
    references = session.states.get(int(told.subscription_id)) if session.states else None
    if references is None:
        return _judge_contents(None, told)
    place = _state_place(told, references)
    if place == 0:
        return None
    if place > 0:
        events: list[Event] = []
        _state(session, events, _state_at(told, place))
        return _facts_of(events)
    facts = Facts()
    pdu = told.pdu()
    found = _read(pdu, facts)
    for reference, value in found.items:
        address = session.address_of(pdu.subscription_id, reference)
        if address is not None and is_state(address):
            _state(session, facts.events, state_in(value))
    return facts
