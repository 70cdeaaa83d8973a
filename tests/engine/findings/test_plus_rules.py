"""S7comm-plus transactions as events of security: who stopped, loaded, read out, wrote, logged in, looked around."""

from __future__ import annotations

from pathlib import Path
from unittest.mock import ANY

import pytest

import dissect
from dissect.engine.acts.book import ActBook
from dissect.engine.findings.plus_rules import MAX_CPUS, PlusWatch
from dissect.engine.findings.reporter import Reporter
from dissect.engine.findings.security_rules import SecurityWatch
from dissect.engine.transactions.operation import OperationBook
from dissect.meaning.report.facets import outcome
from dissect.meaning.report.plus import plus_subject
from dissect.packets.tcp.stream import Endpoint
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    GET_VAR_SUBSTREAMED,
    SET_MULTI_VARIABLES,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB, BOOL, DINT, INT, STRUCT, UDINT, UINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Struct, Value, build_value
from dissect.protocols.s7plus.walk import MAX_WORK
from tests.engine.findings.plus_scenarios import opened
from tests.engine.transactions.talk import RST, SERVER, Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, notified, told
from tests.protocols.s7plus.test_program import type_of, variable
from tests.protocols.s7plus.test_session import LIST, RECORD

NOTHING = Value(0, UDINT, 0)
DENIED = b"\xff" * 8 + b"\x9c"
STATE = VariableAddress(0, 52, 2237, [3486])


def begun(client_port: int = 50000) -> Talk:
    talk = Talk(client_port) if client_port != 50000 else Talk()
    talk.hello()
    talk.connect()
    return talk


def do(talk: Talk, number: int, function: int, body: bytes, answer: bytes = b"\0", version: int = 3) -> None:
    talk.ask(framed(asked(number, function, body=body), version))
    talk.tell(framed(told(number, function, answer + bodies.end(9)), version))


def block(rid: int, class_id: int, name: str, language: int) -> PlusObject:
    texts = [Attribute(233, Value(0, WSTRING, name)), Attribute(2523, Value(0, UINT, language))]
    return PlusObject(rid, class_id, 0, 0, 0, [*texts, Attribute(2533, Value(0, BLOB, Blob(0, b"code")))])


def said(talk: Talk) -> list[tuple[str, str]]:
    """Give slugs, and what the details say behind who and whom."""
    talk.close()
    return [(finding.slug, finding.detail.partition(": ")[2]) for finding in talk.findings]


@pytest.mark.parametrize(
    ("number", "slug", "text"),
    [
        (1, "security.plc_stop", "operating state request 1 STOP"),
        (3, "security.plc_start", "operating state request 3 RUN"),
        (2, "security.memory", "operating state request 2 reset retentive"),
        (9, "security.unknown_service", "operating state request DInt 9 (unknown)"),
    ],
)
@pytest.mark.parametrize("version", [1, 2, 3])
def test_a_cpu_is_told_to_stop_or_to_run(number: int, slug: str, text: str, version: int) -> None:
    talk = begun()
    body = bodies.set_variable(52, [2167], Value(0, DINT, number), -1 if version == 1 else 9)
    talk.ask(framed(asked(1, SET_VARIABLE, body=body), version))
    talk.tell(framed(told(1, SET_VARIABLE, b"\0" + bodies.end()), version))
    assert said(talk) == [(slug, f"{text}, accepted")]


def test_an_order_that_wants_no_answer() -> None:
    talk = begun()
    body = bodies.set_variable(52, [2167], Value(0, DINT, 1))
    talk.ask(framed(asked(1, SET_VARIABLE, flags=0x74, body=body), 3))
    assert said(talk) == [("security.plc_stop", "operating state request 1 STOP")]


def test_an_order_that_is_refused() -> None:
    talk = begun()
    do(talk, 1, SET_VARIABLE, bodies.set_variable(52, [2167], Value(0, DINT, 1)), DENIED)
    assert said(talk) == [
        ("transaction.refused", "0xff9c Service access denied"),
        ("security.plc_stop", "operating state request 1 STOP, refused: 0xff9c Service access denied"),
        ("security.protected", "S7comm-plus SetVariable, refused: 0xff9c Service access denied"),
    ]


def test_a_cpu_reports_that_it_stopped() -> None:
    talk = begun()
    for number, state in enumerate((8, 8, 4, 4, 8), 1):
        do(
            talk,
            number,
            GET_MULTI_VARIABLES,
            bodies.get_multi(STATE),
            b"\0\1" + build_value(Value(0, DINT, state)) + b"\0\0",
        )
    assert said(talk) == [
        ("security.stopped", "operating state STOP"),
        ("security.mode_changed", "operating state RUN"),
    ]
    # It is the CPU that says so, though its client asked.
    for finding in talk.findings:
        assert finding.detail.startswith("10.0.0.2:102 reports to 10.0.0.1:50000: operating state ")


