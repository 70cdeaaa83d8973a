"""Devices as CSV rows, without cells that a spreadsheet would run as formulas."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Final

from dissect.inventory.model import Device
from dissect.inventory.vendors import vendor
from dissect.report.words import Places
from dissect.stations import facts
from dissect.tcp.link import vlan_text
from dissect.wire.text import Clock, cell

#: The columns; with several files, ``first_file`` and ``last_file`` follow them.
COLUMNS: Final = (
    "address", "host_name", "role", "certainty", "mac", "vendor", "order_number", "hardware", "firmware",
    "serial_number", "station_name", "module_name", "module_type", "plant", "location", "operating_mode",
    "protection_level", "max_connections", "max_pdu_length", "pdu_lengths", "parallel_jobs", "modules",
    "clock_offset_ns", "clock_set_offset_ns", "blocks", "connections", "transactions", "answered", "unanswered",
    "with_errors", "median_ns", "p95_ns", "likely", "asked_by", "asks", "first_frame", "first_time", "last_frame",
    "last_time", "vlan",
)  # fmt: skip
FILE_COLUMNS: Final = ("first_file", "last_file")
_SAID: Final = frozenset((
    facts.ORDER_NUMBER, facts.HARDWARE, facts.FIRMWARE, facts.SERIAL_NUMBER, facts.STATION_NAME, facts.MODULE_NAME,
    facts.MODULE_TYPE, facts.PLANT, facts.LOCATION, facts.OPERATING_MODE, facts.PROTECTION, facts.MAX_CONNECTIONS,
    facts.MAX_PDU,
))  # fmt: skip


def device_row(device: Device, places: Places) -> dict[str, str]:
    """Return a device as cells by column, not yet made safe for spreadsheets."""
    clock = Clock()
    times = device.latencies.as_dict()
    mac = device.get(facts.MAC)
    talks = device.asked_by
    asked = device.asked
    row: dict[str, str] = {key: device.get(key) for key in COLUMNS if key in _SAID}
    name = places.name(device.address)
    row |= {
        "address": device.address,
        "host_name": name if name != device.address else "",
        "role": device.role,
        "certainty": device.certainty,
        "mac": mac,
        "vendor": vendor(mac) if mac else "",
        "pdu_lengths": " ".join(device.pdu_lengths.texts),
        "parallel_jobs": " ".join(device.parallel_jobs.texts),
        "modules": ", ".join([module for module in device.modules if module]),
        "clock_offset_ns": _number(device.clock_offset_ns),
        "clock_set_offset_ns": _number(device.clock_set_offset_ns),
        "blocks": ", ".join([f"{count} {kind}" for kind, count in device.block_counts.items()]),
        "connections": str(sum(talk.connections for talk in talks)),
        "transactions": str(sum(talk.transactions for talk in talks)),
        "answered": str(asked.answered),
        "unanswered": str(asked.missed),
        "with_errors": str(asked.errors),
        "median_ns": _number(times["median"]),
        "p95_ns": _number(times["p95"]),
        "likely": str(asked.likely),
        "asked_by": " ".join([talk.client for talk in talks]),
        "asks": " ".join([talk.server for talk in device.asks]),
        "first_frame": str(places.number(device.first_frame)),
        "first_time": clock.iso(device.first_ns),
        "last_frame": str(places.number(device.last_frame)),
        "last_time": clock.iso(device.last_ns),
        "vlan": vlan_text(device.vlan),
    }
    if places.several:
        row |= {"first_file": places.locate(device.first_frame)[0], "last_file": places.locate(device.last_frame)[0]}
    return row


def device_rows(devices: Iterable[Device], places: Places) -> Iterator[list[str]]:
    """Yield the heading, then a row for each device, with cells that are safe for spreadsheets."""
    columns = COLUMNS + FILE_COLUMNS if places.several else COLUMNS
    yield list(columns)
    for device in devices:
        row = device_row(device, places)
        yield [cell(row[column]) for column in columns]


def _number(value: int | None) -> str:
    return "" if value is None else str(value)
