from __future__ import annotations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.s7.parameters import Parameters
from dissect.tcp.connection import TcpConnection
from dissect.tcp.stream import Endpoint
from dissect.transactions.connection import Connection
from dissect.transactions.open_requests import (
    MAX_ORPHANS,
    MAX_REPEATS,
    ORPHAN_HOLD_FRAMES,
    ORPHAN_HOLD_NS,
    REPEAT_NS,
    OpenRequests,
)
from dissect.transactions.transaction import Transaction
from tests.growth import assert_growth

CONNECTION = Connection(
    1, TcpConnection(Endpoint(b"\x0a\x00\x00\x01", 50000), Endpoint(b"\x0a\x00\x00\x02", 102), 0, 1, 0)
)


def request(number: int, octets: bytes = b"", time_ns: int = 0) -> Transaction:
    """A request; ``octets`` are what tells two of them apart."""
    transaction = Transaction(number, CONNECTION, 0, 1, 0, Parameters(b"\x04", 1))
    transaction.request_buf = octets
    transaction.request_size = len(octets)
    transaction.request_ns = time_ns
    transaction.request_frame = number
    return transaction


def answer(number: int, time_ns: int = 0) -> Transaction:
    transaction = Transaction(number, CONNECTION, 0, 3, 0, Parameters(b"\x04", 3))
    transaction.response_ns = time_ns
    return transaction


def put(requests: OpenRequests, key: int, transaction: Transaction) -> list[int]:
    """Open a request; return the numbers of those it replaces, the newest first."""
    waiting = requests.find(key)
    if waiting is None:
        requests.add(key, transaction)
        return []
    replaced = requests.add_again(key, transaction, waiting)
    return chain(replaced)


def chain(transaction: Transaction | None) -> list[int]:
    numbers = []
    while transaction is not None:
        numbers.append(transaction.number)
        transaction = transaction.earlier
    return numbers


def take(requests: OpenRequests, key: int) -> int:
    found = requests.find(key)
    assert found is not None
    return requests.take(key, found).number


# ---- open requests --------------------------------------------------------------------------------------------------


def test_an_answered_request_leaves_the_table() -> None:
    requests = OpenRequests()
    assert put(requests, 5, request(1)) == []
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


def test_another_request_of_the_same_key_replaces_the_first() -> None:
    requests = OpenRequests()
    put(requests, 5, request(1, b"a"))
    put(requests, 6, request(2, b"b"))
    assert put(requests, 5, request(3, b"c")) == [1]
    assert requests.count == 2
    assert [one.number for one in requests.drain()] == [2, 3]


def test_identical_requests_wait_and_are_answered_in_turn() -> None:
    requests = OpenRequests()
    for number in range(1, MAX_REPEATS + 1):
        assert put(requests, 5, request(number, b"same", number)) == []
    assert requests.count == MAX_REPEATS
    assert [take(requests, 5) for _ in range(MAX_REPEATS)] == [*range(1, MAX_REPEATS + 1)]
    assert (requests.count, requests.table) == (0, {})


def test_so_many_identical_requests_may_wait() -> None:
    requests = OpenRequests()
    for number in range(1, MAX_REPEATS + 1):
        put(requests, 5, request(number, b"same"))
    assert put(requests, 5, request(99, b"same")) == [*range(MAX_REPEATS, 0, -1)]
    assert requests.count == 1
    assert take(requests, 5) == 99


def test_a_request_that_came_again_late_replaces_the_first() -> None:
    requests = OpenRequests()
    put(requests, 5, request(1, b"same", 0))
    assert put(requests, 5, request(2, b"same", REPEAT_NS)) == []
    assert put(requests, 5, request(3, b"same", 2 * REPEAT_NS + 1)) == [2, 1]
    assert requests.count == 1


