"""Whose a connection is: every run says the same, and all have something to do."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from dissect.jobs import share as module
from dissect.jobs.share import Share, by_pair, by_service
from dissect.tcp.stream import Endpoint, TcpConnection
from dissect.transactions.connection import Connection


def connection(number: int, client: int, server: int, port: int = 102) -> Connection:
    ends = [Endpoint(bytes([10, 0, 0, host]), at) for host, at in ((client, 50_000 + client), (server, port))]
    return Connection(number, TcpConnection(ends[0], ends[1], -1, 100 + number, 0))


@given(st.lists(st.tuples(st.integers(1, 9), st.integers(10, 14)), max_size=40), st.integers(1, 5))
def test_each_connection_is_read_by_exactly_one(pairs: list[tuple[int, int]], count: int) -> None:
    shares = [Share(index, count, by_pair) for index in range(count)]
    for number, (client, server) in enumerate(pairs, 1):
        one = connection(number, client, server)
        assert sum([share(one) for share in shares]) == 1
    assert {tuple(share.take()) for share in shares} == {tuple(range(101, 101 + len(pairs)))}


def test_few_connections_are_divided_evenly() -> None:
    share = Share(1, 2, by_pair)
    assert [share(connection(number, number, 20)) for number in range(1, 7)] == [False, True] * 3


def test_what_asks_one_service_stays_together() -> None:
    share = Share(0, 3, by_service)
    assert [share(connection(number, client, 20)) for number, client in ((1, 1), (2, 2), (3, 3))] == [True] * 3
    assert not share(connection(4, 1, 21))
    assert by_service(connection(1, 1, 20)) == by_service(connection(2, 20, 20))
    lower = connection(1, 1, 20, 2102)
    assert by_service(lower) == bytes([10, 0, 0, 20]) + (2102).to_bytes(2, "big")


def test_a_connection_in_the_place_of_another_is_remembered_once() -> None:
    share = Share(0, 1, by_pair)
    first, second = connection(1, 1, 20), connection(2, 1, 20)
    assert share(first)
    share.note(first)
    share.note(second)
    assert share.take() == [101, 102]
    assert share.take() == []


def test_what_a_selection_rules_out_is_counted_by_whoever_would_read_it() -> None:
    shares = [Share(index, 2, by_pair, lambda one: one.number != 1) for index in (0, 1)]
    for number in (1, 2):
        one = connection(number, number, 20)
        assert [share(one) for share in shares] == [False, number == 2]
    assert [share.unwanted for share in shares] == [1, 0]


def test_memory_of_turns_is_bounded_and_still_the_same_for_all() -> None:
    shares = [Share(index, 2, lambda one: b"%d" % one.number) for index in (0, 1)]
    for share in shares:
        share._turns.update({b"x%d" % at: 0 for at in range(module.MAX_KEYS)})
    taken = [[share(connection(number, 1, 20)) for share in shares] for number in range(1, 60)]
    assert all([sum(found) == 1 for found in taken])
    assert {tuple(found) for found in taken} == {(True, False), (False, True)}
    assert len(shares[0]._turns) == module.MAX_KEYS
