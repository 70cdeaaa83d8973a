"""The packets that passed last: bounds in time, number and octets."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.files.recording.recent import MAX_COMMENTS, PACKET_COST, KeptPacket, RecentPackets


def packet(frame: int, time_ns: int, size: int = 0) -> KeptPacket:
    return KeptPacket(frame, time_ns, bytes(size), size, 1, "", [])


def frames(recent: RecentPackets) -> list[int]:
    return [kept.frame for kept in recent]


def test_those_whose_time_is_over_leave() -> None:
    recent = RecentPackets(10**6, 10)
    for frame, time_ns in enumerate((0, 5, 10, 11, 16)):
        recent.add(packet(frame, time_ns))
    assert frames(recent) == [2, 3, 4]  # 6 is where the time of the last one begins
    assert [kept.frame for kept in recent.within(21)] == [3, 4]
    assert recent.shortened == 0


def test_no_more_than_so_many_stay() -> None:
    recent = RecentPackets(10**6, 10**9, 3)
    for frame in range(10):
        recent.add(packet(frame, frame))
    assert frames(recent) == [7, 8, 9]
    last = recent.last
    assert last is not None
    assert last.frame == 9


@given(st.lists(st.tuples(st.integers(0, 5), st.integers(0, 3000)), max_size=50), st.integers(1, 5000))
def test_memory_is_bounded_and_the_latest_stay(passed: list[tuple[int, int]], most: int) -> None:
    recent = RecentPackets(most, 10**9)
    time_ns = 0
    for frame, (step, size) in enumerate(passed):
        time_ns += step
        recent.add(packet(frame, time_ns, size))
        assert recent.octets == sum(kept.size for kept in recent) <= most
        assert frames(recent) == list(range(frame + 1 - len(recent), frame + 1))
    assert recent.shortened == len(passed) - len(recent)


def test_a_packet_is_found_by_its_number() -> None:
    recent = RecentPackets(5 * PACKET_COST, 10**9)
    assert recent.find(0) is None
    assert recent.last is None
    for frame in range(10):
        recent.add(packet(frame, frame))
    assert [frame for frame in range(-3, 14) if recent.find(frame) is not None] == [5, 6, 7, 8, 9]
    recent.clear()
    assert (len(recent), recent.octets, recent.find(9)) == (0, 0, None)


def test_comments_are_told_once_and_bounded() -> None:
    kept = packet(1, 1)
    for number in range(200):
        kept.say(str(number))
        kept.say(str(number))
    assert kept.comments == [str(number) for number in range(MAX_COMMENTS)]


def test_room_for_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="too few for one packet"):
        RecentPackets(0, 1)
