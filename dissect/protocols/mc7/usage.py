"""The cross-reference of blocks: which block reads or writes which address, and which block calls which."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.protocols.mc7.block import Block
from dissect.protocols.mc7.code import Instruction
from dissect.protocols.mc7.folding import Callee, no_block
from dissect.protocols.mc7.labels import jump_labels
from dissect.protocols.mc7.notation import operand_text
from dissect.protocols.mc7.operands import MEMORY, NUMBERED, Operand
from dissect.protocols.mc7.registers import OpenBlocks

READ: Final = "read"
WRITE: Final = "write"
BOTH: Final = "read and write"
#: Passed to a called block that may read or write it; the interface of that block was not captured.
GIVEN: Final = "given to a block"

#: Instructions that change their operand; for edges, the operand stores the last state of the bit.
_WRITING: Final = frozenset(("T", "=", "S", "R", "SF", "SE", "SD", "SS", "SP", "CU", "CD", "TAR1", "TAR2"))
_BOTH: Final = frozenset(("FP", "FN"))
#: Areas of the block itself, which do not concern others.
_OWN: Final = frozenset(("L", "V", ""))
_ORDER: Final = ("I", "Q", "M", "PI", "PQ", "T", "C", "DB", "DI")


class Use(NamedTuple):
    """One use of an address.

    ``address`` is STL text, with the number of the data block if that is known. ``area``, ``db`` (0 for none, -1 for one that
    the code opens at run time), ``bit`` and ``bits`` locate it; an indirect use has ``bit`` -1.
    """

    block: str
    network: int
    offset: int
    access: str
    address: str
    area: str
    db: int
    bit: int
    bits: int


class CallUse(NamedTuple):
    """One call: caller, callee, place, and whether it depends on the RLO; ``callee`` of a computed call is a place."""

    block: str
    network: int
    offset: int
    callee: str
    conditional: bool


def uses(block: Block, callee: Callee = no_block) -> list[Use]:
    """Return all uses of addresses outside the block's own data, in the order of the code."""
    found: list[Use] = []
    labels = jump_labels(block)
    opened = OpenBlocks()
    for instruction in block.instructions:
        if instruction.offset in labels:
            opened.forget()
        operand = instruction.operand
        if operand.kind == MEMORY or (operand.kind == NUMBERED and operand.area in {"T", "C"}):
            own = operand.area in _OWN or (operand.area == "DI" and block.kind == "FB" and opened.di < 0)
            if not own:
                found.append(_use(block, instruction, operand, _access(instruction.name), opened))
        if instruction.list is not None:
            found += _given(block, instruction, opened, callee)
        opened.follow(instruction)
    return found


def _access(name: str) -> str:
    if name in _BOTH:
        return BOTH
    return WRITE if name in _WRITING else READ


def _use(block: Block, instruction: Instruction, operand: Operand, access: str, opened: OpenBlocks) -> Use:
    db = opened.block_of(operand) if operand.area in {"DB", "DI"} else 0
    text = operand_text(operand._replace(area="DB") if operand.area == "DI" and db >= 0 else operand)
    if db > 0 and operand.area in {"DB", "DI"}:
        text = f"DB{db}.{text}"
    direct = not operand.via
    bits = 8 * operand.width or (16 if operand.kind == NUMBERED else 1)
    bit = operand.number if direct else -1
    area = "DB" if operand.area == "DI" and db >= 0 else operand.area
    number = block.network_of(instruction.offset)
    return Use(block.label, number, instruction.offset, access, text, area, db, bit, bits)


def _given(block: Block, instruction: Instruction, opened: OpenBlocks, callee: Callee) -> list[Use]:
    """Return the addresses that a call passes, as read or written according to the callee's interface."""
    operand = instruction.operand
    called = callee(operand.area, operand.number) if operand.kind == NUMBERED and not operand.via else None
    declared = called.interface.parameters if called is not None else []
    found: list[Use] = []
    pointers = instruction.pointers
    for position, address in enumerate(pointers):
        area = address.area.removesuffix("X")
        if area not in {"I", "Q", "M", "DB", "DI", "P"} or (area == "DI" and block.kind == "FB" and opened.di < 0):
            continue
        access = GIVEN
        if len(declared) == len(pointers):
            access = {1: READ, 2: WRITE, 6: WRITE}.get(declared[position].place, BOTH)
        # The width depends on the parameter; only the first bit is certain.
        place = Operand(MEMORY, "PI" if area == "P" else area, 0, address.number)
        found.append(_use(block, instruction, place, access, opened))
    return found


