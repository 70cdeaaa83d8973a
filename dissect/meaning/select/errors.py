"""`SelectError`: the fault of an expression, and its place."""

from __future__ import annotations

import re
import unicodedata
from typing import Final

from dissect.wire.errors import Error
from dissect.wire.text import printable

#: This many characters of an expression are shown before the wrong place, and as many after its beginning.
_SHOWN: Final = 70


class SelectError(Error, ValueError):
    """An invalid expression: ``reason`` is one sentence, ``text[start:end]`` the part of the expression that is wrong."""

    def __init__(self, reason: str, text: str = "", start: int = 0, end: int = 0) -> None:
        super().__init__(reason)
        self.reason = reason
        self.text = text
        self.start = start
        self.end = end

    def within(self, text: str, start: int, end: int) -> SelectError:
        """Return the same error with its place, unless it has one."""
        return self if self.text else SelectError(self.reason, text, start, end)

    def lines(self) -> list[str]:
        """Return the reason, the expression, and a mark below the wrong part; escaped."""
        if not self.text:
            return [printable(self.reason)]
        first = max(0, min(self.start, len(self.text)) - _SHOWN)
        shown = self.text[first : first + 2 * _SHOWN]
        before = "… " if first else ""
        line = "".join([_one(character) for character in shown])
        indent = len(before) + sum([_width(character) for character in line[: self.start - first]])
        size = max(1, min(self.end, first + len(shown)) - self.start)
        after = " …" if first + len(shown) < len(self.text) else ""
        return [printable(self.reason), f"  {before}{line}{after}", f"  {' ' * indent}{'^' * size}"]

    def __str__(self) -> str:
        return "\n".join(self.lines())


def _one(character: str) -> str:
    """Return one printable character for any character, so that the mark stays in its place; "?" if it cannot be printed."""
    if character.isspace():
        return " "
    return character if printable(character) == character else "?"


def _width(character: str) -> int:
    return 2 if unicodedata.east_asian_width(character) in {"W", "F"} else 1


def range_hint(text: str) -> str:
    """Return a hint on the notation of ranges, if a text writes one in another way."""
    found = re.fullmatch(r"([0-9]+)(?:-|\.\.\.?)([0-9]+)", text)
    return f", or with `in` the range {found[1]}..{found[2]}" if found else ""
