"""Finds out which data blocks are open: known in straight code, unknown after each label and jump list."""

from __future__ import annotations

from dissect.protocols.mc7.code import Instruction
from dissect.protocols.mc7.operands import MEMORY, NUMBERED, Operand

#: No data block, or one whose number the code computes.
UNKNOWN_BLOCK = -1


class OpenBlocks:
    """The numbers in the DB and DI registers, `UNKNOWN_BLOCK` if unknown."""

    def __init__(self) -> None:
        self.db = UNKNOWN_BLOCK
        self.di = UNKNOWN_BLOCK

    def forget(self) -> None:
        """Forget both numbers, because other code may lead here."""
        self.db = self.di = UNKNOWN_BLOCK

    def follow(self, instruction: Instruction) -> None:
        """Follow an instruction. A call restores both registers."""
        if instruction.name == "OPN":
            operand = instruction.operand
            direct = operand.kind == NUMBERED and not operand.via
            number = operand.number if direct else UNKNOWN_BLOCK
            if operand.area == "DI":
                self.di = number
            else:
                self.db = number
        elif instruction.name == "CDB":
            self.db, self.di = self.di, self.db

    def block_of(self, operand: Operand) -> int:
        """Return the number of an operand's data block, `UNKNOWN_BLOCK` if it is in none or in an unknown one."""
        if operand.kind != MEMORY:
            return UNKNOWN_BLOCK
        if operand.area == "DB":
            return self.db
        return self.di if operand.area == "DI" else UNKNOWN_BLOCK