def test_a_state_that_is_no_number_hides_no_change() -> None:
    for value in (Value(0, BOOL, True), Value(0, WSTRING, "RUN"), Value(0, DINT, -1)):
        talk = begun()
        for number, state in enumerate((Value(0, DINT, 8), value, Value(0, DINT, 4)), 1):
            do(talk, number, GET_MULTI_VARIABLES, bodies.get_multi(STATE), b"\0\1" + build_value(state) + b"\0\0")
        assert said(talk) == [("security.stopped", "operating state STOP")]


#: How an item of a notification begins whose reference is 4: in four octets, and in numbers of variable size, which may have
#: zeros or dropped bits before it.
REFERENCES = [b"\x92\0\0\0\4", b"\x9b\4", b"\x9b\x80\4", b"\x9b\x90\x80\x80\x80\4"]


@pytest.mark.parametrize("reference", REFERENCES)
def test_a_subscription_reports_it(reference: bytes) -> None:
    talk = begun()
    made = PlusObject(
        211, 1001, 0, 0, 0,
        [Attribute(1048, Value(0x20, UDINT, [0x80010000, 0, 1, 0x80150002, 4, 48, 52, 0, 2237, 3486]))],
    )  # fmt: skip
    do(
        talk,
        1,
        CREATE_OBJECT,
        bodies.create_object(285, NOTHING, made, integrity_id=1),
        b"\0\1" + bodies.number(0x70008001),
    )
    for credit, state in ((1, 8), (2, 4)):
        data = b"\x33" + bodies.rid(0x70008001) + b"\4\0\0\0\0\0" + bytes((credit, credit, 1))
        talk.tell(framed(data + reference + build_value(Value(0, DINT, state)) + b"\0" + bytes(4), 3))
    assert said(talk) == [("security.stopped", "operating state STOP")]


def diagnosis(state: int) -> Value:
    """What a CPU says of its hardware in one: how it is, and the operating state."""
    return Value(0, STRUCT, Struct(3481, [(3482, Value(0, DINT, 4)), (3486, Value(0, DINT, state)), (3487, NOTHING)]))


#: By what the operating state comes, and that of which object: what a transaction of that asks for.
WAYS = {
    "a read of several": bodies.get_multi(VariableAddress(0, 80, 3736, [9]), VariableAddress(0, 52, 2237, [])),
    "attributes of an object": bodies.rid(52) + b"\2\2\x12" + bodies.number(2237) + bodies.QUALIFIER + bodies.end(9),
    "a read of one": bodies.get_stream(52, [2237]) + bodies.end(9),
}


@pytest.mark.parametrize("way", WAYS)
def test_a_cpu_reports_it_with_all_of_its_diagnosis(way: str) -> None:
    talk = begun()
    for number, state in enumerate((8, 4, 4), 1):
        value = build_value(diagnosis(state))
        if way == "a read of one":
            do(talk, number, GET_VAR_SUBSTREAMED, WAYS[way], b"\0\0" + value)
        else:
            items = b"\1" + build_value(Value(0, BOOL, True)) + b"\2" + value
            do(talk, number, GET_MULTI_VARIABLES, WAYS[way], b"\0" + items + b"\0\0")
    assert said(talk) == [("security.stopped", "operating state STOP")]


def test_the_state_of_other_hardware_is_not_that_of_the_cpu() -> None:
    """A module that stands still: read with or without what it stands in, or reported by its subscription."""
    talk = begun()
    made = PlusObject(
        211, 1001, 0, 0, 0,
        [Attribute(1048, Value(0x20, UDINT, [0x80010000, 0, 1, 0x80150002, 4, 48, 0x88E10101, 0, 2237, 3486]))],
    )  # fmt: skip
    answer = b"\0\1" + bodies.number(0x70008001)
    do(talk, 1, CREATE_OBJECT, bodies.create_object(285, NOTHING, made, integrity_id=1), answer)
    for number, state in ((2, 8), (3, 4)):
        read_one = bodies.get_stream(0x88E10101, [2237, 3486]) + bodies.end(9)
        do(talk, 3 * number, GET_VAR_SUBSTREAMED, read_one, b"\0\0" + build_value(Value(0, DINT, state)))
        read_all = bodies.get_multi(VariableAddress(0, 0x88E10101, 2237, []))
        told_all = b"\0\1" + build_value(diagnosis(state)) + b"\0\0"
        do(talk, 3 * number + 1, GET_MULTI_VARIABLES, read_all, told_all)
        data = b"\x33" + bodies.rid(0x70008001) + b"\4\0\0\0\0\0" + bytes((number, number, 1))
        talk.tell(framed(data + b"\x92\0\0\0\4" + build_value(Value(0, DINT, state)) + b"\0" + bytes(4), 3))
    assert [one for one in said(talk) if one[0].startswith("security")] == []
    plus = talk.connections[0].plus
    assert plus is not None
    assert plus.identity.state == -1


