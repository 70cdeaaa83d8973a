"""Bounds of a source that are checked before it is read: nesting, and sizes of numbers.

Python's TOML and JSON accept more. Otherwise they would fail later (in texts of errors, in copies for devices) in ways that
have nothing to do with dictionaries.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from dissect.scd.errors import DictionaryError, shown
from dissect.wire.config.hostile import MAX_DEPTH

#: Whole numbers of a source fit 64 bits, signed or unsigned.
LOWEST: Final = -(1 << 63)
HIGHEST: Final = (1 << 64) - 1
#: Longer keys are cut in errors.
_LONGEST_KEY: Final = 100


def check_bounds(content: object, where: str, line: int = 0) -> None:
    """Raise `DictionaryError` with the place of a part that nests too deeply, or of a whole number of more than 64 bits.

    ``content`` is one table of a source, ``where`` its name, ``line`` its line.
    """
    waiting: list[tuple[Iterator[tuple[str, object]], str]] = [(iter((("", content),)), where)]
    while waiting:
        items, place = waiting[-1]
        for key, value in items:
            spot = f"{place}, {key if len(key) <= _LONGEST_KEY else shown(key)}" if key else place
            if isinstance(value, int) and not LOWEST <= value <= HIGHEST:
                raise DictionaryError(spot, f"{shown(value)} does not fit 64 bits", line=line)
            if not isinstance(value, (dict, list)):
                continue
            if len(waiting) > MAX_DEPTH:
                raise DictionaryError(spot, f"tables and arrays nest at most {MAX_DEPTH} deep", line=line)
            inner = value.items() if isinstance(value, dict) else ((str(at), item) for at, item in enumerate(value, 1))
            waiting.append((iter(inner), spot))
            break
        else:
            waiting.pop()
