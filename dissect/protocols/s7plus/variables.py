"""Lists of the variables of a block (0xAB) and of their names (0xAC), and an older form that has both (0xA7).

The numbers in the first list are little-endian, unlike all others (docs/s7plus.md).
"""

from __future__ import annotations

import struct
from typing import Final

from mypy_extensions import mypyc_attr

from dissect.protocols.s7plus.cursor_lists import pass_names, pass_variables
from dissect.protocols.s7plus.layouts import (
    LIST_BLOCK,
    LIST_ID,
    NAME_LIST,
    TAG_DESCRIPTION,
    TAG_DESCRIPTION_END,
    TAG_VARIABLE,
    VARIABLE,
    VARIABLE_LIST,
    VARIABLE_NAME,
)
from dissect.protocols.s7plus.program_tables import DATATYPES
from dissect.protocols.s7plus.tables import (
    NAMES_TAG,
    TAG_DESCRIPTION_END_TAG,
    TAG_DESCRIPTION_TAG,
    VARIABLE_NUMBERS,
    VARIABLES_TAG,
)
from dissect.protocols.s7plus.walk import STEP, FormatError, Walk
from dissect.wire.copies import leaves
from dissect.wire.octets import u32, u32_le
from dissect.wire.varint import SIGNED, VLQ

#: The fields of a variable before its attributes (LID, CRC, type) and after them (offsets), and the size of these.
_HEAD: Final = struct.Struct("<IIB")
_OFFSETS: Final = struct.Struct("<BHH")
_HEAD_SIZE: Final = 9
_OFFSETS_SIZE: Final = 5

# Kinds of variables (`dissect.protocols.s7plus.tables.VARIABLE_KINDS`), and the meaning of their numbers by position.
_FB_ARRAY: Final = 0
_PLAIN: Final = 1
_PLAIN_BOTH: Final = 8
_STRINGS: Final = frozenset((2, 9))
_ARRAYS: Final = frozenset((_FB_ARRAY, 3, 4, 6, 7, 10, 11, 13, 14))
_SEVERAL: Final = frozenset((_FB_ARRAY, 4, 7, 11, 14))
_TYPE_ID: Final[dict[int, int]] = {_FB_ARRAY: 2, 5: 2, 12: 2, 15: 2, 6: 6, 13: 6, 7: 18, 14: 18}
_ELEMENT_SIZES: Final[dict[int, int]] = {6: 4, 13: 4, 7: 16, 14: 16}
#: Octets of an empty list: a block length of 0.
_NO_BLOCK: Final = 2
#: Datatype of the elements of an array of bits.
_BBOOL: Final = 40


def _signed(number: int) -> int:
    return number - (1 << 32) if number >> 31 else number


