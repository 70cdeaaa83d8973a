"""The capture for each golden here: ``captures/NAME.pcapng`` for ``NAME.s7.txt``, and likewise in the folders below."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from dissect.meaning.bindings import load_carrier
from dissect.testing.golden import golden_text, read_session

GOLDENS: Final = Path(__file__).resolve().parent
CAPTURES: Final = GOLDENS.parent
#: The capture with SCD, and the files that decode it.
PLANT: Final = CAPTURES / "scd" / "plant.pcapng"


class Source:
    """A capture and its golden; ``name`` is the golden's name in this folder: ``szl``, ``crafted/plain``, ``scd/plant``."""

    def __init__(self, capture: Path) -> None:
        folder = capture.parent.relative_to(CAPTURES)
        self.capture = capture
        self.name = (folder / capture.name.partition(".")[0]).as_posix()
        self.golden = GOLDENS / f"{self.name}.s7.txt"

    def text(self) -> str:
        """Return the golden that the capture gives."""
        carrier = None
        if self.capture == PLANT:
            carrier = load_carrier(str(PLANT.with_suffix(".toml")), str(PLANT.with_suffix(".bind.toml")))
        return golden_text(read_session(self.capture, decoder=carrier))


def _sources() -> dict[str, Source]:
    """Return every capture of this repository by the name of its golden."""
    captures = [*CAPTURES.glob("*.pcapng"), *(CAPTURES / "crafted").glob("*.pc*"), PLANT]
    captures += (CAPTURES / "s7plus").glob("*.pcapng")
    found = [Source(capture) for capture in sorted(captures)]
    return {source.name: source for source in found}


SOURCES: Final = _sources()
