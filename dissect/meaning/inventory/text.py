"""Devices as text: a card for each, and a matrix of who talks to whom. Entries beyond the limits are counted."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

from dissect.engine.stations import facts
from dissect.engine.stations.facts import KEYS, Stretch
from dissect.engine.transactions.operation import CONNECT
from dissect.meaning.facts.vendors import vendor
from dissect.meaning.inventory.code import code_lines
from dissect.meaning.inventory.collector import Inventory, talks_between
from dissect.meaning.inventory.model import (
    BEHAVIOUR,
    CPU,
    ENGINEERING,
    OPC,
    PANEL,
    SERVER,
    STATED,
    TSAP,
    Area,
    Device,
    Names,
    Reason,
    Talk,
    Use,
)
from dissect.meaning.inventory.outcome import Devices
from dissect.meaning.report import words
from dissect.meaning.report.operations import NAMES
from dissect.meaning.report.styled import DIM, HEADING, PLAIN, Line
from dissect.meaning.report.text import table
from dissect.meaning.report.words import PROTOCOLS, Places
from dissect.packets.tcp.link import within
from dissect.wire.text import Clock, duration_text, printable, shortened, some

#: Limits: cards, talks of a device, areas of a talk, tags of an area, values over time, rows and columns of the matrix.
_CARDS: Final = 50
_TALKS: Final = 8
_AREAS: Final = 8
_TAGS: Final = 4
_VALUES: Final = 6
_ROWS: Final = 40
_COLUMNS: Final = 8
_NAMES: Final = 8
_HANG: Final = 14
_TEXT: Final = 100
_NUMBERED: Final = re.compile(r"([A-Za-z]+) ?([0-9]{1,9})\b")

#: The noun for a device with one of these roles.
_NOUNS: Final = {
    CPU: "a CPU", ENGINEERING: "an engineering station", OPC: "an OPC server", PANEL: "a panel", SERVER: "an S7 server",
}  # fmt: skip

#: Facts on the line of a module, in this order.
_OF_MODULE: Final = (
    facts.ORDER_NUMBER, facts.HARDWARE, facts.FIRMWARE, facts.SERIAL_NUMBER, facts.MODULE_TYPE, facts.CARD_SERIAL,
)  # fmt: skip
_OF_NAMES: Final = (facts.STATION_NAME, facts.MODULE_NAME, facts.PLANT, facts.LOCATION)
_SHORT: Final = {
    facts.ORDER_NUMBER: "",
    facts.HARDWARE: "hardware",
    facts.FIRMWARE: "firmware",
    facts.SERIAL_NUMBER: "serial number",
    facts.MODULE_TYPE: "type",
    facts.CARD_SERIAL: "memory card",
    facts.STATION_NAME: "station",
    facts.MODULE_NAME: "module",
    facts.PLANT: "plant",
    facts.LOCATION: "location",
}
_HOW_SURE: Final = {STATED: "", BEHAVIOUR: "", TSAP: " (by its TSAP alone)"}


def device_lines(outcome: Devices) -> Iterator[Line]:
    """Yield the cards and the matrix."""
    inventory = outcome.inventory
    if outcome.interrupted:
        yield Line("INTERRUPTED: what follows covers what was read before", "warning")
    if inventory.part is not None:
        yield Line(f"SELECTION: {printable(inventory.part.where)}", "warning", 4)
    if not inventory.devices:
        none = (
            "no ISO-on-TCP connection in what was read" if inventory.part is None else "nothing matches the selection"
        )
        yield Line(f"No device: {none}.", HEADING)
        return
    cards = inventory.devices[:_CARDS]
    shared = _shared(inventory.devices)
    for number, device in enumerate(cards):
        if number:
            yield Line("")
        yield from card(device, outcome.places, outcome.clock, shared)
    if len(inventory.devices) > _CARDS:
        yield Line("")
        yield Line(f"and {len(inventory.devices) - _CARDS} more devices; -T json and -T csv list them all", DIM)
    yield from matrix(inventory, outcome.places)
    yield from _not_kept(inventory)


def _shared(devices: Sequence[Device]) -> Mapping[str, int]:
    """Return the MAC addresses that several stations send with, and how many stations each."""
    counts = Counter([mac for device in devices for mac in {stretch.value for stretch in device.history(facts.MAC)}])
    return {mac: count for mac, count in counts.items() if count > 1}


def card(device: Device, places: Places, clock: Clock, shared: Mapping[str, int] | None = None) -> Iterator[Line]:
    """Yield the lines about a device. ``shared``: how many stations share a MAC address."""
    what = [
        device.role + _HOW_SURE.get(device.certainty, ""),
        *[device.get(key) for key in (facts.ORDER_NUMBER, facts.FIRMWARE)],
    ]
    yield Line(
        f"{within(_host(device.address, places), device.vlan)}  {'  '.join([printable(text) for text in what if text])}",
        HEADING,
    )
    for title, said in _card(device, places, clock, shared or {}):
        yield Line(f"  {title:<12}{said}", PLAIN, _HANG)


def _card(device: Device, places: Places, clock: Clock, shared: Mapping[str, int]) -> Iterator[tuple[str, str]]:
    if device.reasons:
        yield "role", _reasons(device, places)
    for stretch in device.history(facts.MAC):
        made = vendor(stretch.value)
        count = shared.get(stretch.value, 0)
        router = (
            f"; {count} stations send with it: a router on the way, or one card with several addresses" if count else ""
        )
        yield (
            "MAC",
            f"{stretch.value}{f' ({printable(made)})' if made else ''}, packet {places.mark(stretch.first_frame)}{router}",
        )
    for module in device.modules:
        for title, keys in (("module", _OF_MODULE), ("names", _OF_NAMES)):
            said = _said(device, module, keys, places)
            if said:
                yield title, f"{module}: {said}" if module else said
    yield from _state(device, places, clock)
    yield from _agreed(device)
    yield from _blocks(device)
    for said in code_lines(device):
        yield "code", said
    if device.more_code:
        more = device.more_code
        verb = "was" if more == 1 else "were"
        yield "code", f"{words.count(more, 'more block')} {verb} not looked at: all code together is too large"
    if device.sessions.texts:
        yield "sessions", _some(device.sessions)
    if device.asked_by or device.asked:
        yield "answers", _answers(device)
    # a talk with itself is already in the list of its clients
    asks = [talk for talk in device.asks if talk.server != talk.client]
    for title, talks, client in (("asked by", device.asked_by, True), ("asks", asks, False)):
        for talk in talks[:_TALKS]:
            yield title, f"{_host(talk.client if client else talk.server, places)}: {_talk(talk)}"
        if len(talks) > _TALKS:
            yield title, f"and {len(talks) - _TALKS} more"
    first, last = places.mark(device.first_frame), places.mark(device.last_frame)
    yield "seen", f"{words.span(clock, device.first_ns, device.last_ns)}, packets {first} to {last}"


def _reasons(device: Device, places: Places) -> str:
    """Return the reasons for the role of a device, then those for other roles."""
    by_role: dict[str, list[Reason]] = {device.role: []}
    for reason in sorted(device.reasons.values(), key=lambda reason: reason.weight):
        by_role.setdefault(reason.role, []).append(reason)
    own = by_role.pop(device.role) + by_role.pop(SERVER, [])  # to answer requests does not contradict any role
    said = [_reason(reason, places) for reason in own]
    for role, reasons in by_role.items():
        said.append(f"perhaps {_NOUNS[role]}: {', '.join([_reason(reason, places) for reason in reasons])}")
    return "; ".join(said)


def _reason(reason: Reason, places: Places) -> str:
    on = f", on {reason.count} connections" if reason.count > 1 else ""
    return f"{shortened(reason.text, _TEXT)} (packet {places.mark(reason.frame)}{on})"


def _said(device: Device, module: str, keys: tuple[str, ...], places: Places) -> str:
    """Return facts about a module with the packet of the first one; for a fact that changed, all its values."""
    said = []
    packets: list[int] = []
    for key in keys:
        stretches = facts.timeline(key, device.station.facts.get((module, key), []))
        if stretches:
            values = " → ".join([shortened(stretch.value, _TEXT) for stretch in stretches[-_VALUES:]])
            said.append(f"{_SHORT[key]} {values}".lstrip())
            packets += [stretch.first_frame for stretch in stretches[-_VALUES:]]
    return f"{', '.join(said)} ({places.phrase(sorted(set(packets)))})" if said else ""


def _state(device: Device, places: Places, clock: Clock) -> Iterator[tuple[str, str]]:
    moment = _moments(device, clock)
    for key in (facts.OPERATING_MODE, facts.MODE_SWITCH, facts.PROTECTION, facts.INTERFACE):
        stretches = device.history(key)
        if stretches:
            dropped = len(stretches) - _VALUES
            more = f"{dropped} earlier values, " if dropped > 0 else ""
            yield (
                _TITLES.get(key, KEYS[key]),
                more + " → ".join([_held(one, places, moment) for one in stretches[-_VALUES:]]),
            )
    for deed, key, offset in (
        ("read", facts.CLOCK, device.clock_offset_ns),
        ("set", facts.CLOCK_SET, device.clock_set_offset_ns),
    ):
        if offset is not None:
            way = "ahead of" if offset >= 0 else "behind"
            latest = max(device.history(key), key=lambda stretch: stretch.last_ns)
            packet = places.mark(latest.last_frame)
            said = f"{duration_text(abs(offset))} {way} the capture in UTC, its time zone included"
            yield "clock", f"{deed}: {said} ({moment(latest.last_ns)}, packet {packet})"


def _moments(device: Device, clock: Clock) -> Callable[[int], str]:
    """Return a function that writes the times on a card: as times of day, or with dates if the card spans several days."""
    times = [device.first_ns, device.last_ns]
    for stretches in device.station.facts.values():
        times += [time_ns for stretch in stretches for time_ns in (stretch.first_ns, stretch.last_ns)]
    days = {clock.moment(time_ns).partition(" ")[0] for time_ns in (min(times), max(times))}
    return clock.time_of_day if len(days) == 1 else clock.moment


_TITLES: Final = {
    facts.OPERATING_MODE: "mode",
    facts.MODE_SWITCH: "switch",
    facts.PROTECTION: "protection",
    facts.INTERFACE: "Ethernet",
}


def _held(stretch: Stretch, places: Places, moment: Callable[[int], str]) -> str:
    times = f", {stretch.count} times" if stretch.count > 1 else ""
    at = moment(stretch.first_ns)
    return f"{shortened(stretch.value, _TEXT)} ({at}, packet {places.mark(stretch.first_frame)}{times})"


def _agreed(device: Device) -> Iterator[tuple[str, str]]:
    most = [
        f"{title} {shortened(device.get(key), _TEXT)}"
        for key, title in ((facts.MAX_PDU, "PDU length"), (facts.MAX_CONNECTIONS, "connections"))
        if device.get(key)
    ]
    if most:
        yield "at most", ", ".join(most)
    if device.pdu_lengths.texts:
        lengths, jobs = [
            ", ".join(sorted(names.texts, key=int)) for names in (device.pdu_lengths, device.parallel_jobs)
        ]
        yield "negotiated", f"PDU length {lengths}, parallel jobs {jobs}"
    if device.tsaps.texts:
        yield "TSAP", _some(device.tsaps)


def _blocks(device: Device) -> Iterator[tuple[str, str]]:
    counts = [f"{count} {printable(kind)}" for kind, count in device.block_counts.items() if count]
    listed = sorted(device.station.blocks, key=_natural)
    said = []
    if counts:
        said.append(", ".join(counts))
    if listed:
        said.append(f"listed: {some([printable(name) for name in listed], _NAMES)}")
    changed = [
        f"{shortened(name, _TEXT)} {' and '.join(how.texts)}"
        for name, how in sorted(device.blocks.items(), key=lambda pair: _natural(pair[0]))
    ]
    if changed:
        said.append(some(changed, _NAMES))
    if said:
        yield "blocks", "; ".join(said)


def _natural(name: str) -> tuple[str, int, str]:
    """Return a sort key that puts "DB 10" after "DB 9", and "DB10 'Tank'" after "DB9 'Pump'"."""
    found = _NUMBERED.match(name)
    return (found[1], int(found[2]), name) if found is not None else (name, 0, name)


def _answers(device: Device) -> str:
    times = device.latencies
    asked = device.asked
    likely = f" ({asked.likely} only likely, left out of answer times)" if asked.likely else ""
    said = [f"{asked.answered} answered{likely}"]
    if asked.missed:
        said.append(f"{asked.missed} unanswered")
    if asked.errors:
        said.append(f"{asked.errors} with errors")
    if times.count:
        said.append(f"median {words.answer_time(times.quantile(0.5))}, 95 % {words.answer_time(times.quantile(0.95))}")
    return ", ".join(said)


def _talk(talk: Talk) -> str:
    """Return a line about the talk of two devices."""
    protocols = [PROTOCOLS.get(name, name) for name in talk.protocols.texts]
    said = [
        words.count(talk.connections, "connection") if talk.connections else "its own requests on the same connection"
    ]
    if protocols:
        said[0] += f" ({printable(', '.join(protocols))})"
    areas = sorted(talk.areas.values(), key=lambda area: (-area.reads - area.writes - area.refused, area.name))
    reads = [(area, area.read) for area in areas]
    writes = [(area, area.written) for area in areas]
    for number, noun, uses in ((talk.reads, "read", reads), (talk.writes, "write", writes)):
        if number:
            mine = [(area, use) for area, use in uses if use.count]
            refused = [(area, use) for area, use in uses if use.refused]
            names = ", ".join([_area(area, use) for area, use in (mine or refused)[:_AREAS]])
            more = len(mine) - _AREAS + len(talk.more_areas)
            said.append(f"{words.count(number, noun)}: {names}{f' and {more} more areas' if more > 0 else ''}")
    others = [f"{NAMES[kind]} ({count})" for kind, count in sorted(talk.operations.items()) if kind != CONNECT]
    if others:
        said.append(", ".join(others))
    if talk.errors:
        said.append(f"{talk.errors} with errors")
    return "; ".join(said)


def _area(area: Area, use: Use) -> str:
    """Return the reads or the writes of an area as text."""
    if use.tags:
        more = len(use.tags) - _TAGS + len(use.more_tags)
        names = ", ".join([shortened(tag.removeprefix(f"{area.name}."), _TEXT) for tag in use.tags[:_TAGS]])
        return f"{printable(area.name)} {{{names}{f' and {more} more' if more > 0 else ''}}}"
    if not use.pieces:
        return shortened(area.name, _TEXT)
    low, high = use.pieces[0][0], use.pieces[-1][1]
    reach = str(low) if low == high else f"{low}..{high}"
    return f"{'' if use.whole else 'within '}{printable(area.name)}[{reach}]"


def _host(address: str, places: Places) -> str:
    """Return an address, after the name from the settings if it has one."""
    name = places.name(address)
    return f"{name} ({address})" if name != address else address


def _some(names: Names) -> str:
    shown = [shortened(text, _TEXT) for text in names.texts[:_NAMES]]
    more = len(names.texts) - len(shown) + len(names.more)
    return ", ".join(shown) + (f" and {more} more" if more else "")


def matrix(inventory: Inventory, places: Places) -> Iterator[Line]:
    """Yield the matrix: a row for each client, a column for each server, numbers of transactions in the cells."""
    talks = [talk for talk in inventory.talks if talk.connections]
    if not talks:
        return
    busy: dict[str, int] = {}
    for talk in talks:
        server = talk.ends[1]
        busy[server] = busy.get(server, 0) + talk.transactions + 1
    order = {device.name: place for place, device in enumerate(inventory.devices)}
    shown = {device.name: within(places.name(device.address), device.vlan) for device in inventory.devices}
    servers = sorted(sorted(busy, key=lambda server: (-busy[server], order[server]))[:_COLUMNS], key=order.__getitem__)
    everybody = sorted({talk.ends[0] for talk in talks}, key=order.__getitem__)
    clients = everybody[:_ROWS]
    yield Line("")
    yield Line("Who talks to whom (transactions; clients in rows, servers in columns)", HEADING)
    rows = [["", *[shown[server] for server in servers]]]
    for client, counts in zip(clients, talks_between(talks, clients, servers), strict=True):
        rows.append([shown[client], *[str(count) if count else "." for count in counts]])
    yield from table(rows, frozenset(range(1, len(servers) + 1)))
    for left, kind in ((len(everybody) - len(clients), "client"), (len(busy) - len(servers), "server")):
        if left > 0:
            yield Line(f"  and {words.count(left, f'more {kind}')}; -T json lists them", DIM)


def _not_kept(inventory: Inventory) -> Iterator[Line]:
    losses = {
        "connections of devices without a card: too many devices": inventory.devices_not_listed,
        "connections without an entry: too many pairs of client and server": inventory.talks_not_listed,
        "requests whose addresses were not looked at: too many different ones at once": inventory.requests_not_looked_at,
        "facts without room: too many of one station, or too many stations": inventory.facts_not_kept,
    }
    for what, count in losses.items():
        if count:
            yield Line(f"{what}: {count}", "warning")
