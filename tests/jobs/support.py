"""What the tests of -j share: workers inside this process."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import pytest

from benchmarks.generate import generate
from dissect.cli import together


class HereTeam:
    """`dissect.jobs.team.Team` without processes: one worker after another, in this process."""

    def __init__(self, target: Callable[..., None], arguments: Sequence[Any], count: int) -> None:
        from dissect.cli.main import group

        self._said: list[list[Any]] = []
        for index in range(count):
            said: list[Any] = []
            together._worker = together.Worker(said.append, arguments[1], index, count)
            try:
                group.main(list(arguments[0]), prog_name="s7dissect", standalone_mode=False)
            finally:
                together._worker = None
            self._said.append(said)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        pass

    def rounds(self, stop: Callable[[], bool]) -> Iterator[list[Any]]:
        """Yield what all of them said first, then second, and so on."""
        for said in zip(*self._said, strict=True):
            yield list(said)


def work_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Have -j work inside this process, with any number of workers."""
    monkeypatch.setattr("dissect.jobs.team.Team", HereTeam)
    monkeypatch.setattr("dissect.cli.options.jobs.processors", lambda: 64)


def lossy(path: Path, packets: int, stations: int, share: float, seed: int) -> Path:
    """Write a capture of some stations at once, of which a share of all packets is missing, and return its path."""
    generate(path, packets, seed, stations)
    written = path.read_bytes()
    chance = random.Random(seed)
    kept, at = [written[:24]], 24
    while at < len(written):
        end = at + 16 + struct.unpack_from("<I", written, at + 8)[0]
        if chance.random() >= share:
            kept.append(written[at:end])
        at = end
    path.write_bytes(b"".join(kept))
    return path
