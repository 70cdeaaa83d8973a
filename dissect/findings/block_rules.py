"""What is worth saying about the contents of blocks that are loaded and read out: by themselves, and beside those before them.

Blocks of S7comm-plus are left out: what of them a CPU changes by itself is not known.
"""

from __future__ import annotations

from typing import Final

from dissect.findings.reporter import Reporter
from dissect.mc7.block import CODE_BLOCKS, Block, parse_block
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
from dissect.program.carved import CODE, INTERFACE, CarvedBlock, carve
from dissect.program.compare import changed_parts
from dissect.s7.blocks import HEADER
from dissect.transactions.operation import DOWNLOAD, Operation

#: Blocks that are remembered, and their octets; those that passed first are forgotten.
MAX_BLOCKS: Final = 4096
MAX_OCTETS: Final = 16 * 1024 * 1024
#: Octets of distinct blocks whose code is decoded; nothing is said of the code of those beyond.
MAX_DECODED: Final = 4 * 1024 * 1024
#: Inconsistencies of a block, and calls, that are named.
_NAMED: Final = 3
#: Octets of a block that say what it is and when it was changed.
_HEADS: Final = HEADER.size
#: What a system function does that is reported of a block of which no version passed before.
_GRAVE: Final = frozenset((STOPS, DELETES))
#: Parts by which two versions of a block are told apart: values, times and texts of a header change on their own.
_LOGIC: Final = frozenset((CODE, INTERFACE))


class Known:
    """What is known of one block of a PLC: the version that ``runs`` by all that passed, and one that was ``loaded`` since."""

    __slots__ = ("loaded", "runs")

    def __init__(self) -> None:
        self.runs: CarvedBlock | None = None
        self.loaded: CarvedBlock | None = None

    @property
    def octets(self) -> int:
        """Octets that are kept for it."""
        return sum([len(block.octets) for block in (self.runs, self.loaded) if block is not None])

    def settle(self) -> None:
        """Let the block that was loaded be the one that runs, unless it has not been activated."""
        if self.loaded is not None:
            if self.loaded.activated is not False:
                self.runs = self.loaded
            self.loaded = None


class BlockWatch:
    """Remembers the latest versions of the blocks of each PLC, and notes what the next one says."""

    def __init__(self, judge: Reporter) -> None:
        self._judge = judge
        self._known: dict[tuple[str, str], Known] = {}
        self._octets = 0
        self._decoded: dict[bytes, Block] = {}
        self._room = MAX_DECODED

    def take(self, operation: Operation) -> None:
        """Take a transfer that is over."""
        for block in carve(operation):
            if block.classic is not None and block.complete:
                self._take(block, operation)

    def _take(self, block: CarvedBlock, operation: Operation) -> None:
        key = block.plc, block.label
        known = self._known.pop(key, None) or Known()
        self._octets -= known.octets
        known.settle()
        program = self._decode(block)
        if program is not None:
            self._judge_code(program, known.runs, operation)
        if known.runs is not None:
            self._judge_change(known.runs, block, operation)
        if operation.kind == DOWNLOAD:
            known.loaded = block
        else:
            known.runs = block
        self._octets += known.octets
        self._known[key] = known
        while len(self._known) > MAX_BLOCKS or (self._octets > MAX_OCTETS and len(self._known) > 1):
            self._octets -= self._known.pop(next(iter(self._known))).octets

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

    def _judge_code(self, program: Block, before: CarvedBlock | None, operation: Operation) -> None:
        facts = inconsistencies(program)
        if facts:
            self._note("block.inconsistent", operation, None, _named([fact.text for fact in facts]))
        if operation.kind != DOWNLOAD:
            return
        known = self._decode(before) if before is not None else None
        if known is None:
            system = [call for call in system_calls(program) if call.effect in _GRAVE]
        else:
            system = new_system_calls(known, program)
            self._judge_new_code(known, program, before, operation)
        if system:
            self._note("block.system_call", operation, before, _named([call.text for call in system]))

    def _judge_new_code(self, known: Block, program: Block, before: CarvedBlock | None, operation: Operation) -> None:
        outputs = [f"{use.address} in network {use.network}" for use in new_output_writes(known, program)]
        if outputs:
            self._note("block.output_write", operation, before, _named(outputs))
        skipped = newly_skipped_calls(known, program, self._safety(before))
        if skipped:
            texts = [
                f"{call.jump} around {call.callee}{' (safety)' if call.safety else ''} in network {call.network}"
                for call in skipped
            ]
            self._note("block.skipped_call", operation, before, _named(texts))

    def _safety(self, block: CarvedBlock | None) -> frozenset[str]:
        """Return the blocks of the safety program of a PLC, as far as they passed."""
        plc = block.plc if block is not None else ""
        blocks = [known.runs for (host, _), known in self._known.items() if host == plc and known.runs is not None]
        programs = [self._decode(each) for each in blocks]
        return frozenset([program.label for program in programs if program is not None and is_safety(program)])

    def _judge_change(self, before: CarvedBlock, block: CarvedBlock, operation: Operation) -> None:
        changed = [part for part in changed_parts(before, block) if part in _LOGIC]
        loads = operation.kind == DOWNLOAD
        older = older_than(parse_block(before.octets[:_HEADS]), parse_block(block.octets[:_HEADS])) if loads else ""
        if older:
            self._note("block.older", operation, before, older)
        if changed:
            slug = "block.changed" if loads else "block.differs"
            self._note(slug, operation, before, self._changes(before, block) or _sizes(before, block, changed))

    def _changes(self, before: CarvedBlock, block: CarvedBlock) -> str:
        """Return in three lines what changed in the code; empty where it was not decoded."""
        was, now = self._decode(before), self._decode(block)
        return "; ".join(summary(block.label, compare_blocks(was, now))) if was is not None and now is not None else ""

    def _note(self, slug: str, operation: Operation, before: CarvedBlock | None, what: str) -> None:
        number = operation.connection.number
        if self._judge.wants(slug, number):
            earlier = before.operation if before is not None else None
            frames = [earlier.first_frame, operation.first_frame] if earlier is not None else [operation.first_frame]
            self._judge.detail(slug, number, frames, operation.end_ns, f"{operation.subject}: {what}")


def _named(texts: list[str]) -> str:
    """Return the first of some texts, and how many more there are."""
    more = f" and {len(texts) - _NAMED} more" if len(texts) > _NAMED else ""
    return "; ".join(texts[:_NAMED]) + more


def _sizes(before: CarvedBlock, block: CarvedBlock, changed: list[str]) -> str:
    """Return which parts differ, with their sizes."""
    was, now = before.parts(), block.parts()
    return ", ".join([
        f"{part} of {len(was[part])} bytes" + (f", now {len(now[part])}" if len(was[part]) != len(now[part]) else "")
        for part in changed
    ])  # fmt: skip
