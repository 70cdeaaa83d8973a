"""Devices as CSV rows, without cells that a spreadsheet would run as formulas."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Any, Final

from dissect.meaning.facts.device import DEVICE
from dissect.meaning.facts.fact import FRAME, TIME
from dissect.meaning.inventory.model import Device
from dissect.meaning.report.words import Places
from dissect.wire.text import Clock, cell

#: The facts in the order of their columns; with several files, ``first_file`` and ``last_file`` follow them.
_FACTS: Final = tuple([
    DEVICE[name]
    for name in (
        "address", "host_name", "role", "certainty", "mac", "vendor", "order_number", "hardware", "firmware",
        "serial_number", "station_name", "module_name", "module_type", "plant", "location", "operating_mode",
        "protection_level", "max_connections", "max_pdu_length", "pdu_lengths_said", "parallel_jobs_said", "modules_said",
        "clock_offset_ns", "clock_set_offset_ns", "blocks_said", "connections", "transactions", "answered", "unanswered",
        "with_errors", "median_ns", "p95_ns", "likely_count", "asked_by_said", "asks_said", "first_frame", "first_time",
        "last_frame", "last_time", "vlan_said",
    )
])  # fmt: skip
COLUMNS: Final = tuple([fact.key or fact.column for fact in _FACTS])
FILE_COLUMNS: Final = ("first_file", "last_file")


def device_row(device: Device, places: Places) -> dict[str, str]:
    """Return a device as cells by column, not yet made safe for spreadsheets."""
    clock = Clock()
    row: dict[str, str] = {}
    for column, fact in zip(COLUMNS, _FACTS, strict=True):
        value: Any = fact.get(device) if fact.get is not None else host_name(device, places)
        if fact.kind in {FRAME, TIME}:
            value = places.number(value) if fact.kind == FRAME else clock.iso(value)
        row[column] = "" if value is None else str(value)
    if places.several:
        row |= {"first_file": places.locate(device.first_frame)[0], "last_file": places.locate(device.last_frame)[0]}
    return row


def host_name(device: Device, places: Places) -> str | None:
    """Return the name that the settings have for the address of a device."""
    name = places.name(device.address)
    return name if name != device.address else None


def device_rows(devices: Iterable[Device], places: Places) -> Iterator[list[str]]:
    """Yield the heading, then a row for each device, with cells that are safe for spreadsheets."""
    columns = COLUMNS + FILE_COLUMNS if places.several else COLUMNS
    yield list(columns)
    for device in devices:
        row = device_row(device, places)
        yield [cell(row[column]) for column in columns]
