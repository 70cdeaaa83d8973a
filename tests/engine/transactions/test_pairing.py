"""Who asked, who answered: reference section 5 point by point, through the whole pipeline."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.engine.transactions.open_requests import MAX_BEHIND, MAX_ORPHANS
from dissect.engine.transactions.pairing import FEW_OPEN, MAX_OPEN, MAX_OPEN_ALL
from dissect.engine.transactions.results import (
    EXPECTED,
    FUNCTION_MISMATCH,
    REORDERED,
)
from dissect.engine.transactions.transaction import (
    CAPTURE_ENDED,
    CONNECTION_CLOSED,
    HOLE,
    REFERENCE_REUSED,
    TABLE_FULL,
    Transaction,
)
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    CONFIRM,
    CONNECT,
    FIN,
    MS,
    RST,
    SECOND,
    SERVER,
    SYN,
    Talk,
    ack,
    ack_data,
    dbw,
    dt,
    good,
    granted,
    head,
    job,
    read,
    refused,
    setup,
    tpkt,
    userdata,
    words,
    write,
    written,
)

REQUEST, RESPONSE, PUSH = 1, 2, 0


@pytest.fixture
def talk() -> Talk:
    """A connection that is set up."""
    talk = Talk()
    talk.open(8, 8)
    return talk


def reasons(talk: Talk) -> list[str]:
    return [transaction.reason for transaction in talk.transactions]


def only(talk: Talk) -> Transaction:
    assert len(talk.transactions) == 1
    return talk.transactions[0]


# ---- 5.1 the key ----------------------------------------------------------------------------------------------------


def test_a_request_and_its_answer(talk: Talk) -> None:
    asked = talk.ask(read(0x0102, dbw(10, 4, 3)))
    answered = talk.tell(words(0x0102, 1, 2, 3), after_ns=7 * MS)
    one = only(talk)
    assert talk.pairs() == [(asked, answered)]
    assert (one.outcome, one.reason, one.rosctr, one.pdu_ref) == ("answered", "", 1, 0x0102)
    assert (one.asked_by, one.latency_ns, one._flags, one.has_errors) == (CLIENT, 7 * MS, 0, False)
    assert (one.function, one.function_name) == (4, "Read Var")
    assert one.request_octets == read(0x0102, dbw(10, 4, 3))
    assert one.response_octets == words(0x0102, 1, 2, 3)
    assert (one.connection.answered, one.connection.pdus) == (2, 4)


def test_answer_and_function_must_fit(talk: Talk) -> None:
    """The answer is the only one there is, so it is taken and told (ROSCTR 3: mismatch is an anomaly)."""
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(ack_data(1, b"\x05\x01", b"\x05"))
    one = only(talk)
    assert (one.outcome, one._flags) == ("answered", FUNCTION_MISMATCH)
    assert (one.function, one.has_errors, one.errors) == (4, False, [])


def test_an_ack_takes_the_function_from_the_request(talk: Talk) -> None:
    talk.ask(job(7, b"\x1d" + bytes(17)))
    talk.tell(ack(7, 0xD209))
    one = only(talk)
    assert (one.function_name, one._flags, one.has_errors, one.error_code) == ("Start upload", 0, True, 0xD209)
    assert [(error.where, error.code, error.name) for error in one.errors] == [("header", 0xD209, "Block not found")]


def test_an_ack_that_names_the_function(talk: Talk) -> None:
    talk.ask(read(7, dbw(1, 0)))
    talk.tell(ack(7, 0x8104, b"\x04"))
    assert (only(talk)._flags, only(talk).error_code) == (0, 0x8104)


def test_userdata_by_group_and_subfunction(talk: Talk) -> None:
    talk.ask(userdata(1, head(REQUEST, 4, 1)))
    talk.tell(userdata(1, head(RESPONSE, 4, 1, 9, 0)))  # the sequence number is chosen by the answering side
    talk.ask(userdata(2, head(REQUEST, 4, 1)))
    talk.tell(userdata(2, head(RESPONSE, 4, 2, 0, 0)))
    talk.ask(userdata(3, head(REQUEST, 4, 1)))
    talk.tell(userdata(3, head(RESPONSE, 3, 1, 0, 0)))
    assert talk.outcomes() == ["answered"] * 3
    assert [one._flags for one in talk.transactions] == [0, FUNCTION_MISMATCH, FUNCTION_MISMATCH]
    assert talk.transactions[0].function_name == "CPU functions: read SZL"


def test_rosctr_belongs_to_the_key(talk: Talk) -> None:
    first = talk.ask(read(5, dbw(1, 0)))
    second = talk.ask(userdata(5, head(REQUEST, 4, 1)))
    third = talk.tell(userdata(5, head(RESPONSE, 4, 1, 1, 0)))
    fourth = talk.tell(words(5, 1))
    assert talk.pairs() == [(second, third), (first, fourth)]
    assert [one.rosctr for one in talk.transactions] == [7, 1]


def test_either_end_asks_and_the_references_are_independent(talk: Talk) -> None:
    """A download: the PLC sends jobs with references of its own, which collide with the client's."""
    ours = talk.ask(read(1, dbw(1, 0)))
    theirs = talk.tell(job(1, b"\x1b" + bytes(17)))
    data = talk.ask(ack_data(1, b"\x1b\x00", b"\x00\x02\x00\xfbpp"))
    answer = talk.tell(words(1, 42))
    assert talk.pairs() == [(theirs, data), (ours, answer)]
    assert [one.asked_by for one in talk.transactions] == [SERVER, CLIENT]
    assert [one.function_name for one in talk.transactions] == ["Download block", "Read Var"]


