"""Blocks from captures: `blocks`, and the observer that collects them."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.program.carved import CarvedBlock, carve
from dissect.engine.transactions.operation import TRANSFERS, Operation
from dissect.files.session import KeyLogFiles, Tags, reading_of
from dissect.packets.source.given import Source

if TYPE_CHECKING:
    from dissect.meaning.select import Where

#: Bounds: octets of all blocks, and number of blocks. A program has some thousand blocks of some KiB.
MAX_OCTETS: Final = 256 * 1024 * 1024
MAX_BLOCKS: Final = 100_000


class BlockCollector(Observer):
    """Collects the blocks of a run, from the operations for which ``choose`` returns True.

    ``blocks`` are in the order in which their transfers ended; `ordered` sorts them by packet. ``lost`` counts blocks beyond
    `MAX_BLOCKS`. Beyond `MAX_OCTETS` the contents of blocks are dropped, and the blocks are marked.
    """

    def __init__(self, choose: Callable[[Operation], bool] | None = None, most_octets: int = MAX_OCTETS) -> None:
        super().__init__()
        self.blocks: list[CarvedBlock] = []
        self.lost = 0
        self._choose = choose
        self._room = most_octets

    def operation(self, operation: Operation) -> None:
        """Take the blocks of an operation that is over."""
        if operation.kind not in TRANSFERS or (self._choose is not None and not self._choose(operation)):
            return
        for block in carve(operation):
            if len(self.blocks) >= MAX_BLOCKS:
                self.lost += 1
                continue
            size = len(block.octets) + len(block.behind_gap)
            if size > self._room:
                block.missing = f"{size} bytes were dropped: the blocks together are too large"
                block.octets = block.behind_gap = b""
            else:
                self._room -= size
            self.blocks.append(block)
        operation.content = b""  # the blocks have the octets

    def ordered(self) -> list[CarvedBlock]:
        """Return the blocks in the order of the packets in which their transfers began."""
        return sorted(self.blocks, key=_place)


def _place(block: CarvedBlock) -> tuple[int, int]:
    operation = block.operation
    return (operation.first_frame, operation.last_frame) if operation is not None else (0, 0)


def blocks(
    path: Source,
    *more: Source,
    where: str | Where | None = None,
    tls_keys: KeyLogFiles = None,
    checksums: bool = False,
    tags: Tags = None,
) -> list[CarvedBlock]:
    """Return all blocks that were downloaded or uploaded in one or several captures, in the order of their packets.

    Incomplete blocks are included; their ``missing`` says what they lack. ``where`` selects operations. ``tls_keys``,
    ``checksums`` and ``tags`` are as for `dissect.open`; with tags, `dissect.output.carve.contents.block_values` names the
    values of a data block. Raises `CaptureError` if a file cannot be read at all, `SelectError` for a wrong expression,
    `dissect.meaning.tags.TagError` for files of tags, and what `read_tls_keys` raises.
    """
    reading = reading_of([path, *more], Options(checksums=checksums), where, tags, tls_keys)
    collector = BlockCollector(reading.where.predicate("operation") if reading.where is not None else None)
    reading.run(collector, sieved=False).read()
    return collector.ordered()
