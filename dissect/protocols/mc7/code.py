"""Splits the code of a block into instructions. Never raises; bytes that are not an instruction become `DW`, two at a time.

Source: reference sheet mc7.md, sections 5, 6 and 9.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from dissect.protocols.mc7.instruction_tables import CALL_LIST, INSTRUCTIONS, Row
from dissect.protocols.mc7.operands import JUMP, JUMP_LIST, Operand, pointer

_BY_FIRST: Final[list[list[Row]]] = [[] for _ in range(256)]
for _row in INSTRUCTIONS:
    for _first in _row.firsts:
        _BY_FIRST[_first].append(_row)


class _Unknown:
    """The operand of bytes that are not an instruction: the bytes themselves."""

    title = "bytes of no instruction"

    def decode(self, word: int, value: int) -> Operand:
        """Return the bytes."""
        return Operand("data", "", 2, word)

    def encode(self, operand: Operand, firsts: range) -> tuple[int, int] | None:
        """Return the bytes."""
        return (operand.number, 0) if operand.kind == "data" and operand.width == 2 else None


class _Single:
    """A single byte after the last word."""

    title = "one byte"

    def decode(self, word: int, value: int) -> Operand:
        """Return the byte."""
        return Operand("data", "", 1, word)

    def encode(self, operand: Operand, firsts: range) -> tuple[int, int] | None:
        """Return the byte."""
        return (operand.number, 0) if operand.kind == "data" and operand.width == 1 else None


#: Rows for bytes that are not an instruction.
UNKNOWN: Final = Row(range(256), frozenset(range(256)), 2, "DW", _Unknown())
LEFT_OVER: Final = Row(range(256), frozenset(range(256)), 1, "DB", _Single())


class Instruction:
    """One instruction.

    ``offset`` is the offset of its first byte in the code; ``size`` is its size in bytes, with the parameter list. ``list`` is
    the parameter list, four bytes for each parameter, None if there is none. ``value`` is the part after its first word.
    """

    __slots__ = ("list", "offset", "row", "size", "value", "word")

    def __init__(self, offset: int, row: Row, word: int, value: int) -> None:
        self.offset = offset
        self.row = row
        self.word = word
        self.value = value
        self.size = row.size
        self.list: bytes | None = None

    @property
    def name(self) -> str:
        """The English name."""
        return self.row.name

    @property
    def operand(self) -> Operand:
        """The operand."""
        return self.row.shape.decode(self.word, self.value)

    @property
    def known(self) -> bool:
        """False for bytes that are not an instruction."""
        return self.row is not UNKNOWN and self.row is not LEFT_OVER

    @property
    def octets(self) -> bytes:
        """The bytes of the instruction."""
        if self.row.size == 1:
            return bytes((self.word,))
        octets = self.word.to_bytes(2, "big")
        if self.row.size > 2:
            octets += self.value.to_bytes(self.row.size - 2, "big")
        if self.list is not None:
            octets += b"\x70\x0b" + (2 + len(self.list) // 2).to_bytes(2, "big") + self.list
        return octets

    @property
    def pointers(self) -> list[Operand]:
        """The addresses of its parameters."""
        data = self.list or b""
        return [pointer(int.from_bytes(data[at : at + 4], "big")) for at in range(0, len(data), 4)]

    @property
    def target(self) -> int:
        """The target of a jump (for a jump list the place after the list), -1 if it is not a jump."""
        operand = self.operand
        if operand.kind == JUMP:
            return self.offset + 2 * operand.number
        if operand.kind == JUMP_LIST:
            return self.offset + 4 + 4 * operand.number
        return -1

    def __repr__(self) -> str:
        return f"Instruction({self.offset}, {self.name!r}, {self.octets.hex()})"


def _find(word: int) -> Row:
    second = word & 0xFF
    for row in _BY_FIRST[word >> 8]:
        if second in row.seconds:
            return row
    return UNKNOWN


_rows: Final[dict[int, Row]] = {}


def row_of(word: int) -> Row:
    """Return the row of the instruction that begins with ``word``, `UNKNOWN` if there is none."""
    row = _rows.get(word)
    if row is None:
        row = _rows[word] = _find(word)
    return row


def decode(code: bytes, borders: Sequence[int] = ()) -> list[Instruction]:
    """Return the instructions of ``code``, without a gap.

    ``borders`` are offsets at which an instruction should begin (networks, jumps). They are used only if some bytes cannot be
    decoded without them, and if fewer such bytes then remain: wrong tables must not hide correct code.
    """
    plain = _decode(code, frozenset())
    unknown = unknown_octets(plain)
    if not unknown or not borders:
        return plain
    guided = _decode(code, frozenset(borders))
    return guided if unknown_octets(guided) < unknown else plain


def unknown_octets(instructions: list[Instruction]) -> int:
    """Return the number of bytes that are not an instruction."""
    return sum([instruction.size for instruction in instructions if not instruction.known])


def _decode(code: bytes, borders: frozenset[int]) -> list[Instruction]:
    found: list[Instruction] = []
    append = found.append
    rows = _rows
    at, end = 0, len(code)
    while at + 1 < end:
        word = code[at] << 8 | code[at + 1]
        row = rows.get(word)
        if row is None:
            row = row_of(word)
        size = row.size
        if size > 2:
            behind = at + size
            if behind > end or (borders and (at + 2 in borders or (size == 6 and at + 4 in borders))):
                row, size, value = UNKNOWN, 2, 0
            elif size == 4:
                value = code[at + 2] << 8 | code[at + 3]
            else:
                value = int.from_bytes(code[at + 2 : behind], "big")
        else:
            value = 0
        instruction = Instruction(at, row, word, value)
        append(instruction)
        at += size
        if row.list == CALL_LIST and at + 4 <= end and code[at] == 0x70 and code[at + 1] == 0x0B:
            words = code[at + 2] << 8 | code[at + 3]
            behind = at + 2 * words
            if (
                words >= 2
                and not words & 1
                and behind <= end
                and (not borders or borders.isdisjoint(range(at, behind)))
            ):
                instruction.list = code[at + 4 : behind]
                instruction.size += 2 * words
                at = behind
    if at < end:
        append(Instruction(at, LEFT_OVER, code[at], 0))
    return found


def jumps(instructions: list[Instruction]) -> list[Instruction]:
    """Return the jumps, without those over parameter lists."""
    kinds = (JUMP, JUMP_LIST)
    return [
        instruction
        for instruction in instructions
        if instruction.word >> 8 in _JUMPING and instruction.operand.kind in kinds
    ]


#: First bytes of all jumps.
_JUMPING: Final = frozenset((0x70, 0xFF))
