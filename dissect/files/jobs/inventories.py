"""Adds up inventories of single captures; the sum is the inventory that one run over all of them would make.

Parts are added in the order of the files, as in `dissect.files.jobs.analyses`.
"""

from __future__ import annotations

from dissect.engine.options import Options
from dissect.files.jobs.sums import FilePart, Sum
from dissect.meaning.inventory.collector import Inventory


class Inventories:
    """Adds up parts. ``result`` is complete after `finish`; ``options`` are those of the whole run."""

    def __init__(self, options: Options) -> None:
        self.result = Inventory()
        self._sum = Sum(options)

    def add(self, part: FilePart) -> None:
        """Add the part of the next file."""
        self.result.merge(self._sum.take(part))

    def finish(self) -> None:
        """Sort the devices, after all parts were added."""
        self.result.take(self._sum.pipeline, self._sum.files)
