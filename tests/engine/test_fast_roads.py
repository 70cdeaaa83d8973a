"""The fast roads are taken: a short cut whose condition no longer holds gives right results slowly; nothing else would show it.

Calls are counted by the profiler of the interpreter, so that the engine has no counters for this. The roads of the compiled
build run interpreted here: `COMPILED` is what decides, and both roads are plain Python.
"""

from __future__ import annotations

import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any, Final

import pytest

import dissect
from benchmarks.generate import generate
from dissect.engine import iso
from dissect.engine.transactions import checks, pairing
from dissect.protocols.s7 import parameters
from dissect.wire import octets
from dissect.wire.build import COMPILED
from tests.growth import UNCOUNTED

pytestmark = pytest.mark.skipif(COMPILED, reason=UNCOUNTED)

CAPTURES: Final = Path(__file__).parents[2] / "captures"
#: A road, and where it is looked for: it has to be taken by at least this share of the calls of the other function.
Road = tuple[str, str, float]


class Taken:
    """How often each function was called, and how often it returned something true."""

    def __init__(self, capture: Path) -> None:
        self.calls: Counter[str] = Counter()
        self.true: Counter[str] = Counter()
        sys.setprofile(self._count)
        try:
            dissect.analyze(capture)
        finally:
            sys.setprofile(None)

    def _count(self, frame: FrameType, event: str, argument: Any) -> None:
        if event == "call":
            self.calls[frame.f_code.co_qualname] += 1
        elif event == "return" and argument is not NotImplemented and argument:
            self.true[frame.f_code.co_qualname] += 1

    def share(self, road: str, of: str) -> float:
        """Return how many of the calls of one function there are for which another one did its work."""
        assert self.calls[of], f"{of} is called no more"
        return self.true[road] / self.calls[of]


@pytest.fixture(scope="module")
def traffic(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Traffic of a made plant, with all that disturbs it."""
    path = tmp_path_factory.mktemp("roads") / "made.pcap"
    generate(path, 3000, 1, 20, "pcap", frozenset())
    return path


@pytest.fixture(scope="module")
def interpreted(traffic: Path) -> Taken:
    return Taken(traffic)


@pytest.fixture(scope="module")
def compiled(traffic: Path) -> Taken:
    with as_compiled():
        return Taken(traffic)


@contextmanager
def as_compiled() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        for module in (checks, iso, octets, pairing, parameters):
            patch.setattr(module, "COMPILED", True)
        yield


#: Of made traffic, in the compiled build. What is left: handshakes, empty acknowledgements, mishaps, refusals, other functions.
COMPILED_ROADS: Final[list[Road]] = [
    ("ConnectionTable.find", "Pipeline.frame", 0.9),
    ("IsoOnTcp.usual", "S7.take", 0.9),
    ("ParameterCache._asked", "Dialogue.ask", 0.8),
    ("begin_alike", "_check_read", 0.5),
]


@pytest.mark.parametrize(("road", "of", "least"), COMPILED_ROADS)
def test_most_of_made_traffic_takes_the_roads_of_the_compiled_build(
    compiled: Taken, road: str, of: str, least: float
) -> None:
    assert least <= compiled.share(road, of) <= 1


def test_most_of_made_traffic_takes_the_roads_of_the_interpreted_build(interpreted: Taken) -> None:
    assert interpreted.share("IsoOnTcp.usual", "S7.take") >= 0.9
    assert interpreted.share("Parameters.like_good", "Dialogue.answer") >= 0.5


def test_most_answers_are_neither_judged_nor_watched(interpreted: Taken) -> None:
    calls = interpreted.calls
    assert 0 < calls["Exchange._complete"] <= 0.2 * calls["Exchange.completed"]
    assert 0 < calls["Pipeline._segment"] <= 0.2 * calls["Pipeline._known"]


def test_a_block_that_is_polled_is_parsed_once(interpreted: Taken) -> None:
    calls = interpreted.calls
    assert 0 < calls["parse_parameters"] <= 0.2 * calls["ParameterCache.get"]


def test_a_block_that_is_polled_is_found_without_a_dictionary(compiled: Taken) -> None:
    calls = compiled.calls
    assert 0 < calls["Parameters.take_items"] <= calls["ParameterCache._asked"] / 4
    # Userdata and functions without items take the dictionary each time.
    assert calls["ParameterCache._distinct"] <= 1.5 * calls["parse_parameters"]


@pytest.mark.parametrize("name", ["read-areas", "two-clients", "many-open", "nodes7-poll-parallel"])
def test_reads_seen_for_the_first_time_need_no_item(name: str) -> None:
    """Recorded captures: all that is read is plain, and each first answer is as CPUs answer."""
    with as_compiled():
        taken = Taken(CAPTURES / f"{name}.pcapng")
    assert taken.calls["parse_items"] == taken.calls["Transaction.s7_results"] == taken.calls["Item.address"] == 0
    assert taken.true["plainly_answered"] + taken.true["begin_alike"] == taken.calls["_check_read"] > 0
    assert taken.calls["judge_parameters"] == taken.calls["parse_parameters"] - taken.calls["Parameters.take_items"]


def test_a_plain_answer_that_comes_again_is_compared_from_the_third_on() -> None:
    with as_compiled():
        taken = Taken(CAPTURES / "nodes7-poll.pcapng")
    assert taken.true["plainly_answered"] == 2
    assert taken.true["item_heads"] == 1
    assert taken.true["begin_alike"] == taken.calls["_check_read"] - 2 == 3


def test_refusals_are_told_apart_by_their_codes(interpreted: Taken) -> None:
    """Beyond those that are detailed, no object is made for an item."""
    assert interpreted.calls["SecurityWatch.refused_items"] > 10
    assert interpreted.share("read_codes", "SecurityWatch.refused_items") >= 0.8
    assert interpreted.calls["Transaction.errors"] <= interpreted.calls["Reporter.detail"]
