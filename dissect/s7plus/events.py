"""What matters for security in requests and their answers, and what they tell of client, CPU and subscriptions.

`take` is asked about everything but most reads. A few octets say whether there is anything to read; only then contents are.
"""

from __future__ import annotations

from typing import Final

from dissect.s7plus.bodies import parse_contents
from dissect.s7plus.contents import Address, Contents
from dissect.s7plus.ids import AREAS, BLOCK_KINDS, PASSWORDS, block_name, short_name
from dissect.s7plus.message import PlusPdu, parsed
from dissect.s7plus.objects import PlusObject, every_object
from dissect.s7plus.program import TYPE_INFO
from dissect.s7plus.program_tables import LANGUAGES, OPERATING_STATES, STATE_REQUESTS
from dissect.s7plus.session import (
    ASKED_OF_OBJECTS,
    CPU_EXEC_UNIT,
    CPU_PROXY,
    IDENTIFICATION,
    IN_VARIABLE,
    NAME,
    OPERATING_MODE,
    OPERATING_STATE,
    REFERENCE_LIST,
    SERVER_SESSION,
    SESSION_KEY,
    SUBSCRIPTION,
    PlusSession,
    reference_list_of,
)
from dissect.s7plus.skipping import table
from dissect.s7plus.summary import single_address
from dissect.s7plus.tables import (
    ATTRIBUTE_TAG,
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    FUNCTIONS,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
    V3,
)
from dissect.s7plus.value_showing import value_text
from dissect.s7plus.values import Value
from dissect.s7plus.walk import MAX_WORK, Wanted
from dissect.wire.malformed import Malformed
from dissect.wire.octets import u16, u32
from dissect.wire.varint import VLQ, build_varint, read_varint

# Kinds of events.
STOP: Final = "stop"
START: Final = "start"
RESET: Final = "reset"
STOPPED: Final = "stopped"
RUNNING: Final = "running"
CHANGED: Final = "program change"
READ_OUT: Final = "program read"
WRITTEN: Final = "write"
WRITTEN_OUTPUTS: Final = "write outputs"
PASSWORD: Final = "password"  # noqa: S105 - the name of a kind, no secret
TEST_JOB: Final = "test job"
STREAMED: Final = "stream"
REPLAYED: Final = "replay"
SESSION: Final = "session"
SUBSCRIBED: Final = "subscription"
SUBSCRIBED_ALARMS: Final = "alarm subscription"
DELETED: Final = "deleted object"

_PROGRAM: Final = 3
_ROOT: Final = 1
_HARDWARE: Final = 2496
_ALARM_SUBSCRIPTION: Final = 2662
_CYCLE: Final = 1049
_TEST_JOBS: Final = frozenset((2709, 2693))
_STATE_REQUEST: Final = 2167
_STATES: Final = {4: STOPPED, 8: RUNNING}
_NUMBER: Final = 2521
_LANGUAGE: Final = 2523
#: Attributes that hold the code of a block.
_CODE: Final = frozenset((2533, 2580))
#: Attributes of objects that are read, those that are only sought included.
_WANTED: Final = table(ASKED_OF_OBJECTS | _CODE | {NAME, _NUMBER, _LANGUAGE, _CYCLE})
_OUTPUTS: Final = frozenset((81,))
#: Blocks that are named.
_NAMED: Final = 5

# What tells cheaply that a PDU may matter.
_STATE_MARK: Final = build_varint(OPERATING_STATE, VLQ)
_IDENTIFICATION_MARK: Final = build_varint(IDENTIFICATION, VLQ)
_EXPLORED_MARKS: Final = (
    *[bytes((ATTRIBUTE_TAG,)) + build_varint(id_, VLQ) for id_ in sorted(_CODE)],
    build_varint(TYPE_INFO, VLQ),
)
#: Functions that clients count on their own, for the integrity id.
_COUNTED: Final = frozenset((
    CREATE_OBJECT, DELETE_OBJECT, SET_VARIABLE, SET_MULTI_VARIABLES, SET_VAR_SUBSTREAMED, BEGIN_SEQUENCE, END_SEQUENCE,
))  # fmt: skip
_ALWAYS: Final = frozenset((CREATE_OBJECT, DELETE_OBJECT, EXPLORE))
_REQUEST_SIZE: Final = 14
_RESPONSE_SIZE: Final = 10
# Within the fixed part of a request.
_SEQUENCE: Final = 7
_SESSION_ID: Final = 9
#: Reads whose latest answers are kept of one connection, and the octets of the largest that are.
_POLLS: Final = 64
_LARGEST_POLL: Final = 4096
#: What ends most PDUs, and the octets that an integrity id may have beside its last one.
_FILL: Final = bytes(4)
_MORE_OF_ID: Final = 4
_HEADER: Final = 4
_INTEGRITY: Final = 33