def test_a_variable_of_a_subscription_that_is_refused() -> None:
    """Each notification refuses it again; the first one also brings the value of the other."""
    talk = begun()
    wanted = [0x80010000, 0, 2, 0x80150004, 1, 0, 82, 0, 3736, 3, 100, 2, 0x80150004, 2, 0, 82, 0, 3736, 3, 102, 2]
    made = PlusObject(211, 1001, 0, 0, 0, [Attribute(1048, Value(0x20, UDINT, wanted))])
    answer = b"\0\1" + bodies.number(0x70008001)
    do(talk, 1, CREATE_OBJECT, bodies.create_object(285, NOTHING, made, integrity_id=1), answer)
    for credit, items in ((1, b"\x92\0\0\0\1" + build_value(Value(0, INT, 5))), (2, b""), (3, b"")):
        data = b"\x33" + bodies.rid(0x70008001) + b"\4\0\0\0\0\0" + bytes((credit, credit, 1))
        talk.tell(framed(data + items + b"\x13\0\0\0\2" + b"\0" + bytes(4), 3))
    talk.close()
    found = [finding for finding in talk.findings if finding.slug == "transaction.item_error"]
    assert [finding.detail for finding in found] == ["S7comm-plus notification MW102: 0x13 refused"] * 3


def test_blocks_are_loaded_and_deleted() -> None:
    talk = begun()
    one = block(0x8A32_0001, 2647, "Main", 4)
    do(talk, 1, CREATE_OBJECT, bodies.create_object(3, NOTHING, one, integrity_id=1), b"\0\0")
    do(talk, 2, DELETE_OBJECT, bodies.delete_object(0x8A0E0003), b"\0" + bodies.rid(0x8A0E0003))
    do(talk, 3, DELETE_OBJECT, bodies.delete_object(0x70400003), b"\0" + bodies.rid(0x70400003))
    hardware = PlusObject(2, 2496, 0, 0, 0, [])
    do(talk, 4, CREATE_OBJECT, bodies.create_object(1, NOTHING, hardware, integrity_id=1), b"\0\0")
    assert said(talk) == [
        ("security.program_change", "load OB1 'Main' (SCL), accepted"),
        ("security.program_change", "delete DB3, accepted"),
        ("security.program_change", "load the hardware configuration, accepted"),
    ]


def test_their_blocks_do_not_load_the_rules_about_blocks_of_s7comm() -> None:
    talk = begun()
    made = bodies.create_object(3, NOTHING, block(0x8A320001, 2647, "Main", 4), integrity_id=1)
    do(talk, 1, CREATE_OBJECT, made, b"\0\1" + bodies.number(0x8A320001))
    assert ("security.program_change", "load OB1 'Main' (SCL)") in [
        (slug, text.partition(",")[0]) for slug, text in said(talk)
    ]
    assert talk.pipeline.exchange.watch._blocks is None


def explore(talk: Talk, number: int, answer: bytes = b"") -> None:
    body = bodies.rid(3) + b"\0\1\1\0\0\0" + bodies.end(4) + b"\0"
    talk.ask(framed(asked(number, EXPLORE, body=body), 3))
    talk.tell(framed(told(number, EXPLORE, b"\0" + bodies.rid(3) + b"\x05" + answer + bodies.FILL), 3))


def test_a_test_job_is_told_once() -> None:
    """SessionTisJob in the container of test jobs, with its request, its trigger and its subscription inside."""
    talk = begun()
    inside = PlusObject(211, 2712, 0, 0, 0, [])
    texts = [Attribute(233, Value(0, WSTRING, "Job_1")), Attribute(2693, Value(0, BLOB, Blob(0, b"what")))]
    job = PlusObject(211, 2709, 0, 0, 0, [*texts, Attribute(2694, Value(0, UDINT, 1)), inside])
    for number in (1, 2):
        request = bodies.create_object(7, NOTHING, job, integrity_id=number)
        do(talk, number, CREATE_OBJECT, request, b"\0\2" + bodies.number(0x70000001) + bodies.number(0x70000002))
    do(talk, 3, DELETE_OBJECT, bodies.delete_object(0x70000001), b"\0" + bodies.rid(0x70000001))
    talk.close()
    assert [one for one in said(talk) if one[0] == "security.debug"] == [("security.debug", "test job Job_1")]
    assert [(one.kind, one.subject) for one in talk.operations] == [("test_job", "test job Job_1")] * 2


def test_blocks_are_read_out_and_told_once() -> None:
    talk = begun()
    for number in (1, 2):
        explore(talk, number, build_object(block(0x8A0E0003, 2574, "tank\x1b", 5)))
    assert said(talk) == [("security.program_read", "DB3 'tank\\x1b' (DB)")]


@pytest.mark.parametrize("frames", [1, 2])
def test_an_answer_to_explore_that_lies_is_told(frames: int) -> None:
    talk = begun()
    body = bodies.rid(3) + b"\0\1\1\0\0\0" + bodies.end(4) + b"\0"
    talk.ask(framed(asked(1, EXPLORE, body=body), 3))
    data = told(1, EXPLORE, b"\0" + bodies.rid(3) + b"\x05" + b"nothing of interest")
    if frames == 2:
        talk.tell(framed(data[:20], 3, trailer=False), framed(data[20:], 3))
    else:
        talk.tell(framed(data, 3))
    assert [slug for slug, _ in said(talk)] == ["s7plus.malformed"]


#: Kinds of items of notifications that are known; 0 is the end of the list.
KNOWN_ITEMS = frozenset((0, 0x03, 0x13, 0x81, 0x83, 0x92, 0x9B, 0x9C))


