"""Members, by name, of structures of the program, which are sent as the raw octets in the CPU (docs/s7plus.md).

The list of variables of a type gives the places of its members, in the optimised layout and in the classic one; a flag of the
value gives the layout of its octets. This is known from one source only, and no capture has it: structures that do not match
stay octets.
"""

from __future__ import annotations

import math
from typing import Final

from dissect.protocols.s7.singles import real_text
from dissect.protocols.s7.values import date_and_time, date_text, duration, s5time, time_of_day
from dissect.protocols.s7plus.program import Program
from dissect.protocols.s7plus.program_times import dtl_text, long_date_text, long_duration, long_time_of_day
from dissect.protocols.s7plus.program_values import DATE_AND_TIME, DTL, DTL_SIZE, DTL_STRUCT, STRING, WSTRING
from dissect.protocols.s7plus.values import DOUBLE, Packed
from dissect.protocols.s7plus.variables import Variable
from dissect.wire.octets import u16

#: Flag of a packed structure: its octets have the classic layout.
CLASSIC: Final = 0x001
#: Limits: nested structures, and members and elements of one value.
_LEVELS: Final = 8
_MEMBERS: Final = 5000

#: The value of a member: a number, a text, a list, or a dict of members by name.
Member = object

_BOOL: Final = 1
_BBOOL: Final = 40
#: Sizes of types that are numbers; types in `_SIGNED` are two's complement.
_SIZES: Final[dict[int, int]] = {
    2: 1, 3: 1, 4: 2, 5: 2, 6: 4, 7: 4, 8: 4, 9: 2, 10: 4, 11: 4, 12: 2, 14: 8, 48: 8, 49: 8, 50: 8, 51: 8, 52: 1,
    53: 2, 54: 4, 55: 1, 61: 2, 64: 8, 65: 8, 66: 8, DTL: DTL_SIZE,
}  # fmt: skip
_SIGNED: Final = frozenset((5, 7, 11, 50, 55, 64))


class _UnknownError(Exception):
    """It is unknown how to read the octets."""


class _MisfitError(Exception):
    """The octets do not fit the declaration."""


class _Reading:
    """Reads one value; ``left`` is the number of further members and elements that it may have."""

    __slots__ = ("classic", "left", "octets", "program")

    def __init__(self, packed: Packed, program: Program) -> None:
        self.octets = packed.octets
        self.program = program
        self.classic = packed.flags & CLASSIC != 0
        self.left = _MEMBERS

    def members(self, type_id: int, at: int, level: int) -> dict[str, Member]:
        """Return the members of a structure that begins at ``at``."""
        known = self.program.members(type_id)
        if known is None or level > _LEVELS:
            raise _UnknownError
        return {name: self._member(variable, at, level) for name, variable in known}

    def _member(self, variable: Variable, at: int, level: int) -> Member:
        self._spend()
        begin = at + variable.offset(self.classic)
        if not variable.is_array:
            return self._one(variable, begin, level)
        size = self._stride(variable)
        if size <= 0:
            raise _UnknownError  # as of bits: it is unknown how they are packed
        return [
            self._one(variable, begin + number * size, level) for number in range(min(variable.count, _MEMBERS + 1))
        ]

    def _stride(self, variable: Variable) -> int:
        if variable.type_id:
            return variable.element_size(self.classic)
        if variable.datatype == STRING:
            return variable.most_characters + 2
        return _SIZES.get(variable.datatype, 0)

    def _spend(self) -> None:
        self.left -= 1
        if self.left < 0:
            raise _UnknownError

    def _one(self, variable: Variable, at: int, level: int) -> Member:
        self._spend()
        datatype = variable.datatype
        if datatype == DTL or variable.type_id == DTL_STRUCT:
            return dtl_text(self._take(at, DTL_SIZE))
        if variable.type_id:
            return self.members(variable.type_id, at, level + 1)
        if datatype == _BOOL or datatype == _BBOOL:
            return bool(self._take(at, 1)[0] >> variable.bit(self.classic) & 1)
        if datatype == STRING:
            most, length = self._take(at, 2)
            return self._text(at + 2, most, length, variable, 1)
        if datatype == WSTRING:
            head = self._take(at, 4)
            return self._text(at + 4, u16(head, 0), u16(head, 2), variable, 2)
        size = _SIZES.get(datatype, 0)
        if size == 0:
            raise _UnknownError
        return _scalar(datatype, self._take(at, size))

    def _text(self, at: int, most: int, length: int, variable: Variable, width: int) -> Member:
        declared = variable.most_characters
        if length > most or (declared and most != declared):
            raise _MisfitError
        octets = self._take(at, length * width)
        return octets.decode("latin-1") if width == 1 else octets.decode("utf-16-be", "replace")

    def _take(self, at: int, size: int) -> bytes:
        if at + size > len(self.octets):
            raise _MisfitError
        return self.octets[at : at + size]


def _scalar(datatype: int, octets: bytes) -> Member:
    if datatype == 8:
        return _float(float(real_text(octets)))
    if datatype == 48:
        return _float(DOUBLE.unpack(octets)[0])
    if datatype == DATE_AND_TIME:
        return date_and_time(octets)
    if datatype == 12:
        return s5time(octets)
    number = int.from_bytes(octets, "big", signed=datatype in _SIGNED)
    if datatype == 3 or datatype == 61:
        return chr(number)
    if datatype == 9:
        return date_text(number)
    if datatype == 10:
        return time_of_day(number)
    if datatype == 11:
        return duration(number)
    if datatype == 64:
        return long_duration(number)
    if datatype == 65:
        return long_time_of_day(number)
    if datatype == 66:
        return long_date_text(int.from_bytes(octets, "big"))
    return number


def _float(number: float) -> Member:
    """Return a number, or its text if JSON has no such number."""
    return number if math.isfinite(number) else repr(number)


def packed_members(packed: Packed, program: Program) -> dict[str, Member] | None:
    """Return the members of a structure of the program by name; None if its type was not captured or does not match.

    Never raises.
    """
    return _read(packed, program)[0]


def misfit(packed: Packed, program: Program) -> bool:
    """Return whether the octets of a structure contradict the declaration of its type, if that was captured."""
    return _read(packed, program)[1]


def _read(packed: Packed, program: Program) -> tuple[dict[str, Member] | None, bool]:
    try:
        return _Reading(packed, program).members(packed.id, 0, 0), False
    except _UnknownError:
        return None, False
    except _MisfitError:
        return None, True
