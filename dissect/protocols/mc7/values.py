"""The actual values of a data block by its declarations (reference sheet mc7.md, section 3)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from dissect.protocols.mc7.block import Block
from dissect.protocols.mc7.constants import constant_text
from dissect.protocols.mc7.interface import ARRAY, BOOL, STRING, STRUCT, TYPES, Declaration, element_step
from dissect.protocols.mc7.operands import CONSTANT, Operand
from dissect.wire.text import printable

#: Maximum number of values that are shown; a block could have one for each bit.
MAX_VALUES: Final = 100_000
#: The prefix of values of a type.
_FORMS: Final[dict[str, str]] = {
    "BYTE": "B#16#",
    "CHAR": "'",
    "WORD": "W#16#",
    "INT": "",
    "DWORD": "DW#16#",
    "DINT": "L#",
    "REAL": "REAL",
    "DATE": "D#",
    "TIME_OF_DAY": "TOD#",
    "TIME": "T#",
    "S5TIME": "S5T#",
}


class DeclaredValue(NamedTuple):
    """A value: the name of its declaration, its first bit in the block, its type, and its STL text."""

    name: str
    bit: int
    type: str
    text: str


def block_data(block: Block) -> list[DeclaredValue]:
    """Return the actual values of a data block, except those after a declaration that is cut off or has an unknown size."""
    found: list[DeclaredValue] = []
    for declaration in block.interface.declarations:
        if declaration.start < 0:
            break
        for value in _values(declaration, declaration.name, declaration.start, block.code):
            if len(found) >= MAX_VALUES:
                return found
            found.append(value)
    return found


def _values(declaration: Declaration, name: str, bit: int, octets: bytes) -> Iterator[DeclaredValue]:
    if bit >= 8 * len(octets):
        return
    if declaration.type == STRUCT:
        for number, member in enumerate(declaration.members):
            if member.start >= 0:
                yield from _values(member, f"{name}.m{number}", bit + member.start, octets)
    elif declaration.type == ARRAY:
        yield from _elements(declaration, name, bit, octets)
    else:
        text = _text(declaration, bit, octets)
        if text:
            yield DeclaredValue(name, bit, declaration.type_text, text)


def _elements(declaration: Declaration, name: str, bit: int, octets: bytes) -> Iterator[DeclaredValue]:
    """Yield the elements of a one-dimensional array; others are shown as bytes, because the rows of bits are uncertain."""
    element = declaration.members[0] if declaration.members else None
    if element is None or declaration.bits <= 0 or element.bits <= 0:
        return
    if len(declaration.bounds) != 1:
        data = octets[bit // 8 : (bit + declaration.bits) // 8]
        yield DeclaredValue(name, bit, declaration.type_text, data.hex())
        return
    low, high = declaration.bounds[0]
    step = element_step(element)
    for number in range(high - low + 1):
        begin = bit + number * step
        if begin >= 8 * len(octets):
            return
        yield from _values(element, f"{name}[{low + number}]", begin, octets)


def _text(declaration: Declaration, bit: int, octets: bytes) -> str:
    at = bit // 8
    if declaration.type == BOOL:
        return "TRUE" if octets[at] >> (bit % 8) & 1 else "FALSE"
    size = declaration.bits // 8
    data = octets[at : at + size]
    if declaration.bits < 0 or len(data) < size:
        return ""
    if declaration.type == STRING:
        return f"'{printable(data[2 : 2 + min(data[1], data[0])].decode('latin-1'))}'" if size >= 2 else ""
    form = _FORMS.get(TYPES.name(declaration.type))
    if form is None:
        return data.hex()
    return constant_text(Operand(CONSTANT, form, size, int.from_bytes(data, "big")))
