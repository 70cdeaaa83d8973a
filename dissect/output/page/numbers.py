"""Numbers in the sentences of a report, with thousands separators as in the plots and tables."""

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
    """Return a sentence with thousands separators in its numbers; it must not contain packet numbers or names."""
    return _COUNT.sub(lambda found: f"{int(found[0]):,}", sentence)
