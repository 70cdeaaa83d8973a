"""How each face writes each kind of value: the value that can be read back, and how much of it the face can show.

A fact is compared in one form: times and durations in nanoseconds, octets in hexadecimal digits, ends as `address:port`,
nothing as None. `READ` has the readers of each family of faces; if a family shows less than all, `TELLS` checks whether its
value agrees.
"""

from __future__ import annotations

import datetime
import re
from collections.abc import Callable
from decimal import Decimal
from typing import Any, Final

COUNT: Final = "count"
TIME: Final = "time"
DURATION: Final = "duration"
END: Final = "end"
WORD: Final = "word"
FLAG: Final = "flag"
OCTETS: Final = "octets"
WORDS: Final = "words"
COUNTS: Final = "counts"
NUMBER: Final = "number"

#: A face that does not show whether it has a fact: there is nothing to compare.
UNTOLD: Final = object()

Reader = Callable[[Any], Any]
#: Returns whether the second value, from a face, agrees with the first.
Agrees = Callable[[Any, Any], bool]

_EPOCH: Final = datetime.datetime(1970, 1, 1, tzinfo=datetime.UTC)
_UNITS: Final = {
    "µs": 1_000,
    "ms": 1_000_000,
    "s": 1_000_000_000,
    "min": 60 * 10**9,
    "h": 3600 * 10**9,
    "d": 86400 * 10**9,
}
_PART: Final = re.compile(r"(-?[\d.]+) (µs|ms|s|min|h|d)\b")


def iso_ns(text: str) -> int:
    """Return a time in ISO 8601 as nanoseconds since 1970; a time for people has a blank and its zone."""
    day, _, rest = text.removesuffix(" UTC").removesuffix("Z").replace(" ", "T").partition(".")
    seconds = (datetime.datetime.fromisoformat(f"{day}+00:00") - _EPOCH).total_seconds()
    return int(seconds) * 10**9 + int(rest.ljust(9, "0") or 0)


def said_ns(text: str) -> tuple[Decimal, Decimal]:
    """Return the minimum and maximum nanoseconds of a duration for people: it is rounded, and long ones are cut."""
    parts = _PART.findall(text)
    if not parts:
        raise ValueError(f"no duration: {text!r}")
    told = sum([Decimal(number) * _UNITS[unit] for number, unit in parts], Decimal(0))
    digits, unit = parts[-1]
    step = Decimal(1).scaleb(-len(digits.partition(".")[2])) * _UNITS[unit]
    if len(parts) > 1:
        return told, told + step
    return told - step / 2, told + step / 2


def _number(text: str) -> Any:
    return float(text) if re.search(r"[.en]", text) else int(text)


def _truth(text: str) -> bool:
    return {"true": True, "false": False}[text]


def _same(value: Any) -> Any:
    return value


def _split(text: str) -> list[str]:
    return text.split(",")


def _seconds(value: Decimal) -> int:
    return int(value * 10**9)


def _uncelled(text: str) -> str:
    """Return a text without the quote that keeps a spreadsheet from running it as a formula."""
    return re.sub(r"^'(?=[=+\-@])", "", text)


def _hexadecimal(value: bytes) -> str:
    return value.hex()


#: By family of faces and kind: the reader of a present value. An empty cell, and null, mean nothing.
READ: Final[dict[str, dict[str, Reader]]] = {
    "tables": {OCTETS: _hexadecimal},
    "json": {TIME: iso_ns},
    "cells": {WORD: _uncelled, COUNT: int, TIME: iso_ns, DURATION: int, FLAG: _truth, NUMBER: _number},
    "fields": {
        COUNT: int, TIME: iso_ns, DURATION: int, FLAG: _truth, NUMBER: _number, WORDS: _split,
        COUNTS: lambda text: [int(one) for one in text.split(",")],
    },
    "zeek": {TIME: _seconds, DURATION: _seconds, NUMBER: float},
    "people": {COUNT: int, TIME: iso_ns, DURATION: said_ns},
}  # fmt: skip


def _within(value: int | None, told: Any) -> bool:
    return value is not None and told[0] <= value <= told[1] if told is not None else value is None


def _to_microseconds(value: int | None, told: Any) -> bool:
    """Cut, not rounded, towards zero."""
    return (
        value is not None and (abs(value) // 1000, value < -999) == (abs(told) // 1000, told < 0)
        if told is not None
        else value is None
    )


#: By family and kind: the check whether a shown value agrees, if a family shows less than all of it.
TELLS: Final[dict[str, dict[str, Agrees]]] = {
    "zeek": {TIME: _to_microseconds, DURATION: _to_microseconds},
    "people": {TIME: _to_microseconds, DURATION: _within},
}


def read_as(family: str, kind: str, value: Any) -> Any:
    """Return the value that a face of a family wrote, in the form in which facts are compared."""
    if value is UNTOLD or value is None or (value == "" and family in {"cells", "fields", "people"}):
        return value if value is UNTOLD else None
    return READ[family].get(kind, _same)(value)
