"""What a capture does to a conversation must not change what is told of it (robustness promises G14 and G15).

The conversations are made by `tests.properties.traffic`, which knows the truth about them.
"""

from __future__ import annotations

from random import Random

from hypothesis import example, given
from hypothesis import strategies as st

from tests.properties.books import (
    Known,
    Result,
    by_connection,
    check_books,
    facts,
    sorted_by_connection,
    told,
    true,
)
from tests.properties.packets import MASK, Segment, captured
from tests.properties.traffic import Conversation, conversations, merged, reordered, segments

#: How far a packet may have moved within its connection. The stream promises a grace of eight segments after the far end
#: acknowledged the missing octets; two packets that move towards each other use it up together.
REACH = 4
COPIES = 0.05

seeds = st.integers(0, 2**32 - 1)
counts = st.integers(1, 3)
rounds = st.integers(1, 8)
shares = st.sampled_from((0.0, 0.3, 0.7, 1.0))


def plain(made: list[Conversation]) -> Result:
    """Return what is told of conversations when each message is a segment and nothing goes wrong."""
    return Result(captured([segment for one in made for segment in segments(one)]))


def in_order(result: Result) -> tuple[object, object]:
    """Return all transactions by content, and those that are complete in the order in which they were told.

    When it is known that the other half will not come depends on what else is in the capture, so that has no order.
    """
    answered = [one for one in result.transactions if one.outcome in {"answered", "unsolicited"}]
    return sorted_by_connection(result.transactions), by_connection(answered)


@given(seeds, counts, rounds, shares, shares, shares)
def test_any_segmentation_gives_the_same_transactions(
    seed: int, count: int, length: int, cut: float, join: float, acks: float
) -> None:
    rng = Random(seed)
    made = conversations(rng, count, length)
    result = Result(captured(merged(rng, [segments(one, rng, cut=cut, join=join, acks=acks) for one in made])))
    check_books(result.pipeline, result.record)
    assert in_order(result) == in_order(plain(made))
    assert told(result.transactions) == true(made)
    assert result.pipeline.counters.octets.skipped == 0
    assert result.pipeline.counters.octets.missing == 0


@given(seeds, counts, rounds, st.integers(0, MASK), st.integers(0, MASK))
def test_any_initial_sequence_number_gives_the_same_transactions(
    seed: int, count: int, length: int, first: int, second: int
) -> None:
    rng = Random(seed)
    made = conversations(rng, count, length)
    # Half of the connections wrap within the first octets.
    numbers = [(first, second) if rng.random() < 0.5 else (-rng.randrange(300), -rng.randrange(300)) for _ in made]
    streams = [segments(one, rng, cut=0.3, join=0.3, isns=isns) for one, isns in zip(made, numbers, strict=True)]
    result = Result(captured(merged(rng, streams)))
    check_books(result.pipeline, result.record)
    assert in_order(result) == in_order(plain(made))
    assert told(result.transactions) == true(made)


@given(seeds, counts, rounds, shares)
def test_reordering_and_copies_give_the_same_transactions(seed: int, count: int, length: int, acks: float) -> None:
    rng = Random(seed)
    made = conversations(rng, count, length, silent=0.0)
    streams = [reordered(rng, segments(one, rng, cut=0.4, join=0.4, acks=acks), REACH, COPIES) for one in made]
    result = Result(captured(merged(rng, streams)))
    check_books(result.pipeline, result.record)
    assert sorted_by_connection(result.transactions) == sorted_by_connection(plain(made).transactions)
    assert told(result.transactions) == true(made)
    assert result.pipeline.counters.octets.missing == 0


@given(seeds, counts, rounds, st.floats(0, 1), st.booleans())
def test_a_prefix_of_the_packets_gives_a_prefix_of_the_transactions(
    seed: int, count: int, length: int, part: float, disorder: bool
) -> None:
    rng = Random(seed)
    made = conversations(rng, count, length)
    streams = [segments(one, rng, cut=0.3, join=0.3) for one in made]
    if disorder:
        streams = [reordered(rng, stream, REACH, COPIES) for stream in streams]
    packets = captured(merged(rng, streams))
    whole = Result(packets)
    begun = Result(packets[: int(part * len(packets))])
    check_books(begun.pipeline, begun.record)
    certain = [facts(one) for one in begun.transactions[: begun.before_the_end]]
    assert certain == [facts(one) for one in whole.transactions[: len(certain)]]
    # What the end of the capture left open goes on in the whole: the same request, or the same answer.
    requests = {(one.connection.number, one.request_octets) for one in whole.transactions}
    answers = {(one.connection.number, one.response_octets) for one in whole.transactions}
    for one in begun.transactions[len(certain) :]:
        assert not one.request_size or (one.connection.number, one.request_octets) in requests
        assert not one.response_size or (one.connection.number, one.response_octets) in answers


