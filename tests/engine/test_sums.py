"""Counts of several pipelines added up, as files that are read apart: the sum is that of one run over all of them."""

from __future__ import annotations

import copy
import pickle
from operator import attrgetter

import pytest

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.sums import _COUNTERS, add_counted, counted_by
from dissect.protocols.tls.key_log import KeyLog
from dissect.wire.octets import Tally
from tests.engine.test_payload import Heard, hearing
from tests.engine.transactions.talk import CLIENT, FIN, MS, SERVER, START_NS, Talk, ack_data, dbw, read, refused, words


def busy(reads: int, wrong: int, ports: tuple[int, ...] = ()) -> Talk:
    """Reads, refusals, and connections to ports that only open and close."""
    talk = Talk()
    talk.open()
    for ref in range(reads):
        talk.ask(read(ref, dbw(1, 0)))
        talk.tell(words(ref, 1) if ref >= wrong else ack_data(ref, b"\x04\x01", refused(0x0A)))
    for at, port in enumerate(ports):
        other = Talk(50001 + at, port, beside=talk)
        other.hello()
        for side in (CLIENT, SERVER, CLIENT):
            other.packet(side, flags=FIN | 16)
    talk.close()
    return talk


def half_a_datagram(talk: Talk) -> None:
    """The first fragment of a datagram that is never whole."""
    header = bytes.fromhex("45000024") + b"\x00\x09\x20\x00\x40\x06\x00\x00" + bytes((10, 0, 0, 1, 10, 0, 0, 2))
    talk.raw(bytes(12) + b"\x08\x00" + header + bytes(16))


def summed(*talks: Talk, given: int = 0) -> Pipeline:
    made = Pipeline(Observer())
    packets = 0
    for talk in talks:
        add_counted(made, counted_by(talk.pipeline), packets, given)
        packets += int(talk.pipeline.frames)
    return made


def value(pipeline: Pipeline, path: str) -> object:
    found = attrgetter(path)(pipeline)
    return list(found.counts()) if isinstance(found, Tally) else found


def together(one: object, other: object) -> object:
    if isinstance(one, dict) and isinstance(other, dict):
        return {key: one.get(key, 0) + other.get(key, 0) for key in {**one, **other}}
    if isinstance(one, list) and isinstance(other, list):
        return [first + second for first, second in zip(one, other, strict=True)]
    assert isinstance(one, int)
    assert isinstance(other, int)
    return one + other


def test_every_counter_is_added_up() -> None:
    first, second = busy(5, 2, (102, 4000)), busy(9, 4, (102,))
    total = summed(first, second)
    apart = [[value(talk.pipeline, path) for path in _COUNTERS] for talk in (first, second)]
    for path, one, other in zip(_COUNTERS, *apart, strict=True):
        assert value(total, path) == together(one, other), path
    assert total.frames == first.pipeline.frames + second.pipeline.frames
    assert total.finding_counts["transaction.item_error"] == 6
    assert total.counters.packet_counts() == together(
        first.pipeline.counters.packet_counts(), second.pipeline.counters.packet_counts()
    )
    # What was read last stays last: adding up leaves what was counted as it was.
    assert [[value(talk.pipeline, path) for path in _COUNTERS] for talk in (first, second)] == apart


def test_times_are_those_of_the_first_and_the_last() -> None:
    early, late = busy(2, 0), Talk()
    late.now_ns += 3_600_000 * MS
    late.open()
    late.close()
    for talks in ((early, late), (late, early)):
        total = summed(*talks)
        assert total.first_ns == talks[0].pipeline.first_ns
        assert total.now_ns == talks[1].pipeline.now_ns
        assert total.counters.earliest_ns == early.pipeline.counters.earliest_ns
        assert total.counters.latest_ns == late.pipeline.counters.latest_ns
    alone = summed(early)
    assert (alone.counters.earliest_ns, alone.counters.latest_ns) == (
        early.pipeline.counters.earliest_ns,
        early.pipeline.counters.latest_ns,
    )


def test_a_file_without_packets_changes_no_time() -> None:
    talk, empty = busy(1, 0), Talk()
    for talks in ((talk, empty), (empty, talk)):
        total = summed(*talks)
        assert (total.frames, total.now_ns) == (talk.pipeline.frames, talk.pipeline.now_ns)
        assert total.first_ns == talk.pipeline.first_ns


