from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.open_requests import (
    BESIDE_NS,
    MAX_ORPHANS,
    ORPHAN_HOLD_FRAMES,
    ORPHAN_HOLD_NS,
    SHORT_REST_NS,
    HeldAnswer,
    OpenRequests,
    acknowledged,
    excludes,
    key_of,
    no_answer,
)
from dissect.engine.transactions.payloads import SCD
from dissect.engine.transactions.transaction import Transaction
from dissect.packets.tcp.connection import TcpConnection
from dissect.packets.tcp.stream import FAR_AHEAD, Endpoint
from dissect.protocols.s7.parameters import Parameters
from dissect.protocols.s7.tables import ACK, ACK_DATA, JOB, USERDATA
from dissect.protocols.s7plus.parameters import PLUS
from tests.growth import assert_growth

CONNECTION = Connection(
    1, TcpConnection(Endpoint(b"\x0a\x00\x00\x01", 50000), Endpoint(b"\x0a\x00\x00\x02", 102), 0, 1, 0)
)


def request(number: int, time_ns: int = 0, ack: int = -1) -> Transaction:
    transaction = Transaction(number, CONNECTION, 0, 1, 0, Parameters(b"\x04", 1))
    transaction.request_ns = time_ns
    transaction.request_frame = number
    transaction._request_ack = ack
    return transaction


def answer(number: int, time_ns: int = 0) -> Transaction:
    transaction = Transaction(number, CONNECTION, 0, 3, 0, Parameters(b"\x04", 3))
    transaction.response_ns = time_ns
    return transaction


def put(requests: OpenRequests, key: int, transaction: Transaction) -> None:
    """Open a request."""
    waiting = requests.add(key, transaction)
    if waiting is not None:
        requests.join(key, transaction, waiting)


def take(requests: OpenRequests, key: int) -> int:
    """Close the oldest open request of a key and return its number."""
    found = requests.under(key)[0]
    requests.close(key, found)
    return found.number


# ---- open requests --------------------------------------------------------------------------------------------------


def test_an_answered_request_leaves_the_table() -> None:
    requests = OpenRequests()
    put(requests, 5, request(1))
    assert requests.count == 1
    assert take(requests, 5) == 1
    assert (requests.count, requests.table) == (0, {})


@given(st.lists(st.tuples(st.integers(0, 4), st.booleans()), max_size=40))
def test_what_is_open_is_found_however_many_are(steps: list[tuple[int, bool]]) -> None:
    """Against a dictionary; the table is looked at now and then, which must change nothing."""
    requests = OpenRequests()
    known: dict[int, int] = {}
    for number, (key, look) in enumerate(steps, 1):
        if key in known:
            assert take(requests, key) == known.pop(key)
        else:
            requests.add(key, request(number))
            known[key] = number
        if look:
            assert [(key, found.number) for key, found in requests.table.items()] == list(known.items())
        assert requests.count == len(known)
        for other in range(5):
            found = requests.find(other)
            assert (found.number if found is not None else None) == known.get(other)
    assert [found.number for found in requests.drain()] == list(known.values())
    assert requests.find(0) is None


def test_requests_of_one_key_stay_open_beside_each_other() -> None:
    requests = OpenRequests()
    for number, key in enumerate((5, 6, 5, 5), 1):
        put(requests, key, request(number))
    assert requests.count == 4
    row = requests.row(5)
    assert row is not None
    assert [one.number for one in row.requests] == [1, 3, 4]
    assert requests.row(6) is None
    requests.close(5, row.requests[1])
    requests.close(5, row.requests[1])  # the latest: the table keeps the first one, at its place
    assert [one.number for one in requests.table.values()] == [1, 2]
    assert requests.row(5) is None
    assert [one.number for one in requests.drain()] == [1, 2]


