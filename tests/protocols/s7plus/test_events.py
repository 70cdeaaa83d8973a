"""What a transaction means: each kind of event, in sound PDUs and in those that have to be read in full."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.protocols.s7plus.check import check
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import (
    DELETED,
    READ_OUT,
    REMOVED,
    REPLAYED,
    RUNNING,
    SEQUENCE_BEGUN,
    SEQUENCE_ENDED,
    SESSION,
    STOP,
    STOPPED,
    STREAMED,
    SUBSCRIBED,
    SUBSCRIBED_ALARMS,
    TEST_JOB,
    WRITTEN,
    Facts,
)
from dissect.protocols.s7plus.events import subscription_of, take
from dissect.protocols.s7plus.loads import FIRMWARE, LOADED
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, build_object
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.reads import Reads
from dissect.protocols.s7plus.session import Identity, PlusSession
from dissect.protocols.s7plus.tables import (
    BEGIN_SEQUENCE,
    CREATE_OBJECT,
    DELETE_OBJECT,
    END_SEQUENCE,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    INVOKE,
    SET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import ADDRESS_ARRAY, BLOB, DINT, INT, LREAL, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Struct, Value, build_value
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.pdus import asked, framed, notified, told
from tests.protocols.s7plus.test_program import TANK

SESSION_ID: Final = 0x386
DB3: Final = 0x8A0E0003
CREATED: Final = 0x70400001
#: The execution unit, its condition, and the operating state in it; what the state may be.
STATE: Final = VariableAddress(0, 52, 2237, [3486])
CONDITION: Final = VariableAddress(0, 52, 2237, [])
WORD: Final = VariableAddress(0, 82, 3736, [3, 100, 2])
STOPS, RUNS = 4, 8
FIVE: Final = Value(0, INT, 5)
NONE: Final = Value(0, UDINT, 0)
#: Return values: not allowed, and an error of some items only.
REFUSED: Final = build_varint(0x8022C4000F6EFF95, VLQ64)
PARTLY: Final = b"\x13"
RECORD: Final = bytes.fromhex("002000380100") + b"\0*6ES7 214-1HE30-0XB0 SZVBDYXX017685  \0\2V\2\2\0" + bytes(10)


def text(value: str) -> Value:
    return Value(0, WSTRING, value)


def condition(state: int) -> Value:
    return Value(0, STRUCT, Struct(3481, [(3482, Value(0, DINT, 0)), (3486, Value(0, DINT, state))]))


def new_object(class_id: int, *elements: Element, object_id: int = 211) -> PlusObject:
    return PlusObject(object_id, class_id, 0, 0, 0, list(elements))


def block(db: int = 3, *elements: Element) -> PlusObject:
    return new_object(2574, *elements, object_id=0x8A0E0000 + db)


def with_code(db: int = 3) -> PlusObject:
    return block(db, Attribute(2533, Value(0, BLOB, Blob(0, b"code"))))


def subscription(addresses: list[VariableAddress], *elements: Element) -> PlusObject:
    """The reference of the first address is 1."""
    items: list[int] = []
    for reference, one in enumerate(addresses, 1):
        items += [0x80040000 | len(one.lids) + 1, reference, 0, one.area, one.crc, one.sub_area, *one.lids]
    listed = Value(ADDRESS_ARRAY, UDINT, [0x80000000, 0, len(addresses), *items])
    return new_object(1001, Attribute(1048, listed), *elements)


class Line:
    """A connection of version 3 whose client has the session `SESSION_ID`."""

    def __init__(self) -> None:
        self.session = PlusSession(Program(), Identity())
        self.number = 0

    def facts(self, function: int, body: bytes = b"", answer: bytes = b"", version: int = 3) -> Facts | None:
        """Take a transaction; without a body or an answer it lacks this half."""
        self.number += 1
        request = framed(asked(self.number, function, SESSION_ID, body=body), version) if body else b""
        response = framed(told(self.number, function, answer), version) if answer else b""
        return take(self.session, function, request, response)

    def take(
        self, function: int, body: bytes = b"", answer: bytes = b"", version: int = 3
    ) -> list[tuple[str, str, int]]:
        """Give the events of a transaction without faults."""
        facts = self.facts(function, body, answer, version)
        if facts is None:
            return []
        assert facts.malformed == []
        assert not facts.exhausted
        return [(event.kind, event.text, event.object_id) for event in facts.events]

    def create(self, *objects: PlusObject, parent: int = 285, result: bytes = b"\0") -> list[tuple[str, str, int]]:
        """Create objects; the first one gets the id `CREATED`."""
        body = bodies.create_object(parent, NONE, integrity_id=self.number + 1)[:-4]
        body += b"".join([build_object(one) for one in objects]) + bodies.FILL
        ids = b"".join([number(CREATED + index) for index in range(len(objects))])
        return self.take(CREATE_OBJECT, body, result + bytes((len(objects),)) + ids + end(9))

    def delete(self, object_id: int, result: bytes = b"\0") -> list[tuple[str, str, int]]:
        return self.take(DELETE_OBJECT, bodies.delete_object(object_id), result + rid(object_id) + end(9))

    def explore(self, *objects: PlusObject, result: bytes = b"\0") -> list[tuple[str, str, int]]:
        held = b"".join([build_object(one) for one in objects])
        body = rid(3) + b"\0\1\1\0" + b"\0\0" + end(4) + b"\0"
        return self.take(EXPLORE, body, result + rid(3) + number(9) + held + end())

    def notify(self, *items: tuple[int, Value], behind: bytes = b"") -> list[tuple[str, str, int]]:
        held = b"".join([b"\x92" + rid(reference) + build_value(value) for reference, value in items])
        facts = take(self.session, -1, b"", framed(notified(7, CREATED)[:-1] + held + behind + b"\0" + bytes(4), 3))
        return [(event.kind, event.text, event.object_id) for event in facts.events] if facts is not None else []


# ---- objects that are created ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("result", [b"\0", REFUSED, b""], ids=["done", "refused", "no answer"])
def test_objects_that_are_created(result: bytes) -> None:
    """What a client creates is an event whatever the answer is; only an answer that is good says which id it got."""
    id_ = CREATED if result == b"\0" else 0
    job = new_object(2709, Attribute(233, text("watch")))
    nameless = new_object(2709)
    client = new_object(287, Attribute(233, text("Session_1")), Attribute(297, text("HMI RT OMS+")))
    line = Line()

    def create(*objects: PlusObject, parent: int = 285) -> list[tuple[str, str, int]]:
        if result:
            return line.create(*objects, parent=parent, result=result)
        return line.take(CREATE_OBJECT, bodies.create_object(parent, NONE, *objects, integrity_id=line.number + 1))

    assert create(job) == [(TEST_JOB, "test job watch", id_)]
    assert create(nameless) == [(TEST_JOB, "test job", id_)]
    assert create(block(), parent=3) == [(LOADED, "DB3", 0)]
    assert create(new_object(7)) == []
    assert create(client) == [(SESSION, "", id_)]
    assert line.session.application == "HMI RT OMS+"
    assert line.session.given == ({CREATED} if id_ else set())


def test_objects_inside_others_count_as_those_around_them() -> None:
    job = new_object(2709, Attribute(233, text("watch")))
    assert Line().create(new_object(7, job)) == [(TEST_JOB, "test job watch", CREATED)]
    assert Line().create(new_object(2520, block(4)), parent=1) == [(LOADED, "the program, DB4", 0)]


@pytest.mark.parametrize(
    ("elements", "kind", "said"),
    [
        ([], SUBSCRIBED, "on change, CPUexecUnit.DIS.OperatingState"),
        ([Attribute(1049, Value(0, UDINT, 500))], SUBSCRIBED, "every 500 ms, CPUexecUnit.DIS.OperatingState"),
        ([Attribute(1049, Value(0, UDINT, 1))], SUBSCRIBED, "every 1 ms, CPUexecUnit.DIS.OperatingState"),
        ([Attribute(1049, Value(0, UDINT, 0))], SUBSCRIBED, "on change, CPUexecUnit.DIS.OperatingState"),
        ([Attribute(233, text("Pump"))], SUBSCRIBED, "Pump, on change, CPUexecUnit.DIS.OperatingState"),
        ([new_object(2662)], SUBSCRIBED_ALARMS, "on change, CPUexecUnit.DIS.OperatingState"),
        ([new_object(2663)], SUBSCRIBED, "on change, CPUexecUnit.DIS.OperatingState"),
    ],
)
def test_a_subscription_says_what_it_is_for(elements: list[Element], kind: str, said: str) -> None:
    line = Line()
    assert line.create(subscription([STATE], *elements)) == [(kind, said, CREATED)]
    assert line.session.states == {CREATED: [1]}


def test_a_subscription_names_five_variables_and_counts_the_others() -> None:
    words = [VariableAddress(0, 82, 3736, [3, 2 * at, 2]) for at in range(8)]
    assert Line().create(subscription(words[:5])) == [(SUBSCRIBED, "on change, MW0, MW2, MW4, MW6, MW8", CREATED)]
    assert Line().create(subscription(words[:6])) == [
        (SUBSCRIBED, "on change, MW0, MW2, MW4, MW6, MW8, and 1 more", CREATED)
    ]
    assert Line().create(subscription(words)) == [
        (SUBSCRIBED, "on change, MW0, MW2, MW4, MW6, MW8, and 3 more", CREATED)
    ]


def test_a_subscription_that_was_refused_reports_nothing() -> None:
    line = Line()
    assert line.create(subscription([STATE]), result=REFUSED) == [
        (SUBSCRIBED, "on change, CPUexecUnit.DIS.OperatingState", 0)
    ]
    assert line.session.subscriptions == {}


def test_names_of_a_download_are_known_from_then_on() -> None:
    line = Line()
    line.create(TANK, parent=3)
    assert line.session.label(VariableAddress(0, DB3, 2550, [9])) == 'DB3."level"'


@pytest.mark.parametrize(
    ("objects", "parent", "kinds"),
    [
        ([new_object(7, object_id=16)], 1, [FIRMWARE]),
        ([new_object(7, new_object(8, object_id=16))], 1, [FIRMWARE]),
        ([new_object(7)], 16, [FIRMWARE]),
        ([new_object(7)], 17, []),
        ([block()], 16, [LOADED, FIRMWARE]),
    ],
)
def test_firmware_is_what_is_created_as_its_package_or_inside_it(
    objects: list[PlusObject], parent: int, kinds: list[str]
) -> None:
    assert [kind for kind, _, _ in Line().create(*objects, parent=parent)] == kinds


def test_a_request_that_breaks_off_shows_what_it_begins_with() -> None:
    """The first objects say what is loaded; a fault behind them is reported with its place in the request."""
    body = bodies.create_object(3, NONE, block(3), block(4), integrity_id=1)
    body = body[: -len(bodies.FILL)] + b"\xa1\0"
    line = Line()
    facts = line.facts(CREATE_OBJECT, body, b"\0\1" + number(CREATED) + end(9))
    assert facts is not None
    assert [(event.kind, event.text) for event in facts.events] == [(LOADED, "DB3, DB4 and more that was not read")]
    assert (facts.in_request, [(fact.reason, fact.field) for fact in facts.malformed]) == (1, [("too_short", "RID")])
    head = 4 + 1 + 32 + 14  # frame, digest, head of a request
    assert facts.malformed[0].offset == head + len(body) - 1


# ---- objects that are deleted ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("result", [b"\0", REFUSED])
@pytest.mark.parametrize(
    ("object_id", "said"),
    [(DB3, "DB3"), (0x8A320001, "OB1"), (3, "the program"), (2, "the hardware configuration")],
)
def test_the_deletion_of_a_part_of_the_program_is_an_event_even_if_refused(
    object_id: int, said: str, result: bytes
) -> None:
    assert Line().delete(object_id, result) == [(REMOVED, said, object_id)]


@pytest.mark.parametrize("answered", ["soundly", "with more behind it", "not at all", "by another function"])
def test_the_deletion_of_anything_else_ends_it(answered: str) -> None:
    line = Line()
    line.create(subscription([STATE]))
    assert line.delete(CREATED, REFUSED) == []
    assert line.session.subscriptions
    body, answer = bodies.delete_object(CREATED), b"\0" + rid(CREATED) + end(9)
    if answered == "soundly":
        assert line.take(DELETE_OBJECT, body, answer) == [(DELETED, "", CREATED)]
    elif answered == "not at all":  # it is not known that it was refused
        assert line.take(DELETE_OBJECT, body) == [(DELETED, "", CREATED)]
    elif answered == "by another function":
        request = framed(asked(7, DELETE_OBJECT, body=body), 3)
        facts = take(line.session, DELETE_OBJECT, request, framed(told(7, GET_LINK, b"\0\0" + end(9)), 3))
        assert facts is not None
        assert [(one.kind, one.object_id) for one in facts.events] == [(DELETED, CREATED)]
    else:
        facts = line.facts(DELETE_OBJECT, body, answer + b"\1")
        assert facts is not None
        assert [(one.kind, one.object_id) for one in facts.events] == [(DELETED, CREATED)]
        assert [fact.reason for fact in facts.malformed] == ["trailing_octets"]
        assert facts.in_request == 0
    assert line.session.subscriptions == {}


def test_a_refusal_is_seen_in_an_answer_that_is_not_sound() -> None:
    line = Line()
    facts = line.facts(DELETE_OBJECT, bodies.delete_object(CREATED), REFUSED + rid(CREATED) + end(9) + b"\1")
    assert facts is not None
    assert facts.events == []
    facts = line.facts(DELETE_OBJECT, bodies.delete_object(CREATED), PARTLY + rid(CREATED) + end(9) + b"\1")
    assert facts is not None
    assert [event.kind for event in facts.events] == [DELETED]


def test_object_0_is_the_session_of_the_request() -> None:
    assert Line().delete(0) == [(DELETED, "", SESSION_ID)]
    facts = Line().facts(DELETE_OBJECT, bodies.delete_object(0) + b"\1")
    assert facts is not None
    assert [(event.kind, event.object_id) for event in facts.events] == [(DELETED, SESSION_ID)]


# ---- objects that are shown -----------------------------------------------------------------------------------------


def test_blocks_that_an_answer_shows_with_their_code_are_read() -> None:
    line = Line()
    assert line.explore(block(3)) == []
    assert line.explore(with_code(3)) == [(READ_OUT, "DB3", 0)]
    assert line.explore(new_object(2520, with_code(3), block(4), with_code(5))) == [(READ_OUT, "DB3, DB5", 0)]
    for id_ in (2533, 2580):  # in whatever form it comes
        for value in (text("code"), FIVE, Value(0x10, UDINT, [1, 2])):
            assert line.explore(block(3, Attribute(id_, value))) == [(READ_OUT, "DB3", 0)]
    assert line.explore(block(3, Attribute(2544, text("interface")))) == []
    assert line.explore(with_code(3), result=PARTLY) == [(READ_OUT, "DB3", 0)]
    assert line.explore(with_code(3), result=REFUSED) == []


def test_names_that_an_answer_shows_are_known_from_then_on() -> None:
    line = Line()
    assert line.explore(new_object(2520, TANK)) == []
    assert line.session.label(VariableAddress(0, DB3, 2550, [9])) == 'DB3."level"'
    line = Line()
    line.explore(new_object(2520, TANK), result=REFUSED)
    assert line.session.label(VariableAddress(0, DB3, 2550, [9])) == "DB3 LID 9"


@pytest.mark.parametrize("alone", [False, True], ids=["with its request", "alone"])
def test_an_answer_that_breaks_off_shows_at_least_what_was_read(alone: bool) -> None:
    held = build_object(TANK) + build_object(with_code(3)) + build_object(with_code(4))[:-3]
    request = b"" if alone else rid(3) + b"\0\1\1\0" + b"\0\0" + end(4) + b"\0"
    for result, wanted in ((b"\0", [(READ_OUT, "at least DB3")]), (REFUSED, [])):
        line = Line()
        facts = line.facts(EXPLORE, request, result + rid(3) + number(9) + held)
        assert facts is not None
        assert [(event.kind, event.text) for event in facts.events] == wanted
        assert facts.in_request == 0
        assert len(facts.malformed) == 1
        assert (line.session.label(VariableAddress(0, DB3, 2550, [9])) == 'DB3."level"') == bool(wanted)


def test_an_answer_alone_may_show_blocks_or_the_cpu() -> None:
    version = Attribute(306, Value(0, STRUCT, Struct(314, [(319, text("1;6ES7 215-1AG40-0XB0 ;V4.3"))])))
    server = build_object(new_object(287, version, object_id=288))
    opened = b"\1" + number(SESSION_ID) + server + bodies.FILL
    line = Line()
    assert line.take(CREATE_OBJECT, answer=b"\0" + opened, version=1) == []
    assert line.session.given == {SESSION_ID}
    assert line.session.identity.order_number == "6ES7 215-1AG40-0XB0"
    for result, body in ((REFUSED, opened), (b"\0", opened.replace(number(287), number(288)))):
        line = Line()
        assert line.take(CREATE_OBJECT, answer=result + body, version=1) == []
        assert line.session.given == set()
    assert line.take(EXPLORE, answer=b"\0" + rid(3) + number(9) + build_object(with_code(7)) + end()) == [
        (READ_OUT, "DB7", 0)
    ]
    assert line.take(EXPLORE, answer=REFUSED + rid(3) + number(9) + build_object(with_code(7)) + end()) == []
    assert line.facts(GET_LINK, answer=b"\0\1" + rid(7) + end(9)) is None
    assert line.facts(EXPLORE, answer=b"\0" + rid(3) + number(9) + end()) is None
    other = framed(told(7, GET_LINK, b"\0\0" + end(9)), 3)
    assert take(line.session, EXPLORE, b"", other) is None
    assert take(line.session, EXPLORE, b"", b"") is None


@pytest.mark.parametrize("half", ["request", "response", "both"])
@pytest.mark.parametrize("function", [EXPLORE, GET_MULTI_VARIABLES, SET_VARIABLE, GET_LINK])
def test_faults_are_reported_where_nothing_else_matters(function: int, half: str) -> None:
    """With their places, and those of the request first, counted apart."""
    sound = {
        EXPLORE: (rid(3) + b"\0\1\1\0" + b"\0\0" + end(4) + b"\0", b"\0" + rid(3) + number(9) + end()),
        GET_MULTI_VARIABLES: (bodies.get_multi(WORD), bodies.multi_got([(1, FIVE)], [])),
        SET_VARIABLE: (bodies.set_variable(CREATED, [1053], FIVE), b"\0" + end(9)),
        GET_LINK: (rid(7) + b"\x09\0\0" + end(9), b"\0\1" + rid(7) + end(9)),
    }
    body, answer = sound[function]
    assert Line().facts(function, body, answer) is None
    lying_body = body + (b"\1" if half != "response" else b"")
    lying_answer = answer + (b"\1" if half != "request" else b"")
    facts = Line().facts(function, lying_body, lying_answer)
    assert facts is not None
    assert facts.events == []
    ends = {EXPLORE: (5, 4), GET_LINK: (5, 5), SET_VARIABLE: (5, 5), GET_MULTI_VARIABLES: (5, 5)}[function]
    places = []
    if half != "response":
        places.append(37 + 14 + len(body) - ends[0] - (function == EXPLORE))
    if half != "request":
        places.append(37 + 10 + len(answer) - ends[1])
    assert [(fact.reason, fact.offset) for fact in facts.malformed] == [("trailing_octets", place) for place in places]
    assert facts.in_request == (half != "response")


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
        (50, 3451, True), (50, 3452, False), (CREATED, 1048, True), (CREATED, 1053, False), (9, 304, True),
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


@pytest.mark.parametrize("damage", [b"", b"\1"], ids=["sound", "damaged"])
@pytest.mark.parametrize(("code", "good"), [(0, True), (1, True), (0x7FFF, True), (0x8000, False), (0xFFFF, False)])
def test_a_code_from_0x8000_on_refuses_a_request(code: int, good: bool, damage: bytes) -> None:
    """The errors are the negative ones of 16 bits; what they refuse has not happened."""
    result = build_varint(code, VLQ64)
    line = Line()

    def take_(function: int, body: bytes, answer: bytes) -> list[str]:
        facts = line.facts(function, body, result + answer + damage)
        assert facts is not None
        assert len(facts.malformed) == len(damage)
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