@mypyc_attr(acyclic=True)  # many are kept, and each is smaller without the header of the garbage collector
class Variable:
    """A variable of a block: its LID, the CRC of its symbol, its type in the program, and its offsets.

    ``attributes`` are 16 bits (`dissect.protocols.s7plus.layouts.VARIABLE`); ``numbers`` are as many as its kind has.
    """

    __slots__ = ("attributes", "bit_offsets", "crc", "datatype", "lid", "numbers", "offset_1", "offset_2")

    def __init__(
        self,
        lid: int,
        crc: int,
        datatype: int,
        attributes: int,
        bit_offsets: int,
        offset_1: int,
        offset_2: int,
        numbers: list[int],
    ) -> None:
        self.lid = lid
        self.crc = crc
        self.datatype = datatype
        self.attributes = attributes
        self.bit_offsets = bit_offsets
        self.offset_1 = offset_1
        self.offset_2 = offset_2
        self.numbers = numbers

    @property
    def kind(self) -> int:
        """The kind of the variable, which says what its numbers mean (`dissect.protocols.s7plus.tables.VARIABLE_KINDS`)."""
        return self.attributes >> 12

    @property
    def datatype_name(self) -> str:
        """Name of the type; for an array, the type of its elements."""
        return DATATYPES.name(self.datatype)

    @property
    def is_array(self) -> bool:
        """True for arrays of any kind."""
        return self.kind in _ARRAYS

    @property
    def count(self) -> int:
        """Number of elements of an array, in all dimensions together; 0 for other variables."""
        if self.kind == _FB_ARRAY:
            return self.numbers[9]
        return self.numbers[3] if self.is_array else 0

    @property
    def dimensions(self) -> list[tuple[int, int]]:
        """Lower bound and count of each dimension of an array; the dimension that counts fastest comes first."""
        if not self.is_array:
            return []
        if self.kind not in _SEVERAL:
            return [(_signed(self.numbers[2]), self.numbers[3])]
        at = 13 if self.kind == _FB_ARRAY else 4
        pairs = zip(self.numbers[at : at + 6], self.numbers[at + 6 : at + 12], strict=True)
        return [(_signed(lower), count) for lower, count in pairs if count]

    @property
    def type_id(self) -> int:
        """Id of the type of a structure or FB instance, or of array elements of this kind; 0 for other variables."""
        at = _TYPE_ID.get(self.kind, -1)
        return self.numbers[at] if at >= 0 else 0

    @property
    def most_characters(self) -> int:
        """Declared maximum length of a String or WString, 0 if unknown."""
        return self.offset_1 if self.kind in _STRINGS or (self.is_array and not self.type_id) else 0

    def offset(self, classic: bool) -> int:
        """Return the offset of the variable within its structure, in the classic or in the optimised layout."""
        if self.kind == _PLAIN:
            return self.offset_1 if classic else self.offset_2
        if self.kind == _PLAIN_BOTH:
            return self.offset_2 if classic else self.offset_1
        return self.numbers[1 if classic else 0]

    def bit(self, classic: bool) -> int:
        """Return the number of the variable's bit, in the classic or in the optimised layout."""
        if self.datatype == _BBOOL and not classic:
            return self.bit_offsets & 7
        return self.bit_offsets >> 4 & 7 if classic and self.bit_offsets & 8 else self.attributes & 7

    def element_size(self, classic: bool) -> int:
        """Return the size of an element of an array of structures, 0 if unknown."""
        at = _ELEMENT_SIZES.get(self.kind, -1)
        return self.numbers[at if classic else at + 1] if at >= 0 else 0

    def index_text(self, index: int) -> str:
        """Return the indices of an element in the form of the program: ``[3]``, ``[2,0]``; empty if it does not exist."""
        dimensions = self.dimensions
        if not 0 <= index < self.count and self.datatype != _BBOOL:
            return ""
        indices: list[str] = []
        for number, (lower, count) in enumerate(dimensions):
            if number == len(dimensions) - 1:
                if index >= count:
                    return ""
                indices.append(str(index + lower))
                break
            row = (count + 7) // 8 * 8 if self.datatype == _BBOOL and number == 0 else count  # rows of bits fill octets
            index, place = divmod(index, row)
            if place >= count:
                return ""
            indices.append(str(place + lower))
        return f"[{','.join(reversed(indices))}]" if indices else ""


class VariableList:
    """The variables of a block, in the blocks in which they were sent; ``first`` is the number before the first block.

    The list may be read only when it is needed: until then ``octets`` contain it, after its tag.
    """

    __slots__ = ("_blocks", "_octets", "count", "first")

    def __init__(self, first: int, blocks: list[list[Variable]], octets: bytes = b"", count: int = 0) -> None:
        self.first = first
        self._blocks = blocks
        self._octets = octets
        self.count = count or sum([len(block) for block in blocks])

    @property
    def blocks(self) -> list[list[Variable]]:
        """The variables in each block of the list."""
        if self._octets:
            self._blocks = _read_blocks(Walk(self._octets, 0, len(self._octets), False))[1]
            self._octets = b""
        return self._blocks

    @property
    def variables(self) -> list[Variable]:
        """All variables in order."""
        return [variable for block in self.blocks for variable in block]