def test_answers_that_fit_several_requests_are_held_with_them() -> None:
    requests = OpenRequests()
    for number in (1, 2, 3):
        put(requests, 5, request(number))
    row = requests.row(5)
    assert row is not None
    for number in (7, 8):
        held = HeldAnswer(5, answer(number), 0, 0)
        held.fits = row.requests[:2]
        requests.hold(row, held)
    assert requests.held == 2
    assert row.wanted == {1, 2}
    assert [one.number for one in requests.waiting()] == [7, 8]
    requests.close(5, row.requests[0])
    assert row.wanted == {2}
    assert [one.transaction.number for one in requests.release(row)] == [7, 8]
    assert (requests.held, requests.undecided, requests.waiting()) == (0, None, [])
    assert requests.count == 2
    for expected in (2, 3):
        assert take(requests, 5) == expected
    assert requests.row(5) is None


def test_a_row_ends_with_the_answers_that_it_holds() -> None:
    requests = OpenRequests()
    for number in (1, 2):
        put(requests, 5, request(number))
    row = requests.row(5)
    assert row is not None
    held = HeldAnswer(5, answer(7), 0, 0)
    held.fits = list(row.requests)
    requests.hold(row, held)
    requests.close(5, row.requests[0])
    assert requests.row(5) is row
    requests.release(row)
    assert requests.row(5) is None
    assert take(requests, 5) == 2


def test_the_oldest_is_found_first() -> None:
    requests = OpenRequests()
    for number in range(1, 5):
        put(requests, number, request(number))
    put(requests, 1, request(5))  # the first key is now the youngest
    gone = []
    while (oldest := requests.oldest()) is not None:
        requests.close(*oldest)
        gone.append(oldest[1].number)
    assert gone == [2, 3, 4, 1, 5]
    assert requests.count == 0


def test_drain_gives_everything_in_the_order_of_asking() -> None:
    requests = OpenRequests()
    for number, key in enumerate((1, 2, 1, 3, 1), 1):
        put(requests, key, request(number))
    assert [one.number for one in requests.drain()] == [1, 2, 3, 4, 5]
    assert (requests.count, requests.table, requests.row(1)) == (0, {}, None)
    assert requests.drain() == []


def test_requests_open_since() -> None:
    requests = OpenRequests()
    for number in range(1, 6):
        put(requests, number, request(number, number * 10))
    put(requests, 5, request(6, 60))
    assert requests.count == 6
    assert requests.open_since(10, 0, -1, 99) == 6
    assert requests.open_since(31, 0, -1, 99) == 3
    assert requests.open_since(51, 0, -1, 99) == 1
    assert requests.open_since(61, 0, -1, 99) == 0
    assert requests.open_since(10, 0, -1, 2) == 2
    assert requests.open_since(10, 3, -1, 99) == 3
    assert requests.open_since(10, 6, -1, 99) == 0
    assert OpenRequests().open_since(0, 0, -1, 99) == 0


def test_what_acknowledged_the_end_of_a_gap_is_not_answered_in_it() -> None:
    requests = OpenRequests()
    for number, ack in enumerate((500, 700, 800), 1):
        put(requests, number, request(number, 10, ack))
    assert requests.open_since(0, 3, 700, 99) == 2
    assert requests.open_since(0, 3, 701, 99) == 1
    assert requests.open_since(0, 3, -1, 99) == 0


@pytest.mark.parametrize("lost", [1, 2, 5, 12])
def test_requests_that_are_long_open_do_not_count(lost: int) -> None:
    """A request whose answer was lost stays open for ever, and each later one asks how many are open beside it."""
    requests = OpenRequests()
    for number in range(1, lost + 1):
        put(requests, number, request(number, number))
    allowed = 2
    for number in range(100, 106):
        put(requests, number, request(number, number * 1000))
        recent = min(number - 99, 3)
        assert requests.open_since(500, 0, -1, lost + 99) == recent
        assert requests.open_since(500, 0, -1, allowed + 1) <= allowed or recent > allowed
        assert requests.open_since(500, lost, -1, allowed + 1) <= allowed or recent > allowed
        assert requests.open_since(0, 0, -1, 1) >= 1  # all are recent
        if number >= 102:
            assert requests.open_since(500, 0, -1, allowed + 1) == allowed + 1
            assert take(requests, number - 2) == number - 2
            assert requests.open_since(500, 0, -1, allowed + 1) == allowed


