"""The queue between relay and dissection: in order, never waiting, bounded, honest about what it left out."""

from __future__ import annotations

from dissect.online.proxy.packets import endpoint_of
from dissect.online.proxy.tap import CLOSED, GONE, OPENED, REFUSED, RESET, SENT, Passed, Tap

ENDS = (endpoint_of(("127.0.0.1", 5000)), endpoint_of(("127.0.0.1", 102)))


def drained(tap: Tap) -> list[Passed]:
    told = []
    while (passed := tap.take(0)) is not None:
        told.append(passed)
    return told


def test_what_is_given_is_taken_in_order() -> None:
    tap = Tap()
    tap.opened(1, ENDS, 10)
    tap.sent(1, 0, b"ab", 11)
    tap.failed(REFUSED, 2, ENDS, 12)
    tap.closed(1, 0, 13)
    tap.reset(1, 1, 14)
    tap.forget(1, 15)
    assert tap.held > 2
    assert drained(tap) == [
        Passed(OPENED, 1, 10, ends=ENDS),
        Passed(SENT, 1, 11, 0, b"ab"),
        Passed(REFUSED, 2, 12, ends=ENDS),
        Passed(CLOSED, 1, 13, 0),
        Passed(RESET, 1, 14, 1),
        Passed(GONE, 1, 15),
    ]
    assert (tap.held, tap.lost, tap.lost_octets) == (0, 0, 0)


def test_a_full_queue_leaves_octets_out_and_says_how_many() -> None:
    tap = Tap(max_octets=10_000)
    tap.opened(1, ENDS, 0)
    for number in range(100):
        tap.sent(1, number % 2, bytes(1000), number)
    assert tap.held <= 10_000
    kept = drained(tap)
    assert [passed.kind for passed in kept] == [OPENED] + [SENT] * 6
    assert (tap.lost, tap.lost_octets) == (94, 94_000)
    tap.sent(1, 1, b"z", 200)
    tap.closed(1, 0, 201)
    tap.sent(1, 1, b"z", 202)
    assert drained(tap) == [
        Passed(SENT, 1, 200, 1, b"z", 47_000),
        Passed(CLOSED, 1, 201, 0, skipped=47_000),
        Passed(SENT, 1, 202, 1, b"z"),
    ]


def test_the_end_of_what_began_always_gets_through() -> None:
    tap = Tap(max_octets=0)
    tap.opened(1, ENDS, 0)  # the beginning has room of its own
    tap.sent(1, 0, b"ab", 1)
    tap.reset(1, 0, 2)
    tap.forget(1, 3)
    assert [(passed.kind, passed.skipped) for passed in drained(tap)] == [(OPENED, 0), (RESET, 2), (GONE, 0)]


def test_a_flood_of_connections_is_bounded() -> None:
    tap = Tap(max_octets=0)
    for link in range(50_000):
        tap.opened(link, ENDS, 0)
        tap.sent(link, 0, b"a", 0)
        tap.closed(link, 0, 0)
        tap.closed(link, 1, 0)
        tap.forget(link, 0)
    told = drained(tap)
    begun = [passed.link for passed in told if passed.kind == OPENED]
    assert 1000 < len(begun) < 25_000
    assert len(told) == 4 * len(begun)  # of those that did not begin nothing is told
    assert tap.lost == 2 * 50_000 - len(begun)


def test_when_nobody_takes_any_more_nothing_is_kept() -> None:
    tap = Tap()
    tap.opened(1, ENDS, 0)
    tap.shut()
    tap.sent(1, 0, bytes(1000), 1)
    tap.closed(1, 0, 1)
    assert [passed.kind for passed in drained(tap)] == [OPENED]
    assert (tap.held, tap.lost) == (0, 0)


def test_the_wait_for_what_happens_next_ends() -> None:
    assert Tap().take(0.01) is None