@pytest.mark.parametrize("version", [2, 3])
def test_items_of_an_unknown_kind_are_no_contradiction(version: int) -> None:
    """In the first and in a second part, one notification after another: a note for the connection, and the values stay."""
    value = b"\x92\0\0\0\x07" + build_value(Value(0, BOOL, True))
    second = b"\0\x70\0\x0e\x5e\0\0"
    unknown = [kind for kind in range(256) if kind not in KNOWN_ITEMS]
    for before in (value, value + second):
        for kinds in (unknown[:124], unknown[124:]):  # the sequence number has one octet
            talk = begun()
            for number, kind in enumerate(kinds, 1):
                talk.tell(framed(notified(number)[:-1] + before + bytes((kind, 0, 0, 0, 0)), version))
            at = len(framed(notified(1)[:-1] + before, version)) - 4
            wrong = f"item at byte {at} is {kinds[0]}, which is unknown"
            assert said(talk) == [("s7plus.unknown_kind", f"s7plus: {wrong}")]
            assert len(talk.transactions) == len(kinds)
            for one in talk.transactions:
                assert "item 7 = Bool true" in plus_subject(one)


def test_a_known_item_that_lies_is_a_contradiction_beside_unknown_ones() -> None:
    talk = begun()
    talk.tell(framed(notified(1)[:-1] + b"\x01\0\0\0\0", 3))
    talk.tell(framed(notified(2)[:-1] + b"\x92\0\0\0\x07\x10\x08\x7f\1", 3))
    talk.tell(framed(notified(3)[:-1] + b"\x02\0\0\0\0", 3))
    assert [slug for slug, _ in said(talk)] == ["s7plus.unknown_kind", "s7plus.malformed"]


def test_names_that_passed_are_used() -> None:
    talk = begun()
    explore(talk, 1, build_object(type_of(0x92000003, ("level", variable(14)))))
    talk.close()
    address = VariableAddress(0, 0x8A0E0003, 2550, [14])
    (connection,) = talk.connections
    assert connection.plus is not None
    assert connection.plus.label(address) == 'DB3."level"'


def test_names_of_a_cpu_are_known_on_all_its_connections() -> None:
    reporter = Reporter()
    book = OperationBook()
    watch = PlusWatch(reporter, SecurityWatch(reporter, ActBook(book)), book)
    talk = begun()
    explore(talk, 1, build_object(type_of(0x92000003, ("level", variable(14)))))
    do(
        talk,
        2,
        SET_MULTI_VARIABLES,
        bodies.set_multi([(VariableAddress(0, 82, 3736, [3, 1, 1]), Value(0, BOOL, True))]),
        b"\0\0",
    )
    talk.close()
    one, two = [transaction.connection for transaction in talk.transactions]
    assert one is two
    for number in range(MAX_CPUS + 1):
        one.tcp.ends = [one.tcp.ends[0], Endpoint(number.to_bytes(4, "big"), 102)]
        one.plus = None
        watch.take(talk.transactions[0])
    one.plus = None
    watch.take(talk.transactions[1])  # of the CPU at hand: its names are there without an Explore of its own
    assert one.plus is not None
    assert one.plus.label(VariableAddress(0, 0x8A0E0003, 2550, [14])) == 'DB3."level"'
    one.plus = None
    one.tcp.ends = [one.tcp.ends[0], Endpoint(bytes(4), 102)]
    watch.take(talk.transactions[1])  # of the first one, which was forgotten
    assert one.plus.label(VariableAddress(0, 0x8A0E0003, 2550, [14])) == "DB3 LID 14"


def test_a_client_that_explores_and_subscribes_to_nothing() -> None:
    talk = begun()
    for number in range(1, 4):
        explore(talk, number)
    assert said(talk) == [("security.reconnaissance", "3 Explore requests and no subscription")]


def test_a_client_that_explores_for_its_subscription() -> None:
    talk = begun()
    for number in range(1, 4):
        explore(talk, number)
    made = PlusObject(211, 1001, 0, 0, 0, [Attribute(1048, Value(0x20, UDINT, list(LIST)))])
    do(talk, 9, CREATE_OBJECT, bodies.create_object(285, NOTHING, made, integrity_id=1), b"\0\1\x87\x07")
    assert said(talk) == []


def test_a_client_that_subscribes_on_another_connection() -> None:
    """TIA Portal explores on one connection while another has its subscriptions."""
    talk = begun()
    made = PlusObject(211, 1001, 0, 0, 0, [Attribute(1048, Value(0x20, UDINT, list(LIST)))])
    do(talk, 1, CREATE_OBJECT, bodies.create_object(285, NOTHING, made, integrity_id=1), b"\0\1\x87\x07")
    other = Talk(client_port=50001, beside=talk)
    other.hello()
    other.connect()
    for number in range(1, 4):
        explore(other, number)
    other.close()
    assert "security.reconnaissance" not in [slug for slug, _ in said(talk)]


