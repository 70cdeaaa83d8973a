from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise, permutations, product
from random import Random
from typing import Final

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.packets.tcp import stream
from dissect.packets.tcp.stream import BEFORE_START, KEEP_ALIVE, NEW, OLD, HalfStream
from tests.packets.tcp.feed import Feed, Model

MS: Final = 1_000_000
SECOND: Final = 1_000_000_000


def visible_conflict(half: HalfStream, model: Model, at: int, octets: bytes) -> bool:
    """Tell whether a segment differs from octets that are held, or in the two stretches passed on last."""
    kept = {
        *range(half.last_at, half.last_at + len(half.last)),
        *range(half.before_at, half.before_at + len(half.before)),
    }
    for place, octet in enumerate(octets, at):
        if place >= half.position or place in kept:
            if model.octets.get(place, octet) != octet:
                return True
    return False


def play(segments: list[tuple[int, bytes]], isn: int, known_start: bool) -> Feed:
    """Feed segments, at most 7 so that nothing is given up before the end, to stream and model, and compare."""
    feed = Feed(isn, known_start)
    model = Model()
    for at, octets in segments:
        place = at - (feed.base if feed.frame else (0 if known_start else at))
        probe = len(octets) == 1 and place == feed.half.position - 1
        conflict = not probe and visible_conflict(feed.half, model, place, octets)
        before = feed.half.conflicts
        expected = KEEP_ALIVE if probe else model.add(place, octets, feed.frame + 1)
        assert feed.segment(at, octets) == expected
        assert (feed.half.conflicts > before) is conflict
    feed.finish()
    assert feed.output() == model.output()
    return feed


# ---- overlaps -------------------------------------------------------------------------------------------------------

#: The 13 relations of Allen that an interval can have to [a, b): (from a or b, plus; to a or b, plus).
RELATIONS: Final = {
    "before": ("a", -6, "a", -2),
    "meets": ("a", -4, "a", 0),
    "overlaps": ("a", -3, "a", 3),
    "starts": ("a", 0, "b", -2),
    "during": ("a", 1, "b", -2),
    "finishes": ("a", 2, "b", 0),
    "equals": ("a", 0, "b", 0),
    "after": ("b", 2, "b", 7),
    "met by": ("b", 0, "b", 5),
    "overlapped by": ("b", -3, "b", 3),
    "started by": ("a", 0, "b", 4),
    "contains": ("a", -2, "b", 3),
    "finished by": ("a", -5, "b", 0),
}
#: Where the stream begins, so that everything lies behind it, touches it, or begins before it; and the wrap in the middle.
STARTS: Final = [(0, True), (18, True), (0, False)]
DATA: Final = b"A natural number of different octets: 0123456789 abcdefghijklmnopqrstuvwxyz"


def related(relation: str, to: tuple[int, int]) -> tuple[int, int]:
    start, start_plus, end, end_plus = RELATIONS[relation]
    return to["ab".index(start)] + start_plus, to["ab".index(end)] + end_plus


def variants(intervals: list[tuple[int, int]]) -> Iterator[list[tuple[int, bytes]]]:
    """Each interval but the first with the same data or other data."""
    for changed in product((False, True), repeat=len(intervals) - 1):
        segments = []
        for (start, end), other in zip(intervals, (False, *changed), strict=True):
            octets = DATA[start:end]
            segments.append((start, bytes(octet ^ 0x80 for octet in octets) if other else octets))
        yield segments


@pytest.mark.parametrize("relation", RELATIONS)
def test_two_segments_in_every_relation(relation: str) -> None:
    first = (20, 30)
    for segments in variants([first, related(relation, first)]):
        for order in permutations(segments):
            for start, known in STARTS:
                for isn in (0, 2**32 - 25):
                    play([(at - start, octets) for at, octets in order], isn + start, known)


