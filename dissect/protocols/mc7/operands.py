"""Operands of MC7 instructions, and the encoding of each operand form (reference sheet mc7.md, section 5).

A form (`Shape`) converts the first word of an instruction and the value after it to an `Operand`, and back. Addresses are in
bits (byte times 8 plus bit), widths in bytes; width 0 is a single bit.
"""

from __future__ import annotations

from typing import Final, NamedTuple, Protocol

# Kinds of operands.
NONE: Final = "none"
COUNT: Final = "count"  # a plain number: INC 1, SLW 4, BLD 1
FIXED: Final = "fixed"  # a name without an address: DBNO, OV, AR2
CONSTANT: Final = "constant"  # `area` is its type, for example S5T#
POINTER: Final = "pointer"  # P#M 0.0
MEMORY: Final = "memory"  # an address
NUMBERED: Final = "numbered"  # a timer, counter or block
PARAMETER: Final = "parameter"  # a parameter of the block itself, by position
JUMP: Final = "jump"  # a distance
JUMP_LIST: Final = "jump list"  # number of entries


class Operand(NamedTuple):
    """One operand.

    ``area`` has the letters of an area (I, Q, M, DB, DI, L, PI, PQ; empty if a register also contains the area) or of a
    numbered object (T, C, DB, FC …), the type of a constant, or the way in which a parameter is used. ``number`` is the bit
    address, number, position or raw value. An indirect operand has its pointer in ``via``: AR1 or AR2, with the offset in bits
    in ``number``; or the letters of a pointer in memory (MD, LW …), with its byte address in ``number``.
    """

    kind: str
    area: str = ""
    width: int = 0
    number: int = 0
    via: str = ""


NO_OPERAND: Final = Operand(NONE)

#: Areas by their nibble in instructions; 0 is the periphery, for instructions that can address it.
AREAS: Final = ("P", "I", "Q", "M", "DB", "DI", "L")
#: Memory areas that may contain a pointer.
PLACES: Final[dict[int, str]] = {3: "M", 4: "DB", 5: "DI", 6: "L"}
_PLACE_OF: Final = {letters: nibble for nibble, letters in PLACES.items()}
_AREA_OF: Final = {letters: nibble for nibble, letters in enumerate(AREAS)} | {"PI": 0, "PQ": 0}

#: Area bytes of a pointer (``P#``); V is the local data of the caller.
POINTER_AREAS: Final[dict[int, str]] = {
    0x00: "",
    0x80: "P",
    0x81: "I",
    0x82: "Q",
    0x83: "M",
    0x84: "DBX",
    0x85: "DIX",
    0x86: "L",
    0x87: "V",
}
POINTER_BYTES: Final = {letters: number for number, letters in POINTER_AREAS.items()}

#: The first word of an instruction and the value after it; None if the form cannot encode the operand.
Encoded = tuple[int, int] | None


class Shape(Protocol):
    """A form of operands.

    ``firsts`` are the first bytes of the row that uses it; ``value`` is the part after the first word.
    """

    title: str

    def decode(self, word: int, value: int) -> Operand:
        """Return the operand of an instruction."""
        ...

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the first word and the value for an operand; None if this form cannot encode it."""
        ...


class Plain:
    """No operand."""

    title = "none"

    def __init__(self, second: int = 0) -> None:
        self._second = second

    def decode(self, word: int, value: int) -> Operand:
        """Return no operand."""
        return NO_OPERAND

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return only the word."""
        return (firsts[0] << 8 | self._second, 0) if operand.kind == NONE else None


class Fixed:
    """A name implied by the instruction: ``L DBNO``, ``A OV``."""

    def __init__(self, second: int, name: str) -> None:
        self._second = second
        self._name = name
        self.title = name

    def decode(self, word: int, value: int) -> Operand:
        """Return the name."""
        return Operand(FIXED, self._name)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word that implies the name."""
        return (firsts[0] << 8 | self._second, 0) if operand == (FIXED, self._name, 0, 0, "") else None


class Count:
    """A plain number in the second byte, counted from ``base`` in steps of ``step``."""

    def __init__(self, base: int = 0, step: int = 1, most: int = 255) -> None:
        self._base = base
        self._step = step
        self._most = most
        self.title = f"number 0 to {most}"

    def decode(self, word: int, value: int) -> Operand:
        """Return the number."""
        return Operand(COUNT, "", 0, ((word & 0xFF) - self._base) // self._step)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the number."""
        if operand.kind != COUNT or not 0 <= operand.number <= self._most:
            return None
        return firsts[0] << 8 | (self._base + operand.number * self._step), 0


