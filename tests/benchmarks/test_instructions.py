"""The compiled engine does not become slower unnoticed: counted instructions, the same on a busy machine."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from benchmarks.instructions import MOST, RECORDED, SAME, combination, interpreter, measure, recorded, too_many
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


def test_more_than_allowed_is_reported() -> None:
    before = {"analyze": 1000, "transactions": 2000, "s7plus": 1000, "start": 3000}
    assert too_many({"analyze": 1050, "transactions": 1, "s7plus": 1050, "start": 3300}, before) == []
    assert too_many({"analyze": 1051, "transactions": 2101, "s7plus": 1051, "start": 3301}, before) == [
        "analyze: 1051 instructions, recorded are 1000, at most 1.05 times that is allowed",
        "transactions: 2101 instructions, recorded are 2000, at most 1.05 times that is allowed",
        "s7plus: 1051 instructions, recorded are 1000, at most 1.05 times that is allowed",
        "start: 3301 instructions, recorded are 3000, at most 1.10 times that is allowed",
    ]
