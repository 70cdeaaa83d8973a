"""Findings about the contents of transferred blocks: faults of a block, and changes since its previous version.

S7comm-plus blocks are left out: it is not known which of their parts a CPU changes by itself.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import TYPE_CHECKING, Final

from dissect.engine.findings.reporter import Reporter
from dissect.engine.program.carved import CODE, INTERFACE, CarvedBlock, carve
from dissect.engine.program.compare import changed_parts
from dissect.engine.transactions.operation import DOWNLOAD, NOT_CAPTURED, Operation
from dissect.packets.tcp.link import within
from dissect.protocols.s7.tables import CODE_BLOCKS

if TYPE_CHECKING:
    from dissect.engine.findings.code_rules import CodeRules

#: Bounds of what is remembered: blocks, and their octets together. Of more, the blocks seen longest ago are forgotten first.
MAX_BLOCKS: Final = 4096
MAX_OCTETS: Final = 16 * 1024 * 1024
#: Parts that count as a change; header values, times and texts change without one.
_LOGIC: Final = frozenset((CODE, INTERFACE))


class Known:
    """The known versions of a block of a PLC: the one that ``runs``, if known, and one that was ``loaded`` since."""

    __slots__ = ("loaded", "runs")

    def __init__(self) -> None:
        self.runs: CarvedBlock | None = None
        self.loaded: CarvedBlock | None = None

    @property
    def octets(self) -> int:
        """Size of both versions that are kept."""
        return sum([len(block.octets) for block in (self.runs, self.loaded) if block is not None])

    def settle(self) -> None:
        """Make the version in ``loaded`` the one that ``runs``, unless it was not activated.

        If the outcome of the download was not captured, either version may run, so the running version is unknown.
        """
        if self.loaded is not None:
            done = self.loaded.operation
            if done is not None and done.result == NOT_CAPTURED:
                self.runs = None
            elif self.loaded.activated is not False:
                self.runs = self.loaded
            self.loaded = None


class BlockWatch:
    """Remembers the latest versions of the blocks of each PLC, and judges each new version."""

    def __init__(self, reporter: Reporter) -> None:
        self._reporter = reporter
        self._known: OrderedDict[tuple[str, str], Known] = OrderedDict()
        self._octets = 0
        self._code: CodeRules | None = None

    def take(self, operation: Operation) -> None:
        """Take a finished transfer."""
        for block in carve(operation):
            if block.classic is not None and block.complete:
                self._take(block, operation)

    def _take(self, block: CarvedBlock, operation: Operation) -> None:
        plc = within(block.plc, operation.connection.tcp.vlan)
        key = plc, block.label
        known = self._known.pop(key, None) or Known()
        self._octets -= known.octets
        known.settle()
        if block.kind in CODE_BLOCKS:
            self._judge_code(block, known.runs, operation, plc)
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

    def _rules(self) -> CodeRules:
        if self._code is None:
            from dissect.engine.findings.code_rules import CodeRules  # late: few captures have code

            self._code = CodeRules()
        return self._code

    def _judge_code(self, block: CarvedBlock, before: CarvedBlock | None, operation: Operation, plc: str) -> None:
        code = self._rules()
        for slug, what in code.judge(block):
            self._note(slug, operation, None, what)
        if operation.kind == DOWNLOAD:
            running = self._running(plc) if before is not None else []
            for slug, what in code.judge_loaded(block, before, running):
                self._note(slug, operation, before, what)

    def _running(self, plc: str) -> list[CarvedBlock]:
        """Return the captured blocks that run in a PLC."""
        return [known.runs for (host, _), known in self._known.items() if host == plc and known.runs is not None]

    def _judge_change(self, before: CarvedBlock, block: CarvedBlock, operation: Operation) -> None:
        changed = [part for part in changed_parts(before, block) if part in _LOGIC]
        loads = operation.kind == DOWNLOAD
        older = self._rules().older(before, block) if loads else ""
        if older:
            self._note("block.older", operation, before, older)
        if changed:
            slug = "block.changed" if loads else "block.differs"
            what = self._rules().changes(before, block) if block.kind in CODE_BLOCKS else ""
            self._note(slug, operation, before, what or _sizes(before, block, changed))

    def _note(self, slug: str, operation: Operation, before: CarvedBlock | None, what: str) -> None:
        number = operation.connection.number
        frame = operation.first_frame
        if self._reporter.wants(slug, number, frame, frame, operation.end_ns):
            earlier = before.operation if before is not None else None
            frames = [earlier.first_frame, frame] if earlier is not None else [frame]
            self._reporter.detail(slug, number, frames, operation.end_ns, f"{operation.subject}: {what}")


def _sizes(before: CarvedBlock, block: CarvedBlock, changed: list[str]) -> str:
    """Return which parts differ, with their sizes."""
    was, now = before.parts(), block.parts()
    return ", ".join([
        f"{part} of {len(was[part])} bytes" + (f", now {len(now[part])}" if len(was[part]) != len(now[part]) else "")
        for part in changed
    ])  # fmt: skip
