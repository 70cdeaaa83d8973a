"""What missing octets mean for a request, condition by condition: each rule, and what makes it say the opposite."""

from __future__ import annotations

from typing import Final

import pytest

from dissect.engine.transactions.gaps import (
    LEAST_ANSWER,
    answered_in,
    begins_open,
    between,
    follows,
    has_gaps,
    latest_gap,
    missing_since,
    passed_over,
    perhaps_answered,
    perhaps_unasked,
    unasked_before,
    unheard,
)
from dissect.engine.transactions.open_requests import OpenRequests
from dissect.engine.transactions.results import Subscription
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import ConnectionTable
from dissect.engine.transactions.transaction import Transaction
from dissect.protocols.s7.parameters import Parameters, UserdataHead

SECOND: Final = 1_000_000_000
HALF: Final = 1 << 31
KEY: Final = b"\x0a\0\0\1\x0a\0\0\2\xc3\x50\0\x66"

#: Where octets are counted from, so that sequence numbers wrap, and so that those that matter (100, 501) are 0.
ZEROS: Final = [5000, 2**32 - 100, 2**32 - 501, 2**31 - 90]


class World:
    """A connection on which request 7 was captured as packet 10. It acknowledges octets up to 100 of the answering side.

    The request begins at 500 of the asking side; numbers of octets count from ``zero`` on both sides.
    """

    def __init__(self, zero: int = 5000) -> None:
        self.zero = zero
        asking = ConnectionTable().open(KEY, 0, 1, 0)
        assert asking.peer is not None
        self.asking: Side = asking
        self.answering: Side = asking.peer
        self.answering.begin(self.at(100))
        self.asking.begin(self.at(500))
        self.asking.last_ack = self.at(100)
        self.answering.last_ack = self.at(531)
        self.asking.end_seq = self.at(531)
        self.requests = OpenRequests()
        self.requests.asked_frame = 10
        self.requests.asked_seq = self.at(500)
        self.request = self.ask(7, 100)

    def at(self, octets: int) -> int:
        return (self.zero + octets) & 0xFFFFFFFF

    def ask(self, number: int, ack: int) -> Transaction:
        request = Transaction(number, self.asking.connection, 0, 1, number, Parameters(b"\x04", 1))
        request.request_frame = number + 3
        request._request_ack = self.at(ack) if ack >= 0 else -1
        request._request_seq = self.at(500)
        self.requests.add(number, request)
        return request

    def gap(self, side: Side, frame: int, end: int) -> None:
        side.holes = 1
        side.note_gap(frame, self.at(end) if end >= 0 else -1)


@pytest.fixture(params=ZEROS)
def world(request: pytest.FixtureRequest) -> World:
    return World(request.param)


# ---- whether there are gaps -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("case", "gaps"), [("none", False), ("own", True), ("other", True), ("ahead", True), ("alone", True)]
)
def test_gaps_of_either_side_count(world: World, case: str, gaps: bool) -> None:
    side = world.answering
    if case == "own":
        side.holes = 1
    elif case == "other":
        world.asking.holes = 1
    elif case == "ahead":  # it acknowledges octets that were not captured
        side.last_ack = world.at(532)
    elif case == "alone":
        side.peer = None
    assert has_gaps(side) is gaps


@pytest.mark.parametrize(
    ("case", "opens"), [("none", False), ("own", True), ("other", True), ("mid", True), ("alone", True)]
)
def test_requests_may_be_open_that_were_not_captured(world: World, case: str, opens: bool) -> None:
    side = world.asking
    side.connection.mid_stream = case == "mid"
    side.holes = 1 if case == "own" else 0
    world.answering.holes = 1 if case == "other" else 0
    if case == "alone":
        side.peer = None
    assert begins_open(side) is opens


@pytest.mark.parametrize(("own", "other", "latest"), [(0, 0, 0), (5, 3, 5), (3, 5, 5), (4, 4, 4), (0, 9, 9), (9, 0, 9)])
def test_the_latest_gap_of_either_side(world: World, own: int, other: int, latest: int) -> None:
    world.asking.hole_frame, world.answering.hole_frame = own, other
    assert latest_gap(world.asking) == latest
    world.asking.peer = None
    assert latest_gap(world.asking) == own


