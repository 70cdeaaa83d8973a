"""What devices state, held against others: Wireshark's SZL fields, and a python-snap7 server that says who it is."""

from __future__ import annotations

import subprocess
from bisect import bisect_left
from itertools import accumulate
from pathlib import Path
from typing import Final

import pytest
import snap7

import dissect
from dissect.engine.stations import facts
from dissect.meaning.inventory.model import Device
from tests.cli.test_proxy import proxy
from tests.meaning.report.schemas import ROOT
from tests.online.live.support import client, plc
from tests.tshark import join

#: Our keys and Wireshark's fields of list 0x001C, and of the records of list 0x0011.
NAMES: Final = {
    facts.STATION_NAME: "s7comm.szl.001c.0001.name",
    facts.MODULE_NAME: "s7comm.szl.001c.0002.name",
    facts.PLANT: "s7comm.szl.001c.0003.tag",
    facts.SERIAL_NUMBER: "s7comm.szl.001c.0005.serialn",
    facts.MODULE_TYPE: "s7comm.szl.001c.0007.cputypname",
    facts.CARD_SERIAL: "s7comm.szl.001c.0008.snmcmmc",
}
IDENTIFICATION: Final = [f"s7comm.szl.xy11.0001.{name}" for name in ("index", "anz", "ausbg", "ausbe")]
MODE: Final = "s7comm.szl.0424.0000.bzu_id.req"
LEVEL: Final = "s7comm.szl.0132.0004.real"
#: Captures with lists that Wireshark reads.
OWN: Final = ("szl.pcapng", "plc-control.pcapng")
SHARED: Final = (
    "tia_s300_goOnline.pcapng",
    "s7ident_refused_upload.pcap",
    "s7comm_reading_plc_status.pcap",
    "scanner_two_connections.pcap",
    "plc4x_manual_test_tpdu_nr.pcapng",
    "step7_s300_AuthPassword.pcapng",
)


def theirs(paths: list[Path], folder: Path) -> list[dict[str, set[str]]]:
    """Return what Wireshark reads of the lists in each of some captures between other hosts, by our keys."""
    joined, counts = join(paths, folder)
    fields = ["frame.number", *IDENTIFICATION, *NAMES.values(), MODE, LEVEL]
    command = ["tshark", "-n", "-r", str(joined), "-o", "tpkt.tcp.port:102,1102", "-Y", "s7comm.data.userdata.szl_id"]
    command += ["-T", "fields", "-E", "separator=/t", "-E", "aggregator=;"]
    for field in fields:
        command += ["-e", field]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    ends = list(accumulate(counts))
    made: list[dict[str, set[str]]] = [{} for _ in paths]
    for line in ran.stdout.splitlines():
        cells = dict(zip(fields, [cell.split(";") if cell else [] for cell in line.split("\t")], strict=False))
        found = made[bisect_left(ends, int(cells["frame.number"][0]))]
        for key, field in NAMES.items():
            found.setdefault(key, set()).update([text.strip() for text in cells[field] if text.strip()])
        for index, order, version, release in zip(*[cells[field] for field in IDENTIFICATION], strict=True):
            _identified(found, int(index, 0), order.strip(), int(version, 0), int(release, 0))
        found.setdefault(facts.OPERATING_MODE, set()).update(cells[MODE])
        found.setdefault(facts.PROTECTION, set()).update(cells[LEVEL])
    assert all(made)
    return made


def _identified(found: dict[str, set[str]], index: int, order: str, version: int, release: int) -> None:
    if index == 1:
        found.setdefault(facts.ORDER_NUMBER, set()).add(order)
    elif index == 6:
        found.setdefault(facts.HARDWARE, set()).add(str(version))
    elif index == 7:
        firmware = f"{chr(version >> 8)}{version & 0xFF}.{release >> 8}.{release & 0xFF}"
        found.setdefault(facts.FIRMWARE, set()).add(firmware)


def ours(devices: list[Device], key: str) -> set[str]:
    return {stretch.value for device in devices for stretch in device.history(key)}


def compared(path: Path, read: dict[str, set[str]]) -> int:
    """Hold everything that Wireshark reads against what we state; return how many values there were."""
    devices = list(dissect.devices(path))
    count = 0
    for key, values in read.items():
        if not values:
            continue  # Wireshark does not look into list 0x0232
        said = ours(devices, key)
        if key == facts.OPERATING_MODE:
            said = {{"STOP": "4", "RUN": "8"}[value] for value in said}
        elif key == facts.PROTECTION:
            said = {value.partition(" ")[0] for value in said}
        numbers = key in {facts.OPERATING_MODE, facts.PROTECTION}
        assert said == ({str(int(value, 0)) for value in values} if numbers else values), (path.name, key)
        count += len(values)
    return count


def test_wireshark_reads_the_same_of_our_captures(tmp_path: Path) -> None:
    paths = [ROOT / "captures" / name for name in OWN]
    assert sum(map(compared, paths, theirs(paths, tmp_path))) >= 10


def test_wireshark_reads_the_same_of_the_shared_captures(corpus: Path, tmp_path: Path) -> None:
    paths = [corpus / name for name in SHARED]
    assert sum(map(compared, paths, theirs(paths, tmp_path))) >= 25


def test_a_server_that_says_who_it_is(tmp_path: Path) -> None:
    """Through the relay: what python-snap7 reads of its server is what the card says, and what it read and wrote.

    Its server answers list 0x001C with a text that is no list, so that a card has no names of it.
    """
    path = tmp_path / "session.pcapng"
    with plc() as server, proxy(server.port, "-w", path) as relay:
        with client(relay.port) as peer:
            order = peer.get_order_code()
            peer.get_cpu_info()
            peer.db_read(1, 4, 4)
            peer.db_write(1, 0, bytearray(b"\x2a"))
            with pytest.raises(snap7.error.S7Error):
                peer.db_read(99, 0, 4)
        relay.ended()
    (device,) = [device for device in dissect.devices(path) if device.get(facts.ORDER_NUMBER)]
    assert device.get(facts.ORDER_NUMBER) == _text(order.OrderCode)
    assert device.role == "CPU"
    (talk,) = [talk for talk in device.asked_by if talk.transactions]
    areas = {name: (area.reads, area.writes, area.refused, area.low, area.high) for name, area in talk.areas.items()}
    assert areas == {"DB1": (1, 1, 0, 0, 7), "DB99": (0, 0, 1, 0, 3)}


def _text(value: bytes) -> str:
    return value.decode().strip("\0 ")
