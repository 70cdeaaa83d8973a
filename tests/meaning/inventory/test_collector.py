"""Devices put together from conversations: who, what, how often, how fast; and the bounds."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.stations import facts
from dissect.files.session import Run
from dissect.meaning.inventory import collector
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.inventory.contract import inventory_as_dict
from dissect.meaning.inventory.model import MAX_AREAS, MAX_BEYOND, MAX_NAMES, MAX_PIECES, MAX_TAGS, Device, Names, Use
from dissect.meaning.inventory.model import Talk as Both
from dissect.meaning.tags import load_tags
from dissect.wire.build import COMPILED
from tests.engine.findings.operation_scenarios import load, read_out
from tests.engine.program.transfers import Said, carry, download, upload
from tests.engine.stations.answers import components, identification, szl
from tests.engine.transactions.talk import MS, Talk, ack_data, dbw, item, read, refused, words, write, written
from tests.meaning.inventory.support import inventory_of
from tests.meaning.report.schemas import ROOT, complaints
from tests.properties.packets import Packet, captured
from tests.properties.traffic import conversations, merged, segments

PLUS = ROOT / "captures" / "crafted" / "plus-plant.pcapng"


def polls(talk: Talk) -> None:
    """DB10.DBW4 is read three times, after 1, 2 and 3 ms; M0.0 is written, DB99 is refused."""
    talk.open(2, 3, 240)
    for number in range(1, 4):
        talk.ask(read(number, dbw(10, 4, 2)))
        talk.tell(words(number, 5, 6), after_ns=number * MS)
    talk.ask(write(4, [item(0x83, 0, 0, 2)], written(4, b"\x01")))
    talk.tell(ack_data(4, b"\x05\x01", b"\xff"), after_ns=4 * MS)
    talk.ask(read(5, dbw(99, 0)))
    talk.tell(ack_data(5, b"\x04\x01", refused(0x0A)), after_ns=5 * MS)
    talk.ask(read(6, item(0x1D, 0, 7, 0x1D, 2)))
    talk.wait(10**10)


def test_who_reads_and_writes_what() -> None:
    inventory = inventory_of(polls)
    server, client = inventory.devices
    (talk,) = inventory.talks
    assert (server.address, server.role, client.address, client.role) == (
        "10.0.0.2",
        "S7 server",
        "10.0.0.1",
        "engineering",
    )
    assert server.asked_by == client.asks == [talk]
    counts = (talk.connections, talk.transactions, talk.reads, talk.writes, talk.answered, talk.errors, talk.missed)
    assert counts == (1, 7, 5, 1, 6, 1, 0)
    assert {
        name: (area.reads, area.writes, area.refused, area.low, area.high) for name, area in talk.areas.items()
    } == {
        "DB10": (3, 0, 0, 4, 7),
        "M": (0, 1, 0, 0, 0),
        "DB99": (0, 0, 1, 0, 1),
        "T": (1, 0, 0, 7, 8),
    }
    assert (server.pdu_lengths.texts, server.parallel_jobs.texts) == (["240"], ["3"])
    assert (client.tsaps.texts, server.tsaps.texts) == (["01.00 (PG)"], ["01.02 (PG, rack 0 slot 2)"])


def test_answer_times_are_those_of_who_answers() -> None:
    server, client = inventory_of(polls).devices
    times = server.latencies
    assert (times.count, times.smallest, times.largest, times.quantile(0.5)) == (6, MS, 5 * MS, 5 * MS // 2)
    assert client.latencies.count == 0


def test_facts_belong_to_the_device_that_stated_them() -> None:
    def online(talk: Talk) -> None:
        talk.open()
        szl(talk, 1, identification("6ES7 315-2EH14-0AB0", (3, 2, 6)))
        szl(talk, 2, components("S C-1", "Station"))

    server, client = inventory_of(online, online).devices
    assert server.get(facts.ORDER_NUMBER) == "6ES7 315-2EH14-0AB0"
    assert (server.get(facts.FIRMWARE), server.get(facts.STATION_NAME)) == ("V3.2.6", "Station")
    assert server.modules == ["rack 0 slot 2"]
    assert [stretch.count for stretch in server.history(facts.FIRMWARE)] == [2]
    assert client.modules == []
    assert server.reasons["CPU", "states its order number (SZL 0x0011)"].frame == 9


def test_blocks_that_come_and_go() -> None:
    def loads(talk: Talk) -> None:
        talk.open()
        load(talk)

    def reads_out(talk: Talk) -> None:
        talk.open()
        read_out(talk)

    server, client = inventory_of(loads, reads_out).devices
    assert {name: how.texts for name, how in server.blocks.items()} == {"DB 1": ["loaded", "read out"]}
    assert client.role == "engineering"
    assert {reason.text for reason in client.reasons.values()} >= {"loads blocks", "reads blocks out"}


@pytest.mark.parametrize(
    ("said", "kept", "became"),
    [
        (upload(bytes(300), "_0A00007A", 7), 1, []),  # not answered
        (upload(bytes(300), "_0A00007A", 7), 5, ["read out in part"]),
        (upload(bytes(300), "_0A00007A", 7), 99, ["read out"]),
        (download(bytes(300), "_0A00007P"), 1, []),
        (download(bytes(300), "_0A00007P"), 5, ["loaded in part"]),
        (download(bytes(300), "_0A00007P"), 99, ["loaded"]),
    ],
)
def test_a_block_is_loaded_or_read_out_once_the_device_answered(said: list[Said], kept: int, became: list[str]) -> None:
    def stops_there(talk: Talk) -> None:
        talk.open()
        carry(talk, said[:kept])
        talk.close()

    server, _ = inventory_of(stops_there).devices
    assert [text for how in server.blocks.values() for text in how.texts] == became


def test_a_server_that_asks_is_no_client_but_reads() -> None:
    """PUT/GET on the connection of others: the reads are those of who asks, the connection is counted once."""

    def both(talk: Talk) -> None:
        talk.open()
        talk.tell(read(1, dbw(5, 0)))

    inventory = inventory_of(both)
    counted = {(talk.client, talk.server): (talk.connections, talk.reads) for talk in inventory.talks}
    assert counted == {("10.0.0.1", "10.0.0.2"): (1, 0), ("10.0.0.2", "10.0.0.1"): (0, 1)}


def test_tags_are_named_by_area(tmp_path: Path) -> None:
    path = tmp_path / "tags.csv"
    path.write_text("address,type,name\nDB10.DBW4,INT,Level\nDB10.DBW6,INT,Speed\n", encoding="utf-8")
    (talk,) = inventory_of(polls, naming=load_tags([path]).naming()).talks
    assert talk.areas["DB10"].tags == ["Level", "Speed"]
    assert talk.areas["M"].tags == []


def test_variables_of_s7comm_plus() -> None:
    devices = {device.address: device for device in dissect.devices(PLUS)}
    server, station, panel = devices["192.0.2.20"], devices["192.0.2.10"], devices["192.0.2.30"]
    assert [stretch.value for stretch in server.history(facts.OPERATING_MODE)] == ["RUN", "STOP", "RUN"]
    assert [stretch.first_frame for stretch in server.history(facts.OPERATING_MODE)] == [14, 39, 44]
    assert (server.get(facts.ORDER_NUMBER), server.get(facts.FIRMWARE)) == ("6ES7 215-1AG40-0XB0", "V4.3")
    assert (station.role, station.certainty, station.sessions.texts) == (
        "engineering",
        "stated",
        ["TIA Portal on ES-07"],
    )
    assert (panel.role, panel.certainty) == ("panel", "stated")
    (talk,) = panel.asks
    area = talk.areas["DB1"]
    assert (area.reads, area.writes, area.low, area.tags) == (4, 1, -1, ['DB1."setpoint"'])
    assert list(talk.areas) == ["DB1"]  # its own session is no data


def test_a_selection_is_of_what_it_selects() -> None:
    def both(talk: Talk) -> None:
        talk.open()
        szl(talk, 1, identification("6ES7 315-2EH14-0AB0", (3, 2, 6)))
        talk.ask(read(2, dbw(1, 0)))
        talk.tell(words(2, 5))

    assert inventory_of(both).devices[0].get(facts.ORDER_NUMBER)
    path = ROOT / "captures" / "szl.pcapng"
    (whole,) = dissect.devices(path)
    (named,) = dissect.devices(path, where="frame in {12..13}")
    assert (whole.get(facts.FIRMWARE), named.get(facts.FIRMWARE)) == ("V3.2.6", "V3.2.6")
    assert (whole.get(facts.STATION_NAME), named.get(facts.STATION_NAME)) == ("SNAP7-SERVER", "")
    assert list(dissect.devices(path, where="host == 10.9.9.9")) == []


def test_files_are_one_inventory() -> None:
    paths = [ROOT / "captures" / name for name in ("szl.pcapng", "clock.pcapng")]
    (device,) = dissect.devices(*paths)
    assert device.get(facts.ORDER_NUMBER)
    assert device.clock_offset_ns == -664_723_057
    assert sum(talk.connections for talk in device.asked_by) == 2


def test_a_card_that_was_only_sent_to_counts_where_none_was_seen() -> None:
    cards = [bytes.fromhex("001b1b000001"), bytes.fromhex("001b1b000002")]

    def late(talk: Talk) -> None:
        talk.macs = cards
        for number in range(1, 4):
            talk.ask(read(number, dbw(1, 0)))

    def whole(talk: Talk) -> None:
        talk.macs = [cards[0], bytes.fromhex("001b1b0000ff")]
        talk.open()

    server = inventory_of(late).devices[-1]
    assert [(one.value, one.source) for one in server.history(facts.MAC)] == [
        ("00:1b:1b:00:00:02", "Ethernet, as receiver")
    ]
    server = inventory_of(late, whole).devices[0]
    assert [(one.value, one.source) for one in server.history(facts.MAC)] == [("00:1b:1b:00:00:ff", "Ethernet")]


# ---- bounds ---------------------------------------------------------------------------------------------------------


@pytest.mark.skipif(COMPILED, reason="compiled constants cannot be changed")
def test_what_has_no_room_is_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    def host(number: int) -> Callable[[Talk], None]:
        def scene(talk: Talk) -> None:
            talk.hosts = [number, 2]
            talk.open()
            for ref in range(1, 4):
                talk.ask(read(ref, dbw(ref, 0)))
                talk.tell(words(ref, 5))

        return scene

    monkeypatch.setattr(collector, "MAX_DEVICES", 3)
    monkeypatch.setattr(collector, "MAX_TALKS", 1)
    monkeypatch.setattr(collector, "MAX_TARGETS", 5)
    inventory = inventory_of(*[host(number) for number in (5, 6, 7, 8)])
    assert len(inventory.devices) == 3
    assert len(inventory.talks) == 1
    assert (inventory.talks_not_listed, inventory.devices_not_listed) == (1, 2)  # the server, two clients
    assert inventory.requests_not_looked_at == 12 - 5
    told = inventory_as_dict(inventory)
    assert complaints("devices", told, exact=True) == []


def test_what_a_device_holds_is_bounded() -> None:
    both, use, names, device = Both("a", "b"), Use(), Names(), Device("10.0.0.1")
    for number in [*range(500), *range(500)]:  # what has no room is counted once, however often it comes
        both.area(f"DB{number}")
        use.tag(str(number))
        use.reach(3 * number, 3 * number)
        names.add(str(number))
        device._because("CPU", "behaviour", str(number), 1)
    assert (len(both.areas), len(both.more_areas)) == (MAX_AREAS, 500 - MAX_AREAS)
    assert (len(use.tags), len(use.more_tags)) == (MAX_TAGS, 500 - MAX_TAGS)
    assert len(use.pieces) <= MAX_PIECES
    assert (use.pieces[0][0], use.pieces[-1][1], use.whole) == (0, 3 * 499, False)
    assert (len(names.texts), len(names.more)) == (MAX_NAMES, 500 - MAX_NAMES)
    assert len(device.reasons) < 500


def test_what_has_no_room_is_counted_once_over_parts_and_up_to_a_bound() -> None:
    first, second = Names(), Names()
    for number in range(30):
        first.add(f"a{number:02}")
        second.add(f"a{number + 10:02}")
    first.merge(second)
    assert first.texts == [f"a{number:02}" for number in range(MAX_NAMES)]
    assert len(first.more) == 40 - MAX_NAMES
    for number in range(2 * MAX_BEYOND):
        first.add(f"b{number}")
    assert len(first.more) == MAX_BEYOND


# ---- properties -----------------------------------------------------------------------------------------------------


def plain(inventory: Inventory) -> object:
    """Return what does not depend on how the same bytes were cut into packets: all but times and packets."""

    def without(value: object) -> object:
        if isinstance(value, dict):
            return {key: without(one) for key, one in value.items() if not key.endswith(("frame", "time", "_ns"))}
        return [without(one) for one in value] if isinstance(value, list) else value

    return without(inventory_as_dict(inventory))


def collected(packets: Iterable[Packet]) -> Inventory:
    inventory = Inventory()
    pipeline = Pipeline(inventory, Options(strict=True))
    for packet in packets:
        pipeline.frame(packet.time_ns, packet.octets, 0, len(packet.octets), packet.wire_length, packet.link_type)
    pipeline.finish()
    inventory.take(pipeline, [])
    return inventory


@given(st.integers(0, 2**32 - 1), st.sampled_from((0.3, 1.0)), st.sampled_from((0.0, 0.7)))
def test_any_segmentation_gives_the_same_devices(seed: int, cut: float, join: float) -> None:
    rng = Random(seed)
    made = conversations(rng, 2, 4)
    whole = collected(captured([segment for one in made for segment in segments(one)]))
    pieces = collected(captured(merged(rng, [segments(one, rng, cut=cut, join=join) for one in made])))
    assert plain(pieces) == plain(whole)
    assert whole.devices


def test_the_same_twice_is_the_same() -> None:
    def once() -> dict[str, object]:
        inventory = Inventory()
        run = Run([PLUS], inventory)
        while run.step():
            pass
        inventory.take(run.pipeline, run.files)
        return inventory_as_dict(inventory)

    assert once() == once()


def test_an_inventory_that_was_not_filled_is_the_callers_mistake() -> None:
    with pytest.raises(ValueError, match="call take"):
        inventory_as_dict(Inventory())


def test_each_end_answers_what_it_was_asked() -> None:
    """The PLC fetches a download by jobs of its own, which the client answers."""

    def loads(talk: Talk) -> None:
        talk.open()
        load(talk)

    server, client = inventory_of(loads).devices
    fetched = client.asked.answered
    assert fetched > 1
    for device in (server, client):
        assert device.asked.answered == device.latencies.count
    (talk,) = client.asks
    assert talk.answered == server.asked.answered + fetched