def _lose(rng: Random, sent: list[Segment]) -> tuple[Segment, tuple[int, int], list[Segment]]:
    """Take one segment with octets out; return it, its place in the octets of its side, and the others."""
    at = rng.choice([number for number, segment in enumerate(sent) if segment.payload])
    gone = sent[at]
    first = next(segment.seq for segment in sent if segment.side == gone.side and segment.payload)
    start = (gone.seq - first) & MASK
    return gone, (start, start + len(gone.payload)), sent[:at] + sent[at + 1 :]


def _check_loss(made: list[Conversation], hit: int, gone: Segment, span: tuple[int, int], result: Result) -> None:
    """Hold a result to this: besides the deals whose octets were lost it misses one at most, and it makes none up."""
    check_books(result.pipeline, result.record)
    missing: list[Known] = true(made)
    invented: list[Known] = []
    for known in told(result.transactions):
        if known in missing:
            missing.remove(known)
        elif known[4] in {"answered", "unsolicited"}:
            invented.append(known)
    assert invented == []
    touched = {(deal.request, deal.response) for deal in made[hit].deals if deal.touched(gone.side, span)}
    assert len([known for known in missing if (known[2], known[3]) not in touched]) <= 1
    assert result.pipeline.counters.octets.missing <= len(gone.payload)


@given(seeds, counts, rounds, shares)
def test_one_lost_segment_costs_its_own_transactions_and_one_more(
    seed: int, count: int, length: int, acks: float
) -> None:
    rng = Random(seed)
    made = conversations(rng, count, length, silent=0.0)
    streams = [segments(one, rng, cut=0.4, join=0.4, acks=acks) for one in made]
    hit = rng.randrange(count)
    gone, span, streams[hit] = _lose(rng, streams[hit])
    _check_loss(made, hit, gone, span, Result(captured(merged(rng, streams))))


@given(seeds, counts, rounds, shares)
@example(641668, 1, 6, 0.0)  # the first request is lost, and the PLC asks something itself before the next one
def test_loss_is_local_with_reordering_in_the_same_run(seed: int, count: int, length: int, acks: float) -> None:
    rng = Random(seed)
    made = conversations(rng, count, length, silent=0.0)
    streams = [segments(one, rng, cut=0.4, join=0.4, acks=acks) for one in made]
    hit = rng.randrange(count)
    gone, span, streams[hit] = _lose(rng, streams[hit])
    streams = [reordered(rng, stream, REACH - 1, COPIES) for stream in streams]
    _check_loss(made, hit, gone, span, Result(captured(merged(rng, streams))))


@given(seeds, counts, rounds, st.integers(1, 12))
def test_mutation_never_raises_and_every_octet_is_told_of(seed: int, count: int, length: int, spoilt: int) -> None:
    rng = Random(seed)
    made = conversations(rng, count, length)
    packets = captured(merged(rng, [segments(one, rng, cut=0.3, join=0.3) for one in made]))
    for _ in range(spoilt):
        at = rng.randrange(len(packets))
        packet = packets[at]
        octets = bytearray(packet.octets or b"\x00")
        choice = rng.randrange(5)
        if choice < 3:  # one octet, mostly behind the TCP header
            place = rng.randrange(54, len(octets)) if len(octets) > 54 and choice else rng.randrange(len(octets))
            octets[place] = rng.choice((0, 1, 0x7F, 0x80, 0xFF, octets[place] ^ 1, octets[place] ^ 0x80))
            packets[at] = packet._replace(octets=bytes(octets))
        elif choice == 3:  # cut by the capture
            packets[at] = packet._replace(octets=bytes(octets[: rng.randrange(len(octets))]))
        else:  # a stretch taken out or repeated
            place = rng.randrange(len(octets))
            size = rng.randrange(1, 20)
            changed = (
                octets[:place]
                + (octets[place : place + size] * 2 if rng.random() < 0.5 else b"")
                + octets[place + size :]
            )
            packets[at] = packet._replace(octets=bytes(changed), wire_length=len(changed))
    result = Result(packets)
    check_books(result.pipeline, result.record)
    for one in result.transactions:
        facts(one)
    slugs = set(result.counts)
    assert "internal.bug" not in slugs
