"""Makes labels of jumps and names of parameters, which a block does not contain."""

from __future__ import annotations

from typing import Final

from dissect.protocols.mc7.block import Block
from dissect.protocols.mc7.interface import TYPES, Declaration
from dissect.protocols.mc7.notation import NO_NAMES, Names

#: How instructions use a parameter of this type.
_USES: Final[dict[str, str]] = {
    "BOOL": "BOOL",
    "BYTE": "BYTE",
    "CHAR": "BYTE",
    "DWORD": "DWORD",
    "DINT": "DWORD",
    "REAL": "DWORD",
    "TIME_OF_DAY": "DWORD",
    "TIME": "DWORD",
    "TIMER": "T",
    "COUNTER": "C",
    "BLOCK_FC": "FC",
    "BLOCK_FB": "FB",
    "BLOCK_DB": "DB",
}


def parameter_names(block: Block) -> Names:
    """Return the names of the formal parameters of an FC; code of other blocks uses addresses instead."""
    if block.kind != "FC":
        return NO_NAMES
    parameters = block.interface.parameters
    return Names([declaration.name for declaration in parameters], [_use(declaration) for declaration in parameters])


def _use(declaration: Declaration) -> str:
    return _USES.get(TYPES.name(declaration.type), "WORD")


def jump_labels(block: Block) -> dict[int, str]:
    """Return a label for each offset that is the target of a jump and the beginning of an instruction.

    Labels count the targets within a network (``M2_1`` is the first one in network 2), so a change in one network does not
    rename labels in another.
    """
    starts = {instruction.offset for instruction in block.instructions}
    targets = sorted(
        {instruction.target for instruction in block.instructions if instruction.word >> 8 in {0x70, 0xFF}} & starts
    )
    counts: dict[int, int] = {}
    labels: dict[int, str] = {}
    for target in targets:
        number = block.network_of(target)
        counts[number] = counts.get(number, 0) + 1
        labels[target] = f"M{number}_{counts[number]}"
    return labels