@pytest.mark.parametrize("relation", RELATIONS)
def test_three_segments_in_every_relation(relation: str) -> None:
    first = (24, 34)
    second = related(relation, first)
    for number, another in enumerate(RELATIONS):
        third = related(another, second)
        for segments in variants([first, second, third]):
            for order in permutations(segments):
                start, known = STARTS[number % len(STARTS)]
                play([(at - start, octets) for at, octets in order], 2**32 - 30, known)


SEGMENTS = st.lists(
    st.tuples(st.integers(-5, 30), st.lists(st.sampled_from([0, 1]), min_size=1, max_size=12).map(bytes)),
    min_size=1,
    max_size=7,
)


@given(SEGMENTS, st.integers(0, stream.MASK), st.booleans())
@example([(5, b"\0"), (0, b"\0" * 5), (5, b"\1")], 0, True)
@example([(0, b"\0\0"), (1, b"\1"), (2, b"\1"), (2, b"\0")], stream.MASK, True)
def test_any_segments_against_the_model(segments: list[tuple[int, bytes]], isn: int, known_start: bool) -> None:
    play(segments, isn, known_start)


def test_a_conflict_is_seen_in_the_two_latest_stretches_and_in_all_that_is_held() -> None:
    feed = Feed()
    for at in (0, 4, 8):
        feed.segment(at, b"abcd")
    assert feed.segment(0, b"xxxx") == OLD  # too long ago: nothing is kept of it
    assert feed.half.conflicts == 0
    for number, at in enumerate((4, 8), 1):
        assert feed.segment(at, b"abcx") == OLD
        assert feed.half.conflicts == number
    for at in range(20, 60, 4):
        feed.segment(at, b"ab")
    for number, at in enumerate(range(20, 60, 4), 3):
        assert feed.segment(at, b"ax") == OLD
        assert feed.half.conflicts == number
    feed.segment(12, b"abcd")
    assert feed.half.conflicts == 12


# ---- order ----------------------------------------------------------------------------------------------------------


@st.composite
def disorder(draw: st.DrawFn) -> tuple[bytes, list[tuple[int, bytes]]]:
    """Octets, and segments that hold them all: any cuts, out of order within the window, with copies and overlaps."""
    data = draw(st.binary(min_size=1, max_size=300))
    edges = sorted({0, len(data), *draw(st.lists(st.integers(0, len(data)), max_size=60))})
    segments: list[tuple[int, bytes]] = []
    for start, end in pairwise(edges):
        segments.append((start, data[start:end]))
    # Sorting by a number that is at most a bit off lets nothing come more than a few segments late or early.
    late = draw(st.lists(st.integers(0, 7), min_size=len(segments), max_size=len(segments)))
    moved = sorted(zip(segments, range(len(segments)), late, strict=True), key=lambda entry: entry[1] + entry[2])
    segments = [segment for segment, _, _ in moved]
    for place, start, size in draw(
        st.lists(st.tuples(st.integers(0, 60), st.integers(0, 300), st.integers(1, 9)), max_size=6)
    ):
        where = min(place, len(segments))
        come = max((at + len(octets) for at, octets in segments[:where]), default=0)
        octets = data[:come][start : start + size]
        if octets:
            segments.insert(where, (start, octets))
    return data, segments


@given(disorder(), st.integers(0, stream.MASK))
@example((b"abc", [(0, b"a"), (2, b"c"), (1, b"b")]), stream.MASK)
def test_any_order_within_the_window(come: tuple[bytes, list[tuple[int, bytes]]], isn: int) -> None:
    data, segments = come
    feed = Feed(isn)
    for at, octets in segments:
        feed.segment(at, octets)
    assert feed.half.held is None
    assert feed.octets == data
    assert (feed.holes, feed.half.conflicts, feed.half.position) == ([], 0, len(data))


@given(st.lists(st.tuples(st.integers(0, 400), st.integers(1, 40)), max_size=60), st.integers(0, stream.MASK))
def test_whatever_comes_the_bounds_and_the_books_hold(segments: list[tuple[int, int]], isn: int) -> None:
    """`Feed.check` looks at them after every step; what comes out stands where it belongs."""
    data = bytes(index * 7 % 251 for index in range(500))
    feed = Feed(isn)
    for at, size in segments:
        feed.segment(at, data[at : at + size])
    feed.finish()
    place = 0
    for chunk in feed.chunks:
        assert chunk.octets == (b"" if chunk.hole else data[place : place + len(chunk.octets)])
        place += chunk.hole + len(chunk.octets)
    assert feed.half.conflicts == 0


