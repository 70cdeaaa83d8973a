"""Faults on demand: their kinds, and the requests they apply to."""

from __future__ import annotations

import re
from collections.abc import Sequence
from fnmatch import fnmatchcase
from typing import Final, NamedTuple

from dissect.protocols.s7.message import Pdu
from dissect.testing.playback.server.answers import NOT_AVAILABLE

DROP: Final = "drop"
DELAY: Final = "delay"
REFUSE: Final = "refuse"
CUT: Final = "cut"
WRONG_REF: Final = "wrong-ref"
SPLIT: Final = "split"

#: The faults and their effects.
KINDS: Final = {
    DROP: "no answer",
    DELAY: "the answer comes MS milliseconds later",
    REFUSE: "the request is refused with CODE (default 0x8104)",
    CUT: "the connection is reset instead of an answer",
    WRONG_REF: "the answer has the reference of another request",
    SPLIT: "the answer comes in segments of 7 bytes",
}
_MAX_MS: Final = 3_600_000
_HEX: Final = re.compile("0x[0-9a-fA-F]{1,4}")
#: Texts that would otherwise be patterns without a match: refuse:3:8104, drop:3:250.
_NUMBER_AND_MORE: Final = re.compile("[0-9]+:.*")


class Fault(NamedTuple):
    """A fault of ``kind`` at request ``number`` (1 is the first; 0 for any), or at those that ``pattern`` matches.

    ``value`` is the delay in milliseconds, or the error code.
    """

    kind: str
    number: int = 0
    pattern: str = ""
    value: float = 0

    def hits(self, number: int, request: Pdu) -> bool:
        """Return whether it applies to a request, by its number, its function or the address of one of its items."""
        return self.named(number, [request.function_name, *[item.address for item in request.parameters.items]])

    def named(self, number: int, names: Sequence[str]) -> bool:
        """Return whether it applies to a request with a number and any of these names."""
        if self.number:
            return number == self.number
        return any([fnmatchcase(name.upper(), self.pattern.upper()) for name in names])


def parse_fault(text: str) -> Fault:
    """Parse ``KIND:WHERE``, for a delay ``delay:WHERE:MS``, for a refusal also ``refuse:WHERE:0xCODE``. Raises ValueError.

    WHERE is the number of a request or a pattern with ``*`` and ``?`` for the name of a function or an address.
    """
    kind, _, where = text.partition(":")
    if kind not in KINDS or not where:
        raise ValueError(
            f"{text!r} is not a fault: expected KIND:WHERE, KIND one of {', '.join(KINDS)}, WHERE a number or a pattern"
        )
    value: float = NOT_AVAILABLE if kind == REFUSE else 0
    if kind == DELAY:
        where, _, ms = where.rpartition(":")
        try:
            value = float(ms)
        except ValueError:
            value = -1
        if not where or not 0 <= value <= _MAX_MS:
            raise ValueError(f"{text!r}: a delay is delay:WHERE:MS, for example delay:3:250, at most {_MAX_MS} ms")
    elif kind == REFUSE and _HEX.fullmatch(where.rpartition(":")[2]):
        where, _, code = where.rpartition(":")
        value = int(code, 16)
        if not where or not value:
            raise ValueError(f"{text!r}: a refusal is refuse:WHERE or refuse:WHERE:0xCODE, and CODE is not 0")
    if _NUMBER_AND_MORE.fullmatch(where):
        forms = {DELAY: "delay:WHERE:MS", REFUSE: "refuse:WHERE or refuse:WHERE:0xCODE"}
        form = forms.get(kind, f"{kind}:WHERE")
        raise ValueError(f"{text!r}: expected {form}, WHERE a number or a pattern")
    if where.isascii() and where.isdigit():
        number = int(where)
        if not 1 <= number <= 1_000_000_000:
            raise ValueError(f"{text!r}: requests are counted from 1")
        return Fault(kind, number, "", value)
    return Fault(kind, 0, where, value)
