"""Numbers in the sentences of a report, with their thousands apart as the plots and tables have them."""

from __future__ import annotations

import re
from typing import Final

_COUNT: Final = re.compile(r"(?<![\w.,:])\d{4,}(?![\w.,:]*\w)")


def counted(number: int, one: str, many: str = "") -> str:
    """Return a number with its noun: ``1 packet``, ``1,000,000 packets``."""
    return f"{number:,} {one if number == 1 else many or one + 's'}"


def how_often(number: int) -> str:
    """Return how often something happened: ``once``, ``twice``, ``6,068 times``."""
    return {1: "once", 2: "twice"}.get(number) or f"{number:,} times"


def grouped(sentence: str) -> str:
    """Return a sentence of counts, which holds no packet numbers and no names, with the thousands of its numbers apart."""
    return _COUNT.sub(lambda found: f"{int(found[0]):,}", sentence)
