"""Compare the items of two read or write requests: which are new, gone or moved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Final

from dissect.protocols.s7.tables import WRITE_VAR
from dissect.testing.golden.addresses import named_item
from dissect.testing.golden.exchange import Exchange
from dissect.testing.golden.keys import subject
from dissect.testing.golden.phrases import Change, short
from dissect.wire.text import some

#: Maximum number of items that are named.
_NAMED: Final = 5


def item_changes(one: Exchange, other: Exchange) -> Change:
    """Describe how the items of two requests differ; both are reads or both are writes."""
    before, after = _names(one), _names(other)
    gone, new = _without(before, after), _without(after, before)
    verb = "writes" if one.function == WRITE_VAR else "requests"
    if len(before) == len(after) == 1:
        was, is_ = subject(one), subject(other)
        if was == is_:  # the items have the same names: their types differ
            was, is_ = before[0], after[0]
        text = f"{verb} {_without_verb(is_)} instead of {_without_verb(was)}"
    elif gone and new:
        was, is_ = some(list(gone), _NAMED), some(list(new), _NAMED)
        text = f"{verb} {is_} instead of {was}"
    elif new:
        was, is_ = "", some(list(new), _NAMED)
        text = f"{verb} {is_} as well"
    elif gone:
        was, is_ = some(list(gone), _NAMED), ""
        text = f"no longer {verb} {was}"
    else:
        was, is_ = some(list(before), _NAMED), some(list(after), _NAMED)
        text = f"{verb} the same items in a different order"
    return Change("requests", text, was, is_, targets=(one.function_name,))


def _without_verb(what: str) -> str:
    """Return the items of a subject without its verb: ``DB10.DBW2`` for ``READ DB10.DBW2``."""
    return what.removeprefix("READ ").removeprefix("WRITE ")


def _names(exchange: Exchange) -> list[str]:
    request = exchange.request_pdu
    return [short(named_item(item)) for item in request.parameters.items] if request is not None else []


def _without(names: Sequence[str], others: Sequence[str]) -> list[str]:
    """Return the names, in order, that ``others`` does not have or has less often."""
    left = Counter(others)
    rest = []
    for name in names:
        left[name] -= 1
        if left[name] < 0:
            rest.append(name)
    return rest