class ShortNumber:
    """The number of a timer, counter or block in the second byte."""

    def __init__(self, area: str) -> None:
        self._area = area
        self.title = f"{area} 0 to 255"

    def decode(self, word: int, value: int) -> Operand:
        """Return the numbered object."""
        return Operand(NUMBERED, self._area, 0, word & 0xFF)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the number."""
        if operand.kind != NUMBERED or operand.area != self._area or operand.via or operand.number > 0xFF:
            return None
        return firsts[0] << 8 | operand.number, 0


class LongNumber:
    """The number of a timer, counter or block in the word after the first one."""

    def __init__(self, second: int, area: str) -> None:
        self._second = second
        self._area = area
        self.title = f"{area} 0 to 65535"

    def decode(self, word: int, value: int) -> Operand:
        """Return the numbered object."""
        return Operand(NUMBERED, self._area, 0, value)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the first word and the number after it."""
        if operand.kind != NUMBERED or operand.area != self._area or operand.via:
            return None
        return firsts[0] << 8 | self._second, operand.number


class NumberVia:
    """A numbered object whose number is in memory: ``T [MW 4]``. The high nibble is the area of the pointer."""

    def __init__(self, low: int, area: str, high: int = 0) -> None:
        self._low = low
        self._area = area
        self._high = high
        self.title = f"{area} [MW, DBW, DIW, LW]"

    def decode(self, word: int, value: int) -> Operand:
        """Return the numbered object and where its number is."""
        return Operand(NUMBERED, self._area, 0, value, PLACES[(word >> 4 & 15) - self._high] + "W")

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the place of the pointer, and its byte."""
        place = _PLACE_OF.get(operand.via[:-1]) if operand.via.endswith("W") else None
        if operand.kind != NUMBERED or operand.area != self._area or place is None:
            return None
        return firsts[0] << 8 | (place + self._high) << 4 | self._low, operand.number


class Short:
    """A byte, word or double word whose byte address is the second byte."""

    def __init__(self, area: str, width: int, base: int = 0, most: int = 255) -> None:
        self._area = area
        self._width = width
        self._base = base
        self._most = most
        self.title = f"{area}{'BW D'[width - 1]} 0 to {most}"

    def decode(self, word: int, value: int) -> Operand:
        """Return the address."""
        return Operand(MEMORY, self._area, self._width, ((word & 0xFF) - self._base) * 8)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the byte address."""
        at, bit = divmod(operand.number, 8)
        if operand[:3] != (MEMORY, self._area, self._width) or operand.via or bit or at > self._most:
            return None
        return firsts[0] << 8 | (self._base + at), 0


class ShortBit:
    """A bit: its number in the low three bits of the first byte, its byte address in the second."""

    def __init__(self, area: str, base: int = 0, most: int = 255) -> None:
        self._area = area
        self._base = base
        self._most = most
        self.title = f"{area} 0.0 to {most}.7"

    def decode(self, word: int, value: int) -> Operand:
        """Return the address of the bit."""
        return Operand(MEMORY, self._area, 0, ((word & 0xFF) - self._base) * 8 + (word >> 8 & 7))

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with byte and bit."""
        at, bit = divmod(operand.number, 8)
        if operand[:3] != (MEMORY, self._area, 0) or operand.via or at > self._most:
            return None
        return firsts[bit] << 8 | (self._base + at), 0


class Bit:
    """A bit: its area in the high nibble, its number in the low one, its byte address in the word after it."""

    title = "I, Q, M, L, DBX, DIX 0.0 to 65535.7"

    def __init__(self, high: int) -> None:
        self._high = high

    def decode(self, word: int, value: int) -> Operand:
        """Return the address of the bit."""
        return Operand(MEMORY, AREAS[(word >> 4 & 15) - self._high], 0, value * 8 + (word & 7))

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with area and bit, and the byte address."""
        area = _AREA_OF.get(operand.area, 0)
        if operand.kind != MEMORY or operand.width or operand.via or not area:
            return None
        return firsts[0] << 8 | (area + self._high) << 4 | (operand.number & 7), operand.number >> 3


