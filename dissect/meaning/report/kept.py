"""`Findings`: keeps the detailed findings of a whole run until the report, compressed because thousands are similar."""

from __future__ import annotations

import json
import zlib
from collections.abc import Iterator, Sequence
from typing import Final, overload

from dissect.engine.findings.catalogue import Rule
from dissect.engine.findings.reporter import Finding

#: This many of the first findings are kept as objects, some 2 MB: packing takes time, and pays only in a long capture with many
#: findings.
FIRST: Final = 4096
#: Of the findings after those, this many at a time are packed together.
BLOCK: Final = 64
#: Settings that make deflate use little memory: windows of 4 KB, some 40 KB in all; by default it takes 256 KB.
_WINDOW_BITS: Final = 12
_MEMORY_LEVEL: Final = 5


class Findings(Sequence[Finding]):
    """Findings in the order in which they were appended.

    ``first`` has up to `FIRST` of them as objects. Later ones are packed in blocks; the latest ones, which do not fill a block
    yet, are objects too. Reading unpacks one block at a time, and makes new objects of its findings.
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
            rows.append(
                (
                    (finding.slug, int(finding.connection), finding.frames, int(finding.time_ns), finding.detail),
                    (int(finding.number), finding.because, int(finding.explained_by), finding.client, finding.server),
                )
            )
        packer = zlib.compressobj(zlib.Z_BEST_SPEED, zlib.DEFLATED, _WINDOW_BITS, _MEMORY_LEVEL)
        return packer.compress(json.dumps(rows).encode()) + packer.flush()

    def _unpack(self, packed: bytes) -> list[Finding]:
        found = []
        for (slug, *rest), (number, because, explained_by, client, server) in json.loads(zlib.decompress(packed)):
            finding = Finding(self._rules[slug], *rest)
            finding.number, finding.because, finding.explained_by = number, because, explained_by
            finding.client, finding.server = client, server
            found.append(finding)
        return found
