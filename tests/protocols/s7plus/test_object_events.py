"""Objects that are created, deleted or shown: what that means, in sound PDUs and in those that have to be read in full."""

from __future__ import annotations

import pytest

from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.event import (
    DELETED,
    READ_OUT,
    REMOVED,
    SESSION,
    SUBSCRIBED,
    SUBSCRIBED_ALARMS,
    TEST_JOB,
)
from dissect.protocols.s7plus.events import take
from dissect.protocols.s7plus.loads import FIRMWARE, LOADED
from dissect.protocols.s7plus.objects import Attribute, Element, PlusObject, build_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_LINK,
    GET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import STRUCT, UDINT
from dissect.protocols.s7plus.values import Struct, Value
from dissect.wire.varint import VLQ64, build_varint
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.bodies import end, number, rid
from tests.protocols.s7plus.lines import (
    CREATED,
    DB3,
    FIVE,
    NONE,
    PARTLY,
    REFUSED,
    SESSION_ID,
    STATE,
    WORD,
    Line,
    block,
    new_object,
    subscription,
    text,
    with_code,
)
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.s7plus.test_program import TANK

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


def test_a_request_that_the_capture_cut_shows_what_is_there_without_a_fault() -> None:
    """What is missing is told elsewhere: only of a whole PDU its contents are judged."""
    body = bodies.create_object(3, NONE, block(3), block(4), integrity_id=1)
    octets = framed(asked(1, CREATE_OBJECT, SESSION_ID, body=body), 3)
    facts = take(Line().session, CREATE_OBJECT, octets[:-9], b"")
    assert facts is not None
    assert [(event.kind, event.text) for event in facts.events] == [(LOADED, "DB3, DB4 and more that was not read")]
    assert (facts.malformed, facts.in_request, facts.exhausted) == ([], 0, False)


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
        other = told(7, GET_LINK, REFUSED + b"\0" + end(9))  # what is refused is not the deletion
        facts = take(line.session, DELETE_OBJECT, request, framed(other, 3))
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
    line = Line()
    two = b"\2" + number(SESSION_ID) + number(9) + build_object(new_object(7)) + server + bodies.FILL
    assert line.take(CREATE_OBJECT, answer=b"\0" + two, version=1) == []
    assert line.session.given == {SESSION_ID}
    lowest = build_varint(0x8000, VLQ64)
    for result, body in ((REFUSED, opened), (lowest, opened), (b"\0", opened.replace(number(287), number(288)))):
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