class Event:
    """Something that matters: its kind, what it is about, and the object it is about, 0 for none.

    Text from the wire is not escaped.
    """

    __slots__ = ("kind", "object_id", "text")

    def __init__(self, kind: str, text: str, object_id: int = 0) -> None:
        self.kind = kind
        self.text = text
        self.object_id = object_id


class Facts:
    """What `take` found: events, and what is wrong with the contents, offsets counted from the beginning of the PDU.

    ``exhausted`` tells of a PDU that takes more than `MAX_WORK`: what it holds is not known.
    """

    __slots__ = ("events", "exhausted", "malformed")

    def __init__(self) -> None:
        self.exhausted = False
        self.events: list[Event] = []
        self.malformed: list[Malformed] = []


def take(session: PlusSession, function: int, request: bytes, response: bytes) -> Facts | None:
    """Take a transaction: the octets of its halves (empty for none) and its function, -1 for a notification. Never raises.

    None when there is nothing in it that matters.
    """
    if function < 0:
        return _notified(session, response) if session.states and response else None
    if not request or not _may_matter(session, function, request):
        return None
    if function == EXPLORE:
        session.explores += 1
        if not _tells(response):
            return None
    polled = answered = b""
    if function == GET_MULTI_VARIABLES:
        polled, answered = _steady(request, _REQUEST_SIZE), _steady(response, _RESPONSE_SIZE)
        if answered and session.polls.get(polled) == answered:
            return _polled_again(session, request, len(polled))
    facts = Facts()
    asked = _read(request, facts)
    _judge_integrity(session, facts, *asked)
    told = _read(response, facts, _state_items(function, asked[1])) if response else None
    answer = told[1] if told is not None and told[0].function == function else None
    good = answer is None or (told is not None and told[0].return_code < 0x8000)
    _judge(session, facts, function, asked[1], answer, good)
    if polled and answered and not facts.malformed:
        while len(session.polls) >= _POLLS:
            del session.polls[next(iter(session.polls))]
        session.polls[polled] = answered
    return facts


def _steady(octets: bytes, head: int) -> bytes:
    """Return of a PDU of GetMultiVariables in one frame what is the same when the same is read or answered again.

    That is all but its numbers, its digest and its integrity id. In front of the id a list ends with 0; where none does, or
    something else than four zeros ends the PDU, empty: such PDUs are always read.
    """
    size = len(octets)
    if size < _HEADER or size > _LARGEST_POLL or _HEADER + u16(octets, 2) + _HEADER != size:
        return b""
    at = _HEADER + head + (_INTEGRITY if octets[1] == V3 else 0)
    end = size - _HEADER - len(_FILL)
    if end <= at or octets[end : end + len(_FILL)] != _FILL:
        return b""
    end -= 1
    least = end - _MORE_OF_ID
    while end > at and end > least and octets[end - 1] >= 0x80:
        end -= 1
    return octets[at:end] if end > at and octets[end - 1] == 0 else b""


def _polled_again(session: PlusSession, octets: bytes, size: int) -> Facts | None:
    """Judge a request that asks the same as before, ``size`` octets behind its head, and got the same: by its integrity id."""
    at = _HEADER + (_INTEGRITY if octets[1] == V3 else 0)
    id_, _ = read_varint(octets, at + _REQUEST_SIZE + size, len(octets), VLQ)
    if id_ <= 0 or u32(octets, at + _SESSION_ID) not in session.given:
        return None  # as when it is read: zeros alone are no id
    if not session.repeats(False, u16(octets, at + _SEQUENCE), id_):
        return None
    facts = Facts()
    facts.events.append(Event(REPLAYED, _replayed(FUNCTIONS.name(GET_MULTI_VARIABLES), id_)))
    return facts


def _replayed(function: str, id_: int) -> str:
    return f"{function} has integrity id {id_} again, or a lower one than before"


def _state_items(function: int, asked: Contents) -> frozenset[int] | None:
    """Return the numbers of the items by which a request asks for the operating state; None for all, where there are others."""
    if function != GET_MULTI_VARIABLES:
        return None
    return frozenset([number for number, address in enumerate(asked.addresses, 1) if _is_state(address)])


def _is_state(address: Address) -> bool:
    return address.area == CPU_EXEC_UNIT and address.lids[-1:] == [OPERATING_STATE]


def _read(octets: bytes, facts: Facts, items: frozenset[int] | None = None) -> tuple[PlusPdu, Contents]:
    pdu = parsed(octets)
    found = parse_contents(pdu, False, MAX_WORK, Wanted(_WANTED, items))
    facts.exhausted = facts.exhausted or found.exhausted
    if pdu.whole and not pdu.malformed:
        for fact in found.malformed:
            fact.offset = pdu.place(fact.offset)
            facts.malformed.append(fact)
    return pdu, found