def test_an_end_does_not_answer_itself(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.ask(words(1, 42))
    talk.close()
    assert sorted(talk.outcomes()) == ["orphan_answer", "unanswered"]


def test_bsend_from_both_sides(talk: Talk) -> None:
    first = talk.ask(userdata(3, head(REQUEST, 6, 1, 0, 0)))
    second = talk.tell(userdata(3, head(REQUEST, 6, 1, 0, 0)))
    third = talk.tell(userdata(3, head(RESPONSE, 6, 1, 0, 0)))
    fourth = talk.ask(userdata(3, head(RESPONSE, 6, 1, 0, 0)))
    assert talk.pairs() == [(first, third), (second, fourth)]


def test_parts_of_a_long_answer_pair_with_their_own_requests(talk: Talk) -> None:
    first = userdata(1, bytes.fromhex("000112081284010cd5010000"))
    last = userdata(2, bytes.fromhex("000112081284010cd5000000"))
    asked = talk.ask(userdata(1, head(REQUEST, 4, 1)))
    told = talk.tell(first)
    again = talk.ask(userdata(2, bytes.fromhex("000112081244010c00000000")))
    rest = talk.tell(last)
    assert talk.pairs() == [(asked, told), (again, rest)]


def test_pushes_belong_to_nothing(talk: Talk) -> None:
    talk.ask(userdata(0, head(REQUEST, 2, 1)))
    pushed = talk.tell(userdata(0, head(PUSH, 2, 1, 4, 0)))
    stopped = talk.tell(userdata(0, bytes.fromhex("0100101000000000"), b""))
    talk.tell(userdata(0, head(RESPONSE, 2, 1, 4, 0)))
    assert talk.outcomes() == ["unsolicited", "unsolicited", "answered"]
    assert talk.pairs()[:2] == [(0, pushed), (0, stopped)]
    push = talk.transactions[0]
    assert (push.asked_by, push.latency_ns, push.request, push.has_errors) == (CLIENT, None, None, False)
    assert push.connection.unsolicited == 2
    assert talk.transactions[1].function_name == "mode transition: STOP"


def test_a_push_may_carry_an_error(talk: Talk) -> None:
    talk.tell(userdata(0, head(PUSH, 2, 1, 4, 0xD807)))
    push = only(talk)
    assert [(error.where, error.code, error.name) for error in push.errors] == [("parameter", 0xD807, "Overload")]


# ---- 5.2 what not to assume of a reference --------------------------------------------------------------------------


def test_references_start_anywhere_wrap_and_may_be_zero(talk: Talk) -> None:
    for pdu_ref in (0xFFFE, 0xFFFF, 0, 1):
        talk.ask(read(pdu_ref, dbw(1, pdu_ref & 7)))
        talk.tell(words(pdu_ref, pdu_ref))
    assert talk.outcomes() == ["answered"] * 4
    assert [one.s7_results[0].value for one in talk.transactions] == [0xFFFE, 0xFFFF, 0, 1]


@pytest.mark.parametrize("pdu_ref", [0x0500, 0])
def test_one_reference_for_everything(talk: Talk, pdu_ref: int) -> None:
    for value in range(20):
        talk.ask(read(pdu_ref, dbw(1, value % 3)))
        talk.tell(words(pdu_ref, value))
    assert talk.outcomes() == ["answered"] * 20
    assert [one.s7_results[0].value for one in talk.transactions] == [*range(20)]
    assert [one.latency_ns for one in talk.transactions] == [MS] * 20


def test_a_setup_may_use_the_reference_of_the_next_job() -> None:
    talk = Talk()
    talk.hello()
    talk.connect()
    talk.ask(setup(1))
    talk.tell(granted(1))
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    assert talk.outcomes() == ["answered"] * 2


def test_a_reference_used_again_while_open() -> None:
    talk = Talk()
    talk.open()
    lost = talk.ask(read(5, dbw(1, 0)))
    asked = talk.ask(read(5, dbw(1, 2)))
    answered = talk.tell(words(5, 7))
    assert talk.pairs() == []  # the other answer may still come
    talk.silence(SECOND)
    assert talk.pairs() == [(lost, 0), (asked, answered)]
    assert [one.certainty for one in talk.transactions] == ["", "likely"]
    assert reasons(talk) == [REFERENCE_REUSED, ""]
    assert only_unanswered(talk).connection.unanswered == 1


def only_unanswered(talk: Talk) -> Transaction:
    found = [one for one in talk.transactions if one.outcome == "unanswered"]
    assert len(found) == 1
    return found[0]


def test_identical_requests_are_answered_in_turn(talk: Talk) -> None:
    asked = [talk.ask(read(5, dbw(1, 0))) for _ in range(3)]
    answered = [talk.tell(words(5, value)) for value in range(3)]
    assert talk.pairs() == [*zip(asked, answered, strict=True)]


def test_more_requests_of_one_reference_than_may_wait(talk: Talk) -> None:
    asked = [talk.ask(read(5, dbw(1, 0))) for _ in range(MAX_BEHIND + 3)]
    assert talk.pairs() == [(frame, 0) for frame in asked[:2]]
    talk.tell(words(5, 1))
    talk.finish()
    assert talk.outcomes().count("answered") == 1
    assert len(talk.transactions) == MAX_BEHIND + 3


def test_a_lost_answer_shifts_nothing(talk: Talk) -> None:
    """A client that never changes its reference polls on after one answer failed to come."""
    talk.ask(read(5, dbw(1, 0)))
    talk.wait(2 * SECOND)
    for value in range(5):
        talk.ask(read(5, dbw(1, 0)))
        talk.tell(words(5, value))
        talk.wait(SECOND // 10)
    talk.silence(2 * SECOND)
    assert reasons(talk) == [REFERENCE_REUSED] + [""] * 5
    assert [one.response_ns - one.request_ns for one in talk.transactions[1:]] == [MS] * 5
    assert {one.certainty for one in talk.transactions[1:]} == {"likely"}


def test_an_answer_lost_in_a_hole_shifts_nothing(talk: Talk) -> None:
    talk.ask(read(5, dbw(1, 0)))
    talk.lose(SERVER, words(5, 99))
    for value in range(15):
        talk.ask(read(5, dbw(1, 0)))
        talk.tell(words(5, value))
    requests = talk.pipeline.table.all_open()[0].connection.open_requests[CLIENT]
    assert (requests.count, len(requests.table)) == (0, 0)
    talk.close()
    found = {(one.outcome, one.reason) for one in talk.transactions}
    assert found == {("answered", ""), ("unanswered", HOLE)}
    assert len(talk.transactions) == 16
    late = [one for one in talk.transactions if one.outcome == "answered"][-4:]
    assert [one.s7_results[0].value for one in late] == [11, 12, 13, 14]
    assert [one.latency_ns for one in late] == [MS] * 4


# ---- 5.3 who is the client ------------------------------------------------------------------------------------------


def test_without_a_handshake_the_job_tells_who_the_client_is() -> None:
    for octets, client in (
        (read(1, dbw(1, 0)), SERVER),
        (setup(1), SERVER),
        (userdata(1, head(REQUEST, 4, 1)), SERVER),
        (job(1, b"\x29" + bytes(5)), SERVER),
        (job(1, b"\x1b" + bytes(17)), CLIENT),
        (job(1, b"\x1c" + bytes(17)), CLIENT),
    ):
        talk = Talk(40000, 40001)
        talk.tell(octets)
        talk.finish()
        connection = talk.connections[0]
        assert (str(connection.client).endswith(":4000" + "01"[client]), connection.client_known) == (True, True)


def test_bsend_and_unknown_functions_tell_nothing() -> None:
    for octets in (userdata(1, head(REQUEST, 6, 1)), job(1, b"\x77"), words(1, 1)):
        talk = Talk(102, 40001)  # port 102 as a last hint
        talk.tell(octets)
        talk.finish()
        connection = talk.connections[0]
        assert (connection.client.port, connection.client_known) == (40001, False)


def test_an_answer_from_the_registered_port_tells_who_asked() -> None:
    """Though the PLC asks something itself before the client is seen to ask."""
    talk = Talk(40000, 102)
    talk.tell(words(1, 1))
    talk.tell(read(2, dbw(1, 0)))
    talk.ask(words(2, 1))
    talk.tell(userdata(0, head(PUSH, 4, 3)))
    talk.finish()
    connection = talk.connections[0]
    assert (connection.client.port, connection.client_known) == (40000, True)
    assert sorted(talk.outcomes()) == ["answered", "orphan_answer", "unsolicited"]


# ---- 5.4 several outstanding ----------------------------------------------------------------------------------------


def test_answers_in_another_order(talk: Talk) -> None:
    asked = [talk.ask(read(number, dbw(1, number))) for number in range(5)]
    answered = {number: talk.tell(words(number, number)) for number in (3, 0, 4, 1, 2)}
    assert talk.pairs() == [(asked[number], answered[number]) for number in (3, 0, 4, 1, 2)]
    assert [one.s7_results[0].value for one in talk.transactions] == [3, 0, 4, 1, 2]


def test_several_pdus_in_a_segment(talk: Talk) -> None:
    asked = talk.ask(*(read(number, dbw(1, number)) for number in range(4)))
    answered = talk.tell(*(words(number, number) for number in range(4)))
    assert talk.pairs() == [(asked, answered)] * 4
    assert [one.s7_results[0].value for one in talk.transactions] == [0, 1, 2, 3]


def test_two_connections_do_not_meet() -> None:
    talk = Talk(50000)
    other = Talk(50001, beside=talk)
    talk.open()
    other.open()
    first = talk.ask(read(1, dbw(1, 0)))
    second = other.ask(read(1, dbw(2, 0)))
    third = other.tell(words(1, 2))
    fourth = talk.tell(words(1, 1))
    assert talk.pairs() == [(second, third), (first, fourth)]


# ---- the bounds -----------------------------------------------------------------------------------------------------


def test_the_table_is_bounded_and_the_sum_exact(talk: Talk) -> None:
    """Robustness T23: 70,000 requests without an answer; every one is told of, the oldest first."""
    count = 70_000
    talk.flood(count)
    assert talk.pipeline.table.all_open()[0].connection.open_requests[CLIENT].count == MAX_OPEN
    given_up = len(talk.transactions)
    assert given_up == count - MAX_OPEN
    assert set(reasons(talk)) == {TABLE_FULL}
    talk.finish()
    assert len(talk.transactions) == count
    assert set(reasons(talk)[given_up:]) == {CAPTURE_ENDED}
    assert [one.number for one in talk.transactions] == [*range(2, count + 2)]
    assert talk.pipeline.finding_counts["transaction.table_full"] == given_up
    assert int(talk.pipeline.exchange.dialogue.open) == 0


def test_the_sum_is_exact_with_one_reference() -> None:
    talk = Talk()
    talk.open()
    for number in range(0, 5_000, 50):
        talk.ask(*(read(7, dbw(1, (number + more) & 0xFF)) for more in range(50)))
    talk.finish()
    assert len(talk.transactions) == 5_000
    assert reasons(talk).count(REFERENCE_REUSED) == 5_000 - MAX_BEHIND - 1


def test_all_connections_together_are_bounded() -> None:
    """Captures of one direction leave every request open: each connection keeps few when there are many."""
    first = Talk(50000)
    talks = [first] + [Talk(50000 + number, beside=first) for number in range(1, 24)]
    for talk in talks:
        talk.flood(MAX_OPEN)
    opened = [side.connection.open_requests[CLIENT].count for side in first.pipeline.table.all_open()]
    assert opened == [MAX_OPEN] * 16 + [FEW_OPEN] * 8
    dialogue = first.pipeline.exchange.dialogue
    assert dialogue.open == sum(opened) == MAX_OPEN_ALL + 8 * FEW_OPEN
    first.finish()
    assert len(first.transactions) == 24 * MAX_OPEN
    assert dialogue.open == 0


def test_what_is_open_is_counted_right() -> None:
    talk = Talk()
    talk.open()
    dialogue = talk.pipeline.exchange.dialogue
    for number in range(10):
        talk.ask(read(number % 4, dbw(1, number)))
    assert dialogue.open == 10
    talk.tell(words(0, 1))
    talk.tell(words(0, 1))
    assert dialogue.open == 10  # the third may still come
    talk.tell(words(0, 1))
    assert dialogue.open == 7
    talk.tell(words(0, 1))
    talk.silence(2 * SECOND)
    assert dialogue.open == 7
    talk.close()
    assert dialogue.open == 0


# ---- 5.5 what a capture does to a conversation -----------------------------------------------------------------------


def early(talk: Talk, request: bytes, *answers: bytes) -> int:
    """The answers to a request are captured before it."""
    talk.acked[SERVER] = talk.seq[CLIENT] + len(dt(request))
    frame = talk.tell(*answers)
    talk.acked[SERVER] = None
    return frame


def test_an_answer_captured_before_its_request(talk: Talk) -> None:
    request = read(5, dbw(1, 0))
    told = early(talk, request, words(5, 42))
    assert talk.transactions == []
    asked = talk.ask(request)
    one = only(talk)
    assert talk.pairs() == [(asked, told)]
    assert (one.outcome, one._flags, one.latency_ns) == ("answered", REORDERED, -MS)
    assert one.s7_results[0].value == 42
    talk.close()
    assert len(talk.transactions) == 1
    assert (one.connection.answered, one.connection.orphans) == (2, 0)


def test_the_acknowledgement_tells_an_old_answer_from_an_early_one(talk: Talk) -> None:
    """The answer did not acknowledge the request, so it was sent before it and belongs to another."""
    orphan = talk.tell(words(5, 1))
    asked = talk.ask(read(5, dbw(1, 0)))
    answered = talk.tell(words(5, 2))
    talk.close()
    assert talk.pairs() == [(0, orphan), (asked, answered)]
    assert talk.outcomes() == ["orphan_answer", "answered"]


def test_an_answer_is_held_no_longer_than_its_request_can_come() -> None:
    """The next request lies behind what the answer acknowledged, so that its own came before the capture."""
    talk = Talk()
    orphan = talk.tell(words(4, 1))
    assert talk.pairs() == []
    asked = talk.ask(read(5, dbw(1, 0)))
    assert talk.pairs() == [(0, orphan)]
    answered = talk.tell(words(5, 2))
    assert talk.pairs() == [(0, orphan), (asked, answered)]


def test_what_a_request_had_acknowledged_is_no_answer_to_it(talk: Talk) -> None:
    """The client got its answer and used the reference again; the capture shows that answer only afterwards."""
    first = talk.ask(read(5, dbw(1, 0)))
    talk.acked[CLIENT] = talk.seq[SERVER] + len(dt(words(5, 1)))
    asked = talk.ask(read(5, dbw(1, 2)))
    talk.acked[CLIENT] = None
    late = talk.tell(words(5, 1))
    answered = talk.tell(words(5, 2))
    talk.close()
    assert talk.pairs() == [(first, late), (asked, answered)]


def test_early_answers_find_their_own_requests(talk: Talk) -> None:
    requests = [read(number, dbw(1, number)) for number in range(3)]
    talk.acked[SERVER] = talk.seq[CLIENT] + len(dt(*requests))
    told = [talk.tell(words(number, number)) for number in (2, 0, 1)]
    talk.acked[SERVER] = None
    asked = talk.ask(*requests)
    assert talk.pairs() == [(asked, told[1]), (asked, told[2]), (asked, told[0])]


def test_an_early_answer_that_names_another_function(talk: Talk) -> None:
    request = read(5, dbw(1, 0))
    early(talk, request, ack_data(5, b"\x05\x01", b"\xff"))
    talk.ask(request)
    assert only(talk)._flags == FUNCTION_MISMATCH | REORDERED


def test_an_early_refusal(talk: Talk) -> None:
    request = read(5, dbw(1, 0))
    early(talk, request, ack(5, 0x8104))
    talk.ask(request)
    assert (only(talk).error_code, only(talk)._flags) == (0x8104, REORDERED)


@pytest.mark.parametrize("early_one", [granted(9, 3, 3, 240), userdata(9, head(RESPONSE, 4, 1, 1, 0xD402))])
def test_an_early_answer_is_looked_at_like_any_other(talk: Talk, early_one: bytes) -> None:
    request = setup(9, 8, 8, 480) if early_one[1] == 3 else userdata(9, head(REQUEST, 4, 1))
    early(talk, request, early_one)
    talk.ask(request)
    connection = only(talk).connection
    if early_one[1] == 3:
        assert (connection.pdu_length, connection.jobs_allowed(CLIENT)) == (240, 3)
    else:
        assert only(talk).error_code == 0xD402


def test_an_orphan_is_held_for_a_second(talk: Talk) -> None:
    orphan = talk.tell(words(5, 1))
    talk.packet(CLIENT, after_ns=SECOND)
    assert talk.transactions == []
    talk.packet(CLIENT, after_ns=60 * MS)
    assert talk.pairs() == [(0, orphan)]
    assert only(talk).connection.orphans == 1


def test_an_orphan_is_held_for_fifty_packets(talk: Talk) -> None:
    orphan = talk.tell(words(5, 1))
    for _ in range(50):
        talk.packet(CLIENT, after_ns=1000)
    assert talk.transactions == []
    talk.packet(CLIENT, after_ns=1000)
    assert talk.pairs() == [(0, orphan)]


def test_another_connection_s_packets_let_time_pass(talk: Talk) -> None:
    other = Talk(50001, beside=talk)
    other.open()
    orphan = talk.tell(words(5, 1))
    other.ask(read(1, dbw(1, 0)), after_ns=SECOND + 60 * MS)
    assert talk.pairs() == [(0, orphan)]


def test_held_orphans_are_bounded_and_all_told(talk: Talk) -> None:
    count = MAX_ORPHANS + 30
    talk.tell(*(words(number, number) for number in range(count)))
    talk.packet(CLIENT)
    assert [one.pdu_ref for one in talk.transactions] == [*range(30)]
    talk.close()
    assert [one.pdu_ref for one in talk.transactions] == [*range(count)]
    assert set(talk.outcomes()) == {"orphan_answer"}


def test_an_orphan_tells_what_it_carries(talk: Talk) -> None:
    talk.tell(ack_data(5, b"\x04\x02", good(4, b"\x00\x2a") + refused(0x05)))
    talk.tell(ack(6, 0xD209))
    talk.tell(userdata(7, head(RESPONSE, 4, 1, 1, 0xD402)))
    talk.close()
    read_answer, refusal, answer = talk.transactions
    assert (read_answer.rosctr, read_answer.function_name, read_answer.request) == (1, "Read Var", None)
    assert [(result.item, result.return_code, result.value) for result in read_answer.s7_results] == [
        (None, 0xFF, None),
        (None, 0x05, None),
    ]
    assert [(error.where, error.code) for error in read_answer.errors] == [("item 2", 0x05)]
    assert [(error.where, error.code) for error in refusal.errors] == [("header", 0xD209)]
    assert [(error.where, error.code) for error in answer.errors] == [("parameter", 0xD402)]
    assert (refusal.function, refusal.function_name) == (-1, "no function")
    assert [one.rosctr for one in talk.transactions] == [1, 1, 7]


def test_mid_stream_the_first_answers_lack_their_requests() -> None:
    talk = Talk()
    talk.tell(words(5, 1))
    talk.tell(words(6, 1))
    talk.ask(read(7, dbw(1, 0)))
    talk.tell(words(8, 1))
    talk.finish()
    found = {one.pdu_ref: one._flags for one in talk.transactions if one.outcome == "orphan_answer"}
    assert found == {5: EXPECTED, 6: EXPECTED, 8: 0}


def heal(talk: Talk) -> None:
    """Both ends acknowledge what they got, and time passes: a hole is given up."""
    for _ in range(2):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60 * MS)


def test_a_request_whose_answer_is_in_a_hole(talk: Talk) -> None:
    lost = talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    asked = talk.ask(read(2, dbw(1, 0)))
    answered = talk.tell(words(2, 2))
    heal(talk)
    assert talk.pairs() == [(lost, 0), (asked, answered)]
    assert reasons(talk) == [HOLE, ""]
    assert [one.certainty for one in talk.transactions] == ["sure", "sure"]
    talk.close()
    assert talk.slugs() == ["stream.hole"]


def test_a_request_after_the_hole_is_not_blamed_on_it(talk: Talk) -> None:
    talk.lose(SERVER, words(1, 1))
    talk.tell(words(2, 2))
    heal(talk)
    talk.ask(read(3, dbw(1, 0)))
    talk.close()
    assert [(one.pdu_ref, one.reason) for one in talk.transactions if one.outcome == "unanswered"] == [
        (3, CONNECTION_CLOSED)
    ]


def test_a_reference_used_again_after_a_hole_is_no_fault_of_the_client(talk: Talk) -> None:
    """The reference came round again; the answer of the first time is in the hole."""
    lost = talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 2))
    heal(talk)
    asked = talk.ask(read(1, dbw(1, 2)))
    answered = talk.tell(words(1, 3))
    assert talk.pairs()[0] == (lost, 0)
    assert talk.pairs()[2:] == [(asked, answered)]
    assert reasons(talk) == [HOLE, "", ""]
    assert "transaction.unanswered" not in talk.slugs()


