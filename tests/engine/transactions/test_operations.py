"""Operations: which transactions belong together, and what came of them."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.operation import MAX_OPEN, MAX_SUBJECT, Operation, OperationBook, result_of
from dissect.engine.transactions.operations import ENDLESS, payload_size, subject_of, subscription_of
from dissect.engine.transactions.results import ALIKE, EXPECTED, STRAY_PUSH
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.parameters import Parameters
from tests.engine.findings import events
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    FIN,
    MS,
    RST,
    SERVER,
    SYN,
    Talk,
    ack,
    dbw,
    dt,
    granted,
    setup,
    tpkt,
    userdata,
)


@pytest.fixture
def talk() -> Talk:
    """Return a talk whose connection is open and whose set-up was told."""
    talk = Talk()
    talk.open()
    assert [one.kind for one in talk.operations] == ["connect"]
    talk.operations.clear()
    return talk


def only(talk: Talk) -> Operation:
    (operation,) = talk.operations
    return operation


# ---- connections ----------------------------------------------------------------------------------------------------


def test_a_connection_from_its_first_packet_to_the_setup() -> None:
    talk = Talk()
    talk.open(2, 3, 240)
    talk.close()
    told = only(talk)
    assert (told.kind, told.result, told.subject) == ("connect", "done", "PDU 240, AmQ 2/3")
    assert (told.first_frame, told.last_frame, told.duration_ns) == (1, 7, 6 * MS)
    assert (told.parts, told.transactions, told.number) == (1, [1], 1)


def test_without_a_handshake_it_begins_with_the_setup() -> None:
    talk = Talk()
    talk.ask(setup(1))
    talk.tell(granted(1))
    assert (only(talk).first_frame, only(talk).last_frame) == (1, 2)


def test_a_later_setup_is_no_other_connection(talk: Talk) -> None:
    talk.ask(setup(1))
    talk.tell(granted(1))
    talk.close()
    assert talk.operations == []


def test_a_setup_that_is_refused() -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.ask(setup(1))
    talk.tell(ack(1, 0x8104))
    talk.close()
    assert (only(talk).result, only(talk).error_code, only(talk).subject) == ("refused", 0x8104, "asks PDU 480")


def test_a_connection_that_is_refused() -> None:
    talk = Talk()
    talk.hello()
    talk.packet(CLIENT, tpkt(bytes.fromhex("11e00000000100c1020100c2020102c0010a")))
    talk.packet(SERVER, tpkt(bytes.fromhex("06800001000003")))
    talk.close()
    told = only(talk)
    assert (told.kind, told.result, told.parts) == ("connect", "refused", 0)
    assert told.subject == talk.connections[0].refused != ""


def test_a_connection_that_is_never_set_up() -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.packet(CLIENT, flags=RST | ACK)
    talk.finish()
    assert (only(talk).result, only(talk).reason) == ("unfinished", "connection_closed")


def test_what_never_asked_to_connect_is_no_operation() -> None:
    talk = Talk()
    talk.packet(CLIENT, flags=SYN)
    talk.packet(SERVER, flags=RST | ACK)
    talk.finish()
    assert talk.operations == []


# ---- answers in parts -----------------------------------------------------------------------------------------------


def list_of(size: int) -> bytes:
    """An SZL answer of ``size`` octets: the head and records of two octets."""
    return bytes.fromhex("000000000002") + ((size - 8) // 2).to_bytes(2, "big") + bytes(size - 8)


def test_an_answer_in_three_parts(talk: Talk) -> None:
    whole = list_of(100)
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, whole[:40], sequence=3, part=9))
    talk.ask(events.asks(2, 4, 1, sequence=3))
    talk.tell(events.tells(2, 4, 1, whole[40:80], sequence=3, part=9))
    talk.ask(events.asks(3, 4, 1, sequence=3))
    talk.tell(events.tells(3, 4, 1, whole[80:], sequence=3, part=-9))
    told = only(talk)
    assert (told.kind, told.result, told.octets, told.parts) == ("long_answer", "done", 100, 3)
    assert told.subject.startswith("SZL 0x0000 ")
    assert told.content == whole
    assert [part.layout.name for part in told.content_parts()] == ["SZL head", *["SZL id of the module"] * 46]
    assert (told.first_frame, told.last_frame) == (8, 13)


def test_a_part_that_is_refused(talk: Talk) -> None:
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, list_of(40), sequence=3, part=9))
    talk.ask(events.asks(2, 4, 1, sequence=3))
    talk.tell(events.tells(2, 4, 1, sequence=3, code=0xD405))
    assert (only(talk).result, only(talk).error_code) == ("failed", 0xD405)
    assert (only(talk).content, only(talk).content_parts()) == (b"", [])


def test_parts_that_are_not_fetched(talk: Talk) -> None:
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, list_of(40), sequence=3, part=9))
    talk.ask(events.szl(2, 0))
    talk.tell(events.tells(2, 4, 1, list_of(40), sequence=3, part=9))
    talk.close()
    assert [(one.result, one.reason) for one in talk.operations] == [
        ("unfinished", "restarted"),
        ("unfinished", "connection_closed"),
    ]


def test_a_whole_answer_is_no_operation(talk: Talk) -> None:
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, list_of(40), sequence=3))
    talk.close()
    assert talk.operations == []


# ---- BSEND ----------------------------------------------------------------------------------------------------------


def send(talk: Talk, pdu: bytes, pdu_ref: int, code: int = 0) -> None:
    talk.ask(pdu)
    talk.tell(events.tells(pdu_ref, 6, 1, sequence=2, code=code))


def test_a_bsend_in_three_pieces(talk: Talk) -> None:
    send(talk, events.bsend(1, b"abc", 8, part=5), 1)
    send(talk, events.bsend(2, b"\xff\xffd", sequence=2, part=6), 2)
    send(talk, events.bsend(3, b"ef", sequence=2, part=-7), 3)
    told = only(talk)
    assert (told.kind, told.result, told.subject, told.complete) == ("bsend", "done", "R_ID 0x00000001", True)
    assert (told.octets, told.announced, told.parts, told.oddities) == (8, 8, 3, [])
    assert told.content == bytes.fromhex("1206130000000001 0008") + b"abc\xff\xffdef"
    assert [part.layout.name for part in told.content_parts()] == ["R_ID", "BSEND length", "BSEND data"]
    assert told.content_parts()[2].octets("bsend_data") == b"abc\xff\xffdef"
    assert (told.first_frame, told.last_frame) == (8, 13)


def test_two_bsends_at_once_are_told_apart(talk: Talk) -> None:
    send(talk, events.bsend(1, b"ab", 4, part=5), 1)
    send(talk, events.bsend(2, b"cd", 4, part=6, r_id=2), 2)
    talk.tell(events.bsend(9, b"ef", 4, part=6))  # the partner sends with the same R_ID
    talk.ask(events.tells(9, 6, 1, sequence=2))
    send(talk, events.bsend(3, b"CD", sequence=2, part=-7, r_id=2), 3)
    send(talk, events.bsend(4, b"AB", sequence=2, part=-8), 4)
    talk.close()
    assert [(one.asked_by, one.content[10:], one.result) for one in talk.operations] == [
        (0, b"cdCD", "done"),
        (0, b"abAB", "done"),
        (1, b"", "unfinished"),
    ]


def test_a_bsend_that_is_refused_begun_again_or_of_another_size(talk: Talk) -> None:
    send(talk, events.bsend(1, b"ab", 4, part=5), 1)
    send(talk, events.bsend(2, b"ab", 4, part=6), 2)
    send(talk, events.bsend(3, b"cd", sequence=2, part=7), 3, code=0xD209)
    send(talk, events.bsend(4, b"ab", 4, part=8), 4)
    send(talk, events.bsend(5, b"cde", sequence=2, part=-9), 5)
    assert [(one.result, one.reason, one.error_code) for one in talk.operations] == [
        ("unfinished", "restarted", 0),
        ("failed", "", 0xD209),
        ("done", "", 0),
    ]
    assert talk.operations[1].content == b""
    assert [(odd.name, odd.detail) for odd in talk.operations[2].oddities] == [("wrong_size", "5 bytes, 4 announced")]


def test_a_bsend_alone_or_without_its_beginning_is_no_operation(talk: Talk) -> None:
    send(talk, events.bsend(1, b"ab", 2), 1)
    send(talk, events.bsend(2, b"cd", sequence=2, part=-7), 2)
    talk.tell(events.tells(3, 6, 1, sequence=2))
    talk.close()
    assert talk.operations == []


# ---- subscriptions --------------------------------------------------------------------------------------------------


def subscribe(talk: Talk, job: int, pdu_ref: int = 1, code: int = 0) -> None:
    talk.ask(events.asks(pdu_ref, 2, 1, events.CYCLIC))
    talk.tell(events.tells(pdu_ref, 2, 1, b"" if code else events.CYCLIC_VALUES, sequence=job, code=code))


def test_a_cyclic_subscription_with_its_pushes_and_its_end(talk: Talk) -> None:
    subscribe(talk, 5)
    for _ in range(3):
        talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
    talk.ask(events.asks(2, 2, 4, bytes((5, 5))))
    talk.tell(events.tells(2, 2, 4))
    told = only(talk)
    assert (told.kind, told.result, told.parts, told.pushes) == ("cyclic", "done", 5, 3)
    assert told.octets == 4 * len(events.CYCLIC_VALUES)
    assert told.subject == "every 1 s, DB10.DBW4"


def test_the_interval_of_pushes_is_theirs(talk: Talk) -> None:
    """How long it takes until the first push, and from the last one to the end of the subscription, is no interval."""
    subscribe(talk, 5)
    for _ in range(3):
        talk.wait(500 * MS)
        talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5), after_ns=0)
    talk.wait(60_000 * MS)
    talk.ask(events.asks(2, 2, 4, bytes((5, 5))))
    talk.tell(events.tells(2, 2, 4))
    assert only(talk).push_interval_ns == 500 * MS


def test_one_push_has_no_interval(talk: Talk) -> None:
    subscribe(talk, 5)
    talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
    talk.close()
    assert only(talk).push_interval_ns == 0


def test_two_subscriptions_are_told_apart(talk: Talk) -> None:
    subscribe(talk, 5, 1)
    subscribe(talk, 6, 2)
    talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=6))
    talk.close()
    assert [(one.pushes, one.result, one.reason) for one in talk.operations] == [
        (0, "running", "connection_closed"),
        (1, "running", "connection_closed"),
    ]


def test_a_subscription_that_is_refused(talk: Talk) -> None:
    subscribe(talk, 0, code=0xD805)
    assert (only(talk).result, only(talk).error_code) == ("refused", 0xD805)


def test_a_subscription_that_is_changed(talk: Talk) -> None:
    subscribe(talk, 5)
    talk.ask(events.asks(2, 2, 7, events.CYCLIC, sequence=5))
    talk.tell(events.tells(2, 2, 7, events.CYCLIC_VALUES, sequence=5))
    talk.close()
    assert only(talk).parts == 2


def test_messages_until_they_are_cancelled(talk: Talk) -> None:
    talk.ask(events.asks(1, 4, 2, events.SUBSCRIBE))
    talk.tell(events.tells(1, 4, 2, b"\x02\x00", sequence=1))
    talk.tell(events.mode(2))
    talk.ask(events.asks(2, 4, 2, events.UNSUBSCRIBE))
    talk.tell(events.tells(2, 4, 2, b"\x02\x00", sequence=1))
    told = only(talk)
    assert (told.kind, told.result, told.parts, told.pushes) == ("messages", "done", 3, 1)


def test_messages_that_are_asked_for_again(talk: Talk) -> None:
    """What a subscription is about is all that it was asked for, as pushes may be of each; what is refused does not count."""
    talk.ask(events.asks(1, 4, 2, events.SUBSCRIBE))
    talk.tell(events.tells(1, 4, 2, b"\x02\x00"))
    alarms = bytes.fromhex("8100") + b"ABCDEFGH" + bytes.fromhex("0500")
    talk.ask(events.asks(2, 4, 2, alarms))
    talk.tell(events.tells(2, 4, 2, b"\x02\x00\x05\x01\x00"))
    talk.ask(events.asks(3, 4, 2, bytes.fromhex("0300") + b"ABCDEFGH"))
    talk.tell(events.tells(3, 4, 2, code=0x8104))
    talk.finish()
    told = only(talk)
    assert (told.subject, told.parts) == ("events: mode transitions, alarms, ALARM initiate", 3)


@pytest.mark.parametrize(
    ("alarm_type", "ends"),
    [
        (0, True),
        (1, False),
        (2, False),
        (3, False),
        (4, True),
        (5, False),
        (6, True),
        (7, False),
        (8, True),
        (9, False),
    ],
)
def test_alarm_types_that_abort_end_the_messages(alarm_type: int, ends: bool, talk: Talk) -> None:
    alarms = bytes.fromhex("8100") + b"ABCDEFGH" + bytes((5, 0))
    talk.ask(events.asks(1, 4, 2, alarms))
    talk.tell(events.tells(1, 4, 2, b"\x02\x00\x05\x01\x00"))
    talk.ask(events.asks(2, 4, 2, alarms[:-2] + bytes((alarm_type, 0))))
    talk.tell(events.tells(2, 4, 2, b"\x02\x00"))
    talk.finish()
    told = only(talk)
    assert (told.kind, told.result == "done", told.parts) == ("messages", ends, 2)


def test_cancelling_what_was_not_subscribed_to_is_no_operation(talk: Talk) -> None:
    talk.ask(events.asks(2, 4, 2, events.UNSUBSCRIBE))
    talk.tell(events.tells(2, 4, 2, b"\x02\x00", sequence=1))
    talk.close()
    assert talk.operations == []


def test_a_test_job_that_is_enabled_pushes_and_is_deleted(talk: Talk) -> None:
    talk.ask(events.asks(1, 1, 2, events.TEST_JOB))
    talk.tell(events.tells(1, 1, 2, sequence=4))
    named = bytes.fromhex("00000002") + bytes((2, 4))
    talk.ask(events.asks(2, 1, 0x0E, named))
    talk.tell(events.tells(2, 1, 0x0E, sequence=5))
    talk.tell(
        events.pushes(1, 2, bytes.fromhex("0004000800000000") + bytes.fromhex("0001ff0400101234"[:16]), sequence=4)
    )
    talk.ask(events.asks(3, 1, 0x0F, bytes.fromhex("00000004") + b"\0\0" + bytes((2, 4))))
    talk.tell(events.tells(3, 1, 0x0F, sequence=6))
    told = only(talk)
    assert (told.kind, told.result, told.parts, told.pushes) == ("test_job", "done", 4, 1)
    assert told.subject == "variable status: MW0"


def test_a_job_with_the_number_of_another_ends_it(talk: Talk) -> None:
    """Pushes and steps belong to the later one; a job that is refused has no number."""
    for reference, code in ((1, 0), (2, 0), (3, 0xD805)):
        talk.ask(events.asks(reference, 1, 2, events.TEST_JOB))
        talk.tell(events.tells(reference, 1, 2, sequence=4, code=code))
        talk.tell(events.pushes(1, 2, bytes(8), sequence=4))
    talk.close()
    told = [(one.first_frame, one.parts, one.pushes, one.result, one.reason) for one in talk.operations]
    first = talk.operations[0].first_frame
    assert told == [
        (first, 2, 1, "done", "number reused"),
        (first + 6, 1, 0, "refused", ""),
        (first + 3, 3, 2, "running", "connection_closed"),
    ]


def test_a_cyclic_job_with_the_number_of_another_ends_it(talk: Talk) -> None:
    subscribe(talk, 5, 1)
    subscribe(talk, 5, 2)
    talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
    talk.close()
    assert [(one.pushes, one.result) for one in talk.operations] == [(0, "done"), (1, "running")]


def test_a_password_is_an_operation_of_its_own(talk: Talk) -> None:
    talk.ask(events.asks(1, 5, 1, events.PASSWORD))
    talk.tell(events.tells(1, 5, 1, code=0xD602))
    told = only(talk)
    assert (told.kind, told.result, told.error_code, told.subject) == ("password", "refused", 0xD602, "")


# ---- bounds ---------------------------------------------------------------------------------------------------------


def test_the_oldest_of_too_many_gives_way(talk: Talk) -> None:
    for number in range(MAX_OPEN + 1):
        subscribe(talk, number, number + 1)
    assert (only(talk).result, only(talk).reason) == ("unfinished", "too many at once")
    assert talk.pipeline.exchange.watch.operations.evicted == 1
    assert len(talk.pipeline.table.all_open()[0].connection.operations.these) == MAX_OPEN


def test_the_numbers_of_endless_transactions_are_bounded(talk: Talk) -> None:
    subscribe(talk, 5)
    for _ in range(1500):
        talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.close()
    told = only(talk)
    assert (told.parts, told.pushes, len(told.transactions)) == (1501, 1500, 1000)
    assert told.kind in ENDLESS


# ---- pushes that belong to none -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "stray"), [("", True), ("mid-stream", False), ("gap of the client", False), ("gap of the server", False)]
)
def test_a_push_of_no_subscription_is_stray_where_all_was_captured(case: str, stray: bool) -> None:
    talk = Talk()
    if case == "mid-stream":
        talk.ask(setup(0))
        talk.tell(granted(0))
    else:
        talk.open()
    if "gap" in case:
        side = CLIENT if "client" in case else SERVER
        talk.lose(side, setup(9))
        talk.packet(1 - side)
        talk.packet(side, dt(events.szl(8, 0x11) if side == CLIENT else events.mode(2)))
        for _ in range(2):
            talk.packet(CLIENT)
            talk.packet(SERVER, after_ns=60 * MS)
    talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
    push = talk.transactions[-1]
    assert bool(push._flags & STRAY_PUSH) is stray


def test_what_a_program_sends_needs_no_subscription(talk: Talk) -> None:
    talk.tell(userdata(0, bytes.fromhex("0001120812061f0000000000"), events.payload(bytes(8))))
    talk.tell(events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5))
    assert [bool(one._flags & STRAY_PUSH) for one in talk.transactions[-1:]] == [True]


@pytest.mark.parametrize(
    ("push", "kind"),
    [
        (events.pushes(2, 1, events.CYCLIC_VALUES, sequence=5), "cyclic"),
        (events.pushes(2, 1, events.CYCLIC_VALUES, sequence=6), ""),
        (events.pushes(1, 2, bytes(8), sequence=4), "test_job"),
        (events.pushes(1, 1, bytes(8), sequence=4), ""),  # a job of another function
        (events.mode(2), "messages"),
        (events.pushes(4, 3, bytes(20)), "messages"),  # a diagnostic message
        (events.pushes(4, 1, bytes(20)), ""),  # no message
        (events.pushes(3, 3, bytes(20)), ""),
    ],
)
def test_the_subscription_of_a_push(talk: Talk, push: bytes, kind: str) -> None:
    subscribe(talk, 5)
    talk.ask(events.asks(2, 1, 2, events.TEST_JOB))
    talk.tell(events.tells(2, 1, 2, sequence=4))
    talk.ask(events.asks(3, 4, 2, events.SUBSCRIBE))
    talk.tell(events.tells(3, 4, 2, b"\x02\x00", sequence=1))
    talk.tell(push)
    found = subscription_of(talk.transactions[-1])
    assert (found.kind if found is not None else "") == kind
    going = talk.transactions[-1].connection.operations.these
    assert [(one.kind, int(one.pushes)) for one in going if one.pushes] == ([(kind, 1)] if kind else [])
    assert [int(one.parts) for one in going if one.pushes] == ([2] if kind else [])


# ---- gaps in long answers -------------------------------------------------------------------------------------------


def test_a_part_of_which_neither_request_nor_answer_was_captured(talk: Talk) -> None:
    whole = list_of(100)
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, whole[:40], sequence=3, part=9))
    talk.lose(CLIENT, events.asks(2, 4, 1, sequence=3))
    talk.lose(SERVER, events.tells(2, 4, 1, whole[40:80], sequence=3, part=9))
    talk.ask(events.asks(3, 4, 1, sequence=3))
    talk.tell(events.tells(3, 4, 1, whole[80:], sequence=3, part=-9))
    for _ in range(2):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60 * MS)
    talk.close()
    told = only(talk)
    assert (told.result, told.content, told.parts, told.octets) == ("not_captured", b"", 2, 60)


def test_a_long_answer_with_fewer_records_than_its_head_states(talk: Talk) -> None:
    whole = list_of(100)
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, whole[:40], sequence=3, part=9))
    talk.ask(events.asks(2, 4, 1, sequence=3))
    talk.tell(events.tells(2, 4, 1, whole[40:90], sequence=3, part=-9))
    told = only(talk)
    assert (told.result, told.octets, told.announced) == ("done", 90, 100)
    assert [(one.name, one.frame) for one in told.oddities] == [("wrong_size", told.last_frame)]
    assert told.oddities[0].detail == "SZL 0x0000 states 46 records of 2 bytes, 82 bytes are there"
    assert told.frames_of(0, 90) == [9, 11]
    assert told.places == [(40, 9), (90, 11)]


@pytest.mark.parametrize(("size", "payload"), [(0, 0), (1, 1), (300, 300)])
def test_the_size_of_a_payload(talk: Talk, size: int, payload: int) -> None:
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, bytes(size), sequence=3))
    assert payload_size(talk.transactions[-1]) == payload
    talk.ask(events.szl(2, 0))
    talk.close()
    assert payload_size(talk.transactions[-1]) == 0


def test_a_subject_is_bounded(talk: Talk) -> None:
    items = bytes((0, 19, 1, 1)) + b"".join(dbw(number, 1000 + 2 * number) for number in range(1, 20))
    talk.ask(events.asks(1, 2, 1, items))
    talk.tell(events.tells(1, 2, 1, events.CYCLIC_VALUES, sequence=5))
    subject = subject_of(talk.transactions[-1])
    assert len(subject) == MAX_SUBJECT
    assert subject.startswith("every 1 s, DB1.DBW1002, DB2.DBW1004, ")
    assert subject_of(Transaction(1, talk.transactions[-1].connection, 0, 1, 1, Parameters(b"\x29", 1))) == "PLC stop"


# ---- results --------------------------------------------------------------------------------------------------------


def test_the_result_of_the_last_step(talk: Talk) -> None:
    talk.ask(events.szl(1, 0))
    talk.tell(events.tells(1, 4, 1, bytes(8), sequence=3))
    talk.ask(events.szl(2, 0))
    talk.tell(events.no_szl(2))
    good, bad = talk.transactions[-2:]
    assert result_of(good, "well", "wrong") == ("well", "", None)
    assert result_of(good, "well", "wrong", 0) == ("well", "", None)
    result, reason, error = result_of(bad, "well", "wrong")
    assert (result, reason, error.code if error is not None else 0) == ("wrong", "", 0xD401)
    assert result_of(bad, "well", "wrong", 0) == ("well", "", None)  # the item went well
    result, reason, error = result_of(good, "well", "wrong", 0x8104)
    assert error is not None
    assert (result, error.where, error.code) == ("wrong", "return value", 0x8104)
    talk.ask(events.szl(3, 0))
    talk.finish()
    assert result_of(talk.transactions[-1], "well", "wrong") == ("unfinished", "capture_ended", None)
    lost = talk.transactions[-1]
    lost._flags |= EXPECTED
    assert result_of(lost, "well", "wrong", 5) == ("not_captured", "", None)


def test_likely_pairs_of_an_operation_are_counted(talk: Talk) -> None:
    subscribe(talk, 5)
    operation = talk.transactions[-1].connection.operations.these[0]
    assert (operation.parts, operation.likely) == (1, 0)
    talk.ask(events.asks(2, 2, 7, events.CYCLIC, sequence=5))
    talk.tell(events.tells(2, 2, 7, events.CYCLIC_VALUES, sequence=5))
    changed = talk.transactions[-1]
    changed._flags |= ALIKE
    operation._add(changed)
    operation._add(changed)
    assert (operation.parts, operation.likely) == (4, 2)


@pytest.mark.parametrize(
    ("half", "answered", "result"), [(True, 0, "not_captured"), (True, 1, "unfinished"), (False, 0, "unfinished")]
)
def test_an_operation_without_its_end(talk: Talk, half: bool, answered: int, result: str) -> None:
    subscribe(talk, 5)
    operation = talk.transactions[-1].connection.operations.these[0]
    operation.half_captured = half
    operation.connection.answered = answered
    OperationBook().break_off(operation, "why")
    assert (operation.result, operation.reason) == (result, "why" if result == "unfinished" else "")


def test_a_connection_of_another_protocol_is_none_that_was_not_set_up() -> None:
    """S7comm-plus has no Setup communication."""
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.ask(bytes.fromhex("7201000e31000004ca00000001000003863400000000") + bytes.fromhex("72010000"))
    talk.close()
    assert talk.connections[0].protocol == "s7comm_plus"
    assert [one.kind for one in talk.operations if one.kind == "connect"] == []


def test_other_functions_of_the_cpu_do_not_belong_to_its_messages(talk: Talk) -> None:
    talk.ask(events.asks(1, 4, 2, events.SUBSCRIBE))
    talk.tell(events.tells(1, 4, 2, b"\x02\x00", sequence=1))
    talk.ask(events.szl(2, 0x11))
    talk.tell(events.tells(2, 4, 1, list_of(40), sequence=3))
    talk.close()
    told = only(talk)
    assert (told.kind, told.result, told.parts) == ("messages", "running", 1)