@pytest.mark.parametrize(
    ("seq", "before", "after"),
    [
        (1, 0, True),
        (0, 0, False),
        (0, 1, False),
        (HALF - 1, 0, True),
        (HALF, 0, False),
        (0, 2**32 - 1, True),
        (2**32 - 1, 0, False),
    ],
)
def test_sequence_numbers_follow_each_other_in_a_circle(seq: int, before: int, after: bool) -> None:
    assert follows(seq, before) is after


# ---- whether a request was answered ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "end", "ack", "answered"),
    [
        (10, 101, 100, True),
        (9, 101, 100, False),  # found before the request
        (11, 101, 100, True),
        (10, 100, 100, False),  # the client had got all that is missing
        (10, 99, 100, False),
        (10, -1, 100, True),  # unknown where it ends
        (10, 50, -1, True),  # unknown what the client had got
        (9, -1, -1, False),
        (0, -1, 100, False),  # there is no gap
    ],
)
def test_a_gap_may_contain_the_answer(world: World, frame: int, end: int, ack: int, answered: bool) -> None:
    world.gap(world.answering, frame, end)
    world.request._request_ack = world.at(ack) if ack >= 0 else -1
    assert perhaps_answered(world.request, world.answering) is answered


@pytest.mark.parametrize(
    ("acked", "ack", "answered"),
    [
        (119, 100, True),
        (107, 100, True),
        (106, 100, False),
        (100, 100, False),
        (119, 119, False),
        (119, 118, True),
        (119, 130, False),
    ],
)
def test_acknowledged_octets_may_contain_the_answer(world: World, acked: int, ack: int, answered: bool) -> None:
    """Seven octets are the shortest TPDU; those that the request itself acknowledged came before it."""
    world.asking.acked = world.at(acked)
    world.request._request_ack = world.at(ack)
    assert perhaps_answered(world.request, world.answering) is answered


def test_of_a_side_that_was_never_captured_nothing_is_concluded() -> None:
    world = World()
    table = ConnectionTable()
    asking = table.open(KEY, 0, 1, 0)
    answering = asking.peer
    assert answering is not None
    asking.first_ack, asking.acked = world.at(100), world.at(150)
    assert answering.unseen == 50
    assert not perhaps_answered(world.request, answering)
    answering.last_ack = 1
    assert perhaps_answered(world.request, answering)
    answering.peer = None
    assert not perhaps_answered(world.request, answering)


@pytest.mark.parametrize(
    ("case", "now_ns", "lossy", "lacks"),
    [
        ("", SECOND + 1, True, True),
        ("", SECOND, True, False),
        ("", SECOND + 1, False, False),
        ("no ack", SECOND + 1, True, False),
        ("unseen", SECOND + 1, True, False),
    ],
)
def test_a_connection_that_falls_silent_in_a_capture_with_gaps(
    case: str, now_ns: int, lossy: bool, lacks: bool
) -> None:
    world = World()
    answering = world.answering
    if case == "no ack":
        world.request._request_ack = -1
    if case == "unseen":
        answering = ConnectionTable().open(KEY, 0, 1, 0)
    answering.tcp.last_ns = 0
    assert unheard(world.request, answering, now_ns, lossy) is lacks


# ---- gaps of both sides ---------------------------------------------------------------------------------------------

#: (packet of the answering side's gap, its end, packet of the asking side's gap, its end, octets acknowledged too many)
BOTH: Final = [
    ((10, 120, 10, 531, 0), True),
    ((12, 120, 11, 531, 0), True),
    ((9, 120, 10, 531, 0), False),
    ((10, -1, 10, 531, 0), False),
    ((10, 100, 10, 531, 0), False),  # nothing is missing behind what the request acknowledged
    ((10, 90, 10, 531, 0), False),
    ((10, 120, 9, 531, 0), False),
    ((10, 120, 10, -1, 0), False),
    ((10, 120, 10, 500, 0), False),  # the client's gap ends where the request begins
    ((10, 120, 10, 501, 0), True),
    ((10, 120, 0, -1, 1), True),  # the server has got more than was captured
    ((10, 120, 0, -1, 0), False),
    ((9, 120, 0, -1, 1), False),
    ((10, -1, 0, -1, 1), False),
]


