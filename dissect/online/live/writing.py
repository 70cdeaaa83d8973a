"""`WritingCompanion`: a companion that reports and counts write failures, and retries."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable
from pathlib import Path

from dissect.meaning.report import words
from dissect.online.alerts.problems import EVIDENCE
from dissect.online.live.problems import Recovery, WriterState
from dissect.online.live.run import Companion
from dissect.wire.text import reason


class WritingCompanion(Companion):
    """Writes files. After an `OSError` it stays, counts the data it does not write, and retries after 1, 2, 4 … 60 s.

    ``recovery`` is the state; ``folder`` is where it writes, ``label`` its name in metrics. Lost data are counted in ``unit``.
    """

    kind = EVIDENCE
    unit = "packet"
    label = "file"

    def __init__(self, folder: Path, clock: Callable[[], float] = time.monotonic) -> None:
        super().__init__()
        self.folder = folder
        self.recovery = Recovery(clock)
        self._why = ""
        self._told = (0, 0)  # the losses reported when the last failure ended

    @property
    def lost(self) -> tuple[int, int]:
        """How many packets or rows were not written so far, and the octets of packets."""
        return 0, 0

    @property
    def written(self) -> tuple[int, int]:
        """How many files were finished so far, and their octets."""
        return 0, 0

    def recover(self, error: OSError) -> bool:
        """Report the error if a failure begins; return True: this companion stays."""
        self._why = reason(error)
        if self.recovery.failed():
            self.problems.tell(self.kind, f"{self.name} cannot be written: {self._why}; it will be tried again")
        return True

    def resumed(self) -> None:
        """Report that writing works again, with the losses."""
        lasted = self.recovery.worked()
        self.problems.tell(
            self.kind, f"{self.name} is written again after {words.duration(int(lasted * 1e9))}; {self._loss()}", True
        )
        self._told = self.lost

    def _loss(self) -> str:
        lost, octets = self.lost
        number, size = lost - self._told[0], octets - self._told[1]
        if not number:
            return "nothing was lost"
        return f"{words.count(number, self.unit)}{f' ({size} bytes)' if size else ''} not written"

    @property
    def state(self) -> WriterState:
        """Return the state for metrics. May be called from another thread."""
        files, octets = self.written
        lost, lost_octets = self.lost
        try:
            free: int | None = shutil.disk_usage(self.folder).free
        except OSError:
            free = None
        recovery = self.recovery
        return WriterState(self.label, not recovery.failing, files, octets, lost, lost_octets, recovery.seconds, free)

    @property
    def summary(self) -> str:
        """Return the losses of the whole run, empty for none."""
        lost, octets = self.lost
        if not lost and not self.recovery.failing:
            return ""
        size = f" ({octets} bytes)" if octets else ""
        seconds = words.duration(int(self.recovery.seconds * 1e9))
        return f"{self.name}: {words.count(lost, self.unit)}{size} not written in {seconds}: {self._why}"