def test_sequence_numbers_wrap_many_times() -> None:
    feed = Feed(2**32 - 10)
    at = 0
    for _ in range(20):  # 20 x 900 MB
        feed.half.skip(900_000_000, feed.frame, 0)
        feed.check()
        at += 900_000_000
        feed.segment(at + 2, b"cd")
        feed.segment(at, b"ab")
        at += 4
    assert feed.half.position == at
    assert feed.octets == b"abcd" * 20
    assert (feed.half.next_seq - (2**32 - 10) - at) % 2**32 == 0


def test_frames_and_times_are_of_the_packet_that_made_the_octets_available() -> None:
    half = HalfStream()
    half.start(0)
    for frame, seq, octets in ((1, 4, b"ef"), (2, 2, b"cd"), (3, 10, b"kl"), (4, 8, b"ij"), (5, 0, b"ab")):
        half.accept(seq, octets, frame, frame * 10)
    half.finish()
    # The hole is told at the packet that shows it; the octets behind it came out of order.
    assert [(chunk.octets, chunk.hole, chunk.frame, chunk.time_ns) for chunk in half.ready] == [
        (b"ab", 0, 5, 50),
        (b"cd", 0, 5, 50),
        (b"ef", 0, 5, 50),
        (b"", 2, 4, 40),
        (b"ij", 0, 4, 40),
        (b"kl", 0, 4, 40),
    ]


# ---- keep-alives and probes -----------------------------------------------------------------------------------------


def test_keep_alive_with_an_octet_of_garbage() -> None:
    feed = Feed()
    assert feed.segment(-1, b"\x00") == KEEP_ALIVE  # of a connection without data yet
    feed.segment(0, b"abcd")
    for garbage in (b"\x00", b"d", b"\xff"):
        assert feed.segment(3, garbage) == KEEP_ALIVE
    assert feed.segment(2, b"\x00") == OLD  # further back it is a copy, and this one differs
    assert (feed.half.conflicts, feed.octets) == (1, b"abcd")


def test_zero_window_probes_are_the_next_octet() -> None:
    feed = Feed()
    feed.segment(0, b"abc")
    assert feed.segment(3, b"d") == NEW
    assert feed.segment(3, b"d") == KEEP_ALIVE  # the probe again: one octet before the next
    assert feed.segment(3, b"defg") == NEW
    assert (feed.octets, feed.half.conflicts) == (b"abcdefg", 0)


def test_octets_before_the_first_one_seen() -> None:
    feed = Feed(known_start=False)
    feed.segment(100, b"abcd")
    assert feed.segment(90, b"0123456789") == BEFORE_START
    assert feed.segment(95, b"56789abc") == OLD
    assert feed.segment(95, b"56789abcdef") == NEW
    assert (feed.octets, feed.half.conflicts) == (b"abcdef", 0)


# ---- holes ----------------------------------------------------------------------------------------------------------


def holding() -> Feed:
    """Octets 0 to 10 passed on at 1 µs, 20 to 30 held at 2 µs."""
    feed = Feed()
    feed.segment(0, b"a" * 10)
    feed.segment(20, b"b" * 10)
    return feed


def test_an_acknowledged_hole_is_given_up_after_a_grace_of_segments() -> None:
    feed = holding()
    feed.ack(30, 3000)
    for _ in range(stream.ACK_GRACE_SEGMENTS):
        feed.passing(3000)
    assert feed.holes == []
    feed.passing(3000)
    assert feed.holes == [10]
    assert feed.octets == b"a" * 10 + b"b" * 10