@pytest.mark.parametrize(
    ("frame", "hole_frame", "lost"),
    [
        (9, 9, [2, 1]),  # the answer came after all of them: it is the last one's, the others' are in the hole
        (9, 1, [1]),  # the second was asked after the hole
        (9, 0, []),  # there was no hole
        (2, 9, [1]),  # the third was asked after the answer
        (1, 9, []),
    ],
)
def test_identical_requests_before_a_hole_are_given_up(frame: int, hole_frame: int, lost: list[int]) -> None:
    requests = OpenRequests()
    for number in (1, 2, 3):
        put(requests, 5, request(number, b"same"))
    assert chain(requests.lose(requests.table[5], frame, hole_frame)) == lost
    assert requests.count == 3 - len(lost)
    assert [take(requests, 5) for _ in range(requests.count)] == [*range(1 + len(lost), 4)]


def test_the_oldest_leaves_first() -> None:
    requests = OpenRequests()
    for number in range(1, 5):
        put(requests, number, request(number, bytes((number,))))
    put(requests, 1, request(5, b"other"))  # the first key is now the youngest
    gone = []
    while (oldest := requests.oldest()) is not None:
        gone.append(oldest.number)
    assert gone == [2, 3, 4, 5]
    assert requests.count == 0


def test_drain_gives_everything_in_the_order_of_asking() -> None:
    requests = OpenRequests()
    put(requests, 1, request(1, b"same"))
    put(requests, 2, request(2, b"x"))
    put(requests, 1, request(3, b"same"))
    put(requests, 3, request(4, b"y"))
    put(requests, 1, request(5, b"same"))
    drained = requests.drain()
    assert [one.number for one in drained] == [1, 2, 3, 4, 5]
    assert [one.earlier for one in drained] == [None] * 5
    assert (requests.count, requests.table) == (0, {})
    assert requests.drain() == []


def test_requests_open_since() -> None:
    requests = OpenRequests()
    for number in range(1, 6):
        put(requests, number, request(number, b"same", number * 10))
    put(requests, 5, request(6, b"same", 60))
    assert requests.count == 6
    assert requests.open_since(10, 0, 99) == 6
    assert requests.open_since(31, 0, 99) == 3
    assert requests.open_since(51, 0, 99) == 1
    assert requests.open_since(61, 0, 99) == 0
    assert requests.open_since(10, 0, 2) == 2
    assert requests.open_since(10, 3, 99) == 3
    assert requests.open_since(10, 6, 99) == 0
    assert OpenRequests().open_since(0, 0, 99) == 0


@pytest.mark.parametrize("lost", [1, 2, 5, 12])
def test_requests_that_are_long_open_do_not_count(lost: int) -> None:
    """A request whose answer was lost stays open for ever, and each later one asks how many are open beside it."""
    requests = OpenRequests()
    for number in range(1, lost + 1):
        put(requests, number, request(number, b"lost", number))
    allowed = 2
    for number in range(100, 106):
        put(requests, number, request(number, b"x", number * 1000))
        recent = min(number - 99, 3)
        assert requests.open_since(500, 0, lost + 99) == recent
        assert requests.open_since(500, 0, allowed + 1) <= allowed or recent > allowed
        assert requests.open_since(500, lost, allowed + 1) <= allowed or recent > allowed
        assert requests.open_since(0, 0, 1) >= 1  # all are recent
        if number >= 102:
            assert requests.open_since(500, 0, allowed + 1) == allowed + 1
            assert take(requests, number - 2) == number - 2
            assert requests.open_since(500, 0, allowed + 1) == allowed


class Model:
    """What the table must do, written plainly: a list of (key, number, octets, time) in the order of asking."""

    def __init__(self) -> None:
        self.open: list[tuple[int, int, bytes, int]] = []

    def put(self, key: int, number: int, octets: bytes, time_ns: int) -> list[int]:
        same = [one for one in self.open if one[0] == key]
        gone: list[tuple[int, int, bytes, int]] = []
        if same and (same[-1][2] != octets or time_ns - same[-1][3] > REPEAT_NS or len(same) >= MAX_REPEATS):
            gone = same
        self.open = [one for one in self.open if one not in gone]
        self.open.append((key, number, octets, time_ns))
        return [one[1] for one in reversed(gone)]

    def take(self, key: int) -> int:
        found = next(one for one in self.open if one[0] == key)
        self.open.remove(found)
        return found[1]


