"""The outputs for all captures of the project and for the shared ones, with the claims in them that are recounted."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple

from tests.recount.kinds import KINDS
from tests.recount.outputs import outputs_of
from tests.recount.recount import Claim, recount, table

CAPTURES: Final = Path(__file__).resolve().parents[2] / "captures"
#: Shared captures up to this size are recounted: larger ones poll for hours.
MOST_BYTES: Final = 3_000_000


class Recounted(NamedTuple):
    """A capture, the statements about it, and the recounted numbers."""

    path: Path
    outputs: dict[str, str]
    claims: list[Claim]


def captures_in(folder: Path, most: int = MOST_BYTES) -> list[Path]:
    """Return the captures below a folder, in order."""
    return sorted(
        path
        for path in folder.rglob("*")
        if path.suffix in {".pcap", ".pcapng", ".cap", ".gz", ".zst"}
        and {".pcap", ".pcapng", ".cap"} & set(path.suffixes)
        and path.stat().st_size <= most
    )


def recounted(path: Path) -> Recounted:
    """Read a capture, and recount the statements about it."""
    with TemporaryDirectory() as folder:
        outputs = outputs_of(path, Path(folder))
    return Recounted(path, outputs, recount(outputs, path, KINDS))


def differences(found: Iterable[Recounted]) -> str:
    """Return the differences, one per line."""
    return "\n".join(
        f"{one.path.name}, {claim.face}: {claim.kind}: says {claim.said!r}, counted {claim.counted}"
        for one in found
        for claim in one.claims
        if not claim.right
    )


def rows(found: Iterable[Recounted]) -> list[tuple[str, int, int]]:
    """Return kinds of sentences, with how many numbers were recounted and how many of them differ."""
    return table([claim for one in found for claim in one.claims])