def test_an_acknowledged_hole_is_given_up_after_a_grace_of_time() -> None:
    feed = holding()
    feed.ack(20, 3000)  # just the missing octets
    feed.expire(3000 + stream.ACK_GRACE_NS)
    assert feed.holes == []
    feed.expire(3001 + stream.ACK_GRACE_NS)
    assert feed.holes == [10]


def test_a_segment_after_its_own_acknowledgement_is_no_hole() -> None:
    feed = holding()
    feed.ack(30, 3000)
    feed.passing(4000)
    assert feed.segment(10, b"c" * 10) == NEW
    feed.finish()
    assert (feed.holes, feed.octets) == ([], b"a" * 10 + b"c" * 10 + b"b" * 10)


@pytest.mark.parametrize("ack", [0, 10, 19, -(2**30)])
def test_acknowledgements_of_less_explain_nothing(ack: int) -> None:
    feed = holding()
    feed.ack(ack, 3000)
    for _ in range(20):
        feed.passing(3000)
    feed.expire(3000 + 2 * stream.ACK_GRACE_NS)
    assert feed.holes == []


def test_an_acknowledgement_while_nothing_is_held_does_nothing() -> None:
    feed = Feed()
    feed.segment(0, b"a" * 10)
    feed.ack(1000, 3000)
    feed.segment(20, b"b" * 10)
    for _ in range(20):
        feed.passing(3000)
    assert feed.holes == []


def test_only_the_acknowledged_hole_is_given_up_and_the_next_gets_a_grace_of_its_own() -> None:
    feed = holding()
    feed.segment(40, b"d" * 10)
    feed.ack(30, 3000)
    feed.passing(10 * MS)
    feed.ack(50, 10 * MS)
    feed.expire(3001 + stream.ACK_GRACE_NS)
    assert feed.holes == [10]
    feed.expire(3001 + 2 * stream.ACK_GRACE_NS)
    assert feed.holes == [10]
    feed.expire(3002 + 2 * stream.ACK_GRACE_NS)
    assert feed.holes == [10, 10]


def test_as_many_held_segments_as_there_may_be_give_the_first_hole_up() -> None:
    feed = Feed()
    for number in range(stream.MAX_HELD - 1):
        feed.segment(10 + number * 4, b"ab")
        assert feed.chunks == []
    feed.segment(10 + (stream.MAX_HELD - 1) * 4, b"ab")
    assert feed.holes == [10]
    assert feed.octets == b"ab"
    feed.segment(10 + stream.MAX_HELD * 4, b"ab")
    assert feed.holes == [10, 2]


@pytest.mark.parametrize("order", ["as sent", "backwards", "mixed"])
def test_the_segments_of_a_window_wait_for_the_one_before_them(order: str) -> None:
    """It was lost on its way and sent again: 44 segments of 1460 octets are a window of 64 KiB."""
    places = [1460 * number for number in range(1, 45)]
    if order == "backwards":
        places.reverse()
    elif order == "mixed":
        Random(4).shuffle(places)
    feed = Feed()
    for place in places:
        feed.segment(place, place.to_bytes(4, "big") * 365)
    assert feed.half.held_size == 44 * (1460 + stream.HELD_COST)
    feed.segment(0, bytes(1460))
    assert feed.holes == []
    assert feed.octets == b"".join([bytes(1460), *[place.to_bytes(4, "big") * 365 for place in sorted(places)]])
    assert feed.half.held is None
    assert feed.half.held_size == 2 * 1460  # the latest two, for what is sent again


def test_a_segment_that_fills_many_holes_does_not_break_the_bound() -> None:
    feed = Feed()
    for number in range(stream.MAX_HELD - 1):
        feed.segment(10 + number * 4, b"ab")
    feed.segment(
        14, b"cd" + b"abcd" * stream.MAX_HELD
    )  # all but the first hole: twice as many stretches, and a hole before them
    assert feed.holes == [10, 2]
    assert feed.half.held is None


def test_a_megabyte_held_gives_holes_up() -> None:
    feed = Feed()
    feed.segment(1, b"x")
    for number in range(6):
        feed.segment(10 + number * 150_000, bytes(150_000))
    assert feed.holes == []
    feed.segment(10 + 6 * 150_000, bytes(150_000))
    assert feed.holes == [1, 8]  # the first alone does not free enough
    assert feed.half.held is None


