"""The compiled engine does not become slower unnoticed: counted instructions, the same on a busy machine."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchmarks.instructions import (
    MOST,
    MOST_OF_LINKS,
    RECORDED,
    SAME,
    combination,
    interpreter,
    measure,
    recorded,
    too_many,
)
from benchmarks.links import KINDS
from dissect.wire.build import COMPILED


def test_the_engine_runs_no_more_instructions_than_recorded(tmp_path: Path) -> None:
    """``python -m benchmarks.instructions --record`` keeps new numbers, where more work is meant."""
    if not COMPILED:
        pytest.skip("instructions are counted of the compiled build: its run of this test does")
    if shutil.which("valgrind") is None:
        pytest.skip("valgrind is not installed (scripts/install-tools.sh)")
    known = recorded()
    if not known or abs(interpreter() / known["interpreter"] - 1) > SAME:
        pytest.skip(f"no instructions are recorded for {combination() or 'this compiler'} with this Python")
    assert too_many(measure(tmp_path), known) == []


def test_what_is_recorded_has_every_number() -> None:
    known = json.loads(RECORDED.read_text(encoding="ascii"))
    assert known
    for numbers in known.values():
        assert set(numbers) == {*MOST, "interpreter"}
        assert all(count > 0 for count in numbers.values())


def test_every_link_is_held_to_plain_ethernet() -> None:
    assert {"plain", *MOST_OF_LINKS} == set(KINDS)


def test_more_than_allowed_is_reported() -> None:
    before = {"analyze": 1000, "transactions": 2000, "s7plus": 1000, "plain": 1000, "start": 3000}
    links = {name: int(1000 * most) for name, most in MOST_OF_LINKS.items()}
    few = {"analyze": 1050, "transactions": 1, "s7plus": 1050, "plain": 1000, "start": 3300}
    assert too_many({**few, **links}, before) == []
    many = {"analyze": 1051, "transactions": 2101, "s7plus": 1051, "plain": 1051, "start": 3301}
    assert too_many({**many, **links}, before) == [
        "analyze: 1051 instructions, recorded are 1000, at most 1.05 times that is allowed",
        "transactions: 2101 instructions, recorded are 2000, at most 1.05 times that is allowed",
        "s7plus: 1051 instructions, recorded are 1000, at most 1.05 times that is allowed",
        "plain: 1051 instructions, recorded are 1000, at most 1.05 times that is allowed",
        "start: 3301 instructions, recorded are 3000, at most 1.10 times that is allowed",
    ]
    for name, count in links.items():
        (sentence,) = too_many({**few, **links, name: count + 10}, before)
        assert sentence.startswith(f"{name}: {count + 10} instructions, 1000 over plain Ethernet")
