"""What is counted of each rule that transactions show by themselves."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from tests.recount.recount import Json, item_errors

#: The transactions that show a rule, one for each time it applied.
RULES: Final[Mapping[str, Callable[[list[Json]], list[Json]]]] = {
    "transaction.item_error": item_errors,
    "transaction.unanswered": lambda rows: [one for one in rows if one["missed"] and not one["deaf"]],
}


def host_of(end: str) -> str:
    """Return the host of ``10.0.0.1:102`` or ``[fe80::1]:102``."""
    return end.rpartition(":")[0].strip("[]")
