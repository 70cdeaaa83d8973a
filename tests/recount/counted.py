"""Counts for each rule that transactions show directly."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from tests.recount.recount import Json, item_errors

_WRITE: Final = 5
#: The function that writes variables in S7comm-plus, and those that may do so in contents that their row does not show as
#: items.
_PLUS_WRITE: Final = "SetMultiVariables"
_PLUS_ALSO: Final = frozenset(("SetVariable", "SetVarSubStreamed"))
_OUTPUTS: Final = frozenset((0x80, 0x82))
#: Kinds of messages of S7comm with functions: others are judged by their contents.
_JOB: Final = 1
#: Places of an error that refuses a request as a whole.
WHOLE: Final = frozenset(("header", "parameter", "data"))

Rule = Callable[[list[Json]], list[Json] | None]


def _refused(rows: list[Json]) -> list[Json] | None:
    """Requests that were refused as a whole; None if S7comm-plus has its own refusals."""
    if any([one.get("s7plus") or one.get("protocol") for one in rows]):
        return None
    return [one for one in rows if any([error["where"] in WHOLE for error in one["errors"]])]


def _writes(rows: list[Json]) -> list[Json] | None:
    """Writes to areas, of S7comm and S7comm-plus; None if other functions write as well."""
    if any([one["userdata"]["group"] == 1 for one in rows if one.get("userdata")]):
        return None
    if any([one["function"]["name"] in _PLUS_ALSO for one in rows if one.get("s7plus")]):
        return None
    return [one for one in rows if _is_write(one)]


def _is_write(one: Json) -> bool:
    if one.get("s7plus"):
        return bool(one["function"]["name"] == _PLUS_WRITE) and any(
            [item.get("area") is not None for item in one["items"]]
        )
    return bool(one["rosctr"] == _JOB and one["function"]["code"] == _WRITE)


def _accepted(outputs: bool) -> Rule:
    """Return a function that finds writes with an accepted item of outputs, or of other areas."""

    def found(rows: list[Json]) -> list[Json] | None:
        writes = _writes(rows)
        if writes is None:
            return None
        return [one for one in writes if one["request_frame"] and _wrote(one, outputs)]

    return found


def _wrote(one: Json, outputs: bool) -> bool:
    wrong = {error["where"] for error in one["errors"] if error["code"] is not None}
    if wrong & WHOLE:
        return False
    areas = [item.get("area") for number, item in enumerate(one["items"], 1) if f"item {number}" not in wrong]
    return any([(area in _OUTPUTS) == outputs for area in areas])


def _writes_refused(rows: list[Json]) -> list[Json] | None:
    writes = _writes(rows)
    return None if writes is None else [one for one in writes if _has_codes(one)]


def _has_codes(one: Json) -> bool:
    """Return whether a write was refused in part: without a return code this is unknown."""
    return any([error["code"] is not None for error in one["errors"]])


#: The transactions that show a rule, one for each time it applied; None if they do not show it.
RULES: Final[Mapping[str, Rule]] = {
    "transaction.item_error": item_errors,
    "transaction.unanswered": lambda rows: [one for one in rows if one["missed"]],
    "transaction.refused": _refused,
    "security.write": _accepted(False),
    "security.write_outputs": _accepted(True),
    "security.write_refused": _writes_refused,
}
#: Rules that report each event. The others report the first event of a connection, and count the rest.
EACH: Final = frozenset(("transaction.item_error", "transaction.unanswered", "transaction.refused"))


def host_of(end: str) -> str:
    """Return the host of ``10.0.0.1:102`` or ``[fe80::1]:102``."""
    return end.rpartition(":")[0].strip("[]")
