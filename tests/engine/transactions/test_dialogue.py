"""Rare turns of pairing: what a request or an answer rules out, answers that are kept, gaps, and what is watched or counted."""

from __future__ import annotations

import pytest

from dissect.engine.transactions.results import FUNCTION_MISMATCH, GAPS, REORDERED
from dissect.engine.transactions.transaction import HOLE, LIKELY, REFERENCE_REUSED, SURE
from dissect.protocols.s7plus.tables import SET_VARIABLE
from dissect.protocols.s7plus.value_tables import DINT
from dissect.protocols.s7plus.values import Value
from tests.engine.findings import events
from tests.engine.findings.test_plus_rules import begun
from tests.engine.transactions.talk import (
    ACK,
    CLIENT,
    FIN,
    MS,
    SECOND,
    SERVER,
    Talk,
    ack,
    ack_data,
    dbw,
    dt,
    good,
    head,
    job,
    read,
    refused,
    tpkt,
    userdata,
    words,
    write,
    written,
)
from tests.protocols.s7plus import bodies
from tests.protocols.s7plus.pdus import asked, framed


@pytest.fixture
def talk() -> Talk:
    talk = Talk()
    talk.open(8, 8)
    return talk


def heal(talk: Talk) -> None:
    """Both ends acknowledge what they got, and time passes: a gap is given up."""
    for _ in range(2):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60 * MS)


# ---- what places in the stream rule out -----------------------------------------------------------------------------


@pytest.mark.parametrize("beginning", [(1000, 90000), (2**32 - 40, 2**32 - 60)])
def test_a_client_that_had_the_answer_before_it_asked_asked_for_another(beginning: tuple[int, int]) -> None:
    """The reference is used for the first time in the capture; the answer was captured late."""
    talk = Talk()
    talk.seq = list(beginning)
    late = talk.seq[SERVER]
    talk.seq[SERVER] += len(dt(words(5, 1)))
    request = talk.ask(read(5, dbw(1, 0)))
    orphan = talk.packet(SERVER, dt(words(5, 1)), seq=late)
    answered = talk.tell(words(5, 2))
    talk.finish()
    assert sorted(talk.pairs()) == [(0, orphan), (request, answered)]


def test_an_answer_that_had_not_got_the_request_belongs_to_another(talk: Talk) -> None:
    """The client repeats its reference: the answer acknowledges everything before this request, and nothing of it."""
    first = talk.ask(read(5, dbw(1, 0)))
    answered = talk.tell(words(5, 1))
    known = talk.seq[CLIENT]
    second = talk.ask(read(5, dbw(1, 2)))
    talk.acked[SERVER] = known
    orphan = talk.tell(words(5, 2))
    talk.acked[SERVER] = None
    last = talk.tell(words(5, 3))
    talk.close()
    assert sorted(talk.pairs()) == [(0, orphan), (first, answered), (second, last)]


def test_an_answer_to_a_row_that_no_request_fits_waits_for_its_own(talk: Talk) -> None:
    """With a gap, an answer of another function may belong to a request that was not captured."""
    talk.ask(read(5, dbw(1, 0)))
    talk.ask(read(5, dbw(1, 2)))
    talk.lose(CLIENT, write(5, [dbw(1, 0)], written(4, b"\0\1")))
    orphan = talk.tell(ack_data(5, b"\x05\x01", b"\xff"))
    talk.finish()
    assert [one.response_frame for one in talk.transactions if one.outcome == "orphan_answer"] == [orphan]


def test_without_a_gap_an_answer_that_fits_none_is_that_to_the_oldest(talk: Talk) -> None:
    first = talk.ask(read(5, dbw(1, 0)))
    talk.ask(read(5, dbw(1, 2)))
    answered = talk.tell(ack_data(5, b"\x05\x01", b"\xff"))
    assert talk.pairs() == [(first, answered)]


# ---- gaps -----------------------------------------------------------------------------------------------------------