@pytest.mark.parametrize(("pushes", "slugs"), [(0, ["security.reconnaissance"]), (1, [])])
def test_a_client_that_subscribed_before_the_capture(pushes: int, slugs: list[str]) -> None:
    """What the CPU sends it says so, on a connection that was there when the capture began."""
    talk = Talk()
    talk.tell(*[framed(notified(5 + number), 2) for number in range(pushes)])
    other = Talk(client_port=50001, beside=talk)
    other.hello()
    other.connect()
    for number in range(1, 4):
        explore(other, number)
    other.close()
    assert [slug for slug, _ in said(talk) if slug.startswith("security")] == slugs


def test_writes_are_told_once_for_outputs_and_once_for_the_rest() -> None:
    talk = begun()
    output, flag = VariableAddress(0, 81, 3736, [3, 0, 1]), VariableAddress(0, 82, 3736, [3, 100, 2])
    for number in (1, 2):
        do(talk, 2 * number, SET_MULTI_VARIABLES, bodies.set_multi([(output, Value(0, BOOL, True))]), b"\0\0")
        do(talk, 2 * number + 1, SET_MULTI_VARIABLES, bodies.set_multi([(flag, Value(0, INT, 5))]), b"\0\0")
    assert said(talk) == [
        ("security.write_outputs", "QB0 = Bool true"),
        ("security.write", "MW100 = Int 5"),
    ]


def test_a_request_that_writes_several_variables_is_one_write() -> None:
    """As in S7comm: the facts of a rule count requests, of however many items."""
    talk = begun()
    flags = [(VariableAddress(0, 82, 3736, [3, 100 + 2 * place, 2]), Value(0, INT, place)) for place in range(7)]
    output = (VariableAddress(0, 81, 3736, [3, 0, 1]), Value(0, BOOL, True))
    for number in range(1, 6):
        do(talk, number, SET_MULTI_VARIABLES, bodies.set_multi([*flags, output]), b"\0\0")
    five = ", ".join(f"MW{100 + 2 * place} = Int {place}" for place in range(5))
    assert said(talk) == [("security.write", f"{five} and 2 more"), ("security.write_outputs", "QB0 = Bool true")]
    rules = talk.pipeline.exchange.reporter.ledger.rules
    assert [(rules[slug].events, rules[slug].reports) for slug, _ in said(talk)] == [(5, 1), (5, 1)]


def test_a_write_that_is_refused_in_part_is_told_for_the_rest() -> None:
    """Of two variables the CPU writes one. That is no refusal of the whole, and what it refused is no write."""
    talk = begun()
    output, flag = VariableAddress(0, 81, 3736, [3, 0, 1]), VariableAddress(0, 82, 3736, [3, 100, 2])
    body = bodies.set_multi([(output, Value(0, BOOL, True)), (flag, Value(0, INT, 5))])
    do(talk, 1, SET_MULTI_VARIABLES, body, b"\x13\1" + b"\xff" * 8 + b"\xf4\0")
    assert said(talk) == [
        ("transaction.item_error", "0xfff4 Object not found"),
        ("security.write_refused", "QB0 = Bool true, refused: 0xfff4 Object not found"),
        ("security.write", "MW100 = Int 5"),
    ]
    (item_error,) = [one.detail for one in talk.findings if one.slug == "transaction.item_error"]
    assert item_error == "S7comm-plus SetMultiVariables QB0: 0xfff4 Object not found"
    (transaction,) = talk.transactions
    assert outcome(transaction) == "PARTLY REFUSED 0x0013 Service executed with partial error"


def test_a_write_that_was_refused_hides_none_that_is_carried_out_later() -> None:
    talk = begun()
    body = bodies.set_multi([(VariableAddress(0, 81, 3736, [3, 0, 1]), Value(0, BOOL, True))])
    do(talk, 1, SET_MULTI_VARIABLES, body, b"\xff" * 8 + b"\xf4\0")
    do(talk, 2, SET_MULTI_VARIABLES, body, b"\0\0")
    do(talk, 3, SET_MULTI_VARIABLES, body, b"\0\0")
    assert [slug for slug, _ in said(talk)].count("security.write_outputs") == 1


def test_attributes_of_a_session_are_no_writes() -> None:
    talk = begun()
    body = bodies.set_multi([(VariableAddress(0, 0x386, 306, []), Value(0, INT, 5))])
    do(talk, 1, SET_MULTI_VARIABLES, body, b"\0\0")
    do(talk, 2, SET_VARIABLE, bodies.set_variable(0x70400001, [1053], Value(0, INT, 5)))
    assert said(talk) == []


def test_a_second_client_that_writes() -> None:
    talk = begun()
    body = bodies.set_multi([(VariableAddress(0, 82, 3736, [3, 100, 2]), Value(0, INT, 5))])
    do(talk, 1, SET_MULTI_VARIABLES, body, b"\0\0")
    for host, port in ((1, 50001), (7, 50002)):
        other = Talk(client_port=port, beside=talk)
        other.hosts[0] = host
        other.hello()
        other.connect()
        do(other, 1, SET_MULTI_VARIABLES, body, b"\0\0")
    writers = [text for slug, text in said(talk) if slug == "security.new_writer"]
    assert writers == ["until now only 10.0.0.1 wrote to 10.0.0.2"]