def test_an_answer_in_a_hole_is_not_replaced_by_that_to_a_later_request_in_a_hole(talk: Talk) -> None:
    """The answer to reference 1 is missing, and so is the request that uses it again: only its answer was captured."""
    lost = talk.ask(read(1, dbw(1, 0)))
    talk.lose(SERVER, words(1, 1))
    asked = [talk.ask(read(2, dbw(1, 0)))]
    answered = [talk.tell(words(2, 2))]
    heal(talk)
    talk.lose(CLIENT, read(1, dbw(1, 0)))
    orphan = talk.tell(words(1, 3))
    asked.append(talk.ask(read(2, dbw(1, 0))))
    answered.append(talk.tell(words(2, 4)))
    heal(talk)
    talk.close()
    assert sorted(talk.pairs()) == sorted([(lost, 0), (0, orphan), *zip(asked, answered, strict=True)])
    assert {one.outcome: one.reason for one in talk.transactions} == {
        "answered": "",
        "unanswered": HOLE,
        "orphan_answer": HOLE,
    }


def test_without_a_hole_of_the_client_a_late_answer_is_that_of_its_reference(talk: Talk) -> None:
    talk.ask(read(3, dbw(1, 0)))
    talk.lose(SERVER, words(3, 3))
    slow = talk.ask(read(1, dbw(1, 0)))
    asked = talk.ask(read(2, dbw(1, 0)))
    answered = talk.tell(words(2, 2))
    heal(talk)
    late = talk.tell(words(1, 1))
    talk.close()
    assert {(slow, late), (asked, answered)} < set(talk.pairs())