def _judge_integrity(session: PlusSession, facts: Facts, pdu: PlusPdu, found: Contents) -> None:
    id_ = found.integrity_id
    if id_ >= 0 and pdu.session_id in session.given and session.repeats(pdu.function in _COUNTED, pdu.sequence, id_):
        facts.events.append(Event(REPLAYED, _replayed(pdu.function_name, id_)))


def _may_matter(session: PlusSession, function: int, octets: bytes) -> bool:
    if function in _ALWAYS:
        return True
    if function == GET_MULTI_VARIABLES or function == GET_VAR_SUBSTREAMED:
        return _STATE_MARK in octets or _IDENTIFICATION_MARK in octets
    if function not in {SET_VARIABLE, SET_VAR_SUBSTREAMED, SET_MULTI_VARIABLES}:
        return False
    at = _HEADER + _REQUEST_SIZE + (_INTEGRITY if octets[1] == V3 else 0)
    if at + 6 > len(octets):
        return True
    object_id = u32(octets, at)
    if function == SET_MULTI_VARIABLES:
        return object_id != 0 or not session.all_written
    if function == SET_VAR_SUBSTREAMED or object_id == CPU_EXEC_UNIT or object_id in AREAS:
        return True
    if (object_id >> 16) in BLOCK_KINDS:
        return True
    first, _ = read_varint(octets, at + 5, len(octets), VLQ)
    return first in PASSWORDS or first == REFERENCE_LIST


def _tells(response: bytes) -> bool:
    """Tell whether an answer to Explore may hold the code of a block, or the names of variables.

    Looked for in the octets of one frame; an answer in several, where a mark could be cut, is read in any case.
    """
    if len(response) <= _HEADER:
        return False
    if _HEADER + u16(response, 2) + _HEADER < len(response):
        return True
    return any([mark in response for mark in _EXPLORED_MARKS])


def _judge(
    session: PlusSession, facts: Facts, function: int, asked: Contents, told: Contents | None, good: bool
) -> None:
    if function == CREATE_OBJECT:
        _created(session, facts, asked, told, good)
    elif function == DELETE_OBJECT:
        block = block_name(asked.object_id)
        if block:
            facts.events.append(Event(CHANGED, f"delete {block}", asked.object_id))
        elif good:
            session.unsubscribe(asked.object_id)
            facts.events.append(Event(DELETED, "", asked.object_id))
    elif function == EXPLORE:
        if told is not None and good:
            _explored(session, facts, told)
    elif function == SET_MULTI_VARIABLES and asked.addresses:
        _written(session, facts, asked, good)
    elif function == GET_MULTI_VARIABLES:
        _states(session, facts, asked, told)
    elif asked.ids:
        _one(session, facts, function, asked, told, good)


def _created(session: PlusSession, facts: Facts, asked: Contents, told: Contents | None, good: bool) -> None:
    made = told.ids if told is not None and good else []
    if any([one.class_id == SERVER_SESSION for one in asked.objects]):
        session.open_session(asked)
        if told is not None and good:
            session.session_opened(told)
        facts.events.append(Event(SESSION, "", made[0] if made else 0))
    elif asked.object_id == _PROGRAM:
        facts.events.append(Event(CHANGED, f"load {_blocks(asked.objects) or 'objects that were not read'}"))
    for one in asked.objects:
        if asked.object_id == _ROOT and one.class_id == _HARDWARE:
            facts.events.append(Event(CHANGED, "load the hardware configuration"))
        elif one.class_id in _TEST_JOBS:
            facts.events.append(Event(TEST_JOB, f"test job {one.text(NAME)}".rstrip(), made[0] if made else 0))
        elif one.class_id == SUBSCRIPTION:
            facts.events.append(_subscription(session, one, made[0] if made else 0))
    session.program.learn(asked.objects)
    if told is not None and good:
        session.subscribe(asked, told)


def _subscription(session: PlusSession, one: PlusObject, id_: int) -> Event:
    """Describe a subscription: its name, its cycle, and what is subscribed."""
    alarms = any([inner.class_id == _ALARM_SUBSCRIPTION for inner in one.objects])
    cycle = one.number(_CYCLE)
    texts = [one.text(NAME), f"every {cycle} ms" if cycle > 0 else "on change"]
    addresses = reference_list_of(one)
    labels = [session.label(address) for address in addresses[:_NAMED]]
    if len(addresses) > _NAMED:
        labels.append(f"and {len(addresses) - _NAMED} more")
    kind = SUBSCRIBED_ALARMS if alarms else SUBSCRIBED
    return Event(kind, ", ".join([text for text in texts if text] + labels), id_)


def _explored(session: PlusSession, facts: Facts, told: Contents) -> None:
    session.program.learn(told.objects)
    found = [one for one in every_object(told.objects) if any([one.holds(id_) for id_ in _CODE])]
    if found:
        facts.events.append(Event(READ_OUT, _blocks(found)))


