"""Several requests open under one reference that look alike: which answer is whose, and how sure that is."""

from __future__ import annotations

import struct

import pytest

from dissect.engine.transactions.alike import (
    HELD_NS,
    MAX_HELD,
    REST_NS,
    assign,
    fitting,
    is_complete,
    is_due,
    is_over,
    is_repeat,
    possible,
)
from dissect.engine.transactions.open_requests import HeldAnswer, Row
from dissect.engine.transactions.transaction import LIKELY, REFERENCE_REUSED, SURE, Transaction
from tests.engine.transactions.talk import (
    CLIENT,
    MS,
    SECOND,
    SERVER,
    Talk,
    ack_data,
    dbw,
    dt,
    good,
    read,
    words,
    write,
    written,
)

#: With a setup that grants so many jobs, or (0) without one that was captured: then the first pairs of a client that repeats
#: its reference are only likely, because a request that was sent before the capture may be open.
JOBS = [0, 1, 3]


def begun(jobs: int) -> Talk:
    talk = Talk()
    if jobs:
        talk.open(jobs, jobs)
    return talk


def truth(talk: Talk) -> list[tuple[int, object, str]]:
    """The number of the request (its address) and of the answer (its value), and how sure the pair is."""
    return sorted(
        (int(result.item.start_bit) // 16, result.value, one.certainty)
        for one in talk.transactions
        for result in one.s7_results
        if one.request_frame and one.response_frame and result.item is not None
    )


def right(numbers: range, certainty: str) -> list[tuple[int, object, str]]:
    return [(number, number, certainty) for number in numbers]


def asks(number: int) -> bytes:
    return read(0, dbw(1, 2 * number))


@pytest.mark.parametrize("jobs", JOBS)
def test_two_threads_on_one_connection(jobs: int) -> None:
    talk = begun(jobs or 1)
    for number in range(0, 8, 2):
        talk.ask(asks(number))
        talk.ask(asks(number + 1))
        talk.tell(words(0, number))
        talk.tell(words(0, number + 1))
        talk.wait(SECOND)
    talk.close()
    assert truth(talk) == right(range(8), SURE)
    assert [slug for slug in talk.slugs() if slug.startswith(("transaction.", "session."))] == [
        "session.shared_reference"
    ]


@pytest.mark.parametrize("jobs", JOBS)
def test_a_read_and_a_write(jobs: int) -> None:
    """Their answers differ, so that each is told at once."""
    talk = begun(jobs)
    asked = [talk.ask(asks(0)), talk.ask(write(0, [dbw(1, 2)], written(4, b"\0\1")))]
    answered = [talk.tell(words(0, 0))]
    assert talk.pairs() == [(asked[0], answered[0])]
    answered.append(talk.tell(ack_data(0, b"\x05\x01", b"\xff")))
    assert talk.pairs() == [*zip(asked, answered, strict=True)]
    assert {one.certainty for one in talk.transactions} == {SURE if jobs else LIKELY}


@pytest.mark.parametrize("jobs", JOBS)
@pytest.mark.parametrize("sizes", [(1, 2, 3), (3, 1, 2), (2, 2, 1)])
def test_the_shape_of_the_answer_tells(sizes: tuple[int, ...], jobs: int) -> None:
    talk = begun(jobs)
    asked = [talk.ask(read(0, dbw(1, 0, size))) for size in sizes]
    answered = [talk.tell(words(0, *range(size))) for size in sizes]
    talk.close()
    assert sorted(talk.pairs()) == [*zip(asked, answered, strict=True)]
    assert {one.certainty for one in talk.transactions} == {SURE if jobs else LIKELY}


@pytest.mark.parametrize("jobs", JOBS)
@pytest.mark.parametrize("timeout_ms", [150, 1000, 3000])
def test_answers_after_the_timeout_of_the_client(timeout_ms: int, jobs: int) -> None:
    """The client takes the answer to its first request for that to its second; the server answers both."""
    talk = begun(jobs)
    talk.ask(asks(0))
    talk.wait(timeout_ms * MS)
    talk.ask(asks(1))
    talk.tell(words(0, 0))
    talk.tell(words(0, 1), after_ns=50 * MS)
    talk.close()
    assert truth(talk) == right(range(2), SURE if jobs else LIKELY)


@pytest.mark.parametrize("jobs", JOBS)
@pytest.mark.parametrize("pause_ms", [300, 1000, 2000])
@pytest.mark.parametrize("same", [False, True])
def test_a_request_without_answer_shifts_nothing(same: bool, pause_ms: int, jobs: int) -> None:
    """The first of nine requests of one shape is never answered; the client waits for each answer."""
    talk = begun(jobs)
    asked = [talk.ask(asks(0))]
    talk.wait(pause_ms * MS)
    answered = []
    for number in range(1, 9):
        asked.append(talk.ask(asks(0 if same else number)))
        answered.append(talk.tell(words(0, number)))
        talk.packet(CLIENT)
        talk.wait(20 * MS)
    talk.close()
    assert sorted(talk.pairs()) == [(asked[0], 0), *zip(asked[1:], answered, strict=True)]
    assert {one.certainty for one in talk.transactions if one.response_frame} == {LIKELY}
    assert [one.reason for one in talk.transactions if one.reason] == [REFERENCE_REUSED]


@pytest.mark.parametrize("jobs", JOBS)
def test_a_request_without_answer_among_three_in_flight(jobs: int) -> None:
    """The client keeps three requests open, and sends another one with each answer that it gets."""
    talk = begun(jobs)
    asked = [talk.ask(asks(number)) for number in range(3)]
    answered = []
    for number in range(1, 9):
        answered.append(talk.tell(words(0, number)))
        if len(asked) < 9:
            asked.append(talk.ask(asks(len(asked))))
    talk.close()
    assert sorted(talk.pairs()) == [(asked[0], 0), *zip(asked[1:], answered, strict=True)]
    assert {one.certainty for one in talk.transactions if one.response_frame} == {LIKELY}


def test_the_same_request_repeated_with_one_answer() -> None:
    talk = begun(1)
    asked = [talk.ask(asks(0)), talk.ask(asks(0))]
    answered = talk.tell(words(0, 0))
    talk.close()
    assert talk.pairs() == [(asked[0], answered), (asked[1], 0)]
    assert talk.transactions[0].certainty == LIKELY
    assert "session.shared_reference" not in talk.slugs()


def test_pairs_are_told_when_the_connection_rests() -> None:
    talk = begun(3)
    asked = [talk.ask(asks(number)) for number in range(2)]
    answered = talk.tell(words(0, 1))
    talk.silence(REST_NS - 100 * MS)
    assert talk.pairs() == []
    talk.silence(200 * MS)
    assert talk.pairs() == [(asked[0], 0), (asked[1], answered)]


def test_an_answer_that_took_long_is_waited_for_as_long_again() -> None:
    talk = begun(3)
    for number in range(2):
        talk.ask(asks(number))
    talk.wait(1200 * MS)
    talk.tell(words(0, 0))
    talk.silence(1000 * MS)
    assert talk.pairs() == []
    talk.tell(words(0, 1))
    assert truth(talk) == right(range(2), SURE)


def test_answers_are_not_held_for_ever() -> None:
    """Two requests are open all the time: neither the connection rests, nor are all answered."""
    talk = begun(3)
    talk.ask(asks(0))
    for number in range(1, 400):
        talk.ask(asks(number))
        talk.tell(words(0, number - 1))
        held = talk.pipeline.table.all_open()[0].connection.open_requests[CLIENT].held
        assert held < MAX_HELD
    assert truth(talk)[:MAX_HELD] == right(range(MAX_HELD), LIKELY)
    talk.tell(words(0, 399))
    talk.close()
    assert [one[:2] for one in truth(talk)] == [one[:2] for one in right(range(400), LIKELY)]
    assert len(talk.transactions) == 400


def test_answers_are_not_held_for_long() -> None:
    talk = begun(3)
    talk.ask(asks(0))
    for number in range(1, 70):
        talk.ask(asks(number))
        talk.tell(words(0, number - 1), after_ns=100 * MS)
        oldest = talk.pipeline.table.all_open()[0].connection.open_requests[CLIENT].waiting()
        assert all(talk.now_ns - one.response_ns <= HELD_NS for one in oldest)
    assert len(talk.transactions) >= 10


def test_what_follows_is_doubtful_until_the_connection_rests() -> None:
    talk = begun(1)
    talk.ask(asks(0))
    talk.wait(SECOND)
    for number in range(1, 4):
        talk.ask(asks(number))
        talk.tell(words(0, number))
        talk.silence(SECOND * 3)
    talk.close()
    assert [one[2] for one in truth(talk)] == [LIKELY, SURE, SURE]


def test_a_gap_makes_order_unsure() -> None:
    """The number of answers is that of the requests, but a request and an answer are missing."""
    talk = begun(3)
    talk.ask(asks(0))
    talk.ask(asks(1))
    talk.lose(CLIENT, asks(2))
    talk.tell(words(0, 0))
    talk.lose(SERVER, words(0, 1))
    talk.tell(words(0, 2))
    for _ in range(12):
        talk.packet(CLIENT)
        talk.packet(SERVER, after_ns=60 * MS)
    talk.close()
    assert SURE not in {one[2] for one in truth(talk)}


def test_answers_of_two_items_and_refusals() -> None:
    """A refused item has no size: such an answer fits any request of as many items."""
    talk = begun(3)
    asked = [talk.ask(read(0, dbw(1, 0), dbw(1, 2))), talk.ask(read(0, dbw(1, 0, 2), dbw(1, 4, 2)))]
    refused = talk.tell(ack_data(0, b"\x04\x02", b"\x0a\0\0\0" * 2))
    answered = talk.tell(ack_data(0, b"\x04\x02", good(4, struct.pack(">2H", 1, 2)) * 2))
    talk.close()
    assert talk.pairs() == [(asked[0], refused), (asked[1], answered)]
    assert {one.certainty for one in talk.transactions} == {SURE}


def test_one_segment_with_both_answers() -> None:
    talk = begun(3)
    asked = talk.packet(CLIENT, dt(asks(0), asks(1)))
    answered = talk.packet(SERVER, dt(words(0, 0), words(0, 1)))
    talk.close()
    assert talk.pairs() == [(asked, answered)] * 2
    assert truth(talk) == right(range(2), SURE)


@pytest.mark.parametrize(
    ("acks", "gap_end", "lost", "left"),
    [
        ([100, 100, 100], -1, [0], [0, 1, 2]),  # there is no gap
        ([100, 100, 100], 200, [], [0, 1, 2]),
        ([100, 100, 100], 200, [0], [1, 2]),  # answered in the gap
        ([100, 100, 200], 200, [], [2]),  # what follows acknowledges the octets that are missing
        ([100, 100, 200], 200, [2], [0, 1, 2]),  # none would be left
        ([100, 200, 250], 200, [1], [2]),
        ([100, 200, 250], 200, [2], [1]),
        ([100, 150, 199], 200, [0], [1, 2]),  # not all of them
        ([100, 100, -1], 200, [0], [0, 1, 2]),  # it is not known what the latest acknowledges
        ([100], 200, [0], [0]),
    ],
)
def test_requests_to_which_an_answer_may_belong_by_its_place(
    acks: list[int], gap_end: int, lost: list[int], left: list[int]
) -> None:
    """Those answered in a gap are left out, and those before one that acknowledges the missing octets; never all of them."""
    talk = begun(8)
    for number in range(len(acks)):
        talk.ask(read(number + 1, dbw(1, 0)))
        talk.tell(words(number + 1, 1))
    requests = talk.transactions
    for request, ack in zip(requests, acks, strict=True):
        request._request_ack, request._request_seq = ack, 1000
    row = Row(0, requests[0])
    row.requests = list(requests)
    assert possible(row, 300, 1100, gap_end, [requests[at] for at in lost]) == [requests[at] for at in left]


# ---- rules of one row -----------------------------------------------------------------------------------------------


def row_of(asks: list[tuple[int, int]], answers: list[list[int]], same: bool = False) -> tuple[Row, list[Transaction]]:
    """A row of requests, each (time in ms, acknowledgement), and of answers with the places of the requests that they fit."""
    talk = begun(8)
    for number in range(len(asks)):
        talk.ask(read(number + 1, dbw(1, 0 if same else number)))
        talk.tell(words(number + 1, 1))
    requests = list(talk.transactions)
    for one, (time_ms, ack) in zip(requests, asks, strict=True):
        one.request_ns, one._request_ack = time_ms * MS, ack
        if same:
            one._request_buf, one._request_offset = asks_once(), 0
            one.request_size = len(asks_once())
    row = Row(0, requests[0])
    row.requests = list(requests)
    for fits in answers:
        held = HeldAnswer(0, requests[0], 0, 0)
        held.fits = [requests[place] for place in fits]
        row.hold(held)
    return row, requests


def asks_once() -> bytes:
    return read(1, dbw(1, 0))


ALL = [0, 1, 2]
#: Requests 10 ms apart, and the same with a pause of 300 ms before the second, or before the third.
STEADY = [(0, 5), (10, 5), (20, 5)]
LATE_SECOND = [(0, 5), (300, 5), (310, 5)]
LATE_THIRD = [(0, 5), (10, 5), (310, 5)]
LATE_BOTH = [(0, 5), (300, 5), (600, 5)]


@pytest.mark.parametrize(
    ("asks", "answers", "over", "expected"),
    [
        (STEADY, [ALL, ALL, ALL], False, [0, 1, 2]),
        (STEADY, [ALL, ALL, ALL], True, [0, 1, 2]),
        (STEADY, [ALL, ALL, ALL, ALL], False, [0, 1, 2, None]),  # one too many
        (STEADY, [ALL, ALL], True, [1, 2]),  # the oldest waited in vain
        (STEADY, [ALL], True, [2]),
        (STEADY, [ALL, ALL], False, [0, 1]),  # the third answer may still come
        (STEADY, [ALL], False, [0]),
        (LATE_SECOND, [ALL, ALL], False, [1, 2]),  # the client had given the first up
        (LATE_SECOND, [ALL], False, [1]),
        (LATE_THIRD, [ALL], False, [2]),
        (LATE_THIRD, [ALL, ALL], False, [0, 1]),  # not the second: then one answer would be too many
        (LATE_BOTH, [ALL], False, [2]),
        (LATE_BOTH, [ALL, ALL], False, [1, 2]),
        ([(0, 5), (300, 6), (310, 6)], [ALL, ALL], False, [0, 1]),  # it got something in between
        ([(0, 5), (200, 5), (210, 5)], [ALL, ALL], False, [0, 1]),  # not long enough to give up
        (STEADY, [[1], [2]], False, [1, 2]),
        (STEADY, [[0, 2], ALL], False, [0, 1]),
        (STEADY, [[2], [0, 1]], False, [2, None]),  # what it fits was asked before the one that is answered already
        (STEADY, [[0, 1], [0, 1]], False, [0, 1]),  # the third is wanted by none of them
        (STEADY, [[0, 1]], True, [1]),
        (STEADY, [[0], [1, 2]], True, [0, 2]),
    ],
)
def test_which_request_each_answer_belongs_to(
    asks: list[tuple[int, int]], answers: list[list[int]], over: bool, expected: list[int | None]
) -> None:
    row, requests = row_of(asks, answers)
    chosen = assign(row, over)
    assert [requests.index(one) if one is not None else None for one in chosen] == expected


@pytest.mark.parametrize(
    ("same", "after_ms", "expected"), [(True, 1000, 0), (True, 1001, 1), (False, 1000, 1), (True, 300, 0)]
)
def test_one_answer_to_a_request_and_its_repetition_is_that_of_the_first(
    same: bool, after_ms: int, expected: int
) -> None:
    row, requests = row_of([(0, 5), (after_ms, 5)], [[0, 1]], same)
    assert is_repeat(requests[1], requests[0]) is (expected == 0)
    assert assign(row, True) == [requests[expected]]


def test_of_three_the_first_may_be_the_one_without_answer_though_they_are_equal() -> None:
    row, requests = row_of(LATE_BOTH, [ALL, ALL], same=True)
    assert assign(row, False) == requests[1:]


@pytest.mark.parametrize(
    ("answers", "complete"), [([[0, 1]], False), ([[0, 1], [0, 1]], True), ([[0]], True), ([[0, 1]] * 3, True)]
)
def test_a_row_is_complete_with_as_many_answers_as_may_be_theirs(answers: list[list[int]], complete: bool) -> None:
    row, _ = row_of(STEADY, answers)
    assert is_complete(row) is complete


@pytest.mark.parametrize(
    ("waited_ms", "rest_ms", "over"),
    [
        (1, 500, True),
        (1, 499, False),
        (500, 500, True),
        (700, 699, False),
        (700, 700, True),
        (9000, 4999, False),
        (9000, 5000, True),  # no longer than answers are held
    ],
)
def test_a_connection_is_idle_after_as_long_as_an_answer_took(waited_ms: int, rest_ms: int, over: bool) -> None:
    row, requests = row_of(STEADY, [ALL])
    row.answers[0].transaction.response_ns = requests[0].request_ns + waited_ms * MS
    last = 100 * SECOND
    assert is_over(row, last + rest_ms * MS, last) is over


def test_answers_are_due_when_they_waited_too_long_or_are_too_many() -> None:
    row, _ = row_of(STEADY, [ALL])
    row.answers[0].transaction.response_ns = 70
    assert not is_due(row, 70 + HELD_NS - 1)
    assert is_due(row, 70 + HELD_NS)
    row.answers *= MAX_HELD - 1
    assert not is_due(row, 70)
    row.answers.append(row.answers[0])
    assert is_due(row, 70)


def test_only_requests_that_an_answer_does_not_contradict_fit_it() -> None:
    talk = begun(8)
    for number, size in enumerate((1, 2, 1, 1, 2, 3), 1):
        talk.ask(read(number, dbw(1, 0, size)))
        talk.tell(words(number, *range(size)))
    requests, answers = talk.transactions[:3], talk.transactions[3:]
    found = [fitting(requests, answer, answer._response_offset + 14) for answer in answers]
    assert found == [[requests[0], requests[2]], [requests[1]], []]