@given(
    st.lists(
        st.tuples(st.sampled_from(["ask", "ask", "first", "any", "oldest"]), st.integers(0, 3), st.integers(0, 5)),
        max_size=80,
    )
)
@example(
    [("ask", 0, 0), ("ask", 1, 0), ("ask", 0, 0), ("any", 0, 1), ("ask", 2, 0)]
)  # the latest of a row leaves first
def test_any_course_of_asking_and_answering(steps: list[tuple[str, int, int]]) -> None:
    """Against a plain list of (key, number) in the order of asking."""
    requests = OpenRequests()
    model: list[tuple[int, int]] = []
    for number, (step, key, which) in enumerate(steps, 1):
        mine = [one for one in model if one[0] == key]
        if step == "ask":
            put(requests, key, request(number, number))
            model.append((key, number))
        elif step == "oldest":
            oldest = requests.oldest()
            assert (oldest is None) is (not model)
            if oldest is not None:
                requests.close(*oldest)
                model.remove((oldest[0], oldest[1].number))
        elif mine:
            chosen = mine[0] if step == "first" else mine[which % len(mine)]
            requests.close(key, next(one for one in requests.under(key) if one.number == chosen[1]))
            model.remove(chosen)
        assert requests.count == len(model)
        for other in range(4):
            assert [one.number for one in requests.under(other)] == [one[1] for one in model if one[0] == other]
            row = requests.row(other)
            assert (row is not None) is (len([one for one in model if one[0] == other]) > 1)
        latest = [one.number for one in requests.table.values()]
        assert latest == sorted(latest)
        for since in (0, number // 2, number):
            assert [one.number for one in requests.asked_after(since)] == [one[1] for one in model if one[1] > since]
            recent = [one[1] for one in model if one[1] >= since]
            assert requests.open_since(since, -1, -1, 999) <= len(recent)
            found = requests.recent(since, 2)
            assert [one.number for one in found] == [one[1] for one in model if one[1] > since] or len(found) > 2
    assert [one.number for one in requests.drain()] == [one[1] for one in model]


@pytest.mark.parametrize("distinct", [True, False])
def test_a_flood_takes_work_in_proportion(distinct: bool) -> None:
    def flood(count: int) -> None:
        requests = OpenRequests()
        for number in range(count):
            put(requests, number if distinct else 0, request(number))
            if requests.count > 4096 or requests.full:
                oldest = requests.oldest()
                assert oldest is not None
                requests.close(*oldest)

    # From 5,000 on the table is full, so the larger flood gives requests up all the time: 8 and a little when linear.
    assert_growth(lambda: flood(5_000), lambda: flood(40_000), 16)


# ---- answers without request ----------------------------------------------------------------------------------------


def test_a_held_answer_fits_a_request_it_acknowledged() -> None:
    requests = OpenRequests()
    assert requests.hold_orphan(5, answer(1), 1000, 1) is None
    assert requests.find_orphan(6, 1000) is None
    assert requests.find_orphan(5, 1001) is None
    orphan = requests.find_orphan(5, 1000)
    assert orphan is not None
    assert orphan.transaction.number == 1
    assert requests.find_orphan(5, 990) is orphan
    requests.release_orphan(orphan)
    assert requests.orphans is None
    assert requests.find_orphan(5, 1000) is None
    requests.release_orphan(orphan)


def test_sequence_numbers_wrap() -> None:
    requests = OpenRequests()
    requests.hold_orphan(5, answer(1), 10, 1)
    requests.hold_orphan(6, answer(2), 0, 1)
    assert requests.find_orphan(5, 0xFFFFFFF0) is not None
    assert requests.find_orphan(6, 0xFFFFFFF0) is not None
    assert requests.find_orphan(6, 1) is None
    assert requests.find_orphan(5, 11) is None


def test_an_answer_without_acknowledgement_fits_nothing() -> None:
    requests = OpenRequests()
    requests.hold_orphan(5, answer(1), -1, 1)
    assert requests.find_orphan(5, 0) is None


def test_the_first_of_several_held_answers_is_taken() -> None:
    requests = OpenRequests()
    for number, key in ((1, 4), (2, 5), (3, 5)):
        requests.hold_orphan(key, answer(number), 1000, number)
    for expected in (2, 3):
        orphan = requests.find_orphan(5, 1000)
        assert orphan is not None
        assert orphan.transaction.number == expected
        requests.release_orphan(orphan)
    assert requests.orphans is not None
    assert [one.transaction.number for one in requests.orphans] == [1]


def test_held_answers_are_bounded() -> None:
    requests = OpenRequests()
    gone = [requests.hold_orphan(number, answer(number), 0, 1) for number in range(MAX_ORPHANS + 3)]
    assert gone[:MAX_ORPHANS] == [None] * MAX_ORPHANS
    assert [one.transaction.number for one in gone[MAX_ORPHANS:] if one is not None] == [0, 1, 2]
    assert requests.orphans is not None
    assert len(requests.orphans) == MAX_ORPHANS


@pytest.mark.parametrize(
    ("time_ns", "packet", "gone"),
    [
        (ORPHAN_HOLD_NS, ORPHAN_HOLD_FRAMES, []),
        (ORPHAN_HOLD_NS + 1, 0, [1]),
        (0, ORPHAN_HOLD_FRAMES + 1, [1]),
        (ORPHAN_HOLD_NS + 6, 0, [1, 2]),
        (0, ORPHAN_HOLD_FRAMES + 3, [1, 2]),
    ],
)
def test_held_answers_are_given_up_after_a_second_or_fifty_packets(time_ns: int, packet: int, gone: list[int]) -> None:
    requests = OpenRequests()
    requests.hold_orphan(1, answer(1, 0), 0, 0)
    requests.hold_orphan(2, answer(2, 5), 0, 2)
    assert [one.transaction.number for one in requests.expired_orphans(time_ns, packet)] == gone
    assert (requests.orphans is None) is (len(gone) == 2)
    assert OpenRequests().expired_orphans(time_ns, packet) == []


@pytest.mark.parametrize(
    ("hold", "time_ns", "packet", "gone"),
    [
        (10, 10 * ORPHAN_HOLD_NS, 10 * ORPHAN_HOLD_FRAMES, False),
        (10, 10 * ORPHAN_HOLD_NS + 1, 0, True),
        (10, 0, 10 * ORPHAN_HOLD_FRAMES + 1, True),
        (1, ORPHAN_HOLD_NS + 1, 0, True),
    ],
)
def test_held_answers_wait_longer_for_an_unfinished_request(hold: int, time_ns: int, packet: int, gone: bool) -> None:
    requests = OpenRequests()
    requests.hold_orphan(1, answer(1, 0), 0, 0)
    assert bool(requests.expired_orphans(time_ns, packet, hold == 10)) is gone


@pytest.mark.parametrize("zero", [1000, 2**32 - 5, 2**32 - 9, 2**32 - 10])
def test_a_request_passes_held_answers_to_earlier_ones(zero: int) -> None:
    """Those that acknowledge less than its end; what an answer without acknowledgement belongs to is not known."""
    requests = OpenRequests()
    assert requests.passed_orphans(0) == []
    for number, octets in enumerate((0, 9, 10, 20), 1):
        requests.hold_orphan(5, answer(number), (zero + octets) & 0xFFFFFFFF, 1)
    requests.hold_orphan(5, answer(5), -1, 1)
    end = (zero + 10) & 0xFFFFFFFF
    assert [one.transaction.number for one in requests.passed_orphans(end)] == [1, 2]
    assert [one.number for one in requests.waiting()] == [3, 4, 5]
    assert requests.passed_orphans(end) == []
    assert [one.number for one in requests.waiting()] == [3, 4, 5]


def test_when_all_held_answers_are_passed_none_is_held() -> None:
    requests = OpenRequests()
    requests.hold_orphan(5, answer(1), 10, 1)
    assert len(requests.passed_orphans(11)) == 1
    assert requests.orphans is None


@pytest.mark.parametrize(
    ("frame", "key", "ack", "passed"),
    [
        (11, 5, 100, False),  # for the request itself
        (11, 6, 100, True),
        (11, 5, 99, True),  # sent before the request arrived
        (11, 5, -1, True),
        (10, 6, 100, False),  # not after the request before
        (9, 6, 99, False),
    ],
)
@pytest.mark.parametrize("zero", [0, 2**32 - 100])
def test_an_answer_since_the_request_before_that_is_not_for_this_one(
    zero: int, frame: int, key: int, ack: int, passed: bool
) -> None:
    requests = OpenRequests()
    requests.asked_frame = 10
    end = (zero + 100) & 0xFFFFFFFF
    assert not requests.was_passed(5, end)
    told = answer(1)
    told.response_frame = frame
    requests.hold_orphan(key, told, (zero + ack) & 0xFFFFFFFF if ack >= 0 else -1, 1)
    assert requests.was_passed(5, end) is passed


# ---- rules of one request -------------------------------------------------------------------------------------------


def test_references_of_different_kinds_do_not_meet() -> None:
    keys = [key_of(kind, ref) for kind in (JOB, USERDATA, PLUS, SCD) for ref in (0, 1, 0x0102, 0xFFFF)]
    assert len(set(keys)) == 16
    for ref in (0, 0x8000, 0xFFFF):
        assert key_of(JOB, ref) == key_of(ACK, ref) == key_of(ACK_DATA, ref) == ref
    assert key_of(SCD, 0x1FFFFFF) != key_of(SCD, 0x0FFFFFF)


@pytest.mark.parametrize("zero", [1000, 2**32 - 100, 2**32 - 500, 2**32 - 501, 2**31 - 5])
@pytest.mark.parametrize(
    ("end", "ack", "excluded"),
    [
        (101, 501, False),
        (100, 501, True),  # the request acknowledges the answer
        (99, 501, True),
        (101, 500, True),  # the answer acknowledges nothing of the request
        (101, 499, True),
        (101, 501 - FAR_AHEAD, True),
        (101, 500 - FAR_AHEAD, False),  # too far to prove anything
        (101, None, False),
    ],
)
def test_what_places_in_the_stream_exclude(zero: int, end: int, ack: int | None, excluded: bool) -> None:
    """A request that acknowledges up to 100, and begins at 500."""

    def at(octets: int) -> int:
        return (zero + octets) & 0xFFFFFFFF

    one = request(1, 0, at(100))
    one._request_seq = at(500)
    told = at(ack) if ack is not None else -1
    assert excludes(one, at(end), told) is excluded
    assert acknowledged(one, at(end)) is (end <= 100)
    one._request_ack = -1
    assert not excludes(one, at(end), told)
    assert not acknowledged(one, at(end))


@pytest.mark.parametrize(
    ("after_ns", "ack", "nothing"), [(BESIDE_NS + 1, 70, True), (BESIDE_NS, 70, False), (BESIDE_NS + 1, 71, False)]
)
def test_a_client_that_got_nothing_gave_its_request_up(after_ns: int, ack: int, nothing: bool) -> None:
    assert no_answer(request(2, 1000 + after_ns, ack), request(1, 1000, 70)) is nothing


# ---- a client with one reference ------------------------------------------------------------------------------------


@pytest.mark.parametrize("opens", [False, True])
def test_the_first_repetition_is_doubtful_if_requests_may_be_open(opens: bool) -> None:
    requests = OpenRequests()
    requests.repeat(opens, False, 0, 0)
    assert (requests.repeats, requests.doubtful) == (1, opens)
    requests.repeat(not opens, False, 0, 0)  # what opened then is known already
    assert (requests.repeats, requests.doubtful) == (2, opens)


@pytest.mark.parametrize(
    ("count", "answered", "since", "beside", "gap", "doubtful"),
    [
        (0, True, SHORT_REST_NS + 1, True, 99, False),  # it was idle
        (0, True, SHORT_REST_NS, True, 9, True),
        (0, True, 0, False, 9, False),  # one exchange without a gap
        (0, True, 0, False, 10, True),
        (0, True, 0, True, 9, True),
        (1, True, SHORT_REST_NS + 1, False, 9, True),  # one is open
        (0, False, SHORT_REST_NS + 1, False, 9, True),  # never answered
    ],
)
def test_when_pairs_are_doubtful_no_longer(
    count: int, answered: bool, since: int, beside: bool, gap: int, doubtful: bool
) -> None:
    requests = OpenRequests()
    requests.repeat(True, False, 0, 0)
    requests.count, requests.beside, requests.asked_frame = count, beside, 10
    requests.repeat(False, answered, since, gap)
    assert requests.doubtful is doubtful


# ---- how many are open ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("closed", [(), (1,), (-1,), (-2,), (-1, -2), (0, 3, -1)])
@pytest.mark.parametrize("many", [1, 2, 3, 4, 12, 25])
def test_whether_as_many_as_asked_for_are_open(many: int, closed: tuple[int, ...]) -> None:
    """Whichever are closed already, by time or by packet; how many more there are is not counted."""
    requests = OpenRequests()
    made = [request(number, number * 10) for number in range(1, many + 1)]
    for one in made:
        put(requests, int(one.number), one)
    for place in closed:
        if -len(made) <= place < len(made):
            requests.close(int(made[place].number), made.pop(place))
    for since in range(many + 2):
        recent = len([one for one in made if one.number > since])
        for enough in range(many + 3):
            by_time = requests.open_since(since * 10 + 1, 0, -1, enough)
            by_packet = requests.open_since(0, since, -1, enough)
            assert (by_time >= enough) is (by_packet >= enough) is (recent >= enough), (since, enough)
            assert max(by_time, by_packet) <= enough
        assert requests.open_since(since * 10 + 1, 0, -1, 99) == requests.open_since(0, since, -1, 99) == recent


@pytest.mark.parametrize("looked", [False, True])
def test_of_requests_with_one_key_each_is_counted(looked: bool) -> None:
    requests = OpenRequests()
    for number, key in enumerate((4, 5, 5, 5), 1):
        put(requests, key, request(number, number * 10))
    if looked:
        assert len(requests.table) == 2
    assert [requests.open_since(time_ns, 0, -1, 99) for time_ns in (0, 11, 21, 31, 41)] == [4, 3, 2, 1, 0]


def test_the_latest_of_all_that_are_open() -> None:
    requests = OpenRequests()
    assert requests.asked_last() is None
    made = [request(number) for number in range(1, 5)]
    for one in made:
        put(requests, int(one.number), one)
    for one in reversed(made):
        assert requests.asked_last() is one
        requests.close(int(one.number), one)
    assert requests.asked_last() is None


def test_the_oldest_is_found_however_often_it_left() -> None:
    requests = OpenRequests()
    for number in range(3000):
        put(requests, number % 4096, request(number + 1))
        if number >= 5:
            oldest = requests.oldest()
            assert oldest is not None
            assert (oldest[0], oldest[1].number) == (number - 5, number - 4)
            requests.close(*oldest)


def test_nothing_is_open_at_first() -> None:
    requests = OpenRequests()
    numbers = (requests.count, requests.repeats, requests.answered, requests.asked_frame, requests.orphan_frame)
    assert numbers == (0, 0, 0, 0, 0)
    assert (requests.latest, requests.latest_key, requests.asked_seq, requests.held) == (None, -1, 0, 0)
    assert (requests.beside, requests.doubtful, requests.full) == (False, False, False)
    assert (requests.lost, requests.orphans, requests.undecided, requests.waiting()) == ([], None, None, [])
    assert requests.find(0) is None  # a reference of 0 is valid
    assert requests.rest_ns == SHORT_REST_NS