class NameList:
    """The names of the variables, in the same order; ``octets`` as in `VariableList`."""

    __slots__ = ("_blocks", "_octets", "count")

    def __init__(self, blocks: list[list[bytes]], octets: bytes = b"", count: int = 0) -> None:
        self._blocks = blocks
        self._octets = octets
        self.count = count or sum([len(block) for block in blocks])

    @property
    def blocks(self) -> list[list[bytes]]:
        """The names in each block of the list."""
        if self._octets:
            self._blocks = _read_name_blocks(Walk(self._octets, 0, len(self._octets), False))
            self._octets = b""
        return self._blocks

    @property
    def names(self) -> list[str]:
        """All names in order."""
        return [name.decode("utf-8", "replace") for block in self.blocks for name in block]


class TagDescription:
    """A variable of an S7-1200 with firmware 2: its LID, name and type; ``octets`` are the description without its tags."""

    __slots__ = ("datatype", "lid", "name", "octets")

    def __init__(self, octets: bytes, name: str, datatype: int, lid: int) -> None:
        self.octets = octets
        self.name = name
        self.datatype = datatype
        self.lid = lid


def read_variables(walk: Walk) -> VariableList:
    """Read a list of variables after its tag. Raises `FormatError`."""
    walk.part(VARIABLE_LIST, walk.at - 1)
    walk.enter("variables")
    if not walk.shown:
        start = walk.at
        end, count = pass_variables(walk.octets, start, walk.end)
        if end > 0:
            _pass(walk, end, count)
            return VariableList(
                u32(walk.octets, start + 2) if end - start > _NO_BLOCK else 0, [], walk.octets[start:end], count
            )
    first, blocks = _read_blocks(walk)
    walk.depth -= 1
    return VariableList(first, blocks)


def _pass(walk: Walk, end: int, count: int) -> None:
    walk.at = end
    walk.spend(STEP * count, "variable")
    walk.depth -= 1


def _read_blocks(walk: Walk) -> tuple[int, list[list[Variable]]]:
    blocks: list[list[Variable]] = []
    first = 0
    while (end := _next_block(walk)) > 0:
        if not blocks:
            at = walk.at
            first = walk.fixed(4, "first")
            walk.part(LIST_ID, at)
        block: list[Variable] = []
        while walk.at < end:
            block.append(_read_variable(walk, end))
        blocks.append(block)
    return first, blocks


def _next_block(walk: Walk) -> int:
    """Read the length of a block; return the end of the block, 0 at the end of the list."""
    at = walk.at
    length = walk.fixed(2, "block length")
    walk.part(LIST_BLOCK, at)
    if length == 0:
        return 0
    if length > walk.left:
        raise FormatError("length_beyond", "block length", at, length, walk.left)
    return walk.at + length


def _read_variable(walk: Walk, end: int) -> Variable:
    at = walk.at
    walk.spend(STEP, "variable")
    octets = walk.octets
    head = walk.step(_HEAD_SIZE, "variable")
    attributes = walk.fixed(2, "variable")
    offsets = walk.step(_OFFSETS_SIZE, "variable")
    count = VARIABLE_NUMBERS[attributes >> 12]
    first = walk.step(4 * count, "variable")
    if walk.at > end:
        raise FormatError("length_beyond", "variable", at, walk.at - at, end - at)
    variable = Variable(
        int(u32_le(octets, head)),
        int(u32_le(octets, head + 4)),
        octets[head + 8],
        attributes,
        octets[offsets],
        octets[offsets + 1] | octets[offsets + 2] << 8,
        octets[offsets + 3] | octets[offsets + 4] << 8,
        [int(u32_le(octets, first + 4 * index)) for index in range(count)],
    )
    if walk.shown:
        walk.part(VARIABLE, at, f"LID {variable.lid} {variable.datatype_name}")
    return variable


def read_names(walk: Walk) -> NameList:
    """Read a list of names after its tag. Raises `FormatError`."""
    walk.part(NAME_LIST, walk.at - 1)
    walk.enter("names")
    if not walk.shown:
        start = walk.at
        end, count = pass_names(walk.octets, start, walk.end)
        if end > 0:
            _pass(walk, end, count)
            return NameList([], walk.octets[start:end], count)
    blocks = _read_name_blocks(walk)
    walk.depth -= 1
    return NameList(blocks)


