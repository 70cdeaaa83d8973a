"""Compares two sets of blocks: which are new, gone, moved to another number or changed, and in which part."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from dissect.engine.program.carved import CODE, HEADER, INTERFACE, VALUES, CarvedBlock

# States of a block in the comparison.
NEW: Final = "new"
GONE: Final = "gone"
MOVED: Final = "moved"
CHANGED: Final = "changed"
#: A sentence for each of these.
STATES: Final[dict[str, str]] = {
    NEW: "Only B has the block.",
    GONE: "Only A has the block.",
    MOVED: "B has the block of A under a different number, with the same code and interface.",
    CHANGED: "Both have the block, and it differs.",
}
#: The order in which parts are named.
_PARTS: Final = (CODE, VALUES, INTERFACE, HEADER)
#: Facts in a header, and the words for them in texts.
_FACTS: Final[dict[str, str]] = {
    "language": "language",
    "name": "name",
    "author": "author",
    "family": "family",
    "version": "version",
    "code_time": "code time",
    "interface_time": "interface time",
    "protected": "know-how protection",
}

#: A changed fact of a header: its name, its value before, its value now.
Fact = tuple[str, str, str]


class BlockChange:
    """The change of one block: ``was`` and ``now`` are its two versions, None if it did not exist.

    ``parts`` are the parts that differ (`STATES` explains ``state``), ``facts`` the differences of the headers.
    """

    __slots__ = ("facts", "now", "parts", "state", "was")

    def __init__(self, state: str, was: CarvedBlock | None, now: CarvedBlock | None) -> None:
        self.state = state
        self.was = was
        self.now = now
        self.parts: tuple[str, ...] = ()
        self.facts: list[Fact] = []
        if was is not None and now is not None:
            self.parts = changed_parts(was, now)
            self.facts = changed_facts(was, now)

    @property
    def block(self) -> CarvedBlock:
        """The present version of the block, or its last one."""
        block = self.now if self.now is not None else self.was
        assert block is not None
        return block

    @property
    def comparable(self) -> bool:
        """False if one of the two is incomplete: then a difference may only be due to missing octets."""
        return all([block.complete for block in (self.was, self.now) if block is not None])

    def __repr__(self) -> str:
        return f"BlockChange({self.block.label!r}, {self.state!r}, {self.parts!r})"


def changed_parts(was: CarvedBlock, now: CarvedBlock) -> tuple[str, ...]:
    """Return the parts in which two versions of a block differ."""
    before, after = was.parts(), now.parts()
    return tuple([name for name in _PARTS if before.get(name, b"") != after.get(name, b"")])


def changed_facts(was: CarvedBlock, now: CarvedBlock) -> list[Fact]:
    """Return the facts in the headers of two versions that differ."""
    found = []
    for name, called in _FACTS.items():
        before, after = getattr(was, name), getattr(now, name)
        if before != after:
            found.append((called, _shown(before), _shown(after)))
    return found


def _shown(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    return str(value)


def versions(blocks: Iterable[CarvedBlock], by_plc: bool) -> dict[tuple[str, str], list[CarvedBlock]]:
    """Return the versions of each block in the order of their transfers, by PLC (empty unless ``by_plc``) and label.

    Incomplete versions are left out if there is a complete one.
    """
    found: dict[tuple[str, str], list[CarvedBlock]] = {}
    for block in blocks:
        found.setdefault((block.plc if by_plc else "", block.label), []).append(block)
    for key, row in found.items():
        whole = [block for block in row if block.complete]
        found[key] = whole or row
    return found


def compare(first: list[CarvedBlock], second: list[CarvedBlock]) -> list[BlockChange]:
    """Return what changed from one set to another, block by block; only the latest version of each block counts.

    Blocks of different PLCs are compared separately if one of the sets has blocks of several PLCs.
    """
    by_plc = any([len({block.plc for block in blocks}) > 1 for blocks in (first, second)])
    before = {key: row[-1] for key, row in versions(first, by_plc).items()}
    after = {key: row[-1] for key, row in versions(second, by_plc).items()}
    found: list[BlockChange] = []
    lost = {key: block for key, block in before.items() if key not in after}
    for key, now in after.items():
        was = before.get(key)
        if was is not None:
            change = BlockChange(CHANGED, was, now)
            if change.parts:
                found.append(change)
            continue
        moved = next((at for at, block in lost.items() if _moved(block, now)), None)
        found.append(BlockChange(MOVED, lost.pop(moved), now) if moved is not None else BlockChange(NEW, None, now))
    return [BlockChange(GONE, block, None) for block in lost.values()] + found


def over_time(blocks: list[CarvedBlock]) -> list[BlockChange]:
    """Return the changes within one set: for each block from its first version to its latest."""
    by_plc = len({block.plc for block in blocks}) > 1
    found = [BlockChange(CHANGED, row[0], row[-1]) for row in versions(blocks, by_plc).values() if len(row) > 1]
    return [change for change in found if change.parts]


def _moved(was: CarvedBlock, now: CarvedBlock) -> bool:
    """Return whether a block moved to another number: same type, code and interface, and not nearly empty."""
    before, after = was.parts(), now.parts()
    same = all([before.get(name, b"") == after.get(name, b"") for name in (CODE, VALUES, INTERFACE)])
    return same and was.kind == now.kind and len(before.get(CODE, b"") or before.get(VALUES, b"")) >= _LEAST


#: Below this many octets of code or values, equality of two blocks proves nothing.
_LEAST: Final = 8