def test_fragments_of_a_file_that_ended_wait_no_longer() -> None:
    first, second = Talk(), Talk()
    for talk, count in ((first, 1), (second, 2)):
        for _ in range(count):
            half_a_datagram(talk)
    waiting = [int(talk.pipeline.counters.fragments.waiting) for talk in (first, second)]
    assert waiting[0] > 0
    total = summed(first, second).counters.packet_counts()
    assert (total["fragment_waiting"], total["fragment_dropped"]) == (
        waiting[1],
        waiting[0] + sum(int(talk.pipeline.counters.fragments.dropped) for talk in (first, second)),
    )
    assert sum(total.values()) == 3


def test_first_packets_of_bare_connections_are_numbered_through() -> None:
    first, second = busy(1, 0, (102,)), busy(2, 0, (102, 102))
    found = summed(first, second).counters.bare.found()
    assert found == (3, first.pipeline.counters.bare.found()[1])
    later = summed(busy(1, 0), second).counters.bare.found()
    assert later == (2, second.pipeline.counters.bare.found()[1] + busy(1, 0).pipeline.frames)


@pytest.mark.parametrize("given", [0, 1])
def test_keys_that_every_run_was_given_count_once(given: int) -> None:
    lines = b"".join(b"CLIENT_RANDOM %064x %096x\n" % (number, number) for number in range(1, 4))
    talks = []
    for _ in range(2):
        keys = KeyLog()
        keys.add(lines)
        talk = Talk()
        talk.pipeline = Pipeline(talk, Options(strict=True, tls_keys=keys))
        talks.append(talk)
    assert [counted_by(talk.pipeline).keys for talk in talks] == [3, 3]
    total = summed(*talks, given=given)
    assert counted_by(total).keys == 6 - 2 * given


@pytest.mark.parametrize("way", ["copy", "pickle"])
def test_a_copy_of_a_pipeline_has_its_counts(way: str) -> None:
    talk = busy(5, 2, (102,))
    half_a_datagram(talk)
    made = copy.deepcopy(talk.pipeline) if way == "copy" else pickle.loads(pickle.dumps(talk.pipeline))
    for path in _COUNTERS:
        assert value(made, path) == value(talk.pipeline, path), path
    assert made.counters.packet_counts() == talk.pipeline.counters.packet_counts()
    assert (made.first_ns, made.now_ns) == (talk.pipeline.first_ns, talk.pipeline.now_ns)
    assert [one.describe() for one in made.protocols] == [one.describe() for one in talk.pipeline.protocols]
    assert [one.counted() for one in made.protocols] == [one.counted() for one in talk.pipeline.protocols]


@pytest.mark.parametrize("way", ["copy", "pickle"])
def test_a_copy_keeps_the_section_of_a_payload_decoder(way: str) -> None:
    """The decoder itself is not copied."""
    talk = hearing(Heard())
    talk.hello()
    talk.packet(CLIENT, b"ab")
    made = copy.deepcopy(talk.pipeline) if way == "copy" else pickle.loads(pickle.dumps(talk.pipeline))
    assert [list(one.describe()) for one in made.protocols] == [
        ["tsdus", "tpdus"],
        ["ibh"],
        ["s7"],
        ["s7plus"],
        ["tls"],
        ["scd"],
    ]
    assert made.protocols[-1].describe() == {"scd": {"heard": 1}}
    assert made.protocols[-1].counted() == [(1, "SCD message")]
    assert made.exchange.decoder is None


def test_keys_that_runs_found_beyond_those_given_are_added() -> None:
    first, second = Talk(), Talk()
    for talk, numbers in ((first, (1, 2)), (second, (3, 4, 5))):
        for number in numbers:
            talk.pipeline.secrets(b"CLIENT_RANDOM %064x %096x\n" % (number, number))
    assert [counted_by(talk.pipeline).keys for talk in (first, second)] == [2, 3]
    assert counted_by(summed(first, second)).keys == 5


def test_what_ran_backwards_in_one_file_counts_for_all() -> None:
    """The earliest and the latest time are those of all packets, not of the first and the last one."""
    first, second = Talk(), Talk()
    for talk, times in ((first, (5, 9, 7)), (second, (20, 14, 16))):
        for seconds in times:
            talk.pipeline.frame(START_NS + seconds * 1000 * MS, bytes(60), 0, 60, 60, 1)
    for talks, now in (((first, second), 16), ((second, first), 7)):
        counters = summed(*talks).counters
        assert (counters.earliest_ns, counters.latest_ns) == (START_NS + 5000 * MS, START_NS + 20_000 * MS)
        assert counters.now_ns == START_NS + now * 1000 * MS


def test_the_facts_of_findings_are_added_up() -> None:
    total = summed(busy(5, 2), busy(9, 4))
    assert total.exchange.reporter.ledger.rules["transaction.item_error"].events == 6
