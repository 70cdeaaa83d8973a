"""Checks whether a regular expression ends in good time for any text, as Python tries every way in which it can match.

``(a+)+$`` has as many ways as there are divisions of a row of letters: their number doubles with each letter. The ways are
estimated here from the structure of the pattern; one that has too many is refused before it meets a text from the wire.
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Callable, Sequence
from typing import Any, Final

from dissect.meaning.select.errors import SelectError
from dissect.meaning.select.grammar import Literal

#: A text is assumed to have this many characters, and a pattern may have this many ways to match it (powers of ten).
_LENGTH: Final = 1000
_MOST: Final = 9.0

#: Greatest number of characters of a pattern.
_MAX_PATTERN: Final = 200

#: re has no public parser; its internal one has not changed since Python 3.11.
_parser: Any = re._parser  # noqa: SLF001
_REPEATS: Final = frozenset(("MAX_REPEAT", "MIN_REPEAT", "POSSESSIVE_REPEAT"))


def searching(literal: Literal) -> Callable[[str], bool]:
    """Return the search for a regular expression; it ignores case, as in Wireshark."""
    if len(literal.text) > _MAX_PATTERN:
        raise SelectError(
            f"a pattern has at most {_MAX_PATTERN} characters; this one has {len(literal.text)}",
            "", literal.start, literal.end,
        )  # fmt: skip
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings about changes in later Python versions do not help users
            search = re.compile(literal.text, re.IGNORECASE).search
            forever = takes_too_long(literal.text)
    except (re.error, OverflowError, RecursionError) as error:
        raise SelectError(f"invalid regular expression: {error}", "", literal.start, literal.end) from None
    if forever:
        raise SelectError(
            "this regular expression may take forever: a repetition within a repetition, or too many of them",
            "", literal.start, literal.end,
        )  # fmt: skip
    return lambda text: search(text) is not None


def takes_too_long(pattern: str) -> bool:
    """Return whether a pattern has too many ways to match. The pattern must be valid."""
    return _ways(_parser.parse(pattern)) > _MOST


def _ways(items: Sequence[tuple[Any, Any]]) -> float:
    """Return the ways in which a sequence of parts can match, as a power of ten."""
    return sum([_ways_of(str(kind), argument) for kind, argument in items])


def _ways_of(kind: str, argument: Any) -> float:
    if kind in _REPEATS:
        least, most, body = argument
        most = min(int(most), _LENGTH)
        return math.log10(max(most - int(least) + 1, 1)) + _ways(body) * most
    if kind == "SUBPATTERN":
        return _ways(argument[3])
    if kind == "BRANCH":
        return _ways_of_branch(argument[1])
    if kind == "GROUPREF_EXISTS":
        return max([_ways(part) for part in argument[1:] if part])
    if kind in {"ASSERT", "ASSERT_NOT"}:
        return _ways(argument[1])
    return _ways(argument) if kind == "ATOMIC_GROUP" else 0.0


def _ways_of_branch(branches: Sequence[Any]) -> float:
    """Return the ways of alternatives: if each begins with a different letter, a text has only the ways of one of them."""
    begins = [str(branch[0]) if len(branch) else "" for branch in branches]
    own = len(set(begins)) == len(begins) and all([begin.startswith("(LITERAL,") for begin in begins])
    most = max([_ways(branch) for branch in branches])
    return most if own else most + math.log10(len(branches))
