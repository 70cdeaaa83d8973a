"""The result of `devices` in all formats: cards and a table of who talks to whom, JSON, CSV rows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.report.outcome import Outcome
from dissect.meaning.report.styled import Line
from dissect.meaning.report.words import Places
from dissect.wire.text import Clock


class Devices(Outcome):
    """An inventory. ``interrupted``: reading was aborted. ``hosts`` are host names by address, for text and CSV."""

    def __init__(
        self,
        inventory: Inventory,
        interrupted: bool = False,
        clock: Clock | None = None,
        hosts: Mapping[str, str] | None = None,
    ) -> None:
        self.inventory = inventory
        self.interrupted = interrupted
        self.clock = clock or Clock()
        self.places = Places(inventory.files, len(inventory.files) > 1, hosts)

    def text(self) -> Iterable[str | Line]:
        """Return the cards and the matrix."""
        from dissect.meaning.inventory.text import device_lines  # late, as JSON and CSV do not need it

        return device_lines(self)

    def rows(self) -> Iterable[list[str]]:
        """Return the heading and a row for each device."""
        from dissect.meaning.inventory.rows import device_rows

        return device_rows(self.inventory.devices, self.places)

    def as_dict(self) -> Mapping[str, object]:
        """Return the object of the JSON contract."""
        from dissect.meaning.inventory.contract import inventory_as_dict

        return inventory_as_dict(self.inventory, self.interrupted)
