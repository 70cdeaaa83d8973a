"""Cards and matrix: what is shown of much, what the settings name, and that nothing of the wire steers a terminal."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable

import pytest

from dissect.files.session import Run
from dissect.meaning.inventory import text as cards
from dissect.meaning.inventory.collector import Inventory
from dissect.meaning.inventory.model import Area
from dissect.meaning.inventory.outcome import Devices
from dissect.meaning.inventory.rows import COLUMNS, device_row
from dissect.meaning.report.outcome import csv_outcome
from tests.engine.stations.answers import answered, components, identification, mode, szl
from tests.engine.transactions.talk import Talk, ack_data, dbw, head, item, read, userdata, words, write, written
from tests.meaning.inventory.support import inventory_of
from tests.meaning.report.support import ROOT, UNSAFE

#: Answer of list 0x37: one Ethernet interface.
ETHERNET = bytes.fromhex("0037 0000 0030 0001 07ff c0a80001 ffffff00 c0a80001 001b1b000001 01 00") + bytes(26)
EVIL = "\x1b[31mred\u202e=cmd()"


def shown(inventory: Inventory, hosts: dict[str, str] | None = None) -> list[str]:
    return [line.text if hasattr(line, "text") else str(line) for line in Devices(inventory, hosts=hosts).text()]


def host(number: int, servers: tuple[int, ...] = (2,)) -> list[Callable[[Talk], None]]:
    """A client reads from servers."""

    def scene_of(server: int) -> Callable[[Talk], None]:
        def scene(talk: Talk) -> None:
            talk.hosts = [number, server]
            talk.open()
            talk.ask(read(1, dbw(1, 0)))
            talk.tell(words(1, 5))

        return scene

    return [scene_of(server) for server in servers]


def test_a_card() -> None:
    def online(talk: Talk) -> None:
        talk.open()
        szl(talk, 1, identification("6ES7 315-2EH14-0AB0", (3, 2, 6)))
        szl(talk, 2, components("S C-1", "Station", plant="Hall 3"))
        for number, code in enumerate((8, 8, 4), 3):
            szl(talk, number, mode(code))
        szl(talk, 6, ETHERNET)

    lines = shown(inventory_of(online), {"10.0.0.2": "Press"})
    assert lines[0] == "Press (10.0.0.2)  CPU  6ES7 315-2EH14-0AB0  V3.2.6"
    assert lines[1].startswith(
        "  role        states its order number (SZL 0x0011) (packet 9); answers S7comm requests (packet 7)"
    )
    assert lines[2] == (
        "  module      rack 0 slot 2: 6ES7 315-2EH14-0AB0, hardware 1, firmware V3.2.6, serial number S C-1 (packets 9, 11)"
    )
    assert lines[3] == "  names       rack 0 slot 2: station Station, plant Hall 3 (packet 11)"
    assert lines[4] == "  mode        RUN (12:26:40.013000, packet 13, 2 times) → STOP (12:26:40.017000, packet 17)"
    assert lines[5] == "  Ethernet    192.168.0.1 00:1b:1b:00:00:01 (12:26:40.019000, packet 19)"
    assert "  asked by    10.0.0.1: 1 connection (S7comm)" in lines
    assert lines[-2:] == ["            Press", "  10.0.0.1      7"]


def test_what_is_read_and_what_is_written_are_told_apart() -> None:
    """Of an area both are done to; where there are gaps between the pieces the ends of all of it are said to be that."""

    def scene(talk: Talk) -> None:
        talk.open()
        for reference, octet in enumerate((0, 2, 300), 1):
            talk.ask(read(reference, item(0x83, 0, octet * 8, 4)))
            talk.tell(words(reference, 5))
        for reference, octet in enumerate((10, 8), 11):
            talk.ask(write(reference, [item(0x83, 0, octet * 8, 4)], written(4, b"\0\1")))
            talk.tell(ack_data(reference, b"\x05\x01", b"\xff"))

    lines = shown(inventory_of(scene))
    assert "  asked by    10.0.0.1: 1 connection (S7comm); 3 reads: within M[0..301]; 2 writes: M[8..11]" in lines


def test_tags_that_are_read_and_tags_that_are_written_are_told_apart() -> None:
    area = Area("DB1")
    area.read.tag("DB1.Level")
    area.written.tag("DB1.Speed")
    assert area.tags == ["DB1.Level", "DB1.Speed"]
    assert [cards._area(area, use) for use in (area.read, area.written)] == ["DB1 {Level}", "DB1 {Speed}"]


def test_a_card_that_several_stations_send_with_is_said_to_be_so() -> None:
    """A router on the way hides whose it is."""
    inventory = Inventory()
    run = Run([str(ROOT / "captures" / "crafted" / "plus-plant.pcapng")], inventory)
    while run.step():
        pass
    inventory.take(run.pipeline, run.files)
    cards_of = [line.strip() for line in shown(inventory) if line.startswith("  MAC ")]
    clients = "02:00:00:00:00:01 (locally administered), packet"
    assert len(cards_of) == 3
    assert [
        line for line in cards_of if clients in line and "; 2 stations send with it: a router on the way" in line
    ] == [line for line in cards_of if clients in line]
    assert len([line for line in cards_of if "stations send with it" in line]) == 2


def test_the_matrix() -> None:
    scenes = [*host(1, (20, 21)), *host(2, (20,)), *host(3, (21,))]
    lines = shown(inventory_of(*scenes))
    begin = next(at for at, line in enumerate(lines) if line.startswith("Who talks to whom"))
    assert [line.split() for line in lines[begin + 1 :]] == [
        ["10.0.0.20", "10.0.0.21"],
        ["10.0.0.1", "2", "2"],
        ["10.0.0.2", "2", "."],
        ["10.0.0.3", ".", "2"],
    ]


def test_much_is_shown_in_part_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(cards, "_CARDS", 3)
    monkeypatch.setattr(cards, "_TALKS", 2)
    monkeypatch.setattr(cards, "_ROWS", 4)
    monkeypatch.setattr(cards, "_COLUMNS", 1)
    scenes = [scene for number in range(10, 16) for scene in host(number, (2, 3))]
    lines = shown(inventory_of(*scenes))
    assert "and 5 more devices; -T json and -T csv list them all" in lines
    assert "  asked by    and 4 more" in lines
    assert lines[-2:] == ["  and 2 more clients; -T json lists them", "  and 1 more server; -T json lists them"]


def test_nothing_on_the_wire_steers_a_terminal_or_a_spreadsheet() -> None:
    name = EVIL.replace("\u202e", "")

    def scene(talk: Talk) -> None:
        talk.open()
        szl(talk, 1, identification("=1+1", (3, 2, 6)))
        szl(talk, 2, components(name, name, "@x", "+cmd"))

    inventory = inventory_of(scene)
    assert not any(UNSAFE.search(line) for line in shown(inventory, {"10.0.0.1": EVIL}))
    outcome = Devices(inventory, hosts={"10.0.0.1": "=2+3"})
    rows = list(csv.reader(io.StringIO("\n".join(str(line) for line in csv_outcome(outcome)))))
    assert tuple(rows[0]) == COLUMNS
    first = dict(zip(rows[0], rows[1], strict=True))
    assert (first["order_number"], first["module_name"], first["plant"]) == ("'=1+1", "'@x", "'+cmd")
    assert "\x1b" not in first["serial_number"]
    assert rows[2][1] == "'=2+3"
    assert device_row(inventory.devices[0], outcome.places)["order_number"] == "=1+1"  # made safe where it is written


def test_evidence_for_another_role_is_said_to_be_that() -> None:
    def scene(talk: Talk) -> None:
        talk.open()
        szl(talk, 1, identification("6ES7 315-2EH14-0AB0", (3, 2, 6)))

    inventory = inventory_of(scene)
    cpu = inventory.devices[0]
    cpu._because("panel", "behaviour", "subscribes to messages", 9)
    (role,) = [text for text in shown(inventory) if "subscribes" in text]
    assert role.endswith("; perhaps a panel: subscribes to messages (packet 9)")


def test_no_device() -> None:
    assert shown(inventory_of(lambda talk: talk.hello())) == ["No device: no ISO-on-TCP connection in what was read."]


def test_an_interruption_is_said() -> None:
    outcome = Devices(inventory_of(*host(1)), interrupted=True)
    assert str(next(iter(outcome.text()))).startswith("Line(text='INTERRUPTED")
    assert outcome.as_dict()["interrupted"] is True


def test_packets_that_are_not_in_order_of_time() -> None:
    """As of captures that are given in another order."""
    inventory = inventory_of(*host(1))
    device = inventory.devices[0]
    device.first_ns, device.last_ns = int(device.last_ns) + 10**9, int(device.first_ns)
    (line,) = [line for line in shown(inventory) if line.startswith("  seen ")][:1]
    assert " UTC back to " in line
    assert " (packets are not in order of time), packets 1 to " in line


@pytest.mark.parametrize(("seconds", "dated"), [(0, False), (3600, False), (86_400, True), (400 * 86_400, True)])
def test_a_card_of_several_days_has_dates(seconds: int, dated: bool) -> None:
    """From 12:26:40 on: an hour later it is the same day."""

    def online(talk: Talk) -> None:
        talk.open()
        szl(talk, 1, mode(8))
        talk.now_ns += seconds * 10**9
        szl(talk, 2, mode(4))

    (line,) = [line for line in shown(inventory_of(online)) if line.startswith("  mode")]
    assert line.count("2020-09-13") == (1 if dated else 0)
    assert line.count(" UTC, packet") == (2 if dated else 0)


def test_what_was_read_of_a_clock_and_what_was_set_are_two_lines() -> None:
    def clock(talk: Talk) -> None:
        talk.open()
        read_time = bytes.fromhex("0019" + "20091312264500" + "01")  # 2020-09-13 12:26:45.000
        answered(talk, 1, 7, 1, b"", read_time)
        set_time = bytes.fromhex("0019" + "23111422133000" + "01")
        talk.ask(userdata(2, head(1, 7, 2), b"\xff\x09\x00\x0a" + set_time))
        talk.tell(userdata(2, head(2, 7, 2, 0, 0), b"\x0a\x00\x00\x00"))

    read_line, set_line = [line for line in shown(inventory_of(clock)) if line.startswith("  clock")]
    assert read_line.startswith("  clock       read: 4.99 s ahead of the capture")
    assert set_line.startswith("  clock       set: 1157 d")