def test_refusals_that_have_nothing_to_do_with_protection() -> None:
    talk = begun()
    do(talk, 1, SET_VARIABLE, bodies.set_variable(52, [9999], Value(0, DINT, 1)), b"\xff" * 8 + b"\xe0")
    assert [slug for slug, _ in said(talk)] == ["transaction.refused"]
    (refused,) = [finding.detail for finding in talk.findings if finding.slug == "transaction.refused"]
    assert refused.startswith("S7comm-plus SetVariable CPUexecUnit.9999: 0x")  # what was refused, not only how


def integrity(talk: Talk, number: int, integrity_id: int, attribute: int = 2168) -> None:
    body = bodies.set_variable(52, [attribute], Value(0, DINT, 3), integrity_id)
    talk.ask(framed(asked(number, SET_VARIABLE, body=body), 3))
    talk.tell(framed(told(number, SET_VARIABLE, b"\0" + bodies.end(integrity_id + number & 0xFFFFFFFF)), 3))


@pytest.mark.parametrize(
    ("ids", "found"),
    [((5, 6, 8), 0), ((5, 5), 1), ((5, 6, 5), 1), ((2**32 - 1, 0), 0), ((5, 4, 6), 1)],
)
def test_integrity_ids_that_repeat_or_go_back(ids: tuple[int, ...], found: int) -> None:
    """As when recorded requests are sent again under sequence numbers of their own."""
    talk = begun()
    opened(talk, challenge=False)
    for number, integrity_id in enumerate(ids, 2):
        integrity(talk, number, integrity_id)
    texts = [text for slug, text in said(talk) if slug == "security.replay"]
    assert len(texts) == found
    assert all("has integrity id" in text for text in texts)


def test_answers_that_overtake_each_other_are_no_replay() -> None:
    talk = begun()
    opened(talk, challenge=False)
    for number in (2, 3, 4):
        body = bodies.set_variable(52, [2168], Value(0, DINT, 3), 10 + number)
        talk.ask(framed(asked(number, SET_VARIABLE, body=body), 3))
    for number in (3, 2, 4):
        talk.tell(framed(told(number, SET_VARIABLE, b"\0" + bodies.end(10 + 2 * number)), 3))
    assert "security.replay" not in [slug for slug, _ in said(talk)]


def test_passwords() -> None:
    talk = begun()
    body = bodies.set_variable(0x386, [304], Value(0, BLOB, Blob(0, b"answer to a challenge")))
    for number in range(1, 4):
        do(talk, number, SET_VARIABLE, body, DENIED)
    do(talk, 4, SET_VARIABLE, body)
    found = [slug for slug, _ in said(talk) if slug.startswith("security.password")]
    assert found == ["security.password_failed"] * 3 + ["security.password_guessing", "security.password"]
    assert not [finding for finding in talk.findings if "challenge" in finding.detail]


def test_a_refused_item_is_an_error_of_its_transaction() -> None:
    talk = begun()
    wanted = bodies.get_multi(VariableAddress(0, 82, 3736, [3, 100, 2]), VariableAddress(0, 82, 3736, [3, 102, 2]))
    refusal = bodies.multi_got([(1, Value(0, INT, 5))], [(2, 2**64 - 255)])
    talk.ask(framed(asked(1, GET_MULTI_VARIABLES, body=wanted), 3))
    talk.tell(framed(told(1, GET_MULTI_VARIABLES, refusal), 3))
    assert said(talk) == [("transaction.item_error", "0xff01 Invalid LID")]
    (transaction,) = talk.transactions
    assert [(error.where, error.code, error.address) for error in transaction.errors] == [("item 2", 0xFF01, "MW102")]


def test_what_the_cpu_is() -> None:
    talk = begun()
    body = bodies.get_stream(49, [3753]) + bodies.end(1)
    do(talk, 1, GET_VAR_SUBSTREAMED, body, b"\0\0" + build_value(Value(0, BLOB, Blob(0, RECORD))))
    talk.close()
    (connection,) = talk.connections
    assert connection.plus is not None
    assert (connection.plus.identity.order_number, connection.plus.identity.firmware) == (
        "6ES7 215-1AG40-0XB0",
        "V4.5.2",
    )


def test_reads_that_lie_are_told_though_nobody_looks_at_what_they_read() -> None:
    talk = begun()
    talk.ask(framed(asked(1, GET_MULTI_VARIABLES, body=b"no contents at all"), 3))
    talk.tell(framed(told(1, GET_MULTI_VARIABLES, b"\0no contents either" + bytes(4)), 3))
    do(talk, 2, GET_MULTI_VARIABLES, bodies.get_multi(VariableAddress(0, 82, 3736, [3, 100, 2])), b"\0\1\0\7\0\5\0\0")
    talk.tell(framed(told(3, GET_MULTI_VARIABLES, b"\0\1\0\7\0"), 3))
    count = "item count at byte 55 announces 111, the rest of the PDU has 13 bytes"
    assert said(talk) == [
        ("s7plus.malformed", f"request: s7plus: {count}"),
        ("s7plus.unknown_kind", "response: s7plus: type at byte 50 is 32, which is unknown"),
        ("transaction.orphan", "reference 0x0003"),
        ("s7plus.malformed", ANY),
    ]