def test_an_answer_whose_request_is_in_a_hole(talk: Talk) -> None:
    talk.lose(CLIENT, read(1, dbw(1, 0)))
    orphan = talk.tell(words(1, 1))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 2))
    heal(talk)
    talk.close()
    found = [one for one in talk.transactions if one.outcome == "orphan_answer"]
    assert [(one.response_frame, one._flags, one.reason) for one in found] == [(orphan, EXPECTED, HOLE)]


def test_with_a_hole_an_answer_of_another_function_is_not_taken(talk: Talk) -> None:
    """Request 5 (write) and its answer to an earlier use of 5 were lost: what comes is not this request's."""
    talk.lose(CLIENT, write(5, [dbw(1, 0)], written(4, b"\0\1")))
    asked = talk.ask(read(5, dbw(1, 0)))
    orphan = talk.tell(ack_data(5, b"\x05\x01", b"\xff"))
    heal(talk)
    answered = talk.tell(words(5, 1))
    talk.close()
    assert (asked, answered) in [(one.request_frame, one.response_frame) for one in talk.transactions]
    assert [one.response_frame for one in talk.transactions if one.outcome == "orphan_answer"] == [orphan]
    assert all(not one._flags & FUNCTION_MISMATCH for one in talk.transactions)


@pytest.mark.parametrize(
    ("told", "its"),
    [
        (ack_data(5, b"\x04\x01", good(4, b"\0\1")), True),
        (ack_data(5, b"\x05\x01", good(4, b"\0\1")), False),
        (ack_data(5, b"\x1d\x01", good(4, b"\0\1")), False),
        (ack_data(5, b"\x04\x02", good(4, b"\0\1")), False),
    ],
    ids=["the read", "a write", "an upload", "another count"],
)
def test_with_a_hole_data_that_look_like_those_of_the_read_do_not_make_an_answer_its_own(
    talk: Talk, told: bytes, its: bool
) -> None:
    """The data are octet for octet those of a good answer to the request: its function and its count decide first."""
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(words(1, 1))
    talk.lose(CLIENT, write(5, [dbw(1, 0)], written(4, b"\0\1")))
    talk.ask(read(5, dbw(1, 0)))
    frame = talk.tell(told)
    talk.close()
    orphans = [one.response_frame for one in talk.transactions if one.outcome == "orphan_answer"]
    assert orphans == ([] if its else [frame])