def both(world: World, gaps: tuple[int, int, int, int, int]) -> None:
    answers, answers_end, asks, asks_end, ahead = gaps
    world.gap(world.answering, answers, answers_end)
    world.gap(world.asking, asks, asks_end)
    world.answering.last_ack = world.at(531 + ahead)


@pytest.mark.parametrize(("gaps", "missing"), BOTH)
def test_octets_of_both_sides_are_missing_behind_a_request(
    world: World, gaps: tuple[int, int, int, int, int], missing: bool
) -> None:
    both(world, gaps)
    assert between(world.answering, world.request) is missing


def test_a_request_without_acknowledgement_may_be_followed_by_any_gap(world: World) -> None:
    both(world, (10, 90, 10, 531, 0))
    world.request._request_ack = -1
    assert between(world.answering, world.request)
    world.answering.peer = None
    assert not between(world.answering, world.request)


@pytest.mark.parametrize(
    ("answered", "repeats", "passed"), [(8, 0, True), (7, 0, False), (0, 2, True), (0, 1, False), (8, 2, True)]
)
def test_an_answer_passes_over_a_request(world: World, answered: int, repeats: int, passed: bool) -> None:
    """Where a later request was answered already, or the client always uses one reference."""
    world.requests.answered, world.requests.repeats = answered, repeats
    assert not passed_over(world.answering, world.requests, world.request)  # nothing is missing
    both(world, (10, 120, 10, 531, 0))
    assert passed_over(world.answering, world.requests, world.request) is passed


@pytest.mark.parametrize(
    ("gaps", "missing"),
    [
        ((0, -1, 0, -1, 0), False),
        ((10, 120, 0, -1, 0), True),
        ((0, -1, 10, 501, 0), True),
        ((0, -1, 9, 501, 0), False),
        ((0, -1, 10, 500, 0), False),
        ((0, -1, 10, -1, 0), True),
        ((0, -1, 0, -1, 1), True),
    ],
)
def test_octets_of_either_side_are_missing_since_a_request(
    world: World, gaps: tuple[int, int, int, int, int], missing: bool
) -> None:
    both(world, gaps)
    assert missing_since(world.answering, world.request) is missing
    world.answering.peer = None
    assert missing_since(world.answering, world.request)


# ---- requests that were not captured --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("frame", "end", "unasked"),
    [
        (10, 501, True),
        (9, 500, True),  # right before the request
        (9, 500 - LEAST_ANSWER + 1, True),
        (9, 500 - LEAST_ANSWER, False),  # a message lies between the gap and the request
        (9, -1, False),
        (9, 501, False),
    ],
)
def test_an_answer_may_belong_to_a_request_that_is_missing(world: World, frame: int, end: int, unasked: bool) -> None:
    world.answering.end_seq = world.at(130)
    assert not perhaps_unasked(world.answering, world.request)
    world.gap(world.asking, frame, end)
    assert perhaps_unasked(world.answering, world.request) is unasked


def test_an_answer_that_the_request_rules_out_belongs_to_another(world: World) -> None:
    world.answering.end_seq = world.at(101)
    assert not perhaps_unasked(world.answering, world.request)
    world.answering.end_seq = world.at(100)  # the client had got it before it asked
    assert perhaps_unasked(world.answering, world.request)
    world.answering.end_seq = world.at(101)
    world.answering.last_ack = world.at(501)
    assert not perhaps_unasked(world.answering, world.request)
    world.answering.last_ack = world.at(500)  # the server had not got the request yet
    assert perhaps_unasked(world.answering, world.request)