def test_a_jumbo_segment_alone_may_be_larger_than_the_bound() -> None:
    feed = Feed()
    feed.segment(10, bytes(2 * stream.MAX_HELD_OCTETS))
    assert feed.holes == [10]


def test_a_hole_that_nothing_explains_is_given_up_after_a_second() -> None:
    feed = holding()
    assert feed.half.time_bound
    feed.expire(2000 + stream.HOLE_TIMEOUT_NS)
    assert feed.holes == []
    feed.expire(2001 + stream.HOLE_TIMEOUT_NS)
    assert feed.holes == [10]
    assert not feed.half.time_bound


def test_time_that_runs_backwards_gives_nothing_up() -> None:
    feed = holding()
    feed.ack(30, 3000)
    feed.expire(-(10**18))
    assert feed.holes == []


def test_the_end_gives_every_hole_up() -> None:
    feed = holding()
    feed.segment(33, b"c")
    feed.finish()
    assert feed.holes == [10, 3]
    feed.finish()
    assert feed.holes == [10, 3]


def test_a_hole_told_by_the_capture() -> None:
    feed = Feed(2**32 - 4)
    feed.segment(0, b"abcd")
    feed.half.skip(6, 7, 70)
    feed.check()
    assert (feed.half.next_seq, feed.holes) == (6, [6])
    assert (feed.chunks[1].frame, feed.chunks[1].time_ns) == (7, 70)
    assert feed.segment(10, b"k") == NEW
    assert feed.segment(5, b"fg") == OLD  # told to be missing: too late


# ---- far jumps ------------------------------------------------------------------------------------------------------

FAR: Final = 500_000_000


def test_a_far_segment_alone_is_not_believed() -> None:
    feed = Feed()
    feed.segment(0, b"abcd")
    feed.segment(FAR, b"evil")
    assert not feed.half.time_bound
    feed.expire(100 * SECOND)
    at = 4
    for number in range(40):  # the connection goes on as if nothing had been
        feed.segment(at, b"efgh", (101 + number) * SECOND)
        feed.passing((101 + number) * SECOND)
        at += 4
    assert feed.holes == []
    assert feed.octets == b"abcd" + b"efgh" * 40
    feed.finish()
    assert feed.holes == []
    assert feed.half.outside == 4


def test_a_far_segment_is_believed_when_another_follows_closely() -> None:
    feed = Feed()
    feed.segment(0, b"abcd")
    feed.segment(FAR, b"next", 5000)
    feed.segment(FAR + 1000, b"more", 6000)
    assert feed.half.time_bound
    feed.expire(5001 + stream.HOLE_TIMEOUT_NS)
    assert feed.holes == [FAR - 4]
    feed.expire(6001 + stream.HOLE_TIMEOUT_NS)
    assert feed.holes == [FAR - 4, 996]


def test_two_far_segments_far_apart_do_not_confirm_each_other() -> None:
    feed = Feed()
    feed.segment(0, b"abcd")
    feed.segment(FAR, b"evil")
    feed.segment(3 * FAR, b"evil")
    assert not feed.half.time_bound
    feed.expire(100 * SECOND)
    assert feed.holes == []
    assert feed.segment(4, b"efgh") == NEW
    assert feed.octets == b"abcdefgh"


def test_a_far_segment_is_believed_when_it_is_acknowledged() -> None:
    feed = Feed()
    feed.segment(0, b"abcd")
    feed.segment(FAR, b"next")
    feed.ack(FAR + 4, 3000)
    feed.expire(3001 + stream.ACK_GRACE_NS)
    assert feed.holes == [FAR - 4]


def test_a_gap_up_to_the_limit_is_not_far() -> None:
    for gap, bound in ((stream.FAR_AHEAD, True), (stream.FAR_AHEAD + 1, False)):
        feed = Feed()
        feed.segment(gap, b"abcd")
        assert feed.half.time_bound is bound