def test_with_a_hole_requests_keep_their_order(talk: Talk) -> None:
    """An answer that was not taken leaves the requests waiting as they were."""
    talk.lose(SERVER, words(9, 1))
    talk.tell(userdata(0, head(PUSH, 2, 1, 4, 0)))
    heal(talk)
    first = [talk.ask(read(5, dbw(1, 0))) for _ in range(2)]
    talk.ask(read(6, dbw(1, 0)))
    talk.tell(ack_data(5, b"\x05\x01", b"\xff"))
    answered = talk.tell(words(5, 1))
    talk.close()
    assert (first[0], answered) in talk.pairs()
    unanswered = [one for one in talk.transactions if one.outcome == "unanswered"]
    assert [one.number for one in unanswered] == sorted(one.number for one in unanswered)


def test_with_a_hole_an_early_answer_of_another_function_is_not_taken(talk: Talk) -> None:
    """Its acknowledgement goes beyond the request: it may be the answer to another one that was not captured."""
    talk.lose(CLIENT, read(8, dbw(1, 0)))
    talk.ask(read(9, dbw(1, 0)))
    talk.tell(words(9, 1))
    heal(talk)
    request = read(5, dbw(1, 0))
    early(talk, request * 2, ack_data(5, b"\x05\x01", b"\xff"))
    asked = talk.ask(request)
    answered = talk.tell(words(5, 1))
    assert (asked, answered) in talk.pairs()