def linked(object_id: int, id_: int, value: Value) -> bytes:
    """A write of several with a link to the object, of one attribute."""
    head = bodies.rid(object_id) + b"\1\1" + bodies.number(id_) + b"\1" + build_value(value) + b"\0"
    return head + bodies.QUALIFIER + bodies.end(4)


def test_a_write_without_an_answer_is_told_and_one_that_is_refused_is_no_write() -> None:
    body = bodies.set_multi([(VariableAddress(0, 81, 3736, [3, 0, 1]), Value(0, BOOL, True))])
    talk = begun()
    talk.ask(framed(asked(1, SET_MULTI_VARIABLES, body=body)))
    talk.packet(SERVER, flags=RST)
    assert ("security.write_outputs", "QB0 = Bool true, not answered") in said(talk)
    talk = begun()
    for number in (1, 2):
        do(talk, number, SET_MULTI_VARIABLES, body, b"\0\1" + bodies.number(0xFFF4) + b"\0")
    found = [one for one in said(talk) if one[0].startswith("security.")]
    assert found == [("security.write_refused", "QB0 = Bool true, refused: 0xfff4 Object not found")]


def test_orders_and_passwords_in_a_write_of_several_are_told_like_those_in_a_write_of_one() -> None:
    """With a link to the object and without, alone and behind writes of which no more is to be told."""
    five = Value(0, INT, 5)
    first = bodies.set_multi([(VariableAddress(0, area, 3736, [3, 0, 2]), five) for area in (81, 82)])
    refused = ", refused: 0xfff4 Object not found"
    for id_, number, found in (
        (2167, 1, [("security.plc_stop", f"operating state request 1 STOP{end}") for end in (", accepted", refused)]),
        (2167, 3, [("security.plc_start", f"operating state request 3 RUN{end}") for end in (", accepted", refused)]),
        (304, 1, [("security.password", "password, accepted"), ("security.password_failed", f"attempt 1{refused}")]),
    ):
        value = Value(0, DINT, number)
        for body in (linked(52, id_, value), bodies.set_multi([(VariableAddress(0, 52, id_, []), value)])):
            talk = begun()
            do(talk, 1, SET_MULTI_VARIABLES, first, b"\0\0")
            do(talk, 2, SET_MULTI_VARIABLES, body, b"\0\0")
            do(talk, 3, SET_MULTI_VARIABLES, body, b"\0\1" + bodies.number(0xFFF4) + b"\0")
            slugs = {slug for slug, _ in found}
            assert [one for one in said(talk) if one[0] in slugs] == found, (id_, body.hex())
            results = [(one.result, one.error_code) for one in talk.operations]
            assert results == [("done", 0), ("refused", 0xFFF4)]


def test_of_a_write_of_several_each_item_is_told_by_what_became_of_it() -> None:
    """The CPU stops and takes no password; then the other way round. What it answers to the whole says neither."""
    pairs = [
        (VariableAddress(0, 52, 2167, []), Value(0, DINT, 1)),
        (VariableAddress(0, 0x386, 304, []), Value(0, BLOB, Blob(0, b"x"))),
    ]
    refused = "refused: 0xfff4 Object not found"
    for whole in (b"\0", b"\x13"):
        for item, stopped, slug, password in (
            (2, "accepted", "security.password_failed", f"attempt 1, {refused}"),
            (1, refused, "security.password", "password, accepted"),
        ):
            talk = begun()
            refusal = bodies.number(item) + bodies.number(0xFFF4) + b"\0"
            do(talk, 1, SET_MULTI_VARIABLES, bodies.set_multi(pairs), whole + refusal)
            found = [one for one in said(talk) if one[0].startswith("security.p")]
            assert found == [("security.plc_stop", f"operating state request 1 STOP, {stopped}"), (slug, password)]


def test_the_key_of_a_session_that_is_refused_authenticates_nobody() -> None:
    for answer, authenticated in ((b"\0\0", True), (b"\0\1" + bodies.number(0xFFF4) + b"\0", False)):
        talk = begun()
        do(talk, 1, SET_MULTI_VARIABLES, linked(0x386, 1830, Value(0, BLOB, Blob(0, b"key"))), answer)
        talk.close()
        session = talk.connections[0].plus
        assert session is not None
        assert session.authenticated is authenticated


def test_a_state_request_that_names_no_state_is_no_start() -> None:
    """Only the CPU knows what it does with it: the value is told, and whether the CPU took it."""
    for value, text in (
        (Value(0, WSTRING, "STOP\n"), r"WString 'STOP\x0a'"),
        (Value(0, BOOL, True), "Bool true"),
        (Value(0x10, DINT, [1, 3]), "DInt[2] 1, 3"),
        (Value(0, BLOB, Blob(0, b"\1")), "Blob 01"),
    ):
        talk = begun()
        do(talk, 1, SET_VARIABLE, bodies.set_variable(52, [2167], value))
        do(talk, 2, SET_MULTI_VARIABLES, linked(52, 2167, value), b"\0\1" + bodies.number(0xFFF4) + b"\0")
        detail = f"operating state request {text} (unknown)"
        assert said(talk) == [
            ("security.unknown_service", f"{detail}, accepted"),
            ("transaction.item_error", "0xfff4 Object not found"),
            ("security.unknown_service", f"{detail}, refused: 0xfff4 Object not found"),
        ]
        assert [(one.kind, one.result) for one in talk.operations] == [("control", "done"), ("control", "refused")]


