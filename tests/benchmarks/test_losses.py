"""What is told of a capture from which packets are missing is told of the whole one, too."""

from __future__ import annotations

from itertools import islice
from random import Random

import pytest

from benchmarks.losses import Verdict, compare, kept, main, pairs
from benchmarks.traffic import Traffic
from benchmarks.truth import Truth

PACKETS = 6000


def test_a_tenth_of_the_packets_is_missing_and_no_answer_is_given_to_another_request() -> None:
    made = islice(Traffic(1, Truth(), 50, grain_ns=1000, without=frozenset()).packets(), PACKETS)
    packets = [(time_ns, frame) for time_ns, frame, _, _ in made]
    whole = pairs(packets, range(PACKETS))
    assert len(whole) > PACKETS // 4
    for burst in (False, True):
        numbers = kept(PACKETS, 0.1, burst, Random(f"losses {burst}"))
        assert 0.85 * PACKETS < len(numbers) < 0.95 * PACKETS
        verdict = compare(whole, pairs(packets, numbers), numbers)
        assert verdict.wrong == 0
        assert verdict.pairs > 0.7 * len(whole)
        assert verdict.missed < 0.01 * len(whole)


def test_what_is_wrong_and_what_is_missed() -> None:
    whole = {("a", "b", 1, 0): 1, ("a", "b", 1, 2): 3, ("a", "b", 2, 4): 5}
    assert compare(whole, dict(whole), range(6)) == Verdict(6, 3, 0, 0)
    # The answer in packet 3 is given to the request in packet 0; a copy of packet 5 answers the last one.
    assert compare(whole, {("a", "b", 1, 0): 3, ("a", "b", 2, 4): 6}, [0, 3, 4, 5, 6]) == Verdict(5, 2, 1, 0)
    assert compare(whole, {}, [0, 1, 2]) == Verdict(3, 0, 0, 1)


def test_losses_are_as_many_as_asked_for() -> None:
    for burst in (False, True):
        numbers = kept(100_000, 0.3, burst, Random(3))
        assert 65_000 < len(numbers) < 75_000
        assert numbers == sorted(set(numbers))


def test_the_command_prints_a_row_for_each_rate(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--packets", "500", "--rates", "0.1", "--rounds", "1"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:2] for line in lines[-2:]] == [["10%", "single"], ["10%", "bursts"]]
