"""Which connections were idle longest: found in rounds, a few connections at a time."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest

from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import (
    LEAVE_AT_ONCE,
    LOOK_AT_ONCE,
    MAX_ALSO,
    MAX_CONNECTIONS,
    MAX_FOUND,
    RESERVE,
    ConnectionTable,
    IdleSearch,
)


def key(number: int, tag: int = 0) -> bytes:
    ends = b"\x0a" + number.to_bytes(3, "big") + b"\x0a\0\0\2" + (50000).to_bytes(2, "big") + (102).to_bytes(2, "big")
    return ends + (tag.to_bytes(8, "big") if tag else b"")


def opened(times: list[int]) -> list[Side]:
    """Side 0 of connections with their latest packets at these times; the later in the list, the later it began."""
    table = ConnectionTable()
    found = [table.open(key(number), 0, number + 1, 0) for number in range(len(times))]
    for side, time_ns in zip(found, times, strict=True):
        side.tcp.last_ns = time_ns
    return found


def both(sides: list[Side]) -> list[Side]:
    peers = [side.peer for side in sides]
    return [end for pair in zip(sides, peers, strict=True) for end in pair if end is not None]


def searched(sides: list[Side]) -> IdleSearch:
    """After a whole round."""
    search = IdleSearch()
    search.begin(both(sides))
    search.finish()
    return search


def all_taken(search: IdleSearch) -> list[Side]:
    taken: list[Side] = []
    while (side := search.take()) is not None:
        taken.append(side)
    return taken


def idlest(sides: list[Side]) -> list[Side]:
    """The longest idle first; of those with the same time, the one that began first."""
    return sorted(sides, key=lambda side: (int(side.tcp.last_ns), int(side.tcp.first_frame)))


@pytest.mark.parametrize("times", [1, 3, 1000])
@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 6, 7, 8, 9, 12, 33])
def test_the_longest_idle_comes_first(count: int, times: int) -> None:
    for seed in range(12):
        chance = Random(seed)
        sides = opened([chance.randrange(times) for _ in range(count)])
        expected = idlest(sides)
        chance.shuffle(sides)
        assert all_taken(searched(sides)) == expected


@pytest.mark.parametrize("times", [4, 1_000_000])
@pytest.mark.parametrize("more", [-1, 0, 1, 300])
def test_the_longest_idle_are_kept_however_many_there_are(more: int, times: int) -> None:
    chance = Random(more + times)
    sides = opened([chance.randrange(times) for _ in range(MAX_FOUND + more)])
    expected = idlest(sides)[:MAX_FOUND]
    chance.shuffle(sides)
    assert all_taken(searched(sides)) == expected


@pytest.mark.parametrize("rising", [False, True])
def test_the_order_of_opening_does_not_matter(rising: bool) -> None:
    count = MAX_FOUND + 200
    sides = opened([number if rising else count - number for number in range(count)])
    assert all_taken(searched(sides)) == idlest(sides)[:MAX_FOUND]


def test_a_round_takes_several_steps() -> None:
    sides = opened(list(range(LOOK_AT_ONCE + 10)))
    search = IdleSearch()
    search.begin(both(sides))
    looks: list[Any] = []
    for _ in range(3):
        assert search.take() is None or len(looks) >= 2  # nothing is known before the round is over
        search.step()
        looks.append(int(search.looks))
    assert looks == [LOOK_AT_ONCE, LOOK_AT_ONCE + 10, LOOK_AT_ONCE + 10]
    assert search.take() is sides[1]  # the first was taken already


def test_without_connections_nothing_is_found() -> None:
    search = IdleSearch()
    search.step()
    search.finish()
    assert (search.take(), search.looks, search.running_out) == (None, 0, True)


def test_the_next_round_begins_while_enough_are_left_to_last_until_its_end() -> None:
    sides = opened(list(range(MAX_FOUND)))
    search = IdleSearch()
    search.begin(both(sides))
    assert not search.running_out  # a round is under way
    search.finish()
    taken = 0
    while not search.running_out:
        assert search.take() is sides[taken]
        taken += 1
    left = MAX_FOUND - taken
    assert (MAX_CONNECTIONS + RESERVE) // LOOK_AT_ONCE <= left < MAX_FOUND // 2
    search.begin(both(sides))
    search.step()
    assert search.take() is sides[taken]  # those of the last round can be had until the next one is over


def test_a_new_round_begins_from_nothing() -> None:
    sides = opened([5, 1, 3])
    search = searched(sides)
    search.begin(both(sides[:1]))
    search.finish()
    assert all_taken(search) == sides[:1]


@pytest.mark.parametrize("before", [True, False])
def test_closed_connections_are_passed_over(before: bool) -> None:
    """However many of them there are, whether they were closed before they were examined or after."""
    table = ConnectionTable()
    sides = [table.open(key(number), 0, number + 1, number) for number in range(40)]
    ends = both(sides)
    search = IdleSearch()
    search.begin(ends)
    if not before:
        search.finish()
    for side in sides[:39]:
        table.remove(side)
    search.finish()
    assert all_taken(search) == sides[39:]
    assert search.looks == 40


def test_connections_that_had_packets_since_are_passed_over() -> None:
    sides = opened(list(range(20)))
    search = searched(sides)
    for side in sides[:10]:
        side.tcp.last_ns += 100
    assert all_taken(search) == sides[10:]


@pytest.mark.parametrize(
    ("since", "best"),
    [
        ([500] * 15 + [400, 100, 100], 15),  # only so many are tried
        ([500] * 3 + [300, 300] + [500] * 13, 3),
        ([300, 200, 300] + [500] * 15, 1),
        ([100] + [500] * 17, 0),
    ],
)
def test_where_all_had_packets_the_longest_idle_of_some_is_taken(since: list[int], best: int) -> None:
    sides = opened(list(range(len(since))))
    search = searched(sides)
    for side, time_ns in zip(sides, since, strict=True):
        side.tcp.last_ns = time_ns
    assert search.take() is sides[best]
    assert search.take() is sides[16]


# ---- where the table is full ----------------------------------------------------------------------------------------


def filled(count: int) -> ConnectionTable:
    table = ConnectionTable()
    for number in range(count):
        assert number >= MAX_CONNECTIONS or table.overflow() == []
        table.open(key(number), 0, number + 1, number)
    return table


def leave(table: ConnectionTable) -> int:
    """Evict as many as must be evicted now; return their number."""
    gone = table.overflow()
    for side in gone:
        table.remove(side)
    return len(gone)


def test_keys_in_other_vlans_do_not_count_as_connections() -> None:
    table = filled(MAX_CONNECTIONS)
    last = table.all_open()[-1]
    for tag in range(1, MAX_ALSO + 1):
        table.add(last, key(MAX_CONNECTIONS - 1, tag))
    assert table.overflow() == []
    for tag in (1, 2):  # two new connections with such keys
        table.open(key(MAX_CONNECTIONS - 1, tag), tag, 1, 1 << 40)
    assert leave(table) == 2
    assert leave(table) == 0
    table.remove(last)
    table.open(key(1 << 20), 0, 1, 1 << 40)
    assert leave(table) == 0
    table.open(key(1 << 21), 0, 1, 1 << 40)
    assert (leave(table), leave(table), table.evicted) == (1, 0, 3)
    assert len(table.all_open()) == MAX_CONNECTIONS


def test_far_too_many_leave_a_few_at_a_time() -> None:
    table = ConnectionTable()
    for number in range(MAX_CONNECTIONS + RESERVE):
        table.open(key(number), 0, number + 1, number)
    assert leave(table) == 0  # a round begins
    table.open(key(1 << 20), 0, 1, 1 << 40)  # now there is no time to wait for its end
    assert [leave(table) for _ in range(3)] == [LEAVE_AT_ONCE] * 3
    assert table.evicted == 3 * LEAVE_AT_ONCE
    assert [side.key for side in table.all_open()[:2]] == [key(3 * LEAVE_AT_ONCE), key(3 * LEAVE_AT_ONCE + 1)]
