"""Findings about the code of transferred blocks, and about changes in it.

This is a module of its own because it imports the tables of all instructions: `dissect.engine.findings.block_rules` imports it
only when the first block with code is seen.
"""

from __future__ import annotations

from typing import Final

from dissect.engine.program.carved import CarvedBlock
from dissect.protocols.mc7.block import Block, parse_block
from dissect.protocols.mc7.changes import compare_blocks
from dissect.protocols.mc7.checks import inconsistencies
from dissect.protocols.mc7.hazards import (
    DELETES,
    STOPS,
    is_safety,
    new_output_writes,
    new_system_calls,
    newly_skipped_calls,
    older_than,
    summary,
    system_calls,
)
from dissect.protocols.s7.blocks import HEADER
from dissect.protocols.s7.tables import CODE_BLOCKS
from dissect.wire.text import some

#: Maximum total size of the distinct blocks whose code is decoded; code beyond that is not judged.
MAX_DECODED: Final = 4 * 1024 * 1024
#: Maximum number of inconsistencies or calls of a block that a finding names.
_NAMED: Final = 3
#: Size of a block header, which has the identity of the block and the times of its last changes.
_HEADS: Final = HEADER.size
#: Effects of system calls that are reported even without an earlier version of the block.
_GRAVE: Final = frozenset((STOPS, DELETES))

#: Slug and detail of a finding.
Remark = tuple[str, str]


class CodeRules:
    """Decodes the code of blocks and judges it; identical code is decoded once. There is one object per analysis."""

    def __init__(self) -> None:
        self._decoded: dict[bytes, Block] = {}
        self._room = MAX_DECODED

    def judge(self, block: CarvedBlock) -> list[Remark]:
        """Return the remarks about the code of a block by itself."""
        program = self._decode(block)
        facts = inconsistencies(program) if program is not None else []
        return [("block.inconsistent", _named([fact.text for fact in facts]))] if facts else []

    def judge_loaded(self, block: CarvedBlock, before: CarvedBlock | None, running: list[CarvedBlock]) -> list[Remark]:
        """Return the remarks about loaded code, given the version ``before`` it and the blocks ``running`` in the PLC."""
        program = self._decode(block)
        if program is None:
            return []
        known = self._decode(before) if before is not None else None
        remarks: list[Remark] = []
        if known is None:
            system = [call for call in system_calls(program) if call.effect in _GRAVE]
        else:
            system = new_system_calls(known, program)
            remarks = self._judge_new(known, program, running)
        if system:
            remarks.append(("block.system_call", _named([call.text for call in system])))
        return remarks

    def _judge_new(self, known: Block, program: Block, running: list[CarvedBlock]) -> list[Remark]:
        remarks: list[Remark] = []
        outputs = [f"{use.address} in network {use.network}" for use in new_output_writes(known, program)]
        if outputs:
            remarks.append(("block.output_write", _named(outputs)))
        skipped = newly_skipped_calls(known, program, self._safety(running))
        if skipped:
            texts = [
                f"{call.jump} around {call.callee}{' (safety)' if call.safety else ''} in network {call.network}"
                for call in skipped
            ]
            remarks.append(("block.skipped_call", _named(texts)))
        return remarks

    def _safety(self, running: list[CarvedBlock]) -> frozenset[str]:
        """Return the labels of the ``running`` blocks that belong to a safety program."""
        programs = [self._decode(each) for each in running]
        return frozenset([program.label for program in programs if program is not None and is_safety(program)])

    def changes(self, before: CarvedBlock, block: CarvedBlock) -> str:
        """Return the changes in the code, in up to three lines; empty if one of the versions was not decoded."""
        was, now = self._decode(before), self._decode(block)
        return "; ".join(summary(block.label, compare_blocks(was, now))) if was is not None and now is not None else ""

    @staticmethod
    def older(before: CarvedBlock, block: CarvedBlock) -> str:
        """Return how a block is older than the version before it; empty if it is not older. Works for blocks of any type."""
        return older_than(parse_block(before.octets[:_HEADS]), parse_block(block.octets[:_HEADS]))

    def _decode(self, block: CarvedBlock) -> Block | None:
        """Return the decoded block, the same object for the same octets; None if it has no code or `MAX_DECODED` is used up."""
        if block.kind not in CODE_BLOCKS:
            return None
        found = self._decoded.get(block.octets)
        if found is None and len(block.octets) <= self._room:
            self._room -= len(block.octets)
            found = parse_block(block.octets)
            self._decoded[block.octets] = found
        return found


def _named(texts: list[str]) -> str:
    """Join the first texts; say how many more there are."""
    return some(texts, _NAMED, "; ")
