"""The statements of stations about themselves: rows for `analyze`."""

from __future__ import annotations

from typing import Final

from dissect.engine.stations import facts
from dissect.engine.stations.facts import Book, Station
from dissect.packets.tcp.link import vlan_ids
from dissect.wire.text import encodable

#: The facts that are shown for each station, in this order (docs/devices.md).
TOLD: Final = (
    facts.ORDER_NUMBER,
    facts.FIRMWARE,
    facts.HARDWARE,
    facts.SERIAL_NUMBER,
    facts.STATION_NAME,
    facts.MODULE_NAME,
    facts.OPERATING_MODE,
    facts.PROTECTION,
)
_TOLD: Final = frozenset(TOLD)


def stations_that_state(book: Book) -> list[Station]:
    """Return the stations that stated any of `TOLD`, by address."""
    return sorted(book.stating(_TOLD), key=_host)


def _host(station: Station) -> tuple[str, int]:
    return station.host, station.vlan


def station_as_dict(station: Station) -> dict[str, object]:
    """Return the latest value of each fact that a station stated, None for others."""
    told: dict[str, object] = {"address": station.host, "vlan": vlan_ids(station.vlan)}
    for key in TOLD:
        told[key] = encodable(station.latest(key)) or None
    return told