def test_an_answer_after_a_gap_that_should_have_contained_it_is_only_likely(talk: Talk) -> None:
    """As long as an answer is missing, and the request is the only one: it is this answer that may be the second one."""
    request = talk.ask(read(5, dbw(1, 0)))
    talk.lose(SERVER, words(9, 1))
    answered = talk.tell(words(5, 2))
    heal(talk)
    talk.close()
    one = talk.transactions[0]
    assert talk.pairs()[0] == (request, answered)
    assert (one.certainty, one.doubt, one._flags & GAPS) == (LIKELY, "gaps", GAPS)


def test_servers_answer_in_order_so_what_came_before_was_answered_in_the_gap(talk: Talk) -> None:
    first = talk.ask(read(5, dbw(1, 0)))
    talk.lose(SERVER, words(5, 1))
    second = talk.ask(read(6, dbw(1, 2)))
    answered = talk.tell(words(6, 2))
    heal(talk)
    assert sorted(talk.pairs()) == [(first, 0), (second, answered)]
    lost = next(one for one in talk.transactions if not one.response_frame)
    assert (lost.reason, lost.certainty) == (HOLE, SURE)
    assert talk.pipeline.exchange.dialogue.open == 0


def test_a_request_that_ends_in_a_gap_is_only_likely_answered(talk: Talk) -> None:
    """Its last octets are missing: whatever follows may belong to another."""
    octets = dt(read(5, dbw(1, 0), dbw(1, 2)))
    talk.packet(CLIENT, octets[:-6])
    talk.seq[CLIENT] += 6
    talk.tell(ack_data(5, b"\x04\x02", good(4, b"\0\1") * 2))
    talk.ask(read(6, dbw(1, 0)))
    talk.tell(words(6, 1))
    heal(talk)
    talk.close()
    assert "internal.bug" not in talk.slugs()
    assert sorted(one.pdu_ref for one in talk.transactions) == [5, 6]


