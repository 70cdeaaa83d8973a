"""Values by the declared type of their variable, if that differs from the type in the message (docs/s7plus.md).

Used only if the declaration was captured. A value that contradicts its declaration is shown as octets; `contradiction` says
why.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from dissect.protocols.s7.values import date_and_time, date_text, duration, s5time, time_of_day
from dissect.protocols.s7plus.program import AddressMeaning, Program
from dissect.protocols.s7plus.program_tables import DATATYPES
from dissect.protocols.s7plus.program_times import dtl_text, long_date_text, long_duration, long_time_of_day
from dissect.protocols.s7plus.value_tables import (
    BOOL,
    BYTE,
    DINT,
    DWORD,
    INT,
    LINT,
    LREAL,
    LWORD,
    REAL,
    SINT,
    STRUCT,
    TIMESPAN,
    TIMESTAMP,
    UDINT,
    UINT,
    ULINT,
    USINT,
    VALUE_TYPES,
    WORD,
)
from dissect.protocols.s7plus.values import Packed, Value
from dissect.protocols.s7plus.variables import Variable

STRING: Final = 19
WSTRING: Final = 62
DATE_AND_TIME: Final = 14
DTL: Final = 67
#: Id of the structure as which a DTL is sent, and its octets.
DTL_STRUCT: Final = 0x02000000 | DTL
DTL_SIZE: Final = 12
_DATE_AND_TIME_SIZE: Final = 8
#: Octets before the characters of a String; also elements before those of a WString.
_LENGTHS: Final = 2
#: Datatypes of bits: arrays of them are sent with a number of elements different from the declared one.
_BITS: Final = frozenset((1, 40))


def program_value(found: AddressMeaning | None, value: Value) -> str | None:
    """Return the text of a value by its declaration; None if that adds nothing to the value itself.

    The value must not contradict its declaration. A DTL is recognised without a declaration.
    """
    content = value.content
    if isinstance(content, Packed):
        return dtl_text(content.octets) if content.id == DTL_STRUCT and len(content.octets) == DTL_SIZE else None
    variable = found.variable if found is not None else None
    if variable is None:
        return None
    if variable.datatype in {STRING, WSTRING, DATE_AND_TIME}:
        numbers = [one for one in content if isinstance(one, int)] if isinstance(content, list) else []
        if variable.datatype == DATE_AND_TIME:
            return date_and_time(bytes(numbers)) if len(numbers) == _DATE_AND_TIME_SIZE else None
        return _characters(variable.datatype, numbers)
    meaning = _MEANINGS.get(variable.datatype)
    if meaning is None or not isinstance(content, int):
        return None
    return meaning(content)


def program_values(found: AddressMeaning | None, value: Value) -> list[str | None] | None:
    """Return the texts of the elements of an array by its declaration; None if that adds nothing."""
    variable = found.variable if found is not None else None
    content = value.content
    if found is None or variable is None or not found.whole_array or not value.array or not isinstance(content, list):
        return None
    meaning = _MEANINGS.get(variable.datatype)
    if meaning is None or value.type != _SENT_AS.get(variable.datatype):
        return None
    return [meaning(one) if isinstance(one, int) else None for one in content]


def contradiction(found: AddressMeaning, value: Value, program: Program) -> str:
    """Return how a value contradicts the declaration of its variable; empty if it does not."""
    variable = found.variable
    if variable is None:
        return ""
    datatype = variable.datatype
    content = value.content
    declared = DATATYPES.name(datatype)
    if variable.type_id or datatype == DTL:
        if value.type != STRUCT:
            return f"declared as a structure, sent as {value.type_name}"
        wanted = DTL_STRUCT if datatype == DTL and not variable.type_id else variable.type_id
        if isinstance(content, Packed) and content.id != wanted and program.members(content.id) is None:
            return f"declared as the structure 0x{wanted:08x}, sent as 0x{content.id:08x}"
        return ""
    wanted_type = _SENT_AS.get(datatype)
    if wanted_type is None:
        return ""
    if datatype in _ARRAYS_OF:
        return _wrong_characters(variable, value, found.whole_array)
    if value.type != wanted_type:
        return f"declared {declared}, sent as {VALUE_TYPES.name(value.type)}"
    if found.whole_array != (value.array or value.sparse):
        return f"declared {'an array of ' if found.whole_array else ''}{declared}, sent as {_form(value)}"
    if found.whole_array and value.array and isinstance(content, list) and datatype not in _BITS:
        count = variable.count
        if len(content) != count:
            return f"declared with {count} elements, sent with {len(content)}"
    return ""


def _form(value: Value) -> str:
    return "an array" if value.array or value.sparse else "one value"


def _wrong_characters(variable: Variable, value: Value, whole_array: bool) -> str:
    """Return the fault of a String, WString or Date_And_Time, which are sent as arrays of numbers; empty for none."""
    declared = DATATYPES.name(variable.datatype)
    content = value.content
    if value.type != _SENT_AS[variable.datatype] or not value.array or not isinstance(content, list):
        return f"declared {declared}, sent as {value.type_name}{'' if value.array else ' without elements'}"
    if whole_array:
        return ""  # it is unknown how several strings are sent
    count = len(content)
    if variable.datatype == DATE_AND_TIME:
        return "" if count == _DATE_AND_TIME_SIZE else f"declared {declared}, sent with {count} bytes"
    first = content[0] if content else -1
    most = variable.most_characters
    if count < _LENGTHS or first != count - _LENGTHS or content[1] > first or (most and most != first):
        return f"declared {declared}{f'[{most}]' if most else ''}, sent with {count} elements that do not fit it"
    return ""


def _characters(datatype: int, numbers: list[int]) -> str:
    """Return the characters of a String or WString: maximum length, length, then as many elements as the maximum."""
    characters = numbers[_LENGTHS : _LENGTHS + numbers[1]]
    if datatype == STRING:
        return bytes(characters).decode("latin-1")
    return b"".join([number.to_bytes(2, "big") for number in characters]).decode("utf-16-be", "replace")


def _s5time(number: int) -> str | None:
    return s5time(number.to_bytes(2, "big"))


def _char(number: int) -> str | None:
    return chr(number)


#: The text of a number, by declared type.
_MEANINGS: Final[dict[int, Callable[[int], str | None]]] = {
    3: _char,
    9: date_text,
    10: time_of_day,
    11: duration,
    12: _s5time,
    61: _char,
    64: long_duration,
    65: long_time_of_day,
    66: long_date_text,
}
#: Declared types that are sent as arrays of numbers.
_ARRAYS_OF: Final = frozenset((STRING, WSTRING, DATE_AND_TIME))
#: The type in the message for values of a declared type; for other declared types it is unknown.
_SENT_AS: Final[dict[int, int]] = {
    1: BOOL, 2: BYTE, 3: USINT, 4: WORD, 5: INT, 6: DWORD, 7: DINT, 8: REAL, 9: UINT, 10: UDINT, 11: DINT, 12: WORD,
    14: USINT, 19: USINT, 40: BOOL, 48: LREAL, 49: ULINT, 50: LINT, 51: LWORD, 52: USINT, 53: UINT, 54: UDINT, 55: SINT,
    61: UINT, 62: UINT, 64: TIMESPAN, 65: ULINT, 66: TIMESTAMP,
}  # fmt: skip
