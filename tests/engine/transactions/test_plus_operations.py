"""Operations of S7comm-plus: sessions, subscriptions, blocks loaded, read out and deleted."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.program.carved import carve, plus_block
from dissect.engine.transactions.operation import MAX_OPEN
from dissect.engine.transactions.plus_operations import MAX_POLLS, addresses_in
from dissect.protocols.s7plus.assembly import MAX_PDU
from dissect.protocols.s7plus.contents import VariableAddress
from dissect.protocols.s7plus.objects import Attribute, PlusObject, build_object
from dissect.protocols.s7plus.tables import (
    CREATE_OBJECT,
    DELETE_OBJECT,
    EXPLORE,
    GET_MULTI_VARIABLES,
    SET_VAR_SUBSTREAMED,
    SET_VARIABLE,
)
from dissect.protocols.s7plus.value_tables import BLOB, DINT, INT, STRUCT, UDINT, WSTRING
from dissect.protocols.s7plus.values import Blob, Struct, Value, build_value
from tests.engine.findings.test_plus_rules import DENIED, NOTHING, begun, block, do, explore
from tests.engine.transactions.talk import ACK, CLIENT, MS, SERVER, Talk
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed, told
from tests.protocols.s7plus.test_session import LIST, client

LIST_ID = 0x70008001


def told_of(talk: Talk) -> list[tuple[str, str, str, int, int]]:
    talk.close()
    return [(one.kind, one.subject, one.result, one.parts, one.pushes) for one in talk.operations]


def log_in(talk: Talk, server: str = "6ES7 215-1AG40-0XB0 ;V4.3") -> None:
    """A panel opens session 0x387."""
    request = bodies.create_object(285, NOTHING, client(name="Session_1", application="HMI RT OMS+", host="panel"))
    talk.ask(framed(asked(1, CREATE_OBJECT, body=request), 1))
    version = Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, f"1;{server}"))]))
    answer = build_object(PlusObject(288, 287, 0, 0, 0, [Attribute(306, version)]))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\0\1\x87\x07" + answer + bodies.FILL), 1))


def test_a_session() -> None:
    talk = begun()
    log_in(talk)
    do(talk, 2, DELETE_OBJECT, bodies.delete_object(0x387), b"\0" + bodies.rid(0x387))
    assert told_of(talk) == [("session", "HMI RT OMS+ on panel (panel), CPU 6ES7 215-1AG40-0XB0 V4.3", "done", 2, 0)]


@pytest.mark.parametrize("body", [bodies.delete_object(0), bodies.rid(0)], ids=["whole", "as s7commplus sends it"])
def test_a_session_that_ends_with_object_0(body: bytes) -> None:
    """It is that of the request: another one goes on, and one whose end is refused."""
    for session, answer, result in ((0x387, b"\0", "done"), (0x388, b"\0", "running"), (0x387, DENIED, "running")):
        talk = begun()
        log_in(talk)
        talk.ask(framed(asked(2, DELETE_OBJECT, session, body=body), 1))
        talk.tell(framed(told(2, DELETE_OBJECT, answer + bodies.rid(0) + bodies.FILL), 1))
        assert [one[2] for one in told_of(talk)] == [result]


def test_a_session_that_goes_on() -> None:
    talk = begun()
    log_in(talk)
    assert [one[2] for one in told_of(talk)] == ["running"]


def test_a_session_that_is_refused() -> None:
    talk = begun()
    request = bodies.create_object(285, NOTHING, client(name="Session_1"))
    talk.ask(framed(asked(1, CREATE_OBJECT, body=request), 1))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\xff" * 8 + b"\x8f\0" + bodies.FILL), 1))
    (operation,) = [one for one in told_of(talk) if one[0] == "session"]
    assert operation[1:3] == ("Session_1 (panel)", "refused")


def subscribe(talk: Talk, *inside: PlusObject) -> None:
    texts = [Attribute(233, Value(0, WSTRING, "Subscription_1")), Attribute(1049, Value(0, UDINT, 1000))]
    made = PlusObject(211, 1001, 0, 0, 0, [*texts, Attribute(1048, Value(0x20, UDINT, list(LIST))), *inside])
    do(
        talk,
        2,
        CREATE_OBJECT,
        bodies.create_object(285, NOTHING, made, integrity_id=1),
        b"\0\1" + bodies.number(LIST_ID),
    )


def notify(talk: Talk, number: int, subscription: int = LIST_ID) -> None:
    head = b"\x33" + bodies.rid(subscription) + b"\4\0\0\0\0\0" + bytes((number, number, 1))
    talk.tell(framed(head + b"\x92\xff\xff\xff\xff" + build_value(Value(0, INT, 5)) + b"\0" + bytes(4), 3))


def test_a_subscription_with_its_notifications() -> None:
    talk = begun()
    log_in(talk)
    subscribe(talk)
    for number in (1, 2, 3):
        notify(talk, number)
    do(talk, 9, DELETE_OBJECT, bodies.delete_object(LIST_ID), b"\0" + bodies.rid(LIST_ID))
    notify(talk, 4)
    assert told_of(talk)[0] == (
        "cyclic",
        "Subscription_1, every 1000 ms, M LID 9 [CRC 0xac43db80], M LID 10 [CRC 0xa1d977b6]",
        "done",
        5,
        3,
    )


def test_a_subscription_is_about_what_it_asks_for_later_too() -> None:
    """TIA makes it empty and fills it afterwards; a list that is refused, or that says nothing new, changes nothing."""
    talk = begun()
    made = PlusObject(211, 1001, 0, 0, 0, [Attribute(1049, Value(0, UDINT, 900))])
    request = bodies.create_object(285, NOTHING, made, integrity_id=1)
    do(talk, 2, CREATE_OBJECT, request, b"\0\1" + bodies.number(LIST_ID))
    write = bodies.set_variable(LIST_ID, [1048], Value(0x20, UDINT, list(LIST)))
    (operation,) = talk.pipeline.exchange.watch.plus._operations._holding[1].objects.values()
    do(talk, 3, SET_VARIABLE, write, DENIED)
    assert operation.subject == "every 900 ms"
    for number in (4, 5):
        do(talk, number, SET_VARIABLE, write)
    variables = "M LID 9 [CRC 0xac43db80], M LID 10 [CRC 0xa1d977b6]"
    assert [one[1] for one in told_of(talk) if one[0] == "cyclic"] == [f"every 900 ms, {variables}"]


def test_a_subscription_from_before_the_capture() -> None:
    """What it is about did not pass; that it is there, and how often it is served, did."""
    talk = Talk()
    for number in (1, 2, 3):
        notify(talk, number)
    notify(talk, 4, LIST_ID + 1)
    assert told_of(talk) == [
        ("cyclic", f"subscription 0x{LIST_ID:08x} from before the capture", "running", 3, 3),
        ("cyclic", f"subscription 0x{LIST_ID + 1:08x} from before the capture", "running", 1, 1),
    ]
    assert {one.connection.tcp.ends[one.asked_by].port for one in talk.operations} == {50000}
    assert talk.operations[0].duration_ns == 2 * MS
    assert [one.push_interval_ns for one in talk.operations] == [MS, 0]


def test_subscriptions_from_before_the_capture_are_bounded() -> None:
    talk = Talk()
    for number in range(1, 100):
        notify(talk, number % 256, LIST_ID + number)
    assert len(talk.pipeline.exchange.watch.plus._operations._holding[1].objects) == MAX_OPEN
    assert len(told_of(talk)) == MAX_OPEN


def test_what_the_book_closed_does_not_stay() -> None:
    """A client that subscribes without end: its oldest subscriptions give way, and nothing is kept of them."""
    talk = begun()
    for number in range(1, 1200):
        made = PlusObject(211, 1001, 0, 0, 0, [Attribute(1049, Value(0, UDINT, 1000))])
        request = bodies.create_object(285, NOTHING, made, integrity_id=number)
        do(talk, number, CREATE_OBJECT, request, b"\0\1" + bodies.number(LIST_ID + number))
    operations = talk.pipeline.exchange.watch.plus._operations
    assert operations._count == len(operations._holding[1].objects)
    assert 0 < operations._count <= 1024


def test_nothing_is_kept_of_a_connection_that_is_over() -> None:
    talk = begun()
    subscribe(talk)
    kept = talk.pipeline.exchange.watch.plus._operations._holding
    assert len(kept) == 1
    assert told_of(talk)[0][2] == "running"
    assert kept == {}


def test_a_subscription_to_alarms() -> None:
    talk = begun()
    subscribe(talk, PlusObject(211, 2662, 0, 0, 0, []))
    assert [(one[0], one[2]) for one in told_of(talk)] == [("messages", "running")]


def test_blocks() -> None:
    talk = begun()
    one = block(0x8A320001, 2647, "Main", 4)
    do(talk, 1, CREATE_OBJECT, bodies.create_object(3, NOTHING, one, integrity_id=1), b"\0\0")
    do(talk, 2, CREATE_OBJECT, bodies.create_object(3, NOTHING, one, integrity_id=1), DENIED + b"\0")
    do(talk, 3, DELETE_OBJECT, bodies.delete_object(0x8A0E0003), b"\0" + bodies.rid(0x8A0E0003))
    explore(talk, 4, build_object(one))
    assert told_of(talk) == [
        ("delete", "DB3", "done", 1, 0),
        ("upload", "OB1 'Main' (SCL)", "done", 1, 0),
        ("download", "OB1 'Main' (SCL)", "failed", 2, 0),  # all that a session loads is one
    ]
    assert [one.error_code for one in talk.operations] == [0, 0, 0xFF9C]


def shown(*blocks: PlusObject) -> bytes:
    """An answer to Explore that shows them in the root of the CPU, 9 bytes of which follow the last one."""
    root = PlusObject(1, 2478, 0, 0, 0, list(blocks))
    return told(4, EXPLORE, b"\0" + bodies.rid(3) + b"\x05" + build_object(root) + bytes(8))


def explored(*frames: bytes, asks: bool = True) -> Talk:
    """Explore with an answer in frames; None of them is the last."""
    talk = begun()
    if asks:
        body = bodies.rid(3) + b"\0\1\1\0\0\0" + bodies.end(4) + b"\0"
        talk.ask(framed(asked(4, EXPLORE, body=body), 3))
    for frame in frames:
        talk.tell(frame)
    return talk


ONE = block(0x8A320001, 2647, "Main", 4)
TWO = block(0x8A0E0003, 2574, "tank", 5)


@pytest.mark.parametrize("lost", [True, False], ids=["a gap", "the capture ends"])
def test_what_an_upload_begins_with_when_its_end_did_not_pass(lost: bool) -> None:
    """The block that is whole, the one that is not, and a finding: whatever of the answer the capture lacks."""
    data = shown(ONE, TWO)
    talk = explored(framed(data[:-17], 3, trailer=False))
    if lost:
        talk.lose(SERVER, framed(data[-17:-12], 3, trailer=False))
        talk.packet(CLIENT, flags=ACK)
        talk.tell(framed(data[-12:], 3))
    assert told_of(talk) == [("upload", "at least OB1 'Main' (SCL)", "not_captured", 1, 0)]
    assert [one.slug for one in talk.findings if one.slug != "stream.hole"] == ["security.program_read"]
    whole, begun_one = carve(talk.operations[0])
    assert (whole.label, whole.missing, whole.octets) == ("OB1", "", build_object(ONE))
    assert (begun_one.label, begun_one.name, begun_one.language) == ("DB3", "tank", "DB")
    assert begun_one.missing == f"ended after {len(begun_one.octets)} bytes"
    assert build_object(TWO).startswith(begun_one.octets)
    again = plus_block(begun_one.octets)
    assert again is not None
    assert (again.label, again.missing, again.parts()) == ("DB3", begun_one.missing, begun_one.parts())


def test_an_upload_that_is_too_long_to_keep_is_over() -> None:
    """What it begins with is there; the rest passed, and was answered."""
    long = block(0x8A0E0004, 2574, "archive", 5)
    long.elements.append(Attribute(2580, Value(0, BLOB, Blob(0, bytes(MAX_PDU)))))
    data = shown(ONE, long)
    starts = range(0, len(data), 60_000)
    talk = explored(*[framed(data[at : at + 60_000], 3, trailer=at == starts[-1]) for at in starts])
    assert told_of(talk) == [("upload", "at least OB1 'Main' (SCL), DB4 'archive' (DB)", "done", 1, 0)]
    assert [(one.label, one.complete) for one in carve(talk.operations[0])] == [("OB1", True), ("DB4", False)]


def test_an_upload_whose_request_did_not_pass() -> None:
    talk = explored(framed(shown(ONE, TWO), 3), asks=False)
    assert told_of(talk) == [("upload", "OB1 'Main' (SCL), DB3 'tank' (DB)", "done", 1, 0)]
    assert [block.label for block in carve(talk.operations[0]) if block.complete] == ["OB1", "DB3"]
    assert "security.program_read" in [one.slug for one in talk.findings]


def test_an_upload_that_was_refused_shows_nothing() -> None:
    refused = bytearray(shown(ONE))
    refused[10:11] = DENIED
    talk = explored(framed(bytes(refused), 3), asks=False)
    assert told_of(talk) == []


def test_a_cpu_says_what_it_is_though_its_client_did_not_pass() -> None:
    talk = begun()
    version = Value(0, STRUCT, Struct(314, [(319, Value(0, WSTRING, "1;6ES7 215-1AG40-0XB0 ;V4.3"))]))
    answer = build_object(PlusObject(288, 287, 0, 0, 0, [Attribute(306, version)]))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\0\1\x87\x07" + answer + bodies.FILL), 1))
    talk.close()
    identity = talk.connections[0].plus.identity if talk.connections[0].plus is not None else None
    assert identity is not None
    assert (identity.order_number, identity.firmware) == ("6ES7 215-1AG40-0XB0", "V4.3")


def test_orders_to_stop_and_to_start() -> None:
    talk = begun()
    for number, (state, answer) in enumerate(((1, b"\0"), (3, DENIED), (2, b"\0")), 1):
        do(talk, number, SET_VARIABLE, bodies.set_variable(52, [2167], Value(0, DINT, state)), answer)
    assert [one[:3] for one in told_of(talk)] == [
        ("control", "operating state request 1 STOP", "done"),
        ("control", "operating state request 3 RUN", "refused"),
        ("control", "operating state request 2 reset retentive", "done"),
    ]


def read(talk: Talk, number: int, *wanted: VariableAddress) -> None:
    talk.ask(framed(asked(number, GET_MULTI_VARIABLES, body=bodies.get_multi(*wanted, integrity_id=number)), 3))
    values = [(item, Value(0, INT, number)) for item in range(1, len(wanted) + 1)]
    talk.tell(framed(told(number, GET_MULTI_VARIABLES, bodies.multi_got(values, [], 2 * number)), 3))


def test_reads_that_end_before_their_variables_are_no_fault_of_ours() -> None:
    for body in (b"", b"\0"):
        talk = begun()
        for number in (1, 2, 3):
            talk.ask(framed(asked(number, GET_MULTI_VARIABLES, body=body)))
            talk.tell(framed(told(number, GET_MULTI_VARIABLES, b"\0")))
        assert "internal.bug" not in talk.pipeline.finding_counts
        assert [one[0] for one in told_of(talk)] == ["polling"]


def test_the_same_variables_read_three_times_are_polled() -> None:
    """Others in between make no difference, nor does what was read twice only."""
    talk = begun()
    level, speed = VariableAddress(0, 82, 3736, [3, 100, 2]), VariableAddress(0, 82, 3736, [3, 102, 2])
    for number, wanted in enumerate(((level, speed), (speed,), (level, speed), (level,), (level, speed), (speed,)), 1):
        read(talk, number, *wanted)
    frames = [int(one.request_frame) for one in talk.transactions]
    assert told_of(talk) == [("polling", "MW100, MW102", "running", 3, 0)]
    (operation,) = talk.operations
    assert (operation.first_frame, operation.last_frame) == (frames[0], frames[4] + 1)
    assert operation.transactions == [1, 3, 5]  # also those from before it was known to be polling


def test_polls_that_are_remembered_are_bounded() -> None:
    talk = begun()
    for number in range(1, MAX_POLLS + 2):
        read(talk, number, VariableAddress(0, 82, 3736, [3, number, 2]))
    for number in range(MAX_POLLS + 2, MAX_POLLS + 4):
        read(talk, number, VariableAddress(0, 82, 3736, [3, 1, 2]))  # the first was forgotten
    assert told_of(talk) == []


def test_a_poll_of_many_variables_is_known_by_a_digest() -> None:
    """A request may have 8 MiB, and a thousand of them are remembered."""
    talk = begun()
    wanted = [VariableAddress(0, 82, 3736, [3, number, 2]) for number in range(600)]
    for number, last in enumerate((600, 600, 601, 600), 1):
        read(talk, number, *wanted, VariableAddress(0, 82, 3736, [3, last, 2]))
    polling = talk.pipeline.exchange.watch.plus._operations._polling
    assert [[len(asked) for asked in here.polls] for here in polling.values()] == [[16, 16]]
    assert [(kind, count) for kind, _, _, count, _ in told_of(talk)] == [("polling", 3)]


def test_a_password() -> None:
    talk = begun()
    do(talk, 1, SET_VARIABLE, bodies.set_variable(0x386, [304], Value(0, BLOB, Blob(0, b"x" * 20))))
    assert [(one[0], one[2]) for one in told_of(talk)] == [("password", "done")]


@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("S7-1200-Uploading-OB1-TIAV12.pcap", {"download": 1, "session": 1, "polling": 1}),
        ("yeni_onlineyapilmis_upload.pcapng", {"upload": 1, "session": 2, "cyclic": 5, "messages": 1, "polling": 5}),
        ("plc.pcap", {"download": 1, "session": 3}),
        ("online_stop_yeni_yeni.pcapng", {"control": 1, "cyclic": 2, "messages": 2, "polling": 2}),
        ("S7-1511_db2_var1_HMI.pcap", {"session": 1, "polling": 1}),
    ],
)
def test_shared_captures(corpus: Path, name: str, kinds: dict[str, int]) -> None:
    analysis = dissect.analyze(str(corpus / "s7plus" / name))
    counts = {kind: sum(results.values()) for kind, results in analysis.operations.items()}
    assert {kind: count for kind, count in counts.items() if kind != "connect"} == kinds


def stream(talk: Talk, number: int, *pieces: bytes, flags: int = 0x34) -> None:
    """A client writes attribute 233 of object 0x90 as a stream, one frame every millisecond."""
    head = bodies.get_stream(0x90, [233]) + build_value(Value(0, BLOB, Blob(0, b"head")))
    frames = [asked(number, SET_VAR_SUBSTREAMED, flags=flags, body=head)]
    frames += [bodies.number(len(piece)) + piece for piece in pieces]
    frames[-1] += bodies.end(7)
    for at, frame in enumerate(frames, 1):
        talk.ask(framed(frame, 3, trailer=at == len(frames)))


def test_a_stream_of_data() -> None:
    """It begins with its first frame; how the object is called is all that is known of it."""
    talk = begun()
    stream(talk, 1, b"x" * 1000, b"y" * 500)
    talk.tell(framed(told(1, SET_VAR_SUBSTREAMED, b"\0" + bodies.end(8)), 3))
    assert told_of(talk) == [("transfer", "144.ObjectVariableTypeName", "done", 1, 0)]
    (operation,) = talk.operations
    (transaction,) = talk.transactions
    assert operation.octets == transaction.request_size > 1500
    assert operation.first_frame == transaction.request_frame - 2
    assert operation.duration_ns == 3 * MS


def test_a_project_for_a_panel() -> None:
    """The panel names itself; a file of its project is told with its octets and how long it took."""
    talk = begun()
    log_in(talk, "6AV2 124-0GC01-0AX0;V17.0")
    stream(talk, 2, b"x" * 1000, b"y" * 500)
    talk.tell(framed(told(2, SET_VAR_SUBSTREAMED, b"\0" + bodies.end(8)), 3))
    found = [one for one in told_of(talk) if one[0] == "transfer"]
    assert found == [("transfer", "panel 6AV2 124-0GC01-0AX0: 144.ObjectVariableTypeName", "done", 1, 0)]
    (operation,) = [one for one in talk.operations if one.kind == "transfer"]
    assert operation.octets > 1500
    assert operation.duration_ns == 3 * MS


def test_a_stream_without_an_answer() -> None:
    talk = begun()
    stream(talk, 1, b"x" * 1000)
    stream(talk, 2, b"x" * 1000, flags=0x74)
    assert sorted([one[2] for one in told_of(talk)]) == ["done", "unfinished"]  # the second wanted none


def test_a_value_in_one_frame_is_no_stream() -> None:
    talk = begun()
    stream(talk, 1)
    talk.tell(framed(told(1, SET_VAR_SUBSTREAMED, b"\0" + bodies.end(8)), 3))
    assert told_of(talk) == []


def test_all_octets_of_a_stream_count() -> None:
    """Also those past the bound, which are not kept."""
    talk = begun()
    piece = b"x" * 60_000
    count = MAX_PDU // len(piece) + 10
    stream(talk, 1, *[piece] * count)
    talk.tell(framed(told(1, SET_VAR_SUBSTREAMED, b"\0" + bodies.end(8)), 3))
    (operation,) = [one for one in told_of(talk) if one[0] == "transfer"]
    assert operation[2] == "done"
    assert count * len(piece) < talk.operations[0].octets < count * (len(piece) + 50)


def test_a_download_in_several_frames_begins_with_the_first() -> None:
    talk = begun()
    octets = asked(
        1, CREATE_OBJECT, body=bodies.create_object(3, NOTHING, block(0x8A320001, 2647, "Main", 4), integrity_id=1)
    )
    talk.ask(framed(octets[:40], 3, trailer=False))
    talk.ask(framed(octets[40:], 3))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\0\0" + bodies.end(2)), 3))
    assert told_of(talk) == [("download", "OB1 'Main' (SCL)", "done", 1, 0)]
    assert talk.operations[0].duration_ns == 2 * MS


def test_beginnings_that_are_remembered_are_bounded() -> None:
    talk = begun()
    for number in range(1, 100):
        stream(talk, number, b"x")
    (connection,) = {one.connection for one in talk.transactions} or {talk.pipeline.table.all_open()[0].connection}
    assert connection._begun is not None
    assert len(connection._begun) == 64


@given(st.binary(max_size=12), st.lists(st.sampled_from(b"\x00\x04\xe8\x07"), max_size=40))
def test_a_poll_is_known_by_what_stands_before_the_first_qualifier(ahead: bytes, more: list[int]) -> None:
    body = ahead + bytes(more)
    data = asked(1, body=body)
    for version in (1, 3):
        wanted = body.partition(b"\x00\x00\x04\xe8")[0]
        assert addresses_in(framed(data, version)) == wanted
        assert addresses_in(framed(data[:13], version)) == b""
        for place in range(len(data) + 1):
            assert addresses_in(framed(data[:place], version, False) + framed(data[place:], version)) == wanted


def test_polls_of_connections_that_are_over_do_not_count() -> None:
    """What is remembered is bounded for all connections together: those that go leave room for others."""
    talk = begun()
    for number in range(1, MAX_POLLS):
        read(talk, number, VariableAddress(0, 82, 3736, [3, number, 2]))
    talk.packet(CLIENT, flags=4)
    talk.pipeline.tick(talk.now_ns + 60_000 * MS)
    other = Talk(50001, beside=talk)
    other.hello()
    other.connect()
    for number, address in enumerate((1, 2, 3, 1, 2, 3, 1, 2, 3), 1):
        read(other, number, VariableAddress(0, 82, 3736, [3, address, 2]))
    other.close()
    talk.pipeline.finish()
    assert "internal.bug" not in talk.pipeline.finding_counts
    assert [(one.kind, one.subject, one.parts) for one in talk.operations if one.kind == "polling"] == [
        ("polling", f"MW{number}", 3) for number in (1, 2, 3)
    ]


def test_the_oldest_poll_is_forgotten_first() -> None:
    talk = begun()
    for number in range(1, MAX_POLLS + 2):
        read(talk, number, VariableAddress(0, 82, 3736, [3, number, 2]))
    for turn in range(2):
        read(talk, 2000 + turn, VariableAddress(0, 82, 3736, [3, 2, 2]))  # the first that is still there
    assert [(kind, subject, parts) for kind, subject, _, parts, _ in told_of(talk)] == [("polling", "MW2", 3)]


@pytest.mark.parametrize("mid_stream", [True, False])
def test_notifications_of_a_subscription_that_was_not_captured(mid_stream: bool) -> None:
    """From before the capture, or none that is known."""
    talk = Talk() if mid_stream else begun()
    notify(talk, 1)
    assert [one[0] for one in told_of(talk)] == (["cyclic"] if mid_stream else [])


def test_an_item_that_is_refused_is_an_error_of_the_answer() -> None:
    """Each by its own code, and a request that is refused as a whole by one."""
    talk = begun()
    wanted = [VariableAddress(0, 82, 3736, [3, number, 2]) for number in (100, 102)]
    talk.ask(framed(asked(1, GET_MULTI_VARIABLES, body=bodies.get_multi(*wanted, integrity_id=1)), 3))
    talk.tell(framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([(1, Value(0, INT, 5))], [(2, 0x8104)], 2)), 3))
    do(talk, 2, SET_VARIABLE, bodies.set_variable(52, [2167], Value(0, DINT, 1)), DENIED)
    do(talk, 3, SET_VARIABLE, bodies.set_variable(52, [2167], Value(0, DINT, 1)))
    found = [one for one in talk.transactions if one.is_plus]
    assert [(one.has_errors, one.failed, one.refused) for one in found] == [
        (True, True, False),
        (True, True, True),
        (False, False, False),
    ]
    assert [[(error.part, error.item, error.code) for error in one.errors] for one in found] == [
        [("item", 2, 0x8104)],
        [("return value", 0, 0xFF9C)],
        [],
    ]
    halves = [(one.plus_request, one.plus_response) for one in found[:1]]
    assert [(half.side, half.frame, half.connection) for pair in halves for half in pair if half is not None] == [
        (CLIENT, found[0].request_frame, found[0].connection.number),
        (SERVER, found[0].response_frame, found[0].connection.number),
    ]


@pytest.mark.parametrize("subscribed", [True, False])
def test_a_client_that_subscribed_before_the_capture_is_no_scout(subscribed: bool) -> None:
    talk = Talk()
    for number in range(1, 40):
        explore(talk, number, build_object(ONE))
    if subscribed:
        notify(talk, 1)
    talk.packet(CLIENT, flags=4)
    talk.finish()
    assert ("security.reconnaissance" in talk.slugs()) is not subscribed


def test_items_of_a_subscription_that_was_not_captured_are_named_by_their_references() -> None:
    talk = Talk()
    notify(talk, 1)
    talk.finish()
    (item,) = talk.transactions[0].items
    assert (item.address, item.tag, item.type, item.value, item.result) == ("item 4294967295", "", "Int", 5, "ok")


@pytest.mark.parametrize("captured", [True, False])
def test_a_notification_that_refuses_items_has_errors(captured: bool) -> None:
    """Named by the subscription, if that was captured; a value beside them is none."""
    talk = begun()
    if captured:
        log_in(talk)
        subscribe(talk)
    first, second, third = (number.to_bytes(4, "big") for number in (0xFFFFFFFE, 0xFFFFFFFF, 7))
    value = build_value(Value(0, INT, 5))
    for items in (
        b"\x13" + first,
        b"\x03" + second,
        b"\x92" + second + value + b"\x13" + third,
        b"\x92" + second + value,
    ):
        head = b"\x33" + bodies.rid(LIST_ID) + b"\4\0\0\0\0\0\1\1\1"
        talk.tell(framed(head + items + b"\0" + bytes(4), 3))
    talk.finish()
    found = [one for one in talk.transactions if one.outcome == "unsolicited"]
    assert [one.has_errors for one in found] == [True, True, True, False]
    labels = (
        ["M LID 9 [CRC 0xac43db80]", "M LID 10 [CRC 0xa1d977b6]"]
        if captured
        else ["item 4294967294", "item 4294967295"]
    )
    assert [[(error.part, error.item, error.code, error.address) for error in one.errors] for one in found] == [
        [("item", 0xFFFFFFFE, 0x13, labels[0])],
        [("item", 0xFFFFFFFF, 0x03, labels[1])],
        [("item", 7, 0x13, "item 7")],
        [],
    ]


def test_operations_of_two_connections_are_apart() -> None:
    """Both have an object of the same number."""
    talk = begun()
    other = Talk(50001, beside=talk)
    other.open()
    for one in (talk, other):
        subscribe(one)
        notify(one, 1)
    notify(other, 2)
    do(talk, 9, DELETE_OBJECT, bodies.delete_object(LIST_ID), b"\0" + bodies.rid(LIST_ID))
    other.close()
    talk.pipeline.finish()
    found = [(one.result, one.parts, one.pushes) for one in talk.operations if one.kind == "cyclic"]
    assert found == [("done", 3, 1), ("running", 3, 2)]


def test_a_deletion_of_something_else_ends_nothing() -> None:
    talk = begun()
    subscribe(talk)
    do(talk, 9, DELETE_OBJECT, bodies.delete_object(LIST_ID + 1), b"\0" + bodies.rid(LIST_ID + 1))
    notify(talk, 1)
    assert [(kind, result, parts, pushes) for kind, _, result, parts, pushes in told_of(talk)] == [
        ("cyclic", "running", 2, 1)
    ]


def test_a_subscription_whose_deletion_is_refused_goes_on() -> None:
    talk = begun()
    subscribe(talk)
    do(talk, 9, DELETE_OBJECT, bodies.delete_object(LIST_ID), DENIED + bodies.rid(LIST_ID))
    assert [(one[0], *one[2:]) for one in told_of(talk)] == [("cyclic", "running", 1, 0)]


def test_a_request_whose_end_was_not_captured_is_only_likely_answered() -> None:
    """What follows may answer another one, of which more was in the gap."""
    talk = begun()
    octets = asked(1, CREATE_OBJECT, body=bodies.create_object(3, NOTHING, ONE, integrity_id=1))
    talk.ask(framed(octets[:60], 3, trailer=False))
    talk.lose(CLIENT, framed(octets[60:], 3))
    talk.packet(SERVER)
    notify(talk, 1)
    talk.ask(framed(asked(2, SET_VARIABLE, body=bodies.set_variable(52, [1], Value(0, DINT, 1))), 3))
    talk.tell(framed(told(1, CREATE_OBJECT, b"\0\0" + bodies.end(2)), 3))
    talk.tell(framed(told(2, SET_VARIABLE, b"\0" + bodies.end(2)), 3))
    for _ in range(3):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60 * MS)
    talk.close()
    pairs = {
        one.pdu_ref: (one.outcome, one.certainty) for one in talk.transactions if one.is_plus and one.request_frame
    }
    assert pairs == {1: ("answered", "likely"), 2: ("answered", "sure")}


def test_an_answer_whose_end_was_not_captured_is_only_likely() -> None:
    data = shown(ONE, TWO)
    talk = explored(framed(data[:-17], 3, trailer=False))
    talk.lose(SERVER, framed(data[-17:-12], 3, trailer=False))
    talk.packet(CLIENT, flags=ACK)
    talk.tell(framed(data[-12:], 3))
    talk.close()
    (one,) = [one for one in talk.transactions if one.is_plus]
    assert (one.outcome, one.certainty, one.doubt) == ("answered", "likely", "gaps")


def test_an_answer_alone_that_refuses_items_names_none() -> None:
    """What was asked for is not known."""
    talk = Talk()
    talk.tell(framed(told(1, GET_MULTI_VARIABLES, bodies.multi_got([(1, Value(0, INT, 5))], [(2, 0x8104)], 2)), 3))
    talk.finish()
    (one,) = talk.transactions
    assert (one.outcome, one.has_errors, one.refused, one.errors) == ("orphan_answer", True, False, [])
