"""What is worth saying about the code of blocks that are loaded and read out, and about what changed in it.

A module of its own because the tables of all instructions come with it: `dissect.findings.block_rules` imports it when the
first block with code passes.
"""

from __future__ import annotations

from typing import Final

from dissect.mc7.block import Block, parse_block
from dissect.mc7.changes import compare_blocks
from dissect.mc7.checks import inconsistencies
from dissect.mc7.hazards import (
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
from dissect.program.carved import CarvedBlock
from dissect.s7.blocks import HEADER
from dissect.s7.tables import CODE_BLOCKS

#: Octets of distinct blocks whose code is decoded; nothing is said of the code of those beyond.
MAX_DECODED: Final = 4 * 1024 * 1024
#: Inconsistencies of a block, and calls, that are named.
_NAMED: Final = 3
#: Octets of a block that say what it is and when it was changed.
_HEADS: Final = HEADER.size
#: What a system function does that is reported of a block of which no version passed before.
_GRAVE: Final = frozenset((STOPS, DELETES))

#: The slug of a finding, and its detail.
Remark = tuple[str, str]


class CodeRules:
    """Decodes the code of blocks, the same octets once, and judges it. One for a whole analysis."""

    def __init__(self) -> None:
        self._decoded: dict[bytes, Block] = {}
        self._room = MAX_DECODED

    def reporter(self, block: CarvedBlock) -> list[Remark]:
        """Return what is to be said of the code of a block by itself."""
        program = self._decode(block)
        facts = inconsistencies(program) if program is not None else []
        return [("block.inconsistent", _named([fact.text for fact in facts]))] if facts else []

    def judge_loaded(self, block: CarvedBlock, before: CarvedBlock | None, running: list[CarvedBlock]) -> list[Remark]:
        """Return what is to be said of code that a PLC is given, beside the version ``before`` and all that is ``running``."""
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
        """Return those of some blocks that belong to a safety program."""
        programs = [self._decode(each) for each in running]
        return frozenset([program.label for program in programs if program is not None and is_safety(program)])

    def changes(self, before: CarvedBlock, block: CarvedBlock) -> str:
        """Return in three lines what changed in the code; empty where it was not decoded."""
        was, now = self._decode(before), self._decode(block)
        return "; ".join(summary(block.label, compare_blocks(was, now))) if was is not None and now is not None else ""

    @staticmethod
    def older(before: CarvedBlock, block: CarvedBlock) -> str:
        """Return in which way a block, of whatever type, is older than the version before it; empty where it is not."""
        return older_than(parse_block(before.octets[:_HEADS]), parse_block(block.octets[:_HEADS]))

    def _decode(self, block: CarvedBlock) -> Block | None:
        """Return the code of a block, the same object for the same octets; None where there is none, or no room for more."""
        if block.kind not in CODE_BLOCKS:
            return None
        found = self._decoded.get(block.octets)
        if found is None and len(block.octets) <= self._room:
            self._room -= len(block.octets)
            found = parse_block(block.octets)
            self._decoded[block.octets] = found
        return found


def _named(texts: list[str]) -> str:
    """Return the first of some texts, and how many more there are."""
    more = f" and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return "; ".join(texts[:_NAMED]) + more