@pytest.mark.parametrize("first", [1, 4])
def test_a_request_after_a_gap_may_share_its_reference_with_one_in_it(first: int) -> None:
    """A client that repeats its reference, or has sent too few requests to know: the first answer is not this one's."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(first, dbw(1, 0)))
    talk.tell(words(first, 1))
    talk.lose(CLIENT, write(4, [dbw(1, 0)], written(4, b"\0\1")))
    request = talk.ask(read(4, dbw(1, 0)))
    heal(talk)
    orphan = talk.tell(ack_data(4, b"\x05\x01", b"\xff"))
    answered = talk.tell(words(4, 7))
    heal(talk)
    talk.finish()
    assert talk.pairs()[-2:] in ([(0, orphan), (request, answered)], [(request, answered), (0, orphan)])
    (pair,) = [one for one in talk.transactions if one.request_frame == request]
    assert pair.doubt == "alike"


def test_a_row_whose_older_requests_may_be_answered_in_a_gap(talk: Talk) -> None:
    first = talk.ask(read(5, dbw(1, 0)))
    talk.lose(SERVER, words(5, 1))
    second = talk.ask(read(5, dbw(1, 2, 2)))
    answered = talk.tell(words(5, 2, 3))
    heal(talk)
    talk.close()
    assert sorted(talk.pairs()) == [(first, 0), (second, answered)]
    lost = next(one for one in talk.transactions if not one.response_frame)
    assert lost.reason == HOLE


# ---- rows -----------------------------------------------------------------------------------------------------------


def test_the_latest_answered_request_is_the_one_that_was_sent_last(talk: Talk) -> None:
    """In whatever order requests with one reference are answered."""
    for size in (1, 2, 3):
        talk.ask(read(5, dbw(1, 0, size)))
    connection = talk.pipeline.table.all_open()[0].connection
    numbers = []
    for size in (2, 1, 3):
        talk.tell(words(5, *range(size)))
        numbers.append(int(connection.open_requests[CLIENT].answered) - int(talk.transactions[0].number))
    assert numbers == [0, 0, 1]


def test_too_many_answers_for_a_row_stand_alone(talk: Talk) -> None:
    asked = [talk.ask(read(5, dbw(1, 2 * number))) for number in range(2)]
    talk.ask(read(5, dbw(1, 0, 9)))
    answered = [talk.tell(words(5, number)) for number in range(2)]
    extra = talk.tell(words(5, 7))
    talk.close()
    assert set(zip(asked, answered, strict=True)) < set(talk.pairs())
    assert [one.response_frame for one in talk.transactions if not one.request_frame] in ([extra], [])


def test_a_reference_of_which_too_many_are_open_settles_what_it_knows() -> None:
    """The rows of a client that sends on and on, though answers to some are kept."""
    talk = Talk()
    talk.open(8, 8)
    for number in range(300):
        talk.ask(read(5, dbw(1, 2 * number)))
        if number == 2:
            talk.tell(words(5, 0))
    talk.finish()
    assert len(talk.transactions) == 300
    assert talk.outcomes().count("answered") == 1
    assert {one.reason for one in talk.transactions if one.reason} <= {REFERENCE_REUSED, "capture_ended"}
    assert talk.pipeline.exchange.dialogue.open == 0


@pytest.mark.parametrize(("after_ns", "left"), [(10 * SECOND, 2), (10 * SECOND + MS, 1)])
def test_no_server_answers_after_ten_seconds_once_the_reference_is_used_again(after_ns: int, left: int) -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(5, dbw(1, 0)))
    talk.ask(read(5, dbw(1, 2)), after_ns=after_ns)
    assert talk.pipeline.exchange.dialogue.open == left
    assert [one.reason for one in talk.transactions] == [REFERENCE_REUSED] * (2 - left)


# ---- what is shared and watched -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("after_ns", "same", "shared"),
    [(MS, False, True), (2 * SECOND, False, True), (2 * SECOND + MS, False, False), (MS, True, False)],
)
def test_a_reference_shared_by_requests_that_are_open_at_once(after_ns: int, same: bool, shared: bool) -> None:
    """Unless the client gave the first up, or repeats it."""
    talk = Talk()
    talk.open(8, 8)
    talk.ask(read(5, dbw(1, 0)))
    talk.ask(read(5, dbw(1, 0 if same else 2)), after_ns=after_ns)
    talk.finish()
    assert ("session.shared_reference" in talk.slugs()) is shared


def test_a_reference_used_again_where_an_answer_may_be_missing_is_not_shared(talk: Talk) -> None:
    talk.ask(read(5, dbw(1, 0)))
    talk.lose(SERVER, words(5, 1))
    talk.packet(CLIENT)
    talk.ask(read(5, dbw(1, 2)))
    talk.finish()
    assert "session.shared_reference" not in talk.slugs()


@pytest.mark.parametrize("number", [1, 2, 5])
def test_each_request_that_waits_too_long_is_told_of_once(number: int) -> None:
    """Also the very first one of a capture."""
    talk = Talk()
    talk.watch(2 * SECOND)
    talk.hello()
    talk.connect()
    for other in range(1, number):
        talk.ask(read(other, dbw(1, 0)))
        talk.tell(words(other, 1))
    talk.ask(read(number, dbw(1, 0)))
    talk.silence(SECOND)
    assert "transaction.overdue" not in talk.slugs()
    for _ in range(3):
        talk.silence(2 * SECOND)
    assert talk.slugs().count("transaction.overdue") == 1
    talk.tell(words(number, 1))
    talk.ask(read(number + 1, dbw(1, 0)))
    for _ in range(3):
        talk.silence(2 * SECOND)
    assert talk.slugs().count("transaction.overdue") == 2


def test_requests_of_both_sides_are_watched() -> None:
    talk = Talk()
    talk.open(8, 8)
    talk.watch(2 * SECOND)
    talk.ask(read(1, dbw(1, 0)))
    talk.tell(job(1, b"\x1b" + bytes(17)))
    talk.silence(3 * SECOND)
    talk.silence(3 * SECOND)
    assert talk.slugs().count("transaction.overdue") == 2


# ---- the end --------------------------------------------------------------------------------------------------------


def test_of_one_direction_no_request_is_certainly_open() -> None:
    talk = Talk()
    for number in range(3):
        talk.ask(read(number, dbw(1, 0)))
        talk.lose(SERVER, words(number, 1))
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.finish()
    ending = talk.connections[0].ending
    assert ending is not None
    assert (ending.open_requests, ending.cut, talk.connections[0].open_at_end) == (0, False, 3)


def test_what_was_kept_goes_to_its_requests_when_the_connection_ends(talk: Talk) -> None:
    first = talk.ask(read(5, dbw(1, 0)))
    second = talk.ask(read(5, dbw(1, 2)))
    answered = talk.tell(words(5, 1))
    talk.packet(CLIENT, flags=FIN | ACK)
    talk.finish()
    assert sorted(talk.pairs()) == [(first, 0), (second, answered)]
    ending = talk.connections[0].ending
    assert ending is not None
    assert ending.open_requests == 0


# ---- answers alone --------------------------------------------------------------------------------------------------


def test_an_early_answer_to_one_reference_waits_beside_another_request(talk: Talk) -> None:
    """Where other requests are open, and those that come are of another key."""
    request = read(5, dbw(1, 0))
    talk.acked[SERVER] = talk.seq[CLIENT] + len(dt(read(4, dbw(1, 0)))) + len(dt(request))
    told = talk.tell(words(5, 42))
    talk.acked[SERVER] = None
    other = talk.ask(read(4, dbw(1, 0)))
    assert talk.transactions == []
    frame = talk.ask(request)
    assert talk.pairs() == [(frame, told)]
    assert talk.transactions[0]._flags == REORDERED
    assert other < frame


@pytest.mark.parametrize(
    ("octets", "rosctr", "errors"),
    [
        (ack_data(5, b"\x04\x01", refused(10)), 1, ["item 1"]),
        (ack_data(5, b"\x04\x01", good(4, b"\0\1")), 1, []),
        (ack(5, 0xD209), 1, ["header"]),
        (userdata(5, head(2, 4, 1, 1, 0xD402)), 7, ["parameter"]),
        (userdata(5, head(2, 4, 1, 1, 0)), 7, ["data"]),
        (events.tells(5, 7, 1, bytes(10)), 7, []),
    ],
)
def test_an_answer_alone_says_whether_it_refuses(octets: bytes, rosctr: int, errors: list[str]) -> None:
    talk = Talk()
    talk.open()
    talk.tell(octets)
    talk.finish()
    (one,) = talk.transactions
    assert (one.outcome, one.rosctr, one.has_errors) == ("orphan_answer", rosctr, bool(errors))
    assert [error.where for error in one.errors] == errors


# ---- S7comm-plus requests that need no answer ----------------------------------------------------------------------


def test_a_request_that_wants_no_answer_is_open_to_none() -> None:
    """Before version 3 it is answered all the same; without that answer it is not missed. In version 3 it is whole at once."""
    for version in (1, 3):
        talk = begun()
        body = bodies.set_variable(0x90, [233], Value(0, DINT, 1))
        for number in (1, 2):
            talk.ask(framed(asked(number, SET_VARIABLE, flags=0x74, body=body), version))
        assert len([one for one in talk.transactions if one.is_plus]) == (0 if version == 1 else 2)
        talk.close()
        connection = talk.connections[0]
        plus = [one for one in talk.transactions if one.is_plus]
        assert [(one.outcome, one.missed) for one in plus] == [("unsolicited", False)] * 2
        assert (connection.one_way, connection.unanswered, connection.unsolicited) == (2, 0, 2)
        assert plus[1].number == plus[0].number + 1


# ---- what is remembered of a side -----------------------------------------------------------------------------------


def test_the_latest_answer_that_no_request_came_for_is_remembered(talk: Talk) -> None:
    connection = talk.pipeline.table.all_open()[0].connection
    latest = 0
    for number in (1, 2):
        latest = talk.tell(words(number, 1))
        talk.packet(CLIENT, after_ns=2 * SECOND)
        assert connection.open_requests[CLIENT].orphan_frame == latest
    assert connection.orphans == 2


@pytest.mark.parametrize(("took_ms", "rest_ms"), [(1, 100), (25, 100), (26, 104), (300, 1200)])
def test_a_client_with_one_reference_rests_after_four_times_its_wait(talk: Talk, took_ms: int, rest_ms: int) -> None:
    """At least 100 ms."""
    for _ in range(2):
        talk.ask(read(5, dbw(1, 0)))
        talk.tell(words(5, 1), after_ns=took_ms * MS)
    requests = talk.pipeline.table.all_open()[0].connection.open_requests[CLIENT]
    assert (requests.repeats, requests.rest_ns) == (1, rest_ms * MS)


def test_places_of_the_latest_request_are_remembered(talk: Talk) -> None:
    begin = talk.seq[CLIENT]
    frame = talk.ask(read(5, dbw(1, 0)))
    side = talk.pipeline.table.all_open()[0]
    requests = side.connection.open_requests[CLIENT]
    assert (requests.asked_frame, requests.asked_seq, requests.latest_key) == (frame, begin, 5)
    assert requests.latest is not None
    assert (requests.latest._request_ack, requests.latest._request_seq) == (talk.seq[SERVER], begin)
    assert (side.requests, side.connection.last_request_ns) == (2, talk.now_ns)
    talk.tell(words(5, 1))
    assert (side.connection.last_answer_ns, requests.answered) == (talk.now_ns, talk.transactions[0].number)
    assert (requests.count, requests.latest_key) == (0, 5)
    latest: object = requests.latest  # not the one of above
    assert latest is None
    assert side.connection.last_answer is side.connection.last_request is talk.transactions[0].parameters


def test_without_a_gap_an_answer_of_another_function_is_that_of_its_reference(talk: Talk) -> None:
    """Whatever it acknowledges: the device is wrong."""
    talk.ask(read(4, dbw(1, 0)))
    talk.tell(words(4, 1))
    known = talk.seq[CLIENT]
    request = talk.ask(read(5, dbw(1, 0)))
    talk.acked[SERVER] = known
    answered = talk.tell(ack_data(5, b"\x05\x01", b"\xff"))
    assert talk.pairs()[1:] == [(request, answered)]
    assert talk.transactions[1]._flags & FUNCTION_MISMATCH


@pytest.mark.parametrize(("lossy", "silence_ns"), [(True, 3 * SECOND), (False, 3 * SECOND), (True, SECOND // 2)])
def test_a_connection_that_falls_silent_where_the_capture_has_gaps_may_have_gone_on(
    lossy: bool, silence_ns: int
) -> None:
    """TCP acknowledges a request within a second, or sends it again; the gap is on another connection."""
    talk = Talk()
    talk.open()
    other = Talk(50001, beside=talk)
    other.open()
    request = talk.ask(read(1, dbw(1, 0)))
    if lossy:
        other.lose(SERVER, words(1, 1))
    other.ask(read(1, dbw(1, 0)))
    other.tell(words(1, 2))
    for _ in range(3):
        other.packet(CLIENT)
        other.packet(SERVER, after_ns=60 * MS)
    other.packet(CLIENT, after_ns=silence_ns)
    talk.finish()
    (one,) = [one for one in talk.transactions if one.request_frame == request]
    expected = (HOLE, LIKELY) if lossy and silence_ns > SECOND else ("capture_ended", "")
    assert (one.reason, one.certainty) == expected


def test_every_transaction_has_a_number_of_its_own(talk: Talk) -> None:
    """Answers without a request, pushes, requests and what is behind malformed headers are counted as they come to an end."""
    talk.tell(words(7, 1))
    talk.tell(words(8, 1))
    talk.tell(events.mode(2))
    talk.packet(CLIENT, after_ns=2 * SECOND)
    talk.ask(read(1, dbw(1, 0)))
    talk.packet(CLIENT, tpkt(b"\x00\xf0\x80" + read(9, dbw(1, 0))))
    talk.packet(SERVER, tpkt(b"\x00\xf0\x80" + words(10, 1)))
    talk.tell(words(1, 1))
    talk.close()
    numbers = [int(one.number) for one in talk.transactions]
    assert sorted(numbers) == [*range(2, 8)]
    assert talk.pipeline.exchange.dialogue.count == 7


def test_an_answer_that_fits_no_request_after_those_that_are_answered_stands_alone(talk: Talk) -> None:
    """Servers answer in order: what was asked before an answered request is not answered after it."""
    asked_at = [talk.ask(read(5, dbw(1, 2 * number, size))) for number, size in enumerate((1, 1, 2))]
    refusal = talk.tell(ack_data(5, b"\x04\x01", refused(10)))  # it may be that to any of them
    double = talk.tell(words(5, 1, 2))
    single = talk.tell(words(5, 3))
    talk.close()
    assert sorted(talk.pairs()) == sorted(
        [(asked_at[0], refusal), (asked_at[1], 0), (asked_at[2], double), (0, single)]
    )
    (unanswered,) = [one for one in talk.transactions if not one.response_frame]
    assert unanswered.reason == REFERENCE_REUSED


def test_a_row_after_a_gap_that_may_also_contain_a_push(talk: Talk) -> None:
    """Whether the missing octets are the answer is not known, so that it is only likely."""
    talk.tell(events.mode(2))
    first = talk.ask(read(5, dbw(1, 0)))
    talk.lose(SERVER, words(5, 1))
    second = talk.ask(read(5, dbw(1, 2, 2)))
    answered = talk.tell(words(5, 2, 3))
    heal(talk)
    lost = next(one for one in talk.transactions if one.request_frame == first)
    assert (lost.response_frame, lost.reason, lost.certainty) == (0, HOLE, LIKELY)
    assert (second, answered) in talk.pairs()
    assert talk.pipeline.exchange.dialogue.open == 0


def test_whether_an_answer_would_complete_a_request(talk: Talk) -> None:
    dialogue = talk.pipeline.exchange.dialogue
    client = talk.pipeline.table.all_open()[0]
    assert client.peer is not None
    assert not dialogue.waits(client.peer, 1, 5)
    talk.ask(read(5, dbw(1, 0)))
    assert dialogue.waits(client.peer, 1, 5)
    assert dialogue.waits(client.peer, 3, 5)
    assert not dialogue.waits(client.peer, 1, 6)
    assert not dialogue.waits(client.peer, 7, 5)
    assert not dialogue.waits(client, 1, 5)
    talk.tell(words(5, 1))
    assert not dialogue.waits(client.peer, 1, 5)


def test_while_pairs_are_doubtful_an_early_answer_is_only_likely_too(talk: Talk) -> None:
    for _ in range(2):  # a client that waits long, so that it takes long until it is idle
        talk.ask(read(5, dbw(1, 0)))
        talk.tell(words(5, 1), after_ns=2 * SECOND)
    talk.ask(read(5, dbw(1, 2)), after_ns=9 * SECOND)
    talk.ask(read(5, dbw(1, 4)), after_ns=SECOND)
    talk.tell(words(5, 2))
    talk.silence(2 * SECOND)
    request = read(5, dbw(1, 6))
    talk.acked[SERVER] = talk.seq[CLIENT] + len(dt(request))
    told = talk.tell(words(5, 3))
    talk.acked[SERVER] = None
    frame = talk.ask(request)
    (one,) = [one for one in talk.transactions if one.request_frame == frame]
    assert (one.response_frame, one.doubt) == (told, "alike")


@pytest.mark.parametrize("answered_before", [False, True])
def test_a_first_answer_that_had_not_got_the_request_may_belong_to_an_earlier_one(answered_before: bool) -> None:
    """Once something was answered, it is known how this capture acknowledges."""
    talk = Talk()
    talk.hello()
    talk.connect()
    if answered_before:
        talk.ask(read(4, dbw(1, 0)))
        talk.tell(words(4, 1))
    known = talk.seq[CLIENT]
    request = talk.ask(read(5, dbw(1, 0)))
    talk.acked[SERVER] = known
    answered = talk.tell(words(5, 1))
    one = talk.transactions[-1]
    assert (one.request_frame, one.response_frame) == (request, answered)
    assert (one.certainty, one.doubt) == ((SURE, "") if answered_before else (LIKELY, "alike"))


def test_an_answer_that_stands_alone_takes_no_later_one_with_it(talk: Talk) -> None:
    asked_at = [talk.ask(read(5, dbw(1, 2 * number, size))) for number, size in enumerate((1, 1, 2, 2))]
    told = [
        talk.tell(ack_data(5, b"\x04\x01", refused(10))),
        talk.tell(words(5, 1, 2)),
        talk.tell(words(5, 3)),
        talk.tell(words(5, 4, 5)),
    ]
    talk.close()
    assert sorted(talk.pairs()) == sorted(
        [(asked_at[0], told[0]), (asked_at[1], 0), (asked_at[2], told[1]), (0, told[2]), (asked_at[3], told[3])]
    )