def _read_name_blocks(walk: Walk) -> list[list[bytes]]:
    blocks: list[list[bytes]] = []
    while (end := _next_block(walk)) > 0:
        block: list[bytes] = []
        while walk.at < end:
            at = walk.at
            walk.spend(STEP, "name")
            name = walk.take(walk.u8("name length") + 1, "name")
            if walk.at > end or name[-1]:
                raise FormatError("length_beyond", "name", at, walk.at - at, end - at)
            block.append(name[:-1])
            if walk.shown:
                walk.part(VARIABLE_NAME, at, name[:-1].decode("utf-8", "replace"))
        blocks.append(block)
    return blocks


def read_tag_description(walk: Walk) -> TagDescription:
    """Read an old description of a variable after its tag, with its end tag. Raises `FormatError`."""
    start = walk.at
    kind = walk.u8("kind")
    name = walk.take(walk.counted(VLQ, "name length"), "name").decode("utf-8", "replace")
    walk.part(TAG_DESCRIPTION, start - 1, name)
    behind = walk.at
    walk.take(2, "type")  # an octet of unknown meaning, and the type of the value
    datatype = walk.number(VLQ, "datatype")
    walk.take(4, "flags")
    lid = walk.number(VLQ, "LID")
    walk.number(VLQ, "length")
    if kind & 0x0C:
        walk.number(VLQ, "accessibility")
        walk.number(VLQ, "section")
    walk.number(VLQ, "offset")
    walk.number(VLQ, "offset")
    form = kind & 3
    if form == 1:
        _numbers(walk, 2)
    elif form == 2:
        walk.number(SIGNED, "lower bound")
        _numbers(walk, 3)
    elif form == 3:
        _numbers(walk, 2)
        for _ in range(walk.counted(VLQ, "dimension count")):
            walk.number(SIGNED, "lower bound")
            _numbers(walk, 1)
    if kind & 0x08:
        _numbers(walk, 2)
    octets = walk.octets[start : walk.at]
    walk.part(TAG_VARIABLE, behind, f"LID {lid} {DATATYPES.name(datatype)}" if walk.shown else "", 1)
    if walk.u8("end of tag description") != TAG_DESCRIPTION_END_TAG:
        raise FormatError(
            "bad_value", "end of tag description", walk.at - 1, TAG_DESCRIPTION_END_TAG, walk.octets[walk.at - 1]
        )
    walk.part(TAG_DESCRIPTION_END, walk.at - 1)
    return TagDescription(octets, name, datatype, lid)


def _numbers(walk: Walk, count: int) -> None:
    for _ in range(count):
        walk.number(VLQ, "offset")


# ---- writing --------------------------------------------------------------------------------------------------------


def build_variables(found: VariableList) -> bytes:
    """Return the octets of a list of variables with its tag. Raises struct.error for numbers that do not fit."""
    blocks = [b"".join([_build_variable(variable) for variable in block]) for block in found.blocks]
    if blocks:
        blocks[0] = found.first.to_bytes(4, "big") + blocks[0]
    return bytes((VARIABLES_TAG,)) + _build_blocks(blocks)


def _build_variable(variable: Variable) -> bytes:
    return (
        _HEAD.pack(variable.lid, variable.crc, variable.datatype)
        + variable.attributes.to_bytes(2, "big")
        + _OFFSETS.pack(variable.bit_offsets, variable.offset_1, variable.offset_2)
        + struct.pack(f"<{len(variable.numbers)}I", *variable.numbers)
    )


def build_names(found: NameList) -> bytes:
    """Return the octets of a list of names with its tag. Raises ValueError for a name of more than 255 octets."""
    blocks = [b"".join([bytes((len(name),)) + name + b"\0" for name in block]) for block in found.blocks]
    return bytes((NAMES_TAG,)) + _build_blocks(blocks)


def _build_blocks(blocks: list[bytes]) -> bytes:
    return b"".join([len(block).to_bytes(2, "big") + block for block in blocks]) + b"\0\0"


def build_tag_description(found: TagDescription) -> bytes:
    """Return the octets of an old description of a variable with its tags."""
    return bytes((TAG_DESCRIPTION_TAG,)) + found.octets + bytes((TAG_DESCRIPTION_END_TAG,))


leaves(Variable)
