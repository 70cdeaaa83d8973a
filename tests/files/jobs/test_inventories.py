"""Parts of an inventory, one for each file, added up: what one run over all files finds, to the byte."""

from __future__ import annotations

from functools import cache
from typing import Final

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dissect.engine.options import Options
from dissect.engine.stations.facts import MAC, Fact
from dissect.files.jobs.inventories import Inventories
from dissect.files.jobs.numbers import Offsets
from dissect.files.jobs.sending import receive, send
from dissect.files.jobs.sums import FilePart, part_of, unread
from dissect.files.session import Run
from dissect.meaning.inventory import collector, model
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.inventory.contract import inventory_as_dict
from dissect.meaning.inventory.model import Device, Talk
from dissect.meaning.inventory.outcome import Devices
from dissect.wire.build import COMPILED
from tests.files.jobs.test_analyses import APART, CAPTURES

#: With all that a card has: code of blocks, tags, clocks, sessions, network cards, several stations, IPv6.
FILES: Final = [
    *APART,
    *[
        str(CAPTURES / name)
        for name in (
            "program-python.pcapng",
            "crafted/ipv6.pcapng",
            "crafted/plus-plant.pcapng",
            "clock-python.pcapng",
        )
    ],
]


def said(inventory: Inventory) -> list[str]:
    """Return all that is said of an inventory, as text, as values and as rows."""
    outcome = Devices(inventory)
    return [*map(str, outcome.text()), repr(inventory_as_dict(inventory)), *map(str, outcome.rows())]


def whole(*paths: str) -> Inventory:
    """Return what one run over all files finds."""
    inventory = Inventory()
    run = Run(paths, inventory, Options())
    while run.step():
        pass
    run.close()
    inventory.take(run.pipeline, run.files)
    return inventory


@cache
def part(path: str) -> FilePart:
    """Return what a run over one file finds, as it is sent."""
    inventory = Inventory()
    run = Run([path], inventory, Options())
    while run.step():
        pass
    return part_of(inventory, run.pipeline, run.files)


def added(*parts: FilePart) -> Inventory:
    """Add up what runs over one file each found."""
    sums = Inventories(Options())
    for each in parts:
        sums.add(each)
    sums.finish()
    return sums.result


@settings(max_examples=8)
@given(st.permutations(FILES), st.integers(1, len(FILES)))
def test_files_by_themselves_come_to_what_one_run_finds(order: list[str], count: int) -> None:
    assert said(added(*map(part, order[:count]))) == said(whole(*order[:count]))


def test_the_captures_have_what_is_added_up() -> None:
    """So that the test before shows something of each."""
    inventory = added(*map(part, FILES))
    devices = inventory.devices
    assert len(inventory.files) == len(FILES)
    assert max([len(device.asked_by) for device in devices]) > 1
    for filled in ("code", "blocks", "sessions", "tsaps", "pdu_lengths", "reasons", "sent_to"):
        assert any([getattr(device, filled) for device in devices]), filled
    assert any([device.clock_offset_ns is not None for device in devices])
    assert any([area.tags for talk in inventory.talks for area in talk.areas.values()])
    assert any([talk.operations for talk in inventory.talks])


def test_a_file_that_could_not_be_read_stays_in_the_list() -> None:
    gone = unread("gone.pcap", "no such file", Inventory())
    inventory = added(part(FILES[0]), gone, part(FILES[3]))
    assert [(file.name, file.damage) for file in inventory.files][1] == ("gone.pcap", "no such file")
    assert inventory.finding_counts["capture.damaged"] == 1
    inventory.files = [file for file in inventory.files if not file.damage]
    assert said(inventory) == said(whole(FILES[0], FILES[3]))


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_code_and_devices_and_talks_have_their_bounds(monkeypatch: pytest.MonkeyPatch) -> None:
    """What comes first is kept, as in one run, and what has no room is counted."""
    code = str(CAPTURES / "program-python.pcapng")
    kept = whole(code)
    size = sum([len(block.octets) for device in kept.devices for block in device.code])
    monkeypatch.setattr(collector, "MAX_CODE", size)
    sums = added(part(code), part(code))
    assert [len(device.code) for device in sums.devices] == [len(device.code) for device in kept.devices]
    assert sum([device.more_code for device in sums.devices]) == sum([len(device.code) for device in kept.devices]) > 0
    plant, ipv6 = (str(CAPTURES / "crafted" / name) for name in ("plus-plant.pcapng", "ipv6.pcapng"))
    for bound, count, lost in (
        ("MAX_DEVICES", len(whole(plant).devices), "devices_not_listed"),
        ("MAX_TALKS", len(whole(plant).talks), "talks_not_listed"),
    ):
        with monkeypatch.context() as context:
            context.setattr(collector, bound, count)
            inventory = added(part(plant), part(ipv6))
            assert said(inventory) == said(whole(plant, ipv6))
            assert getattr(inventory, lost) > 0


def test_lists_of_a_device_have_their_bounds() -> None:
    one, two = Device("192.0.2.1"), Device("192.0.2.1")
    for number in range(2 * model.MAX_NAMES):
        (one if number < 10 else two).tsaps.add(f"{number:02}")
    for number in range(model.MAX_REASONS + 3):
        (one if number < 10 else two)._because(model.CPU, model.STATED, f"says {number}", number + 1)
    two._because(model.CPU, model.STATED, "says 0", 99)
    for number in range(model.MAX_BLOCKS):
        for device in (one, two):
            names = device._block(f"DB {number + (1 if device is two else 0)}")
            assert names is not None
            names.add("loaded" if device is one else "deleted")
    one._merge(two)
    assert (len(one.tsaps.texts), len(one.tsaps.more)) == (model.MAX_NAMES, model.MAX_NAMES)
    assert one.tsaps.texts == sorted(one.tsaps.texts)
    assert len(one.reasons) == model.MAX_REASONS
    first = one.reasons[model.CPU, "says 0"]
    assert (first.frame, first.count) == (1, 2)
    assert (len(one.blocks), len(one.more_blocks)) == (model.MAX_BLOCKS, 1)
    assert one.blocks["DB 0"].texts == ["loaded"]
    assert one.blocks["DB 1"].texts == ["deleted", "loaded"]


def test_areas_of_two_have_their_bounds() -> None:
    one, two = Talk("a", "b"), Talk("a", "b")
    for number in range(model.MAX_AREAS):
        for talk, more in ((one, 0), (two, 1)):
            area = talk.area(f"DB{number + more}")
            assert area is not None
            area.read.count += 1
            area.read.reach(10 * more, 10 * more + 3)
            area.read.tag(f"tag {more}")
    one.merge(two)
    assert (len(one.areas), len(one.more_areas)) == (model.MAX_AREAS, 1)
    shared = one.areas["DB1"]
    assert (shared.reads, shared.low, shared.high, shared.tags) == (2, 0, 13, ["tag 0", "tag 1"])


def test_numbers_move_and_no_transfer_is_sent() -> None:
    """A block keeps its bytes; the transfer that carried it has a connection and all its transactions."""
    fact = Fact("192.0.2.1", "", MAC, "00:1b:1b:00:00:01", "Ethernet", 3, [4], 5)
    moved = receive(send(fact), Offsets(100, 20, 7))
    assert (moved.connection, moved.frames, moved.time_ns) == (23, [104], 5)
    sent = part(str(CAPTURES / "program-python.pcapng")).sent
    classes = {name for _, name in sent.classes}
    assert "CarvedBlock" in classes
    assert not classes & {"Operation", "Connection", "Transaction"}