@given(
    st.lists(
        st.tuples(st.booleans(), st.integers(0, 3), st.integers(0, 1), st.integers(0, REPEAT_NS // 2)), max_size=80
    )
)
def test_any_course_of_asking_and_answering(steps: list[tuple[bool, int, int, int]]) -> None:
    requests, model, now = OpenRequests(), Model(), 0
    for number, (asks, key, content, after) in enumerate(steps, 1):
        now += after
        octets = bytes((content,))
        if asks:
            assert put(requests, key, request(number, octets, now)) == model.put(key, number, octets, now)
        elif key in requests.table:
            assert take(requests, key) == model.take(key)
        assert requests.count == len(model.open)
        assert set(requests.table) == {one[0] for one in model.open}
        assert all(len(chain(one)) <= MAX_REPEATS for one in requests.table.values())
        for since in (0, now // 2, now):
            true = sum(1 for one in model.open if one[3] >= since)
            assert requests.open_since(since, -1, 999) <= true
            assert requests.open_since(since, -1, len(model.open)) < len(model.open) or true == len(model.open)
    assert [one.number for one in requests.drain()] == [one[1] for one in model.open]


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["ask", "ask", "after", "take", "behind", "oldest", "any"]),
            st.integers(0, 1),
            st.integers(1, 9),
        ),
        max_size=60,
    )
)
@example([("ask", 0, 1), ("ask", 0, 1), ("after", 1, 1), ("behind", 0, 1)])  # two wait behind it
@example([("ask", 0, 1), ("after", 0, 1), ("after", 0, 1), ("oldest", 0, 1)])  # one behind the other
def test_no_request_is_forgotten(steps: list[tuple[str, int, int]]) -> None:
    """Identical ones that wait behind a request that was asked after what they wait for."""
    requests = OpenRequests()
    asked: list[int] = []
    gone: list[int] = []
    for number, (step, content, ago) in enumerate(steps, 1):
        waiting = requests.table.get(5)
        one = request(number, bytes((content,)), number)
        one.request_ack = number
        closed: Transaction | None = None
        if step in {"ask", "after"}:
            asked.append(number)
            if waiting is None:
                requests.add(5, one)
            elif step == "ask" or not requests.supersede(5, one, waiting):
                closed = requests.add_again(5, one, waiting)
                gone += [] if closed is None else [behind.number for behind in requests.drop_superseded(closed)]
        elif step == "oldest":
            closed = requests.oldest()
            assert closed is None or closed.number == min(set(asked) - set(gone))
        elif waiting is not None and step == "any":
            row = requests.row(waiting)
            assert [found.number for found in row] == sorted(set(asked) - set(gone))
            assert requests.first(waiting) is row[0]
            closed = row[ago % len(row)]
            requests.close(5, closed)
            assert chain(closed) == [closed.number]
        elif waiting is not None:
            gone += [behind.number for behind in requests.drop_superseded(waiting)] if step == "take" else []
            closed = (
                requests.take(5, waiting)
                if step == "take"
                else requests.take_superseded(waiting, max(0, number - ago), -1)
            )
            # What is answered in turn is not linked to what goes on waiting.
            assert closed is None or chain(closed) == [closed.number]
        gone += chain(closed)
        assert requests.count == len(asked) - len(gone)
    assert sorted(gone + [one.number for one in requests.drain()]) == asked


@pytest.mark.parametrize("distinct", [True, False])
def test_a_flood_takes_work_in_proportion(distinct: bool) -> None:
    def flood(count: int) -> None:
        requests = OpenRequests()
        for number in range(count):
            put(
                requests, number if distinct else 0, request(number, number.to_bytes(4, "big") if distinct else b"same")
            )
            if requests.count > 4096:
                requests.oldest()

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
    assert [one.number for one in gone[MAX_ORPHANS:] if one is not None] == [0, 1, 2]
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
    assert [one.number for one in requests.expired_orphans(time_ns, packet)] == gone
    assert (requests.orphans is None) is (len(gone) == 2)
    assert OpenRequests().expired_orphans(time_ns, packet) == []
