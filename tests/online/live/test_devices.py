"""What stations state, while it happens: a line and an event when it is new or different, and only then."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from dissect.online.monitor.model import Model
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT, complaints
from tests.meaning.report.support import UNSAFE

Capture = pytest.CaptureFixture[bytes]
PLANT = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
SZL = ROOT / "captures" / "szl.pcapng"


def test_a_line_for_what_is_new_or_different(capfdbinary: Capture) -> None:
    lines = run(capfdbinary, "monitor", "--plain", "--only", "devices", PLANT).out.splitlines()
    assert [line[32:] for line in lines] == [
        "DEVICE  192.0.2.20 rack 0 slot 2  order number 6ES7 215-1AG40-0XB0  (S7comm-plus session, packets 6, 7)",
        "DEVICE  192.0.2.20 rack 0 slot 2  firmware version V4.3  (S7comm-plus session, packets 6, 7)",
        "DEVICE  192.0.2.20 rack 0 slot 2  operating mode RUN  (operating state variable, packet 14)",
        "DEVICE  192.0.2.20 rack 0 slot 2  operating mode STOP, before RUN  (operating state variable, packet 39)",
        "DEVICE  192.0.2.20 rack 0 slot 2  operating mode RUN, before STOP  (operating state variable, packet 44)",
    ]


def test_an_event_for_programs(capfdbinary: Capture) -> None:
    told = [
        json.loads(line)
        for line in run(capfdbinary, "monitor", "-T", "jsonl", "--only", "devices", SZL).out.splitlines()
    ]
    assert all(complaints("event", line, exact=True) == [] for line in told)
    assert told.pop()["event"] == "summary"
    assert {line["event"] for line in told} == {"device"}
    assert told[0]["device"] == {
        "address": "127.0.0.1",
        "vlan": [],
        "module": "rack 0 slot 2",
        "kind": "order_number",
        "value": "6ES7 315-2EH14-0AB0",
        "before": None,
        "source": "SZL 0x0011",
        "connection": 1,
        "frames": [12, 13],
    }


def test_a_selection_holds_for_them(capfdbinary: Capture) -> None:
    said = run(capfdbinary, "monitor", "--plain", "--only", "devices", "-Y", "frame in {14..15}", SZL).out.splitlines()
    assert len(said) == 5
    assert all("SZL 0x001c, packets 14, 15" in line for line in said)


def test_nothing_that_a_station_states_steers_a_terminal(capfdbinary: Capture, tmp_path: Path) -> None:
    evil = tmp_path / "evil.pcapng"
    evil.write_bytes(SZL.read_bytes().replace(b"SNAP7-SERVER", b"\x1b[31mSERVER\r"))
    lines = run(capfdbinary, "monitor", "--plain", "--only", "devices", evil).out.splitlines()
    assert any("SERVER" in line and "name of the station" in line for line in lines)
    assert not any(UNSAFE.search(line) for line in lines)


def test_screens_take_no_notice() -> None:
    from dissect.engine.pipeline import Options
    from dissect.online.live.events import DEVICE
    from dissect.online.live.session import Session
    from dissect.packets.source.files import open_capture

    session = Session(lambda: open_capture(str(SZL)), Options())
    session.start()
    events = []
    while session.running or session.waiting:
        events += session.poll(0.2)
    session.close()
    assert sum(event.kind == DEVICE for event in events) == 13
    with_them, without = Model(), Model()
    with_them.take(events)
    without.take([event for event in events if event.kind != DEVICE])
    assert len(with_them.entries) == len(without.entries) > 0
