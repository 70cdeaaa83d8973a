"""What connections keep, and that all of them together keep no more than they may."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import pytest

from dissect.engine.options import MEMORY
from dissect.engine.pipeline import LOOK_OCTETS, Options
from dissect.engine.transactions.memory_limit import LEAVE_AT_ONCE, LOOK_AT_ONCE, Room, held_octets
from dissect.engine.transactions.side import Side
from tests.engine.test_pipeline import answered, asked, ready
from tests.engine.transactions.test_multipart import answer, question
from tests.properties.books import Result, check_books
from tests.properties.messages import connect, dt
from tests.properties.packets import ACK, Flow, Packet, Segment, Talk, captured

MIB: Final = 1024 * 1024
#: Octets of one segment: what network cards put together out of many.
BIG: Final = 60_000


def flow(number: int) -> Flow:
    return Flow(f"10.9.{number >> 8}.{number & 255}")


def sides(result: Result) -> list[Side]:
    return result.pipeline.table.all_open()


def kept(packets: list[Packet]) -> int:
    """Return what the only connection of a capture keeps."""
    (side,) = sides(Result(packets, finish=False))
    peer = side.peer
    assert peer is not None
    assert held_octets(peer) == held_octets(side)
    return held_octets(side)


def test_a_connection_at_rest_keeps_its_latest_segments_only() -> None:
    talk = ready().send(0, asked(1)).send(1, answered(1))
    before = kept(talk.packets())
    talk.send(0, asked(2)).send(1, answered(2)).send(0, asked(3)).send(1, answered(3))
    assert before < 300
    assert kept(talk.packets()) <= before + 40


def test_what_is_kept_is_counted_to_the_octet() -> None:
    """A connection at rest keeps the latest segment of each side, and the one before it."""
    talk = ready().send(0, asked(1)).send(1, answered(1)).send(0, asked(2)).send(1, answered(2))
    assert kept(talk.packets()) == len(asked(1)) + len(answered(1)) + len(asked(2)) + len(answered(2))


@pytest.mark.parametrize(
    ("what", "holds"),
    [
        (lambda: ready().send(0, b"\x03\x00\xff\xf0" + bytes(9_000)), 9_000),
        (lambda: ready().send(0, dt(bytes(9_000), eot=False)), 9_000),
        (lambda: ready().skip(0, 10).send(0, bytes(9_000)), 9_000),
        (lambda: ready().send(0, asked(1)).send(0, asked(2)).send(0, asked(3)), 3 * len(asked(1))),
        (lambda: ready().send(1, answered(1)), len(answered(1))),
        (lambda: ready().send(0, dt(question(1))).send(1, dt(answer(1, bytes(9_000), 3, 213, 1))), 2 * 9_000),
    ],
    ids=["half a TPKT", "TSDU without end", "behind a hole", "open requests", "orphan", "answer in parts"],
)
def test_each_buffer_counts(what: Callable[[], Talk], holds: int) -> None:
    assert kept(what().packets()) >= kept(ready().packets()) + holds


def half_tpkts(count: int) -> Iterator[Packet]:
    """Many connections, each in the middle of a TPKT of the greatest size."""
    segments = []
    for number in range(count):
        one = flow(number)
        segments.append(Segment(one, 0, 1, 1, ACK, connect()))
        begin = b"\x03\x00\xff\xf0\x02\xf0\x80\x32" + bytes(BIG)
        segments.append(Segment(one, 0, 1 + len(connect()), 1, ACK, begin))
    yield from captured(segments, step_ns=1000)


@pytest.mark.parametrize("memory", [8 * MIB, 40 * MIB])
def test_all_together_keep_no_more_than_they_may(memory: int) -> None:
    result = Result([], Options(strict=True, memory=memory), finish=False)
    most = evicted = 0
    for number, packet in enumerate(half_tpkts(2000)):
        result.feed(packet)
        if number % 50 == 0 or result.pipeline.table.evicted != evicted:
            evicted = int(result.pipeline.table.evicted)
            most = max(most, sum([held_octets(side) for side in sides(result)]))
    # The latest segment of each is kept to compare with, too, so that a half TPKT counts twice.
    # While 2000 connections are looked at, more come.
    assert memory < most <= memory + 2 * LOOK_OCTETS + BIG * 2 * (2 + 2000 // LOOK_AT_ONCE)
    assert evicted > 200
    result.pipeline.finish()
    check_books(result.pipeline, result.record)
    assert result.counts["stream.evicted"] == evicted
    assert all([detail.startswith("it held 1200") for detail in result.details("stream.evicted")])


def test_what_is_usual_stays() -> None:
    result = Result(half_tpkts(200))
    assert result.pipeline.table.evicted == 0
    assert 200 * BIG * 2 < MEMORY


def test_the_fullest_have_to_leave() -> None:
    segments = []
    for number in range(30):
        one = flow(number)
        segments.append(Segment(one, 0, 1, 1, ACK, connect()))
        begin = b"\x03\x00\xff\xf0\x02\xf0\x80\x32" + bytes(1000 * number)
        segments.append(Segment(one, 0, 1 + len(connect()), 1, ACK, begin))
    result = Result(captured(segments), finish=False)
    each = {side.connection.number: held_octets(side) for side in sides(result)}
    total = sum(each.values())
    assert leaving(result, total) == []
    gone = leaving(result, total - 1)
    assert all([held == each[side.connection.number] for held, side in gone])
    rest = sorted(each.values())[: -len(gone)]
    assert 2 * min([held for held, _ in gone]) >= max(rest)  # the fullest, as far as powers of two tell
    left = total - sum([held for held, _ in gone])
    assert left <= (total - 1) // 2 < left + gone[-1][0]
    assert leaving(Result([]), 0) == []


def leaving(result: Result, most: int) -> list[tuple[int, Side]]:
    """Return those that have to leave, found step by step; no step does more than its part."""
    room = Room(most)
    room.begin(sides(result))
    gone = []
    while room.busy:
        looks = room.looks
        now = room.step()
        assert room.looks - looks <= LOOK_AT_ONCE
        assert len(now) <= LEAVE_AT_ONCE
        gone += now
    return gone


def test_making_room_is_spread_over_the_packets() -> None:
    """However many connections are open, one packet costs a bounded number of looks and of connections given up."""
    result = Result([], Options(strict=True, memory=8 * MIB), finish=False)
    gone: list[int] = []
    for packet in half_tpkts(2000):
        before = int(result.pipeline.table.evicted)
        result.feed(packet)
        gone.append(int(result.pipeline.table.evicted) - before)
    assert 0 < max(gone) <= LEAVE_AT_ONCE
    assert sum(gone) > 200