def test_with_a_hole_an_early_answer_that_acknowledges_just_this_request_is_taken(talk: Talk) -> None:
    talk.lose(CLIENT, read(8, dbw(1, 0)))
    talk.ask(read(9, dbw(1, 0)))
    talk.tell(words(9, 1))
    heal(talk)
    request = read(5, dbw(1, 0))
    answered = early(talk, request, ack_data(5, b"\x05\x01", b"\xff"))
    asked = talk.ask(request)
    assert talk.pairs()[-1] == (asked, answered)
    assert talk.transactions[-1]._flags & FUNCTION_MISMATCH


@pytest.mark.parametrize("answering", [CLIENT, SERVER])
def test_one_direction_only(answering: int) -> None:
    """Nothing can be paired; the transactions say that it is no wonder."""
    talk = Talk()
    for number in range(5):
        if answering == SERVER:
            talk.tell(words(number, number))
            talk.seq[CLIENT] += len(dt(read(number, dbw(1, 0))))
        else:
            talk.ask(read(number, dbw(1, 0)))
            talk.seq[SERVER] += len(dt(words(number, number)))
    talk.finish()
    assert talk.outcomes() == (["orphan_answer"] if answering == SERVER else ["unanswered"]) * 5
    assert [one._flags for one in talk.transactions] == [EXPECTED] * 5
    if answering == CLIENT:
        assert [(one.reason, one.unseen, one.missed) for one in talk.transactions] == [("one_sided", True, False)] * 5
    assert talk.slugs() == ["capture.one_sided"]


