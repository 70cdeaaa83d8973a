"""How the time of some work grows with its size, judged so that a busy machine cannot fail it.

One long measurement can be disturbed at any time, the least of several hardly ever. Work that grows with the square of its
size misses these bounds in each attempt, so a few more attempts let nothing through.
"""

from __future__ import annotations

import gc
from collections.abc import Callable
from typing import Final

ATTEMPTS: Final = 12


def assert_growth(few: Callable[[], float], many: Callable[[], float], most: float) -> None:
    """Assert that the least time of ``many`` is at most ``most`` times that of ``few``; each call returns seconds."""
    least_few = least_many = float("inf")
    gc.collect()
    gc.freeze()  # what the other tests left behind is not looked through while this work is measured
    try:
        for _ in range(ATTEMPTS):
            least_few = min(least_few, few())
            least_many = min(least_many, many())
            if least_many <= most * least_few:
                return
    finally:
        gc.unfreeze()
    raise AssertionError(f"{least_few:.4f} s became {least_many:.4f} s, more than {most} times as long")