def _blocks(objects: list[PlusObject]) -> str:
    """Name blocks with their names and languages."""
    texts: list[str] = []
    for one in objects[:_NAMED]:
        name = one.text(NAME)
        language = one.number(_LANGUAGE)
        text = short_name(one.rid) if block_name(one.rid) else short_name(one.class_id)
        number = one.number(_NUMBER)
        if not block_name(one.rid) and number >= 0:
            text += f" {number}"
        texts.append(f"{text}{f' {name!r}' if name else ''}{f' ({LANGUAGES.name(language)})' if language > 0 else ''}")
    more = f" and {len(objects) - _NAMED} more" if len(objects) > _NAMED else ""
    return ", ".join(texts) + more


def _written(session: PlusSession, facts: Facts, asked: Contents, good: bool) -> None:
    values = dict(asked.items)
    for number, address in enumerate(asked.addresses, 1):
        value = values.get(number)
        last = address.lids[-1] if address.lids else address.sub_area
        if last in PASSWORDS:
            facts.events.append(Event(PASSWORD, ""))
        elif last == SESSION_KEY:
            session.authenticated = session.authenticated or good
        elif last == REFERENCE_LIST and value is not None and good:
            session.change(address.area, value)
        else:
            _write(session, facts, address, value)


def _write(session: PlusSession, facts: Facts, address: Address, value: Value | None) -> None:
    if address.area not in AREAS and address.area >> 16 not in BLOCK_KINDS:
        return
    kind = WRITTEN_OUTPUTS if address.area in _OUTPUTS else WRITTEN
    facts.events.append(
        Event(kind, f"{session.label(address)}{f' = {value_text(value)}' if value is not None else ''}")
    )


def _one(session: PlusSession, facts: Facts, function: int, asked: Contents, told: Contents | None, good: bool) -> None:
    """Judge a read or write of one variable or attribute."""
    object_id, ids = asked.object_id, asked.ids
    if function == GET_VAR_SUBSTREAMED:
        if told is None or told.value is None or not good:
            return
        if ids[-1] == OPERATING_STATE:
            _state(session, facts, told.value)
        elif ids[0] == IDENTIFICATION and object_id == CPU_PROXY:
            session.identified(told.value)
        return
    value = asked.value
    if asked.pieces:
        facts.events.append(Event(STREAMED, session.label(Address(0, object_id, ids[0], ids[1:])), object_id))
    if ids[-1] in PASSWORDS:
        facts.events.append(Event(PASSWORD, ""))
    elif ids[0] == REFERENCE_LIST and value is not None and good:
        session.change(object_id, value)
    elif object_id == CPU_EXEC_UNIT and ids == [_STATE_REQUEST] and value is not None:
        facts.events.append(_state_requested(value))
    else:
        address = single_address(asked)
        if address is not None:
            _write(session, facts, address, value)


def _state_requested(value: Value) -> Event:
    number = value.content if isinstance(value.content, int) else -1
    kind = {1: STOP, 2: RESET}.get(number, START)
    row = STATE_REQUESTS.get(number)
    return Event(kind, f"operating state request {number} {row.name if row is not None else '(unknown)'}")


def _states(session: PlusSession, facts: Facts, asked: Contents, told: Contents | None) -> None:
    values = dict(told.items) if told is not None else {}
    for number, address in enumerate(asked.addresses, 1):
        value = values.get(number)
        if value is not None and _is_state(address):
            _state(session, facts, value)


def _state(session: PlusSession, facts: Facts, value: Value) -> None:
    """Note the operating state of the CPU; an event where it is a different one from before."""
    state = value.content if isinstance(value.content, int) else -1
    before, session.identity.state = session.identity.state, state
    session.identity.tell(OPERATING_MODE, OPERATING_STATES.name(state) if state in _STATES else "", IN_VARIABLE)
    if state in _STATES and before >= 0 and state != before:
        facts.events.append(Event(_STATES[state], f"operating state {OPERATING_STATES.name(state)}"))


def subscription_of(octets: bytes) -> int:
    """Return the subscription of a notification, read in place; -1 when it is too short."""
    at = _HEADER + 1 + (_INTEGRITY if octets[1:2] == bytes((V3,)) else 0)
    return int(u32(octets, at)) if at + 4 <= len(octets) else -1


def _notified(session: PlusSession, octets: bytes) -> Facts | None:
    if subscription_of(octets) not in session.states:
        return None
    facts = Facts()
    pdu, found = _read(octets, facts)
    for reference, value in found.items:
        address = session.address_of(pdu.subscription_id, reference)
        if address is not None and address.lids[-1:] == [OPERATING_STATE]:
            _state(session, facts, value)
    return facts