def test_only_the_packet_that_lies_is_named() -> None:
    for asked_more, told_more, said_of, packet in ((b"", b"x", "response: ", 1), (b"x", b"", "request: ", 0)):
        talk = begun()
        request = asked(
            1, GET_MULTI_VARIABLES, body=bodies.get_multi(VariableAddress(0, 82, 3736, [3, 100, 2])) + asked_more
        )
        talk.ask(framed(request, 3))
        first = int(talk.pipeline.frames)
        talk.tell(framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([], [], 3) + told_more), 3))
        (finding,) = [one for one in talk.findings if one.slug == "s7plus.malformed"]
        assert finding.frames == [first + packet]
        assert finding.detail.startswith(f"S7comm-plus GetMultiVariables: {said_of}s7plus: ")


def test_a_pdu_with_too_many_values_is_told() -> None:
    talk = begun()
    many = Value(0x10, BOOL, [True] * (MAX_WORK + 1))
    body = bodies.create_object(3, NOTHING, PlusObject(1, 2, 0, 0, 0, [Attribute(7, many)]), integrity_id=1)
    data = asked(1, CREATE_OBJECT, body=body)
    pieces = [framed(data[at : at + 900], 2, trailer=False) for at in range(0, len(data), 900)]
    for at in range(0, len(pieces), 60):
        talk.ask(*pieces[at : at + 60])
    talk.ask(framed(b"\0", 2))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\0\0" + bodies.FILL), 2))
    assert said(talk) == [
        ("security.program_change", "load HWConfiguration and more that was not read, accepted"),
        ("s7.plus_too_long", "more than 100000 values"),
    ]


def test_a_block_longer_than_what_is_kept_of_a_pdu_is_named_all_the_same() -> None:
    talk = begun()
    made = block(0x8A0E0007, 2574, "tank", 4)
    made.elements.append(Attribute(2580, Value(0, BLOB, Blob(0, bytes(9 << 20)))))
    data = asked(1, CREATE_OBJECT, body=bodies.create_object(3, NOTHING, made, integrity_id=1))
    for at in range(0, len(data), 60_000):
        talk.ask(framed(data[at : at + 60_000], 2, trailer=at + 60_000 >= len(data)))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\0\0" + bodies.FILL), 2))
    found = dict(said(talk))
    assert found["security.program_change"] == "load DB7 'tank' (SCL) and more that was not read, accepted"
    assert "s7plus.malformed" not in found
    assert "s7.plus_too_long" in found


def test_what_a_pdu_that_lies_begins_with_is_not_hidden() -> None:
    """The hardware configuration, a test job: an attribute further on that ends too soon does not make them nothing."""
    for parent, class_id, slug in ((1, 2496, "security.program_change"), (7, 2709, "security.debug")):
        talk = begun()
        body = bodies.create_object(parent, NOTHING, PlusObject(9, class_id, 0, 0, 0, []), integrity_id=1)[:-5]
        do(talk, 1, CREATE_OBJECT, body + b"\xa3\7\x10\7\xff\xff\x7f")
        assert sorted([slug for slug, _ in said(talk)]) == sorted(["s7plus.malformed", slug])


@pytest.mark.parametrize(
    ("name", "slugs"),
    [
        ("online_stop_yeni_yeni.pcapng", {"security.plc_stop": 1, "security.stopped": 1}),
        ("paket_start.pcapng", {"security.plc_start": 1, "security.mode_changed": 1}),
        (
            "s71200_GoOfline_HWCompileDownload.pcapng",
            {
                "security.plc_stop": 1,
                "security.plc_start": 1,
                "security.stopped": 1,
                "security.mode_changed": 1,
                "security.program_change": 1,
            },
        ),
        ("S7-1200-Uploading-OB1-TIAV12.pcap", {"security.program_change": 1}),
        ("yeni_onlineyapilmis_upload.pcapng", {"security.program_read": 1}),
        ("TEST.pcapng", {"security.write": 1, "security.write_outputs": 1}),
        ("plc.pcap", {"security.program_change": 4, "security.reconnaissance": 3}),
        ("S7-1511_db2_var1_HMI.pcap", {}),
        ("stabil_haberlesme.pcapng", {}),
    ],
)
def test_shared_captures(corpus: Path, name: str, slugs: dict[str, int]) -> None:
    analysis = dissect.analyze(str(corpus / "s7plus" / name))
    assert analysis.pipeline is not None
    counts = analysis.pipeline.finding_counts
    assert {slug: count for slug, count in counts.items() if slug.startswith(("security.", "s7plus."))} == slugs
