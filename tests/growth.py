"""How some work grows with its size, judged by counted work: the lines of Python that run, never by a clock.

Only interpreted code runs lines that can be counted; the same work of the compiled build is measured by `benchmarks.growth`.
The cost of a line is not measured, so repeated copies of octets need their own test.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from types import FrameType
from typing import Any, Final

import pytest

from dissect.wire.build import COMPILED

#: Why a test is skipped if nothing can be counted.
UNCOUNTED: Final = "lines of compiled code cannot be counted: the interpreted run of this test does"


def lines(work: Callable[[], object]) -> int:
    """Return how many lines of Python ``work`` runs, in all functions that it calls."""
    count = 0

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == "line"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return count


def assert_growth(few: Callable[[], object], many: Callable[[], object], most: float) -> None:
    """Assert that ``many`` runs at most ``most`` times the lines of ``few``; skip the test if nothing can be counted."""
    if COMPILED:
        pytest.skip(UNCOUNTED)
    less, more = lines(few), lines(many)
    assert less > 0
    assert more <= most * less, f"{less} lines became {more}, more than {most} times as many"
