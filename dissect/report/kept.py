"""Detailed findings of a whole run in little memory: thousands are kept until the report, and they are much alike."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Sequence
from typing import Final, overload

from dissect.findings.catalogue import Rule
from dissect.findings.reporter import Finding

#: So many are kept as they are, in some 2 MB: packing takes time, which only a long capture with many repays.
FIRST: Final = 4096
#: So many of those behind them are packed together.
BLOCK: Final = 64
#: The memory of deflate while it packs: windows of 4 KB, some 40 KB in all, where its usual ones take 256 KB.
_WINDOW_BITS: Final = 12
_MEMORY_LEVEL: Final = 5


class Findings(Sequence[Finding]):
    """Findings in the order they were appended in: the first as they are, then blocks, then what fills no block yet.

    Reading makes new objects of those that were packed, one block at a time. ``first`` are the first, at most `FIRST`.
    """

    def __init__(self) -> None:
        self.first: list[Finding] = []
        self._packed: list[bytes] = []  # `BLOCK` findings each
        self._latest: list[Finding] = []
        self._rules: dict[str, Rule] = {}

    def append(self, finding: Finding) -> None:
        """Keep one more."""
        if len(self.first) < FIRST:
            self.first.append(finding)
            return
        self._latest.append(finding)
        if len(self._latest) == BLOCK:
            self._packed.append(self._pack())
            self._latest = []

    def __len__(self) -> int:
        return len(self.first) + BLOCK * len(self._packed) + len(self._latest)

    def __iter__(self) -> Iterator[Finding]:
        yield from self.first
        for packed in self._packed:
            yield from self._unpack(packed)
        yield from self._latest

    @overload
    def __getitem__(self, index: int) -> Finding: ...
    @overload
    def __getitem__(self, index: slice) -> list[Finding]: ...
    def __getitem__(self, index: int | slice) -> Finding | list[Finding]:
        if isinstance(index, slice):
            return list(self)[index]
        number = range(len(self))[index]
        if number < len(self.first):
            return self.first[number]
        block, place = divmod(number - FIRST, BLOCK)
        return self._unpack(self._packed[block])[place] if block < len(self._packed) else self._latest[place]

    def __repr__(self) -> str:
        return f"Findings({len(self)})"

    def _pack(self) -> bytes:
        rows = []
        for finding in self._latest:
            self._rules[finding.slug] = finding.rule
            rows.append((finding.slug, int(finding.connection), finding.frames, int(finding.time_ns), finding.detail))
        packer = zlib.compressobj(zlib.Z_BEST_SPEED, zlib.DEFLATED, _WINDOW_BITS, _MEMORY_LEVEL)
        return packer.compress(json.dumps(rows).encode()) + packer.flush()

    def _unpack(self, packed: bytes) -> list[Finding]:
        rows = json.loads(zlib.decompress(packed))
        return [Finding(self._rules[slug], *rest) for slug, *rest in rows]
