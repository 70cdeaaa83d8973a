"""What a transaction means: each kind of event, in sound PDUs and in those that have to be read in full."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import (
    DELETED,
    READ_OUT,
    REPLAYED,
    RUNNING,
    SEQUENCE_BEGUN,
    SEQUENCE_ENDED,
    STOP,
    STOPPED,
    STREAMED,
    SUBSCRIBED,
    WRITTEN,
)
from dissect.protocols.s7plus.events import subscription_of, take
from dissect.protocols.s7plus.loads import FIRMWARE, LOADED
from dissect.protocols.s7plus.objects import Attribute, build_object
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.reads import Reads
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    GET_VARIABLE,
    INVOKE,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, BLOB, DINT, LREAL, UDINT
from dissect.protocols.s7plus.values import Blob, Value, build_value
from dissect.protocols.s7plus.walk import MAX_WORK
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.lines import (
    CONDITION,
    CREATED,
    DB3,
    FIVE,
    NONE,
    PARTLY,
    RECORD,
    REFUSED,
    RUNS,
    SESSION_ID,
    STATE,
    STOPS,
    WORD,
    Line,
    block,
    condition,
    new_object,
    subscription,
    text,
    with_code,
)
from tests.protocols.s7plus.pdus import asked, framed, notified, told

# ---- sequences ------------------------------------------------------------------------------------------------------


def test_sequences_begin_with_what_they_load_and_end() -> None:
    line = Line()
    assert line.take(BEGIN_SEQUENCE, b"\1\0\2" + rid(7) + end(9), b"\0\0\2" + rid(7) + end(9)) == [
        (SEQUENCE_BEGUN, "", 0)
    ]
    assert line.take(END_SEQUENCE, b"\0\0" + end(10), b"\0" + end(9)) == [(SEQUENCE_ENDED, "", 0)]
    body = b"\1\0\1\0" + build_object(new_object(2520, block(4))) + end(11)
    assert line.take(BEGIN_SEQUENCE, body) == [(LOADED, "the program, DB4", 0), (SEQUENCE_BEGUN, "", 0)]
    package = build_object(new_object(2520, Attribute(233, text("V4")), object_id=16))
    for damage in (end(12), b"\1"):
        facts = line.facts(BEGIN_SEQUENCE, b"\1\0\1\0" + package + damage)
        assert facts is not None
        assert [(event.kind, event.text) for event in facts.events] == [
            (LOADED, "the program"), (FIRMWARE, "PLCProgram 'V4'"), (SEQUENCE_BEGUN, ""),
        ]  # fmt: skip
    facts = line.facts(BEGIN_SEQUENCE, b"\1\0\1\0" + package[:-1] + b"\1")
    assert facts is not None
    assert [(event.kind, event.text) for event in facts.events] == [
        (LOADED, "the program and more that was not read"), (FIRMWARE, "PLCProgram 'V4'"), (SEQUENCE_BEGUN, ""),
    ]  # fmt: skip
    facts = line.facts(BEGIN_SEQUENCE, body[:-4] + b"\1")
    assert facts is not None
    assert [(event.kind, event.text) for event in facts.events][-1] == (SEQUENCE_BEGUN, "")
    assert facts.in_request == len(facts.malformed) == 1


# ---- the operating state --------------------------------------------------------------------------------------------


def read(wanted: VariableAddress, *others: VariableAddress, behind: bytes = b"") -> bytes:
    return bodies.get_multi(*others, wanted) + behind


@pytest.mark.parametrize("damage", [b"", b"\1"], ids=["sound", "damaged"])
@pytest.mark.parametrize("address", [STATE, CONDITION], ids=["state", "condition"])
def test_a_state_that_is_read_among_others_is_compared_with_the_one_before(
    address: VariableAddress, damage: bytes
) -> None:
    line = Line()

    def poll(state: int, code: bytes = b"\0") -> list[str]:
        value = condition(state) if address is CONDITION else Value(0, DINT, state)
        items = [(1, Value(0, DINT, STOPS)), (2, value), (3, Value(0, DINT, RUNS))]
        body = bodies.get_multi(WORD, address, VariableAddress(0, 49, 2237, [3486]), integrity_id=-1)
        facts = line.facts(GET_MULTI_VARIABLES, body + damage, code + bodies.multi_got(items, [])[1:])
        assert (facts.in_request if facts is not None else 0) == len(damage)
        return [event.text for event in facts.events] if facts is not None else []

    assert poll(RUNS) == []
    assert poll(RUNS) == []
    assert poll(STOPS) == ["operating state STOP"]
    assert poll(6) == []
    assert poll(STOPS) == ["operating state STOP"]
    assert poll(-1) == []
    assert poll(RUNS, PARTLY) == ["operating state RUN"]
    assert line.session.identity.state == RUNS


def test_a_state_that_two_items_report_is_seen_in_both() -> None:
    line = Line()
    body = bodies.get_multi(STATE, CONDITION, integrity_id=-1)
    answer = bodies.multi_got([(1, Value(0, DINT, RUNS)), (2, condition(STOPS))], [])
    assert line.take(GET_MULTI_VARIABLES, body, answer) == [(STOPPED, "operating state STOP", 0)]
    refused = bodies.multi_got([(2, condition(RUNS))], [(1, 2**64 - 12)])
    assert line.take(GET_MULTI_VARIABLES, body, PARTLY + refused[1:]) == [(RUNNING, "operating state RUN", 0)]
    assert line.take(GET_MULTI_VARIABLES, body) == []


def test_an_answer_by_another_function_says_nothing_of_the_state() -> None:
    line = Line()
    line.session.identity.state = RUNS
    request = framed(asked(7, GET_MULTI_VARIABLES, body=bodies.get_multi(STATE)), 3)
    held = b"\1" + build_value(Value(0, DINT, STOPS)) + b"\0"
    answer = framed(told(7, INVOKE, b"\0\0\0" + held + b"\0" + end(9)), 3)
    assert check(answer).numbered == 1
    facts = take(line.session, GET_MULTI_VARIABLES, request, answer)
    assert facts is None or facts.events == []
    assert line.session.identity.state == RUNS


@pytest.mark.parametrize("ids", [[2237], [2237, 3486]])
@pytest.mark.parametrize("end_of_request", [end(9), end(9) + b"\1"], ids=["sound", "damaged"])
def test_a_state_that_is_read_alone(ids: list[int], end_of_request: bytes) -> None:
    line = Line()

    def poll(state: int, result: bytes = b"\0", object_id: int = 52) -> list[str]:
        value = condition(state) if ids == [2237] else Value(0, DINT, state)
        body = bodies.get_stream(object_id, ids) + end_of_request
        facts = line.facts(GET_VAR_SUBSTREAMED, body, result + b"\0" + build_value(value) + end(line.number))
        return [event.kind for event in facts.events] if facts is not None else []

    assert poll(RUNS) == []
    assert poll(STOPS, object_id=49) == []
    assert poll(STOPS, REFUSED) == []
    assert poll(STOPS) == [STOPPED]
    assert poll(RUNS, PARTLY) == [RUNNING]


@pytest.mark.parametrize(("object_id", "ids", "known"), [(49, [3753], True), (50, [3753], False), (49, [4114], False)])
def test_the_record_that_identifies_the_cpu(object_id: int, ids: list[int], known: bool) -> None:
    def after(result: bytes, value: Value) -> str:
        line = Line()
        body = bodies.get_stream(object_id, ids) + end(9)
        assert line.take(GET_VAR_SUBSTREAMED, body, result + b"\0" + build_value(value) + end(9)) == []
        return line.session.identity.serial_number

    held = Value(0, BLOB, Blob(0, RECORD))
    assert after(b"\0", held) == ("SZVBDYXX017685" if known else "")
    assert after(REFUSED, held) == ""
    assert after(b"\0", text("6ES7")) == ""


def test_a_read_whose_check_is_known_is_not_checked_again() -> None:
    """The engine keeps the result for the next request with the same addresses."""
    session = PlusSession(Program(), Identity())
    request = framed(asked(1, GET_MULTI_VARIABLES, body=bodies.get_multi(WORD)), 3)
    reads = Reads(check(request))
    good = framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE)], [])), 3)
    bad = framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([(1, FIVE)], []) + b"\1"), 3)
    assert take(session, GET_MULTI_VARIABLES, request, good, check(good), reads) is None
    assert take(session, GET_MULTI_VARIABLES, request, b"", None, reads) is None
    facts = take(session, GET_MULTI_VARIABLES, request, bad, check(bad), reads)
    assert facts is not None
    assert ([fact.reason for fact in facts.malformed], facts.in_request) == (["trailing_octets"], 0)
    lying = framed(asked(1, GET_MULTI_VARIABLES, body=bodies.get_multi(WORD) + b"\1"), 3)
    facts = take(session, GET_MULTI_VARIABLES, lying, good, check(good), Reads(check(lying)))
    assert facts is not None
    assert ([fact.reason for fact in facts.malformed], facts.in_request) == (["trailing_octets"], 1)


def test_a_state_that_a_subscription_reports() -> None:
    line = Line()
    line.create(subscription([WORD, STATE]))
    run, stop, five = Value(0, DINT, RUNS), Value(0, DINT, STOPS), Value(0, DINT, 5)
    stopped, running = (STOPPED, "operating state STOP", 0), (RUNNING, "operating state RUN", 0)
    assert line.notify((2, run)) == []
    assert line.notify((1, stop)) == []
    assert line.notify((2, stop), (1, five)) == [stopped]
    assert line.notify((2, run), (2, stop)) == [running, stopped]
    assert line.notify((2, text("RUN"))) == []
    assert line.notify((2, run), behind=b"\x13" + rid(1)) == [running]
    assert line.notify((2, condition(STOPS))) == [stopped]
    assert line.notify((2, run), behind=b"\x44") == [running]  # an item of an unknown kind hides none before it
    assert line.notify() == []
    line.create(subscription([STATE, CONDITION]))
    assert line.notify((1, stop), (2, condition(RUNS))) == [stopped, running]
    assert line.notify((1, run), (2, condition(STOPS))) == [stopped]
    assert line.notify((2, condition(RUNS)), (1, stop)) == [running, stopped]
    assert line.notify((1, run), (1, stop), (1, run), (2, condition(STOPS))) == [running, stopped, running, stopped]
    line.create(subscription([WORD, STATE]))
    line.notify((2, run))
    lying = framed(notified(7, CREATED)[:-1] + b"\x92" + rid(2) + build_value(stop) + b"\x44\0" + bytes(4), 3)
    facts = take(line.session, -1, b"", lying)
    assert facts is not None
    assert ([event.kind for event in facts.events], [fact.reason for fact in facts.malformed]) == (
        [STOPPED], ["unknown_type"]
    )  # fmt: skip


def test_a_long_notification_is_read_in_full() -> None:
    """In however many frames it comes."""
    line = Line()
    line.create(subscription([STATE]))
    assert line.notify((1, Value(0, DINT, RUNS))) == []
    for count in (5_000, 20_000):
        held = [b"\x92" + rid(9) + build_value(Value(0x10, LREAL, [0.5] * count))]
        held += [b"\x92" + rid(1) + build_value(Value(0, DINT, state)) for state in (STOPS, RUNS)]
        data = notified(7, CREATED)[:-1] + b"".join(held) + b"\0" + bytes(4)
        frames = [framed(data[at : at + 60_000], 3, trailer=False) for at in range(0, len(data), 60_000)]
        octets = b"".join(frames) + b"\x72\3\0\0"
        assert check(octets).sound
        facts = take(line.session, -1, b"", octets)
        assert facts is not None
        assert [event.kind for event in facts.events] == [STOPPED, RUNNING]


def test_a_notification_of_a_subscription_that_is_not_known_has_faults_at_most() -> None:
    line = Line()
    octets = framed(notified(7, CREATED)[:-1] + b"\x92" + rid(1) + build_value(FIVE) + b"\0" + bytes(4), 3)
    assert take(line.session, -1, b"", octets) is None
    assert take(line.session, -1, b"", b"") is None
    line.create(subscription([STATE]))
    other = octets.replace(rid(CREATED), rid(CREATED + 1))
    assert take(line.session, -1, b"", other) is None
    facts = take(line.session, -1, b"", framed(notified(7, CREATED + 1)[:-1] + b"\x44\0" + bytes(4), 3))
    assert facts is not None
    assert ([fact.reason for fact in facts.malformed], facts.in_request, facts.events) == (["unknown_type"], 0, [])


@pytest.mark.parametrize("version", [1, 2, 3])
def test_the_subscription_of_a_notification_is_read_in_place(version: int) -> None:
    octets = framed(notified(7, CREATED), version)
    assert subscription_of(octets) == CREATED
    assert subscription_of(framed(notified(7, CREATED)[:5], version)) == CREATED
    assert subscription_of(framed(notified(7, CREATED)[:4], version)) == -1
    assert subscription_of(octets[:3]) == -1


# ---- writes ---------------------------------------------------------------------------------------------------------

ORDER: Final = bodies.set_variable(52, [2167], Value(0, DINT, 1))
STREAM: Final = bodies.get_stream(DB3, [2550]) + build_value(Value(0, BLOB, Blob(0, b"head")))


@pytest.mark.parametrize("damaged", ["none", "request", "response"])
def test_an_order_to_stop_is_seen_in_any_form(damaged: str) -> None:
    several = bodies.set_multi([(WORD, FIVE), (VariableAddress(0, 52, 2167, []), Value(0, DINT, 1))])
    for function, body, answer in ((SET_VARIABLE, ORDER, b"\0"), (SET_MULTI_VARIABLES, several, b"\0\0")):
        asked_ = body + (b"\1" if damaged == "request" else b"")
        told_ = answer + end(9) + (b"\1" if damaged == "response" else b"")
        facts = Line().facts(function, asked_, told_)
        assert facts is not None
        assert [event.text for event in facts.events if event.kind == STOP] == ["operating state request 1 STOP"]
        assert len(facts.malformed) == (damaged != "none")
        assert facts.in_request == (damaged == "request")


def test_each_item_of_a_write_has_its_own_result() -> None:
    """A refusal of one item is that of its event; whether an answer is sound decides what is known of the others."""
    body = bodies.set_multi([(WORD, FIVE), (VariableAddress(0, 52, 2167, []), Value(0, DINT, 1))])
    refusal = number(2) + build_varint(0x8022C4000F6EFF95, VLQ64)
    for answer, wanted in (
        (PARTLY + refusal + b"\0" + end(9), [(WRITTEN, 0), (STOP, 0xFF95)]),
        (b"\0\0" + end(9), [(WRITTEN, 0), (STOP, 0)]),
        (PARTLY + refusal + b"\0" + end(9) + b"\1", [(WRITTEN, -1), (STOP, 0xFF95)]),
        (b"", [(WRITTEN, -1), (STOP, -1)]),
    ):
        facts = Line().facts(SET_MULTI_VARIABLES, body, answer)
        assert facts is not None
        assert [(event.kind, event.refusal) for event in facts.events] == wanted


def test_a_stream_is_told_once_by_its_attribute() -> None:
    request = framed(asked(1, SET_VAR_SUBSTREAMED, body=STREAM), 3, trailer=False)
    request += framed(b"\3abc" + end(7), 3)
    answer = framed(told(1, SET_VAR_SUBSTREAMED, b"\0" + end(7)), 3)
    facts = take(PlusSession(Program(), Identity()), SET_VAR_SUBSTREAMED, request, answer)
    assert facts is not None
    assert [(event.kind, event.text, event.object_id) for event in facts.events] == [
        (STREAMED, "DB3", DB3), (WRITTEN, "DB3 = Blob 68 65 61 64", 0),
    ]  # fmt: skip
    assert [kind for kind, _, _ in Line().take(SET_VAR_SUBSTREAMED, STREAM + end(7), b"\0" + end(7))] == [WRITTEN]


@pytest.mark.parametrize(
    ("object_id", "attribute", "matters"),
    [
        (80, 5, True), (84, 5, True), (85, 5, False), (79, 5, False), (52, 2167, True), (53, 2167, False),
        (DB3, 2550, True), (0x8A110003, 2550, False), (0x89FD0001, 2550, True), (0x89FC0001, 2550, False),
        (50, 3451, True), (50, 3452, False), (50, 7917, False), (50, 7918, True), (50, 7919, True), (50, 7920, True),
        (50, 7921, True), (50, 7922, False), (CREATED, 1048, True), (CREATED, 1053, False), (9, 304, True),
    ],
)  # fmt: skip
@pytest.mark.parametrize("damage", [b"", b"\1"])
def test_a_write_of_one_attribute_matters_by_its_object_or_its_id(
    object_id: int, attribute: int, matters: bool, damage: bytes
) -> None:
    """Only then a sound transaction is looked into."""
    listed = Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 1, 0x80040002, 1, 0, 82, 0, 3736, 9])
    body = bodies.set_variable(object_id, [attribute], listed if attribute == 1048 else Value(0, DINT, 1))
    facts = Line().facts(SET_VARIABLE, body + damage, b"\0" + end(9))
    if damage:
        assert facts is not None
        assert [fact.reason for fact in facts.malformed] == ["trailing_octets"]
        assert bool(facts.events) == matters
    else:
        assert (facts is not None) == matters
        assert facts is None or facts.events


# ---- integrity ids --------------------------------------------------------------------------------------------------

_WRITING_BODIES: Final = {
    CREATE_OBJECT: bodies.create_object(285, NONE, new_object(7), integrity_id=10),
    DELETE_OBJECT: bodies.delete_object(7, 10),
    SET_VARIABLE: bodies.set_variable(52, [2167], Value(0, DINT, 3), 10),
    SET_MULTI_VARIABLES: bodies.set_multi([(WORD, FIVE)], 10),
    SET_VAR_SUBSTREAMED: STREAM + end(10),
    BEGIN_SEQUENCE: b"\1\0\2" + rid(7) + end(10),
    END_SEQUENCE: b"\0\0" + end(10),
}
_READING_BODIES: Final = {
    GET_MULTI_VARIABLES: bodies.get_multi(STATE, integrity_id=10),
    GET_VAR_SUBSTREAMED: bodies.get_stream(52, [2237]) + end(10),
    EXPLORE: rid(3) + b"\0\1\1\0" + b"\0\0" + end(10) + b"\0",
}
_ANSWERS: Final = {EXPLORE: b"\0" + rid(3) + number(9) + build_object(with_code()) + end()}


@pytest.mark.parametrize("function", [*_WRITING_BODIES, *_READING_BODIES])
@pytest.mark.parametrize("known", ["given", "latest", "no"])
def test_requests_that_change_something_are_counted_apart_from_those_that_read(function: int, known: str) -> None:
    """The id of a request has to be higher than that of the one before it in the same count and session."""
    same, other = _WRITING_BODIES, _READING_BODIES
    if function in other:
        same, other = other, same
    first = next(one for one in same if one != function)
    line = Line()
    if known == "given":
        line.session.given.add(SESSION_ID)
    elif known == "latest":
        line.session.latest = SESSION_ID
    for before in (first, next(iter(other))):
        kinds = [kind for kind, _, _ in line.take(before, same.get(before) or other[before], _ANSWERS.get(before, b""))]
        assert REPLAYED not in kinds
    events = line.take(function, same[function], _ANSWERS.get(function, b""))
    name = {SET_VARIABLE: "SetVariable", EXPLORE: "Explore", DELETE_OBJECT: "DeleteObject"}.get(function)
    if known != "no":
        assert (line.session.writes if same is _WRITING_BODIES else line.session.reads).sequence == line.number
    replays = [said for kind, said, _ in events if kind == REPLAYED]
    assert len(replays) == (known != "no")
    if name and replays:
        assert replays == [f"{name} has integrity id 10 again, or a lower one than before"]


def test_a_function_that_neither_changes_nor_shows_anything_is_passed_over() -> None:
    called = rid(7) + rid(9) + b"\1" + build_value(FIVE) + b"\0\0"
    line = Line()
    line.session.given.add(SESSION_ID)
    for _ in range(2):
        assert line.facts(INVOKE, called + end(10), b"\0\0\0\1" + build_value(FIVE) + b"\0\0" + end(9)) is None


# ---- what is a refusal ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damaged", ["none", "request", "response"])
@pytest.mark.parametrize(("code", "good"), [(0, True), (1, True), (0x7FFF, True), (0x8000, False), (0xFFFF, False)])
def test_a_code_from_0x8000_on_refuses_a_request(code: int, good: bool, damaged: str) -> None:
    """The errors are the negative ones of 16 bits; what they refuse has not happened."""
    result = build_varint(code, VLQ64)
    line = Line()

    def take_(function: int, body: bytes, answer: bytes) -> list[str]:
        behind = [b"\1" if damaged == half else b"" for half in ("request", "response")]
        facts = line.facts(function, body + behind[0], result + answer + behind[1])
        assert facts is not None
        assert len(facts.malformed) == (damaged != "none")
        return [event.kind for event in facts.events]

    assert take_(
        CREATE_OBJECT,
        bodies.create_object(285, NONE, subscription([WORD]), integrity_id=1),
        b"\1" + number(CREATED) + end(9),
    ) == [SUBSCRIBED]
    assert (CREATED in line.session.subscriptions) == good
    line.session.subscriptions[CREATED] = {}
    listed = Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, 1, 0x80040002, 1, 0, 82, 0, 3736, 9])
    assert take_(SET_VARIABLE, bodies.set_variable(CREATED, [1048], listed), end(9)) == ["subscription list"] * good
    assert bool(line.session.subscriptions[CREATED]) == good
    several = bodies.set_multi([(VariableAddress(0, 0x386, 1830, []), FIVE)])
    assert take_(SET_MULTI_VARIABLES, several, b"\0" + end(9)) == []
    assert line.session.authenticated == good
    assert (
        take_(
            EXPLORE,
            rid(3) + b"\0\1\1\0" + b"\0\0" + end(4) + b"\0",
            rid(3) + number(9) + build_object(with_code()) + end(),
        )
        == [READ_OUT] * good
    )
    line.session.identity.state = RUNS
    assert (
        take_(
            GET_VAR_SUBSTREAMED,
            bodies.get_stream(52, [2237, 3486]) + end(9),
            b"\0" + build_value(Value(0, DINT, STOPS)) + end(9),
        )
        == [STOPPED] * good
    )
    assert take_(DELETE_OBJECT, bodies.delete_object(CREATED), rid(CREATED) + end(9)) == [DELETED] * good
    assert (CREATED in line.session.subscriptions) != good


# ---- what takes too much work ---------------------------------------------------------------------------------------


def in_frames(data: bytes) -> bytes:
    frames = [framed(data[at : at + 60_000], 3, trailer=False) for at in range(0, len(data), 60_000)]
    return b"".join(frames) + b"\x72\3\0\0"


@pytest.mark.parametrize("half", ["request", "response"])
def test_a_pdu_that_takes_too_much_work_is_not_judged(half: str) -> None:
    """Nothing is said against it, and what is wrong with the other half is found."""
    large, small = Value(0x10, 2, [7] * MAX_WORK), Value(0x10, 2, [7, 8])
    body = bodies.set_variable(CREATED, [1053], large if half != "response" else small)
    answer = b"\0" + build_value(large if half != "request" else small) + end(9)
    request = in_frames(asked(1, SET_VARIABLE, body=body + (b"\1" if half == "response" else b"")))
    response = in_frames(told(1, GET_VARIABLE, answer + (b"\1" if half == "request" else b"")))
    facts = take(PlusSession(Program(), Identity()), SET_VARIABLE, request, response)
    assert facts is not None
    assert facts.exhausted
    assert facts.events == []
    assert [fact.reason for fact in facts.malformed] == ["trailing_octets"]
    assert facts.in_request == (half == "response")