@pytest.mark.parametrize(
    ("case", "unasked"),
    [
        ("", True),
        ("no gap", False),
        ("gap before", False),
        ("gap at the request before", False),
        ("alone", False),
        ("answers missing", False),
        ("answers missing earlier", True),
        ("orphan", False),
        ("orphan dropped", False),
        ("orphan dropped earlier", True),
        ("orphan of this one", True),
        ("many", False),
        ("few", True),
        ("many, repeats", True),
        ("many, same key", True),
    ],
)
def test_a_request_with_the_same_reference_may_be_missing_before_this_one(
    world: World, case: str, unasked: bool
) -> None:
    side, requests = world.asking, world.requests
    side.note_gap(11, world.at(501))
    side.requests = 4 if "many" in case else 3
    requests.repeats = 1 if "repeats" in case else 0
    requests.latest_key = 9 if "same key" in case else 8
    answer = Transaction(0, side.connection, 0, 3, 9, Parameters(b"\x04", 3))
    answer.response_frame = 11
    if case == "no gap":
        side.hole_end = -1
    elif case.startswith("gap"):
        side.hole_end = world.at(500 if "at" in case else 499)
    elif case == "alone":
        side.peer = None
    elif case.startswith("answers missing"):
        world.answering.hole_frame = 9 if "earlier" in case else 10
    elif case == "orphan":  # of another request: the missing one did not use this reference
        requests.hold_orphan(8, answer, world.at(531), 1)
    elif case == "orphan of this one":
        requests.hold_orphan(9, answer, world.at(531), 1)
    elif case.startswith("orphan dropped"):
        requests.orphan_frame = 10 if "earlier" in case else 11
    assert unasked_before(side, requests, 9) is unasked


# ---- whose answers are in a gap -------------------------------------------------------------------------------------


def certain(world: World, acks: list[int], size: int, begin: int = 100) -> list[int]:
    """Return the places of the requests, one with each of ``acks``, that were answered in a gap from ``begin`` on."""
    world.requests = OpenRequests()
    made = [world.ask(number, ack) for number, ack in enumerate(acks, 1)]
    world.gap(world.answering, 30, begin + size)
    return [made.index(one) for one in answered_in(world.answering, size, world.requests)]


@pytest.mark.parametrize(
    ("acks", "size", "expected"),
    [
        ([100], 19, [0]),
        ([100], 18, []),  # too short for an answer
        ([100], 500, [0]),
        ([40], 19, [0]),  # it also acknowledged less than what came before the gap
        ([101], 19, []),  # ... or a part of the gap, so that the rest is too short
        ([101], 20, [0]),
        ([119], 19, []),  # all that is missing had come before the request
        ([130], 19, []),
        ([-1], 19, []),
        ([100, 119], 38, [0, 1]),
        ([100, 119], 37, [0]),
        ([100, 118], 38, []),  # too short for the first, so it is unknown whose the rest is
        ([100, 100], 38, []),
        ([40, 50], 38, []),
        ([40, 119], 38, [0, 1]),
        ([100, 119, 138], 57, [0, 1, 2]),
        ([100, 119, 119], 57, [0]),
        ([100, 119, 119], 19, [0]),
        ([100, 119, 100], 19, [0]),  # what was sent after one that had got all was sent after all had come
        ([100, 90], 38, []),  # acknowledgements that go back divide nothing
        ([], 19, []),
    ],
)
def test_a_gap_is_divided_by_acknowledgements(world: World, acks: list[int], size: int, expected: list[int]) -> None:
    assert certain(world, acks, size) == expected


def test_as_many_requests_as_are_examined_for_a_gap(world: World) -> None:
    acks = [100 + 19 * number for number in range(17)]
    assert certain(world, acks[:16], 19 * 16) == [*range(16)]
    assert certain(world, acks, 19 * 17) == []


def test_only_requests_after_the_latest_answered_one_are_in_a_gap(world: World) -> None:
    assert certain(world, [100, 100, 100], 19) == []
    world.requests.answered = 2
    assert [int(one.number) for one in answered_in(world.answering, 19, world.requests)] == [3]


@pytest.mark.parametrize(
    ("case", "expected"),
    [
        ("", [0]),
        ("asks itself", []),
        ("pushes", []),
        ("one-way requests", [0]),
        ("pushes and one-way requests", []),
        ("subscribed", []),
    ],
)
def test_a_gap_of_a_side_that_sends_other_things_as_well_says_nothing(
    world: World, case: str, expected: list[int]
) -> None:
    connection = world.answering.connection
    world.answering.requests = 1 if case == "asks itself" else 0
    connection.unsolicited = 2 if "and" in case else 1 if case in {"pushes", "one-way requests"} else 0
    connection.one_way = 1 if "one-way" in case else 0
    if case == "subscribed":
        connection.subscriptions[1] = Subscription(UserdataHead(1, 2, 1, 0), b"")
    assert certain(world, [100], 19) == expected