def test_one_direction_only_from_its_beginning() -> None:
    """The answer to the SYN was captured, so the beginning is known; of the client there is nothing."""
    talk = Talk()
    talk.packet(SERVER, flags=SYN | ACK)
    talk.packet(SERVER, CONFIRM)
    for number in range(5):
        talk.tell(words(number, number))
        talk.seq[CLIENT] += len(dt(read(number, dbw(1, 0))))
    talk.finish()
    assert talk.connections[0].tcp.known_start
    assert [one._flags for one in talk.transactions] == [EXPECTED] * 5
    assert talk.slugs() == ["capture.one_sided"]


def test_a_silent_server_whose_acknowledgements_are_there_is_not_one_direction_only() -> None:
    talk = Talk()
    for number in range(5):
        talk.ask(read(number, dbw(1, 0)))
        talk.packet(SERVER, after_ns=3 * SECOND)
    talk.finish()
    assert [one._flags for one in talk.transactions] == [0] * 5
    assert "capture.one_sided" not in talk.slugs()
    assert talk.slugs().count("transaction.unanswered") == 5


def test_duplicated_packets_ask_once(talk: Talk) -> None:
    octets = dt(read(1, dbw(1, 0)))
    asked = talk.packet(CLIENT, octets)
    talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - len(octets))
    answered = talk.tell(words(1, 1))
    talk.close()
    assert talk.pairs() == [(asked, answered)]


@pytest.mark.parametrize(("flags", "ended"), [(FIN, "fin"), (RST, "reset")])
def test_a_request_open_when_the_connection_ends(talk: Talk, flags: int, ended: str) -> None:
    asked = talk.ask(read(1, dbw(1, 0)))
    if flags == FIN:
        talk.close()
    else:
        talk.packet(SERVER, flags=RST)
        talk.packet(CLIENT, after_ns=2 * SECOND)
        talk.finish()
    assert talk.pairs() == [(asked, 0)]
    assert (only(talk).reason, only(talk).latency_ns, only(talk).response) == (CONNECTION_CLOSED, None, None)
    assert (talk.connections[0].tcp.ended, talk.connections[0].open_at_end) == (ended, 1)


def test_a_request_open_when_the_capture_ends(talk: Talk) -> None:
    talk.ask(read(1, dbw(1, 0)))
    talk.finish()
    assert (only(talk).reason, talk.connections[0].open_at_end) == (CAPTURE_ENDED, 0)


def test_what_is_open_on_both_sides_is_told_in_the_order_of_asking(talk: Talk) -> None:
    for number in range(3):
        talk.ask(read(number, dbw(1, 0)))
        talk.tell(job(number, b"\x1b" + bytes(17)))
    talk.ask(read(1, dbw(1, 4)))
    talk.close()
    ours = [one.number for one in talk.transactions if one.asked_by == CLIENT]
    theirs = [one.number for one in talk.transactions if one.asked_by == SERVER]
    assert (len(ours), len(theirs)) == (4, 3)
    assert ours[1:] == sorted(ours[1:])  # the first one ended before, when its reference was used again
    assert theirs == sorted(theirs)


def test_a_connect_request_after_data_is_another_connection(talk: Talk) -> None:
    """The close and the new SYN in between were not captured: references are cleared."""
    lost = talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, CONNECT)
    talk.packet(SERVER, CONFIRM)
    orphan = talk.tell(words(1, 1))
    talk.close()
    assert talk.pairs() == [(lost, 0), (0, orphan)]
    assert len(talk.connections) == 2
    assert [connection.number for connection in talk.connections] == [1, 2]


# ---- any conversation -----------------------------------------------------------------------------------------------

#: (who asks, kind, reference, whether it is answered at once, later or never), in the order of asking.
STEPS = st.lists(
    st.tuples(
        st.sampled_from([CLIENT, SERVER]), st.sampled_from(["job", "userdata"]), st.integers(0, 3), st.integers(0, 2)
    ),
    max_size=40,
)


