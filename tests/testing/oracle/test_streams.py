"""TCP streams put together from sequence numbers and payloads: what is new, what is ahead, what stands where."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from dissect.testing.oracle import grounds
from dissect.testing.oracle.facts import PDU, TPDU
from dissect.testing.oracle.grounds import Evidence, Streams
from dissect.testing.oracle.tshark import Segment

MASK = 0xFFFFFFFF


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> list[Segment]:
    """The segments a capture is made of."""
    segments: list[Segment] = []
    monkeypatch.setattr(grounds, "read_segments", lambda _path: iter(segments))
    return segments


def add(made: list[Segment], sequence: int, payload: bytes, flow: str = "a") -> int:
    made.append(Segment(len(made) + 1, flow, sequence & MASK, payload, frozenset()))
    return len(made)


def told(made: list[Segment]) -> list[tuple[int, int, bool]]:
    """For every segment its position, the octets that are new, and whether octets before it are missing."""
    found = Streams("any")
    arrivals = [found.arrival(segment.frame) for segment in made]
    return [(arrival.at, arrival.new, arrival.ahead) for arrival in arrivals if arrival is not None]


@pytest.mark.parametrize("start", [0, 1000, MASK - 5, MASK])
def test_in_order_over_the_wrap(made: list[Segment], start: int) -> None:
    for index in range(4):
        add(made, start + 4 * index, b"abcd")
    assert told(made) == [(0, 4, False), (4, 4, False), (8, 4, False), (12, 4, False)]


def test_retransmission_and_overlap(made: list[Segment]) -> None:
    add(made, 100, b"abcdef")
    add(made, 100, b"abcdef")
    add(made, 104, b"efgh")
    add(made, 102, b"cdefghij")
    assert told(made) == [(0, 6, False), (0, 0, False), (4, 2, False), (2, 2, False)]


def test_a_gap_and_what_fills_it(made: list[Segment]) -> None:
    add(made, 100, b"abc")
    add(made, 106, b"ghi")
    add(made, 112, b"mno")
    add(made, 103, b"def")
    add(made, 115, b"pqr")
    add(made, 109, b"jkl")
    assert told(made) == [(0, 3, False), (6, 3, True), (12, 3, True), (3, 3, False), (15, 3, True), (9, 3, False)]
    assert Streams("any").follow([(1, b"abcdefghijklmnopqr")]) == [True]


def test_what_comes_before_the_first(made: list[Segment]) -> None:
    add(made, 100, b"def")
    add(made, 97, b"abc")
    assert told(made) == [(0, 3, False), (-3, 3, False)]
    assert Streams("any").follow([(1, b"abcdef")]) == [True]


def test_directions_are_apart(made: list[Segment]) -> None:
    add(made, 100, b"abc")
    add(made, 100, b"xyz", "b")
    assert told(made) == [(0, 3, False), (0, 3, False)]
    assert Streams("any").follow([(1, b"abc"), (2, b"xyz"), (1, b"xyz")]) == [True, True, False]


def test_the_first_copy_counts(made: list[Segment]) -> None:
    add(made, 100, b"good")
    add(made, 100, b"evil")
    assert Streams("any").follow([(1, b"good")]) == [True]
    assert Streams("any").follow([(2, b"evil")]) == [False]


def test_pieces_follow_each_other(made: list[Segment]) -> None:
    add(made, 100, b"onetwotwothree")
    assert Streams("any").follow([(1, b"one"), (1, b"two"), (1, b"two"), (1, b"three")]) == [True] * 4
    assert Streams("any").follow([(1, b"one"), (1, b"one")]) == [True, False], "told twice"
    assert Streams("any").follow([(1, b"onetwo"), (1, b"two"), (1, b"two")]) == [True, True, False]
    assert Streams("any").follow([(1, b"two"), (1, b"one")]) == [True, False], "out of order"


def test_a_piece_does_not_stand_across_a_gap(made: list[Segment]) -> None:
    add(made, 100, b"abc")
    add(made, 110, b"def")
    assert Streams("any").follow([(1, b"abc"), (2, b"def")]) == [True, True]
    assert Streams("any").follow([(1, b"abcdef")]) == [False]


def test_a_connection_taken_up_again_with_lower_numbers(made: list[Segment]) -> None:
    add(made, 100, b"first")
    add(made, 700_000_000, b"second")
    add(made, 105, b"third")
    assert Streams("any").follow([(1, b"first"), (2, b"second"), (3, b"third")]) == [True] * 3


def test_a_packet_without_octets(made: list[Segment]) -> None:
    add(made, 100, b"abc")
    assert Streams("any").arrival(2) is None
    assert Streams("any").follow([(2, b"abc")]) == [False]


def test_nothing_is_read_before_it_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(path: str) -> Iterator[Segment]:
        raise AssertionError(path)

    monkeypatch.setattr(grounds, "read_segments", fail)
    found = Streams("any")
    with pytest.raises(AssertionError, match="any"):
        found.arrival(1)


def test_which_octets_are_fresh(made: list[Segment]) -> None:
    for sequence, payload in ((100, b"abc"), (106, b"ghi"), (100, b"abcdefghijkl"), (112, b"mn"), (101, b"bcd")):
        add(made, sequence, payload)
    found = Streams("any")
    arrivals = [arrival for segment in made if (arrival := found.arrival(segment.frame)) is not None]
    assert [list(arrival.fresh) for arrival in arrivals] == [[(0, 3)], [(0, 3)], [(3, 6), (9, 12)], [(0, 2)], []]
    assert [arrival.new for arrival in arrivals] == [3, 3, 6, 2, 0]
    again = arrivals[2]
    assert (again.brought(b"ghi"), again.brought(b"abc"), again.brought(b"hij")) == ([True], [True], [False])
    assert (again.brought(b"none"), again.brought(b"")) == ([], [])


def test_where_a_header_can_stand(made: list[Segment]) -> None:
    """One that a segment holds, or whose TPKT ends in the segment; what only looks like it elsewhere does not count."""
    header = b"\x03\x00\x00\x08"
    add(made, 100, header + b"abcd" + header)
    add(made, 112, b"efgh" + header)
    found = Streams("any")
    first, second = found.arrival(1), found.arrival(2)
    assert first is not None
    assert second is not None
    assert found.headers(first, header) == [0, 8]
    assert found.headers(second, header) == [8, 16]
    assert found.headers(second, b"\x03\x00\x00\x09") == []


def test_what_both_directions_carry(made: list[Segment]) -> None:
    for flow, protocols in (("7 a", "tcp:tpkt:cotp"), ("7 b", "tcp:cotp:rdp"), ("8 a", "tcp:tpkt")):
        made.append(Segment(len(made) + 1, flow, 0, b"x", frozenset(), frozenset(protocols.split(":"))))
    evidence = Evidence("any", {TPDU: [], PDU: []})
    assert [evidence.carries(frame, frozenset(("rdp", "t125"))) for frame in (1, 2, 3, 9)] == [True, True, False, False]


@pytest.mark.parametrize(
    ("found", "within"),
    [
        ([(1, b"message one."), (1, b"and two: XY two")], True),
        ([(1, b"message one.and two: XY two")], True),
        ([(1, b"age one."), (1, b"and two: XY two")], True),
        ([(1, b"and two: XY two")], False),  # nothing leads up to it
        ([(1, b"message one.and two: "), (1, b"XY two")], False),  # it begins there
        ([(1, b"message one.")], False),
        ([], False),
    ],
)
def test_inside_a_message_that_was_found(made: list[Segment], found: list[tuple[int, bytes]], within: bool) -> None:
    add(made, 100, b"message one.and two: XY two")
    evidence = Evidence("any", {TPDU: found, PDU: []})
    assert evidence.inside(1, b"XY") is within
    assert not evidence.inside(2, b"XY")