class Via:
    """A bit, byte, word or double word whose address is in memory: ``DBW [LD 20]``.

    High nibble: the place of the pointer, plus ``high``; low nibble: the area, plus ``low``; ``periphery`` are the letters of
    area 0, empty if it has none.
    """

    def __init__(self, width: int, high: int, low: int, periphery: str = "") -> None:
        self._width = width
        self._high = high
        self._low = low
        self._periphery = periphery
        self.title = f"{('bit', 'byte', 'word', '', 'double word')[width]} [MD, DBD, DID, LD]"

    def decode(self, word: int, value: int) -> Operand:
        """Return the area and where the address is."""
        area = AREAS[(word & 15) - self._low]
        place = PLACES[(word >> 4 & 15) - self._high]
        return Operand(MEMORY, self._periphery if area == "P" else area, self._width, value, place + "D")

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the place of the pointer and the area, and the byte of the pointer."""
        area = _AREA_OF.get(operand.area)
        place = _PLACE_OF.get(operand.via[:-1]) if operand.via.endswith("D") else None
        if operand.kind != MEMORY or operand.width != self._width or area is None or place is None:
            return None
        if not area and operand.area != self._periphery:
            return None
        return firsts[0] << 8 | (place + self._high) << 4 | (area + self._low), operand.number


class Indexed:
    """An operand at an address register plus an offset: ``M [AR1,P#0.0]``.

    The high nibble is the area plus ``high``, the low nibble is ``low``. With ``crossing`` the register also contains the area,
    and the high nibble is fixed.
    """

    def __init__(
        self, register: str, width: int, high: int, low: int, crossing: bool = False, periphery: str = ""
    ) -> None:
        self._register = register
        self._width = width
        self._high = high
        self._low = low
        self._crossing = crossing
        self._periphery = periphery
        what = ("bit", "byte", "word", "", "double word")[width]
        self.title = f"{what} [{register},P#]{' area-crossing' if crossing else ''}"

    def decode(self, word: int, value: int) -> Operand:
        """Return the area, the register and the offset."""
        area = "" if self._crossing else AREAS[(word >> 4 & 15) - self._high]
        return Operand(MEMORY, self._periphery if area == "P" else area, self._width, value, self._register)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the area, and the offset."""
        if operand.kind != MEMORY or operand.width != self._width or operand.via != self._register:
            return None
        if self._crossing:
            return None if operand.area else (firsts[0] << 8 | self._high << 4 | self._low, operand.number)
        area = _AREA_OF.get(operand.area) if operand.area else None
        if area is None or (not area and operand.area != self._periphery):
            return None
        return firsts[0] << 8 | (area + self._high) << 4 | self._low, operand.number


class Wide:
    """A byte, word or double word: its area in the high nibble, its byte address in the word after it."""

    def __init__(self, width: int, low: int, periphery: str) -> None:
        self._width = width
        self._low = low
        self._periphery = periphery
        self.title = f"{('', 'byte', 'word', '', 'double word')[width]} of I, Q, M, L, DB, DI, {periphery} 0 to 65535"

    def decode(self, word: int, value: int) -> Operand:
        """Return the address."""
        area = AREAS[word >> 4 & 15]
        return Operand(MEMORY, self._periphery if area == "P" else area, self._width, value * 8)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the area, and the byte address."""
        area = _AREA_OF.get(operand.area)
        if operand.kind != MEMORY or operand.width != self._width or operand.via or area is None or operand.number & 7:
            return None
        if not area and operand.area != self._periphery:
            return None
        return firsts[0] << 8 | area << 4 | self._low, operand.number >> 3


class PointerPlace:
    """A double word that contains a pointer: ``LAR1 MD 20``."""

    title = "MD, DBD, DID, LD 0 to 65535"

    def __init__(self, low: int) -> None:
        self._low = low

    def decode(self, word: int, value: int) -> Operand:
        """Return the address of the double word."""
        return Operand(MEMORY, PLACES[word >> 4 & 15], 4, value * 8)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the area, and the byte address."""
        place = _PLACE_OF.get(operand.area)
        if operand.kind != MEMORY or operand.width != 4 or operand.via or place is None or operand.number & 7:
            return None
        return firsts[0] << 8 | place << 4 | self._low, operand.number >> 3


class ShortConstant:
    """A constant in the second byte."""

    title = "B#16#00 to B#16#FF"

    def decode(self, word: int, value: int) -> Operand:
        """Return the constant."""
        return Operand(CONSTANT, "B#16#", 1, word & 0xFF)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word with the constant."""
        return (firsts[0] << 8 | operand.number, 0) if operand[:3] == (CONSTANT, "B#16#", 1) else None


class Constant:
    """A constant of ``width`` bytes after the first word; ``type_`` is its text form (`dissect.protocols.mc7.constants`)."""

    def __init__(self, second: int, type_: str, width: int) -> None:
        self._second = second
        self._type = type_
        self._width = width
        self.title = f"{type_ or 'number'} of {width} bytes"

    def decode(self, word: int, value: int) -> Operand:
        """Return the constant."""
        return Operand(CONSTANT, self._type, self._width, value)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the first word and the constant after it."""
        if operand[:3] != (CONSTANT, self._type, self._width):
            return None
        return firsts[0] << 8 | self._second, operand.number


class Pointer:
    """A pointer of ``width`` bytes after the first word; one of 2 bytes has no area."""

    def __init__(self, second: int, width: int) -> None:
        self._second = second
        self._width = width
        self.title = "P#" if width == 2 else "P# with area"

    def decode(self, word: int, value: int) -> Operand:
        """Return the pointer; for an unknown area byte the letters are its hexadecimal digits."""
        if self._width == 2:
            return Operand(POINTER, "", 2, value)
        return pointer(value)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the first word and the pointer after it."""
        if operand.kind != POINTER or operand.width != self._width:
            return None
        return firsts[0] << 8 | self._second, pointer_value(operand)


def pointer(value: int) -> Operand:
    """Return the pointer in four bytes: the area byte, then the address in bits."""
    area = value >> 24
    return Operand(POINTER, POINTER_AREAS.get(area, f"{area:02X}"), 4, value & 0xFFFFFF)


def pointer_value(operand: Operand) -> int:
    """Return a pointer as a number of its width."""
    if operand.width == 2:
        return operand.number
    area = POINTER_BYTES.get(operand.area)
    return (int(operand.area, 16) if area is None else area) << 24 | operand.number


class Parameter:
    """A formal parameter of an FC: twice its position. ``used`` is the way in which the instruction uses it."""

    def __init__(self, second: int, used: str) -> None:
        self._second = second
        self._used = used
        self.title = f"parameter as {used}"

    def decode(self, word: int, value: int) -> Operand:
        """Return the parameter; ``number`` is twice its position (1 is the first)."""
        return Operand(PARAMETER, self._used, 0, value)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word and the position."""
        if operand[:2] != (PARAMETER, self._used):
            return None
        return firsts[0] << 8 | self._second, operand.number


class Jump:
    """A signed distance in words from the jump itself; or the number of entries of a jump list."""

    def __init__(self, second: int, kind: str = JUMP) -> None:
        self._second = second
        self._kind = kind
        self.title = "label" if kind == JUMP else "label behind the list"

    def decode(self, word: int, value: int) -> Operand:
        """Return the distance in words, or the number of entries."""
        return Operand(self._kind, "", 0, value - 0x10000 if self._kind == JUMP and value & 0x8000 else value)

    def encode(self, operand: Operand, firsts: range) -> Encoded:
        """Return the word and the distance."""
        if operand.kind != self._kind:
            return None
        return firsts[0] << 8 | self._second, operand.number & 0xFFFF
