"""Self-checks of a block: its tables repeat facts of its code, so a block not written by a programming tool is noticed.

Source: reference sheet mc7.md, sections 0, 4, 9 and 10.
"""

from __future__ import annotations

from typing import Final

from dissect.protocols.mc7.block import BE_SIZE, SCL, Block, BlockFault
from dissect.protocols.mc7.code import Instruction, jumps
from dissect.protocols.mc7.instruction_tables import CALL_LIST
from dissect.protocols.mc7.interface import TYPES, stated_start_length
from dissect.protocols.mc7.operands import NUMBERED, PARAMETER

#: Maximum number of facts of one kind about one block; the last one counts the others.
MAX_ALIKE: Final = 8

#: Facts that show that no programming tool wrote the block in this form: the finding `block.inconsistent`. Unknown instructions
#: are not in it, because our table may lack one.
TAMPERED: Final = frozenset(
    (
        "lengths",
        "no_end",
        "network_border",
        "network_sum",
        "network_table",
        "jump_list",
        "jump_target",
        "interface",
        "start_values",
        "local_data",
        "parameter",
        "parameter_type",
        "parameter_list",
    )
)

#: The type of a parameter that an instruction uses in this way.
_USED_AS: Final[dict[str, str]] = {"BOOL": "BOOL", "T": "TIMER", "C": "COUNTER"}


def check_block(block: Block) -> list[BlockFault]:
    """Return the inconsistencies of a block, besides the facts of `parse_block`."""
    facts: list[BlockFault] = []
    _check_interface(block, facts)
    if block.has_code and not _is_cut(block):
        _check_code(block, facts)
        _check_tables(block, facts)
        _check_parameters(block, facts)
    return _bounded(facts)


def all_facts(block: Block) -> list[BlockFault]:
    """Return the facts of `parse_block` and of the checks."""
    return [*block.facts, *check_block(block)]


def inconsistencies(block: Block) -> list[BlockFault]:
    """Return the facts that show that no programming tool wrote the block in this form (finding ``block.inconsistent``).

    If the code is all zeros, as after `s7dissect anonymize`, there are none.
    """
    if block.code and not any(block.code):
        return []
    return [fact for fact in all_facts(block) if fact.slug in TAMPERED]


def _is_cut(block: Block) -> bool:
    return any(fact.slug == "cut" for fact in block.facts)


def _bounded(facts: list[BlockFault]) -> list[BlockFault]:
    """Keep a few facts of each kind; the last one kept states the number of the others."""
    counts: dict[str, int] = {}
    kept: list[BlockFault] = []
    for fact in facts:
        count = counts.get(fact.slug, 0)
        counts[fact.slug] = count + 1
        if count < MAX_ALIKE:
            kept.append(fact)
    for at, fact in reversed(list(enumerate(kept))):
        more = counts.pop(fact.slug, 0) - MAX_ALIKE
        if more > 0:
            kept[at] = BlockFault(fact.slug, fact.offset, f"{fact.text}; and {more} more of this kind")
    return kept


def _check_interface(block: Block, facts: list[BlockFault]) -> None:
    interface = block.interface
    if interface.fault:
        facts.append(BlockFault("interface", -1, f"the interface cannot be read to its end: {interface.fault}"))
        return
    if len(interface.rest) > 1:
        facts.append(BlockFault("interface", -1, f"{len(interface.rest)} bytes behind the interface"))
    expected = stated_start_length(interface)
    if expected >= 0 and expected != interface.start_length:
        text = f"{interface.start_length} bytes of start values, the declarations take {expected}"
        facts.append(BlockFault("start_values", -1, text))
    temporary, local = interface.temp_bits, block.field("local_length")
    if block.has_code and local >= 0 and temporary > 8 * local:
        text = f"{temporary // 8} bytes of temporary data are declared, the header states {local} bytes of local data"
        facts.append(BlockFault("local_data", -1, text))


def _check_code(block: Block, facts: list[BlockFault]) -> None:
    last = block.instructions[-1] if block.instructions else None
    if block.code and (last is None or last.word != 0x6500 or last.size != BE_SIZE):
        facts.append(
            BlockFault("no_end", len(block.code), f"the code does not end with BE at its {len(block.code)} bytes")
        )
    for instruction in block.instructions:
        if not instruction.known:
            text = f"bytes {instruction.octets.hex(' ')} at {instruction.offset} are no instruction"
            facts.append(BlockFault("unknown_instruction", instruction.offset, text))
        if instruction.row.list == CALL_LIST and instruction.list is None:
            text = f"the call at {instruction.offset} has no parameter list"
            facts.append(BlockFault("parameter_list", instruction.offset, text))


def _check_tables(block: Block, facts: list[BlockFault]) -> None:
    tables = block.tables
    starts = {instruction.offset for instruction in block.instructions}
    starts.add(len(block.code))
    if tables.cut:
        facts.append(BlockFault("network_table", -1, "the network table or the jump list is cut off"))
    if tables.networks:
        total = sum(tables.networks)
        wanted = len(block.code) if block.language == SCL and total == len(block.code) else len(block.code) - BE_SIZE
        if total != wanted:
            text = f"the networks add up to {total} bytes, the code has {wanted} without its end"
            facts.append(BlockFault("network_sum", -1, text))
        at = 0
        for number, length in enumerate(tables.networks, 1):
            if at not in starts and at < len(block.code):
                facts.append(
                    BlockFault("network_border", at, f"network {number} begins at {at}, inside an instruction")
                )
            at += length
    found = jumps(block.instructions)
    if tables.present and not tables.cut:
        _compare_jumps({instruction.offset for instruction in found}, set(tables.jumps), facts)
    for jump in found:
        if jump.target not in starts:
            text = f"{jump.name} at {jump.offset} goes to {jump.target}, where no instruction begins"
            facts.append(BlockFault("jump_target", jump.offset, text))


def _compare_jumps(there: set[int], listed: set[int], facts: list[BlockFault]) -> None:
    texts = [(offset, f"the jump at {offset} is not in the jump list") for offset in sorted(there - listed)]
    texts += [(offset, f"the jump list names {offset}, where no jump is") for offset in sorted(listed - there)]
    facts += [BlockFault("jump_list", offset, text) for offset, text in texts]


def _check_parameters(block: Block, facts: list[BlockFault]) -> None:
    if block.kind != "FC" or block.interface.fault:
        return
    parameters = block.interface.parameters
    for instruction in block.instructions:
        operand = instruction.operand
        if operand.kind != PARAMETER:
            continue
        position = operand.number // 2
        if operand.number & 1 or not 1 <= position <= len(parameters):
            text = (
                f"{instruction.name} at {instruction.offset} uses parameter {operand.number / 2:g} of {len(parameters)}"
            )
            facts.append(BlockFault("parameter", instruction.offset, text))
            continue
        wanted = _USED_AS.get(operand.area)
        declared = TYPES.name(parameters[position - 1].type)
        if wanted is not None and wanted != declared:
            name = parameters[position - 1].name
            text = f"{instruction.name} at {instruction.offset} uses {name} as {wanted}, it is {declared}"
            facts.append(BlockFault("parameter_type", instruction.offset, text))


def calls(block: Block) -> list[tuple[Instruction, str, int]]:
    """Return each direct call in a block: the instruction, type and number of the callee."""
    found: list[tuple[Instruction, str, int]] = []
    for instruction in block.instructions:
        if instruction.name in {"UC", "CC"}:
            operand = instruction.operand
            if operand.kind == NUMBERED and not operand.via:
                found.append((instruction, operand.area, operand.number))
    return found
