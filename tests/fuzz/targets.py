"""The fuzz targets: each takes any octets and fails if a condition is false that should always be true (docs/fuzzing.md)."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from tests.fuzz.blocks import blocks
from tests.fuzz.containers import container
from tests.fuzz.files import files
from tests.fuzz.frames import frames
from tests.fuzz.inputs import inputs
from tests.fuzz.pdus import pdus
from tests.fuzz.plus import plus
from tests.fuzz.seeds import Seeds
from tests.fuzz.segments import segments
from tests.fuzz.streams import streams
from tests.fuzz.tls import tls

#: A target, its seeds, and the longest input that a fuzzer makes.
TargetRow = tuple[Callable[[bytes], None], Callable[[Seeds], list[bytes]], int]

TARGETS: Final[dict[str, TargetRow]] = {
    "container": (container, Seeds.container, 12288),
    "frames": (frames, Seeds.frames, 8192),
    "segments": (segments, Seeds.segments, 4096),
    "streams": (streams, Seeds.streams, 4096),
    "pdus": (pdus, Seeds.pdus, 2048),
    "plus": (plus, Seeds.plus, 4096),
    "blocks": (blocks, Seeds.blocks, 4096),
    "tls": (tls, Seeds.tls, 12288),
    "files": (files, Seeds.files, 12288),
    "inputs": (inputs, Seeds.inputs, 8192),
}
