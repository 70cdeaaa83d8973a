"""What somebody may have meant by a name that is not there."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import islice
from typing import Final

#: Names that are compared with one that is not there, characters of one that are, and names that a hint has.
_MOST_COMPARED: Final = 4096
_LONGEST: Final = 200
_MOST_SHOWN: Final = 3
#: How much alike two names are (`difflib`): with it a name is worth a hint, or surely meant.
_ALIKE: Final = 0.6
SURELY: Final = 0.7


def close_names(written: str, names: Iterable[str], alike: float = _ALIKE) -> list[str]:
    """Return at most three of ``names`` that are much like ``written``, the closest first, also where only case differs."""
    from difflib import get_close_matches  # where nothing is written wrong, it is not needed

    known = list(islice(names, _MOST_COMPARED))
    found = get_close_matches(written[:_LONGEST], known, _MOST_SHOWN, alike)
    if found:
        return found
    lower = {name.lower(): name for name in known}
    return [lower[name] for name in get_close_matches(written[:_LONGEST].lower(), lower, _MOST_SHOWN, alike)]


def close_to(written: str, names: Iterable[str]) -> str:
    """Return "; close to it: 'a', 'b'" for an error, empty where no name is."""
    found = close_names(written, names)
    return f"; close to it: {', '.join(repr(name) for name in found)}" if found else ""