@pytest.mark.parametrize("jobs", [1, 3, 8])
@given(STEPS)
def test_every_request_and_answer_is_told_of_once(jobs: int, steps: list[tuple[int, str, int, int]]) -> None:
    """Against a plain model: the references are few, so they collide in every way there is.

    The server answers in order, and some requests never. What is told as sure is true.
    """
    talk = Talk()
    talk.open(jobs, jobs)
    waiting: list[tuple[tuple[int, str, int], int]] = []
    asked: set[int] = set()
    answers: dict[int, int] = {}  # packet of the answer: that of the request
    for number, (side, kind, pdu_ref, when) in enumerate(steps):
        key = (side, kind, pdu_ref)
        # Every request is another one, so that none is taken for a repetition.
        request = (
            read(pdu_ref, dbw(number, 0)) if kind == "job" else userdata(pdu_ref, head(REQUEST, 4, 1, number & 255))
        )
        waiting.append((key, talk.packet(side, dt(request))))
        asked.add(waiting[-1][1])
        for other, frame in (waiting if when == 2 else waiting[-1:]) if when else []:
            answer = words(other[2], 1) if other[1] == "job" else userdata(other[2], head(RESPONSE, 4, 1, 1, 0))
            answers[talk.packet(1 - other[0], dt(answer))] = frame
        if when:  # what was asked before is never answered after it
            waiting = [] if when == 2 else [one for one in waiting[:-1] if one[0] != key]
    talk.close()
    told = [one for one in talk.transactions if one.request_frame]
    assert sorted(one.request_frame for one in told) == sorted(asked)
    assert sorted(one.response_frame for one in talk.transactions if one.response_frame) == sorted(answers)
    assert all(answers[one.response_frame] == one.request_frame for one in told if one.certainty == "sure")
    assert len({one.number for one in talk.transactions}) == len(talk.transactions) == len(steps)
    connection = talk.connections[0]
    assert connection.answered + connection.unanswered == len(steps) + 1  # and the setup
    assert talk.pipeline.exchange.dialogue.open == 0


@pytest.mark.parametrize("same", [True, False], ids=["the same again", "something else"])
def test_what_waits_behind_a_request_is_told_when_that_is_replaced(same: bool) -> None:
    """Two requests of one reference, the second acknowledging an answer not captured; then the reference comes again."""
    talk = Talk()
    talk.open(8, 8)
    first = talk.ask(read(1, dbw(1, 0)))
    talk.seq[SERVER] += len(dt(words(1, 1)))  # an answer that comes later, or never
    second = talk.ask(read(1, dbw(1, 2)))
    talk.acked[CLIENT] = 1
    third = talk.ask(read(1, dbw(1, 2 if same else 4)))
    talk.finish()
    assert sorted(talk.pairs()) == [(first, 0), (second, 0), (third, 0)]
    assert talk.outcomes() == ["unanswered"] * 3
    assert talk.pipeline.exchange.dialogue.open == 0


# ---- sent again by TCP ----------------------------------------------------------------------------------------------


def again(transaction: Transaction) -> tuple[int, int, str] | None:
    """Return how often a request was sent again, the latest packet, and the words for it."""
    found = transaction.again
    return None if found is None else (found.times, found.frame, found.text(transaction.request_ns))


def test_a_request_that_tcp_sends_again() -> None:
    talk = Talk()
    talk.open()
    octets = dt(read(1, dbw(1, 0)))
    asked = talk.packet(CLIENT, octets)
    first = talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - len(octets), after_ns=300 * MS)
    second = talk.packet(CLIENT, octets, seq=talk.seq[CLIENT] - len(octets), after_ns=600 * MS)
    assert second == first + 1 == asked + 2
    talk.tell(words(1, 5))
    talk.ask(read(2, dbw(1, 0)))
    talk.tell(words(2, 6))
    talk.close()
    assert talk.outcomes() == ["answered", "answered"]
    assert [again(one) for one in talk.transactions] == [
        (2, second, "request sent again 2 times, last after 900 ms"),
        None,
    ]


def test_what_tcp_sends_again_together_with_something_new() -> None:
    """The client repeats its request in one segment with what it sends next."""
    talk = Talk()
    talk.open()
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets)
    empty = tpkt(b"\x02\xf0\x80")
    frame = talk.packet(CLIENT, octets + empty, seq=talk.seq[CLIENT] - len(octets), after_ns=300 * MS)
    talk.seq[CLIENT] += len(empty)
    talk.tell(words(1, 5))
    talk.close()
    assert [again(one) for one in talk.transactions] == [(1, frame, "request sent again after 300 ms")]


def test_what_was_captured_behind_a_gap_is_sent_again() -> None:
    """The segment that fills the gap carries the request behind it once more."""
    talk = Talk()
    talk.open()
    empty = tpkt(b"\x02\xf0\x80")
    octets = dt(read(1, dbw(1, 0)))
    talk.seq[CLIENT] += len(empty)
    talk.packet(CLIENT, octets)
    frame = talk.packet(CLIENT, empty + octets, seq=talk.seq[CLIENT] - len(octets) - len(empty), after_ns=200 * MS)
    talk.tell(words(1, 5))
    talk.close()
    assert [again(one) for one in talk.transactions] == [(1, frame, "request sent again after 200 ms")]


@pytest.mark.parametrize("case", ["captured twice", "a probe", "answered before", "only the one before it"])
def test_what_is_no_request_sent_again(case: str) -> None:
    talk = Talk()
    talk.open(8, 8)
    octets = dt(read(1, dbw(1, 0)))
    talk.packet(CLIENT, octets)
    at = talk.seq[CLIENT] - len(octets)
    if case == "captured twice":
        talk.packet(CLIENT, octets, seq=at, after_ns=20_000)
    elif case == "a probe":
        talk.packet(CLIENT, octets[-1:], seq=talk.seq[CLIENT] - 1, after_ns=300 * MS)
    elif case == "answered before":
        talk.tell(words(1, 5))
        talk.packet(CLIENT, octets, seq=at, after_ns=300 * MS)
    else:
        talk.ask(read(2, dbw(1, 0)))
        talk.packet(CLIENT, octets, seq=at, after_ns=300 * MS)
        talk.tell(words(2, 6))
    talk.tell(words(1, 5))
    talk.close()
    assert [again(one) for one in talk.transactions if one.request_frame] == [None] * (
        2 if case == "only the one before it" else 1
    )
