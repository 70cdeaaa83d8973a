"""Captures for the property tests: the shared public ones if they exist, and our own."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

from dissect.engine.pipeline import Options, Pipeline
from dissect.packets.source.packet import Reader
from dissect.packets.source.pcap import PCAP_MAGICS, PcapReader
from dissect.packets.source.pcapng import PcapngReader
from tests.properties.books import Record, check_books

ROOT: Final = Path(__file__).resolve().parents[2]
SHARED: Final = Path(os.environ.get("S7DISSECT_CORPUS") or ROOT.parent / "shared" / "captures")

#: Every existing capture, the shared ones first. (A test over none of the shared ones skips by the fixture `corpus`.)
PATHS: Final = sorted(SHARED.glob("*.pcap*")) + sorted((ROOT / "captures").rglob("*.pcap*"))
PLAIN: Final = [path for path in PATHS if path.suffix in {".pcap", ".pcapng"}]


def name_of(path: Path) -> str:
    """Return the name of a test over a capture."""
    return path.name


class Memory:
    """The octets of a file, as a reader takes them."""

    damage = ""

    def __init__(self, octets: bytes) -> None:
        self._octets = octets
        self._at = 0

    def read(self, size: int) -> bytes:
        piece = self._octets[self._at : self._at + size]
        self._at += size
        return piece

    def close(self) -> None:
        """Nothing is open."""


def reader_of(octets: bytes) -> Reader | None:
    """Return the reader of a plain capture in memory, None if it is not one."""
    source = Memory(octets)
    head = source.read(256 * 1024)
    if head[:4] in PCAP_MAGICS:
        return PcapReader(source, head)
    return PcapngReader(source, head) if head[:4] == b"\x0a\x0d\x0d\x0a" else None


def analyze(octets: bytes) -> Pipeline | None:
    """Run a capture in memory through a strict pipeline and check its accounts; None if it is not a capture."""
    reader = reader_of(octets)
    if reader is None:
        return None
    record = Record()
    pipeline = Pipeline(record, Options(strict=True))
    while reader.step(pipeline):
        pass
    pipeline.finish()
    assert pipeline.frames == reader.packets
    check_books(pipeline, record)
    return pipeline