def call_uses(block: Block) -> list[CallUse]:
    """Return every call of a block."""
    found: list[CallUse] = []
    for instruction in block.instructions:
        if instruction.name not in {"UC", "CC"}:
            continue
        operand = instruction.operand
        text = operand_text(operand)
        called = text.replace(" ", "") if operand.kind == NUMBERED and not operand.via else text
        number = block.network_of(instruction.offset)
        found.append(CallUse(block.label, number, instruction.offset, called, instruction.name == "CC"))
    return found


def cross_reference(blocks: list[Block]) -> tuple[list[Use], list[CallUse]]:
    """Return the uses of all blocks by address, and their calls by callee."""
    known = {(block.kind, block.number): block for block in blocks}

    def callee(kind: str, number: int) -> Block | None:
        return known.get((kind, number))

    found = [use for block in blocks for use in uses(block, callee)]
    found.sort(key=_by_address)
    calls = [call for block in blocks for call in call_uses(block)]
    calls.sort(key=lambda call: (_natural(call.callee), _natural(call.block), call.offset))
    return found, calls


def _by_address(use: Use) -> tuple[int, int, int, int, str, str, int]:
    area = _ORDER.index(use.area) if use.area in _ORDER else len(_ORDER)
    return area, use.db, use.bit, use.bits, use.address, use.block, use.offset


def _natural(label: str) -> tuple[str, int]:
    letters = label.rstrip("0123456789")
    digits = label[len(letters) :]
    return letters, int(digits) if digits else -1


def cross_reference_lines(blocks: list[Block]) -> list[str]:
    """Return the cross-reference as text: a line for each address with the blocks that read or write it, then the calls."""
    found, calls = cross_reference(blocks)
    lines: list[str] = []
    by_address: dict[str, list[Use]] = {}
    for use in found:
        by_address.setdefault(use.address, []).append(use)
    for address, list_ in by_address.items():
        parts = [
            f"{access}: {_where([(use.block, use.network) for use in list_ if use.access == access])}"
            for access in (WRITE, READ, BOTH, GIVEN)
            if any(use.access == access for use in list_)
        ]
        lines.append(f"{address:<24} {'; '.join(parts)}")
    by_callee: dict[str, list[CallUse]] = {}
    for call in calls:
        by_callee.setdefault(call.callee, []).append(call)
    if lines and by_callee:
        lines.append("")
    for callee, uses_there in by_callee.items():
        lines.append(f"{callee:<24} called by: {_where([(call.block, call.network) for call in uses_there])}")
    return lines


def _where(places: list[tuple[str, int]]) -> str:
    """Return blocks and networks: ``OB1 network 2, FC5 network 1 (3 times)``."""
    counts: dict[tuple[str, int], int] = {}
    for place in places:
        counts[place] = counts.get(place, 0) + 1
    return ", ".join([
        f"{block} network {network}" + (f" ({count} times)" if count > 1 else "")
        for (block, network), count in counts.items()
    ])  # fmt: skip


def cross_reference_values(blocks: list[Block]) -> dict[str, object]:
    """Return the cross-reference as JSON-ready values (schema blocks-code)."""
    found, calls = cross_reference(blocks)
    return {
        "uses": [
            {
                "address": use.address,
                "access": use.access,
                "block": use.block,
                "network": use.network,
                "offset": use.offset,
                "area": use.area,
                "db": use.db if use.db > 0 else None,
                "bit": use.bit if use.bit >= 0 else None,
                "bits": use.bits,
            }
            for use in found
        ],
        "calls": [
            {
                "callee": call.callee,
                "block": call.block,
                "network": call.network,
                "offset": call.offset,
                "conditional": call.conditional,
            }
            for call in calls
        ],
    }
