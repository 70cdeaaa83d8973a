"""Labels of jumps and names of parameters, which do not travel with a block and are made here."""

from __future__ import annotations

from typing import Final

from dissect.mc7.block import Block
from dissect.mc7.interface import TYPES, Declaration
from dissect.mc7.notation import NO_NAMES, Names

#: What an instruction takes a parameter of a type for.
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
    """Return the names of the formal parameters of an FC; other blocks use theirs by address."""
    if block.kind != "FC":
        return NO_NAMES
    parameters = block.interface.parameters
    return Names([declaration.name for declaration in parameters], [_use(declaration) for declaration in parameters])


def _use(declaration: Declaration) -> str:
    return _USES.get(TYPES.name(declaration.type), "WORD")


def jump_labels(block: Block) -> dict[int, str]:
    """Return a label for each place that a jump goes to and where an instruction begins: offset → name.

    A label counts the targets within its network, ``M2_1`` being the first one of network 2, so that a change in one network
    renames none in another.
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
