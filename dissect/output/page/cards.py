"""The cards of the page, one for each PLC: its identity, the clients that poll or write, its slow answers and refusals."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from dissect.engine.stations import facts
from dissect.engine.transactions.operation import CONTROL, DELETE, DOWNLOAD, TEST_JOB, TRANSFER
from dissect.meaning.inventory.model import Device, Talk
from dissect.meaning.inventory.rows import device_row
from dissect.meaning.report import words
from dissect.meaning.report.operations import NAMES as KINDS
from dissect.output.page.bins import cells_of
from dissect.output.page.gathered import Gathered
from dissect.output.page.ordered import Ordered
from dissect.output.page.plcs import BAND, Plc
from dissect.output.page.polls import PolledRequest, PolledVariable
from dissect.output.page.rows import Station, station_of
from dissect.wire.text import printable, shortened

#: Greatest number of cards, and of lines in each list of a card.
_CARDS: Final = 24
_LINES: Final = 8
#: Polls up to this number are rows of the table of repeated requests.
_TEXT: Final = 120
#: Operations that change the PLC or may.
_CHANGING: Final = (CONTROL, DELETE, DOWNLOAD, TEST_JOB, TRANSFER)
#: The labels for the identity of a PLC on a card, by key of a row of `dissect.meaning.inventory.rows`.
_IDENTITY: Final = {
    "role": "role",
    "order_number": "order number",
    "firmware": "firmware",
    "hardware": "hardware",
    "serial_number": "serial number",
    "station_name": "station",
    "module_name": "module",
    "module_type": "type",
    "plant": "plant",
    "location": "location",
    "protection_level": "protection level",
    "mac": "MAC",
    "vendor": "vendor",
    "pdu_lengths": "PDU length",
    "blocks": "blocks",
}


def cards(ordered: Ordered, seconds: Callable[[int], float], width: int) -> dict[str, Any]:
    """Return the cards of the machines that answer, those with most transactions first.

    ``seconds`` converts a time to seconds after the start; ``width`` is the width of the bins of answer times, in nanoseconds.
    """
    gathered = ordered.of
    servers = [(number, device) for number, device in enumerate(gathered.inventory.devices, 1) if device.asked_by]
    servers.sort(key=lambda entry: (-_transactions(entry[1]), entry[0]))
    polls: dict[Station, list[tuple[int, PolledRequest]]] = {}
    for number, known in enumerate(ordered.polls, 1):
        polls.setdefault(station_of(known.connection), []).append((number, known))
    refused: dict[Station, list[tuple[str, PolledVariable]]] = {}
    for (station, address), variable in ordered.variables:
        if variable.refused:
            refused.setdefault(station, []).append((address, variable))
    rows = []
    for number, device in servers[:_CARDS]:
        station = (device.address, device.vlan)
        card = _Card(gathered, device, seconds)
        plc = gathered.plcs.found.get(station) or Plc()
        plc.times.widen(width)
        rows.append(
            {
                "key": f"d{number}",
                "host": gathered.rows.station(station),
                "identity": card.identity(),
                "clients": [card.client(talk) for talk in card.busiest()[:_LINES]],
                "writers": [card.writer(talk) for talk in card.busiest() if _changes(talk)][:_LINES],
                "more_clients": max(0, len(device.asked_by) - _LINES),
                "polls": [card.poll(number, known) for number, known in polls.get(station, [])[:_LINES]],
                "more_polls": max(0, len(polls.get(station, [])) - _LINES),
                "refused": card.refused(refused.get(station, []))[:_LINES],
                "more_refused": max(0, len(refused.get(station, [])) - _LINES),
                "modes": card.modes(),
                "slowest": card.slowest(plc),
                "times": cells_of(plc.times, BAND, seconds),
            }
        )
    return {"rows": rows, "total": len(servers)}


def _transactions(device: Device) -> int:
    return sum([talk.transactions for talk in device.asked_by])


def _changes(talk: Talk) -> list[str]:
    """Return how a client changed the PLC, or tried to: its writes, and its operations that change it."""
    writes = [words.count(talk.writes, "write")] if talk.writes else []
    return writes + [f"{KINDS[kind]} ({talk.operations[kind]})" for kind in _CHANGING if talk.operations.get(kind)]


class _Card:
    """The lists of the card of one PLC."""

    def __init__(self, gathered: Gathered, device: Device, seconds: Callable[[int], float]) -> None:
        self._rows = gathered.rows
        self._device = device
        self._seconds = seconds

    def identity(self) -> list[list[str]]:
        """Return the identity of the PLC, as (label, text); without facts that it did not state."""
        told = device_row(self._device, self._rows.places)
        return [[label, shortened(told[key], _TEXT)] for key, label in _IDENTITY.items() if told[key]]

    def busiest(self) -> list[Talk]:
        """Return its talks, those with most transactions first."""
        return sorted(self._device.asked_by, key=lambda talk: (-talk.transactions, talk.client))

    def client(self, talk: Talk) -> list[Any]:
        """Return a client: name, connections, transactions, reads, writes, with errors, without answer, its operations."""
        done = ", ".join([f"{KINDS.get(kind, kind)} ({count})" for kind, count in sorted(talk.operations.items())])
        return [
            self._rows.host(talk.client), talk.connections, talk.transactions, talk.reads, talk.writes, talk.errors,
            talk.missed, printable(done),
        ]  # fmt: skip

    def writer(self, talk: Talk) -> list[str]:
        """Return a client that writes: its name, and its actions."""
        return [self._rows.host(talk.client), ", ".join(_changes(talk))]

    def poll(self, number: int, known: PolledRequest) -> list[Any]:
        """Return a poll: its client, its requests, their number, the median of its periods, the key of its row."""
        client = self._rows.host(known.connection.client.host)
        return [client, shortened(known.subject, _TEXT), known.count, known.periods.quantile(0.5), f"p{number}"]

    def refused(self, found: list[tuple[str, PolledVariable]]) -> list[list[Any]]:
        """Return refused addresses, the most often refused first: address, how often, reason."""
        ordered = sorted(found, key=lambda entry: (-entry[1].refused, entry[0]))
        return [[shortened(address, _TEXT), variable.refused, variable.why] for address, variable in ordered]

    def modes(self) -> list[list[Any]]:
        """Return the operating modes in order: seconds after the start, mode, packet."""
        told = self._device.history(facts.OPERATING_MODE)
        number = self._rows.places.number
        return [[self._seconds(one.first_ns), printable(one.value), number(one.first_frame)] for one in told[:_LINES]]

    def slowest(self, plc: Plc) -> list[list[Any]]:
        """Return the slowest answers: answer time, time, function, subject, the key of its row."""
        return [
            [row["cells"][4], self._seconds(row["cells"][1]), row["cells"][5], row["cells"][6], row["key"]]
            for row in plc.slowest()
        ]
