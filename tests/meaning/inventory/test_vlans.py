"""Stations in VLANs: the same address in another one has a card of its own, one that was seen in several has one card."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest

from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.stations import facts
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.inventory.contract import inventory_as_dict
from dissect.meaning.inventory.outcome import Devices
from dissect.packets.source.packet import SourceFile
from tests.engine.stations.answers import components, szl
from tests.engine.test_pipeline import poll, ready
from tests.engine.test_vlans import ASYMMETRIC, TWICE, Tags, tagged
from tests.engine.transactions.talk import Talk
from tests.meaning.inventory.support import inventory_of
from tests.meaning.report.schemas import complaints
from tests.properties.packets import Flow, Packet


def in_vlan(vlan: int, serial: str) -> Callable[[Talk], None]:
    def scene(talk: Talk) -> None:
        talk.vlan = vlan
        talk.macs = [bytes((2, 0, 0, 0, 1, vlan)), bytes((2, 0, 0, 0, 2, vlan))]
        talk.open()
        szl(talk, 1, components(serial=serial))

    return scene


def test_each_network_has_cards_of_its_own() -> None:
    inventory = inventory_of(in_vlan(10, "A"), in_vlan(0, "B"), in_vlan(20, "C"), in_vlan(10, "A"))
    cards = [(device.name, device.get(facts.SERIAL_NUMBER), device.get(facts.MAC)) for device in inventory.devices]
    assert cards == [
        ("10.0.0.2", "B", "02:00:00:00:02:00"),
        ("10.0.0.2 in VLAN 10", "A", "02:00:00:00:02:0a"),
        ("10.0.0.2 in VLAN 20", "C", "02:00:00:00:02:14"),
        ("10.0.0.1", "", "02:00:00:00:01:00"),
        ("10.0.0.1 in VLAN 10", "", "02:00:00:00:01:0a"),
        ("10.0.0.1 in VLAN 20", "", "02:00:00:00:01:14"),
    ]
    assert [(talk.vlan, talk.connections) for talk in inventory.talks] == [(0, 1), (10, 2), (20, 1)]
    assert [sum(talk.connections for talk in device.asked_by) for device in inventory.devices] == [1, 2, 1, 0, 0, 0]


def test_the_network_is_told() -> None:
    inventory = inventory_of(in_vlan(0, "B"), in_vlan(20, "C"))
    outcome = Devices(inventory)
    text = "\n".join([str(line) for line in outcome.text()])
    assert "10.0.0.2 in VLAN 20  S7 server" in text
    assert "10.0.0.1 in VLAN 20         .                    2" in text
    heading, *rows = outcome.rows()
    assert [dict(zip(heading, row, strict=True))["vlan"] for row in rows] == ["", "20", "", "20"]
    told: dict[str, Any] = json.loads(json.dumps(inventory_as_dict(inventory)))
    assert complaints("devices", told, exact=True) == []
    assert [device["vlan"] for device in told["devices"]] == [[], [20], [], [20]]
    assert [talk["vlan"] for talk in told["talks"]] == [[], [20]]


def of(*captures: list[Packet]) -> Inventory:
    """Return the inventory of captures, each read by itself and put together."""
    parts = []
    for packets in captures:
        part = Inventory()
        pipeline = Pipeline(part, Options(strict=True))
        for packet in packets:
            pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), len(packet.octets), 1)
        pipeline.finish()
        parts.append((part, pipeline))
    whole = parts[0][0]
    for part, _ in parts[1:]:
        whole.merge(part)
    whole.take(parts[-1][1], [SourceFile("made.pcapng", 1)])
    return whole


@pytest.mark.parametrize("how", [*ASYMMETRIC, *TWICE])
def test_a_station_that_was_seen_in_several_vlans_has_one_card(how: str) -> None:
    """Also where each of its connections was seen first in another one, and where another one was seen in a single VLAN."""
    tags = ASYMMETRIC.get(how) or TWICE[how]

    def turned(side: int) -> list[tuple[int, ...]]:
        return tags(side)[::-1]

    def single(side: int) -> list[tuple[int, ...]]:
        return [max(tags(0))]

    def captured_with(port: int, with_tags: Tags, begin: int) -> list[Packet]:
        talk = poll(ready(Flow(ports=(port, 102))), 1, 2, 3).close()
        return tagged(talk.segments[begin:], with_tags)

    captures = [
        captured_with(50000, tags, 0),
        captured_with(50001, turned, 0),
        captured_with(50002, tags, 7),
        captured_with(50003, single, 0),
    ]
    for inventory in (of([packet for packets in captures for packet in packets]), of(*captures)):
        assert [device.address for device in inventory.devices] == ["10.0.0.2", "10.0.0.1"]
        (talk,) = inventory.talks
        assert (talk.connections, talk.transactions) == (4, 15)
        server, client = inventory.devices
        assert (server.asked_by, client.asks) == ([talk], [talk])
        assert server.latencies.count == 15
        assert server.get(facts.MAC)
        assert server.vlan == client.vlan
