"""Bounds of a source that are checked before it is read: nesting, and sizes of numbers.

Python's TOML and JSON accept more. But later (texts of errors, copies for devices) that would fail in ways that have nothing to
do with dictionaries.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Final

from dissect.scd.errors import DictionaryError, shown

#: Whole numbers of a source fit 64 bits, signed or unsigned.
LOWEST: Final = -(1 << 63)
HIGHEST: Final = (1 << 64) - 1
#: Most nested tables and arrays; the text for a value of a field of a type is on level seven.
MAX_DEPTH: Final = 16
#: Longer keys are cut in errors.
_LONGEST_KEY: Final = 100

_KEY: Final = r"(?:[A-Za-z0-9_-]++|\"[^\"\n]*\"|'[^'\n]*')"
#: A dotted key with so many parts that tomllib needs too much memory, which grows with the square of the parts.
_LONG_KEY: Final = re.compile(rf"(?<![A-Za-z0-9_-]){_KEY}(?:[ \t]*\.[ \t]*{_KEY}){{{MAX_DEPTH}}}")
_LONG_NUMBER: Final = re.compile(r"(?<![\w\"'.-])[0-9][0-9_]{4000}")


def long_key_line(text: str) -> int:
    """Return the line of a dotted key with more parts than tables may nest, 0 if there is none.

    It looks at the text only, so that a value is found as well: sixteen words with points between them.
    """
    return _line(text, _LONG_KEY)


def long_number_line(text: str) -> int:
    """Return the line of a decimal number with more digits than Python reads, 0 if there is none."""
    return _line(text, _LONG_NUMBER)


def _line(text: str, pattern: re.Pattern[str]) -> int:
    match = pattern.search(text)
    return text.count("\n", 0, match.start()) + 1 if match else 0


def check_bounds(content: object, where: str, line: int = 0) -> None:
    """Raise `DictionaryError` with the place of what nests too deeply, or of a whole number of more than 64 bits.

    ``content`` is one table of a source, ``where`` its name, ``line`` its line.
    """
    waiting: list[tuple[Iterator[tuple[str, object]], str]] = [(iter((("", content),)), where)]
    while waiting:
        items, place = waiting[-1]
        for key, value in items:
            spot = f"{place}, {key if len(key) <= _LONGEST_KEY else shown(key)}" if key else place
            if isinstance(value, int) and not LOWEST <= value <= HIGHEST:
                raise DictionaryError(spot, f"{shown(value)} is more than 64 bits hold", line=line)
            if not isinstance(value, (dict, list)):
                continue
            if len(waiting) > MAX_DEPTH:
                raise DictionaryError(spot, f"tables and arrays nest at most {MAX_DEPTH} deep", line=line)
            inner = value.items() if isinstance(value, dict) else ((str(at), item) for at, item in enumerate(value, 1))
            waiting.append((iter(inner), spot))
            break
        else:
            waiting.pop()
