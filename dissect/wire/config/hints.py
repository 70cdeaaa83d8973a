"""Suggestions for a name that does not exist."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Final

#: At most this many names are compared, this many characters of a name, and this many names suggested.
_MOST_COMPARED: Final = 4096
_LONGEST: Final = 200
_MOST_SHOWN: Final = 3
#: How similar two names must be (`difflib`): to be suggested, or to be taken as meant.
_ALIKE: Final = 0.6
SURELY: Final = 0.7


def close_names(written: str, names: Iterable[str], alike: float = _ALIKE) -> list[str]:
    """Return at most three of ``names`` that are similar to ``written``, the closest first; case is ignored."""
    from difflib import get_close_matches  # not needed if every name is right

    known = list(islice(names, _MOST_COMPARED))
    found = get_close_matches(written[:_LONGEST], known, _MOST_SHOWN, alike)
    if found:
        return found
    lower = {name.lower(): name for name in known}
    return [lower[name] for name in get_close_matches(written[:_LONGEST].lower(), lower, _MOST_SHOWN, alike)]


def close_to(written: str, names: Iterable[str]) -> str:
    """Return "; close to it: 'a', 'b'" for an error message; empty if no name is similar."""
    found = close_names(written, names)
    return f"; close to it: {', '.join(repr(name) for name in found)}" if found else ""
