"""Values as the program means them: the type that a variable was declared with, over the one it is sent with (docs/s7plus.md).

Used only where the declaration passed in the capture. A value that does not fit its declaration stays as it was sent.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.s7.values import date_and_time, date_text, duration, s5time, time_of_day
from dissect.s7plus.value_tables import DINT, UDINT, UINT, USINT, WORD
from dissect.s7plus.values import Value
from dissect.s7plus.variables import Variable

_STRING: Final = 19
_WSTRING: Final = 62
_DATE_AND_TIME: Final = 14
#: Kinds of variables that are no arrays.
_PLAIN: Final = frozenset((1, 2, 8, 9))


def program_value(variable: Variable, value: Value) -> str | None:
    """Return a value as its declaration means it, None where it says nothing else than the value itself, or does not fit."""
    content = value.content
    if variable.datatype in {_STRING, _WSTRING, _DATE_AND_TIME}:
        numbers = [one for one in content if isinstance(one, int)] if value.array and isinstance(content, list) else []
        if variable.datatype == _DATE_AND_TIME:
            return (
                date_and_time(bytes(numbers)) if value.type == USINT and len(numbers) == _DATE_AND_TIME_SIZE else None
            )
        return _characters(variable.datatype, value.type, numbers)
    row = _TYPES.get(variable.datatype)
    if row is None or value.array or value.sparse or variable.kind not in _PLAIN or not isinstance(content, int):
        return None
    type_, meaning = row
    return meaning(content) if value.type == type_ else None


def _characters(datatype: int, type_: int, numbers: list[int]) -> str | None:
    """Return the characters of a String or WString: maximum, length, and as many elements as the maximum."""
    if len(numbers) < 2 or numbers[0] != len(numbers) - 2 or numbers[1] > numbers[0]:
        return None
    characters = numbers[2 : 2 + numbers[1]]
    if datatype == _STRING and type_ == USINT:
        return bytes(characters).decode("latin-1")
    if datatype == _WSTRING and type_ == UINT:
        return b"".join([number.to_bytes(2, "big") for number in characters]).decode("utf-16-be", "replace")
    return None


def _s5time(number: int) -> str | None:
    return s5time(number.to_bytes(2, "big"))


def _char(number: int) -> str | None:
    return chr(number)


_DATE_AND_TIME_SIZE: Final = 8
#: By declared type: the type it is sent with, and what its number means.
_TYPES: Final[dict[int, tuple[int, Callable[[int], str | None]]]] = {
    3: (USINT, _char),
    9: (UINT, date_text),
    10: (UDINT, time_of_day),
    11: (DINT, duration),
    12: (WORD, _s5time),
    61: (UINT, _char),
}
