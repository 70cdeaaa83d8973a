"""Inventories of captures that stand for themselves, added up to the one that a run over all of them would make.

As analyses are (`dissect.jobs.analyses`): in the order of the files, so that every bound keeps what comes first.
"""

from __future__ import annotations

from dissect.engine.options import Options
from dissect.inventory.collector import Inventory
from dissect.jobs.sums import FilePart, Sum


class Inventories:
    """Adds parts up. ``found`` is complete after `finish`; ``options`` are those of the run that they are parts of."""

    def __init__(self, options: Options) -> None:
        self.found = Inventory()
        self._sum = Sum(options)

    def add(self, part: FilePart) -> None:
        """Add the part of the file that comes next."""
        self.found.merge(self._sum.take(part))

    def finish(self) -> None:
        """All parts were added: put the devices in order."""
        self.found.take(self._sum.pipeline, self._sum.files)
