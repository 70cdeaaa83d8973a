"""What connections keep, and that all of them together keep no more than they may."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random
from typing import Final

import pytest

from dissect.engine.options import MEMORY
from dissect.engine.pipeline import LOOK_OCTETS, Options
from dissect.engine.transactions.memory_limit import LEAVE_AT_ONCE, LOOK_AT_ONCE, Room, held_octets, holds_something
from dissect.engine.transactions.side import Side
from tests.engine.findings import events
from tests.engine.test_pipeline import answered, asked, ready
from tests.engine.transactions.talk import CLIENT, SERVER, dbw, granted, setup, tpkt, words
from tests.engine.transactions.talk import Talk as Conversation
from tests.engine.transactions.talk import read as asks
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


@pytest.mark.parametrize("seed", range(4))
def test_the_fullest_have_to_leave_wherever_they_are(seed: int) -> None:
    """Their order among the connections says nothing."""
    segments = []
    sizes = [100 << number for number in range(10)]
    Random(seed).shuffle(sizes)
    for number, size in enumerate(sizes):
        one = flow(number)
        segments.append(Segment(one, 0, 1, 1, ACK, connect()))
        for at in range(0, size, BIG):
            begin = b"\x03\x00\xff\xf0\x02\xf0\x80\x32" + bytes(min(BIG, size))
            segments.append(Segment(one, 0, 1 + len(connect()) + at, 1, ACK, begin))
    result = Result(captured(segments), finish=False)
    each = sorted((held_octets(side) for side in sides(result)), reverse=True)
    gone = [held for held, _ in leaving(result, sum(each) - 1)]
    assert gone == each[: len(gone)]
    assert sum(each[len(gone) :]) <= (sum(each) - 1) // 2 < sum(each[len(gone) - 1 :])


def test_one_that_ended_meanwhile_need_not_leave() -> None:
    result = Result(half_tpkts(4), finish=False)
    there = sides(result)
    room = Room(1)
    room.begin(there)
    assert room.step() == []  # all were examined
    assert (room.looks, room.busy) == (4, True)
    result.pipeline.table.remove(there[3])
    room.begin([])  # the round goes on
    gone = room.step()
    assert {id(side) for _, side in gone} == {id(side) for side in there[:3]}
    assert all(held > BIG for held, _ in gone)


def test_the_sum_is_that_of_the_latest_round() -> None:
    result = Result(half_tpkts(3), finish=False)
    room = Room(10 * MIB)
    for _ in range(2):
        room.begin(sides(result))
        while room.busy:
            room.step()
        assert room.total == sum(held_octets(side) for side in sides(result)) > 6 * BIG
    assert room.looks == 6


def test_connections_that_ended_before_they_were_examined_do_not_count() -> None:
    result = Result(half_tpkts(3), finish=False)
    there = sides(result)
    for side in there:
        result.pipeline.table.remove(side)
    room = Room(0)
    room.begin(there)
    while room.busy:
        assert room.step() == []
    assert (room.total, room.looks) == (0, 3)


# ---- what would be lost ---------------------------------------------------------------------------------------------


def opened(probing: bool = False) -> Conversation:
    talk = Conversation()
    talk.hello()
    if not probing:
        talk.connect()
        talk.ask(setup(0, 8, 8))
        talk.tell(granted(0, 8, 8))
    return talk


@pytest.mark.parametrize(
    ("what", "holds"),
    [
        (lambda talk: talk.packet(CLIENT), False),
        (lambda talk: (talk.ask(asks(1, dbw(1, 0))), talk.tell(words(1, 1))), False),
        (lambda talk: talk.ask(asks(1, dbw(1, 0))), True),
        (lambda talk: talk.tell(asks(1, dbw(1, 0))), True),
        (lambda talk: talk.tell(words(1, 1)), True),
        (lambda talk: talk.packet(CLIENT, b"\x03\x00\x00"), True),
        (lambda talk: talk.packet(SERVER, b"\x03\x00\x00"), True),
        (lambda talk: (talk.lose(CLIENT, asks(1, dbw(1, 0))), talk.ask(asks(2, dbw(1, 0)))), True),
        (lambda talk: talk.packet(CLIENT, tpkt(b"\x00\xf0\x80" + asks(1, dbw(1, 0)))), True),
        (lambda talk: (talk.ask(events.request_download(1)), talk.tell(events.answered(1, 0x1A))), True),
    ],
    ids=[
        "nothing", "an answered read", "a request", "a request of the server", "an answer alone", "half a TPKT of the client",
        "half a TPKT of the server", "behind a gap", "behind a malformed header", "a download",
    ],
)  # fmt: skip
def test_a_connection_holds_something_that_would_be_lost(what: Callable[[Conversation], object], holds: bool) -> None:
    talk = opened()
    what(talk)
    side = talk.pipeline.table.all_open()[0]
    assert side.peer is not None
    assert holds_something(side) is holds_something(side.peer) is holds


@pytest.mark.parametrize(("octets", "holds"), [(b"", False), (b"what is this", True)])
def test_octets_of_a_protocol_that_is_not_known_yet_would_be_lost(octets: bytes, holds: bool) -> None:
    talk = opened(probing=True)
    if octets:
        talk.packet(CLIENT, octets)
    assert holds_something(talk.pipeline.table.all_open()[0]) is holds
