"""What a pcapng capture says of the packets it lost."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

import dissect
from dissect.packets.source.pcapng import PcapngReader
from dissect.packets.source.statistics import Lost, read_lost
from tests.packets.source.live_support import Sink


def option(order: str, code: int, value: bytes) -> bytes:
    return struct.pack(f"{order}HH", code, len(value)) + value + bytes(-len(value) % 4)


def statistics(order: str, interface: int, *options: bytes) -> bytes:
    return block(order, 5, struct.pack(f"{order}III", interface, 1, 2) + b"".join(options))


def block(order: str, kind: int, body: bytes) -> bytes:
    size = 12 + len(body)
    return struct.pack(f"{order}II", kind, size) + body + struct.pack(f"{order}I", size)


class Memory:
    damage = ""

    def read(self, size: int) -> bytes:
        return b""

    def close(self) -> None:
        pass


@pytest.mark.parametrize("order", ["<", ">"])
def test_both_counts(order: str) -> None:
    counts = [option(order, code, struct.pack(f"{order}Q", count)) for code, count in ((4, 9), (5, 2**40), (7, 3))]
    assert read_lost(statistics(order, 0, option(order, 1, b"odd"), *counts)) == Lost(2**40, 3)


@pytest.mark.parametrize("order", ["<", ">"])
def test_what_is_not_said_is_not_none(order: str) -> None:
    assert read_lost(statistics(order, 0)) == Lost(None, None)
    assert read_lost(statistics(order, 0, option(order, 7, struct.pack(f"{order}Q", 0)))) == Lost(None, 0)
    assert read_lost(statistics(order, 0, option(order, 7, bytes(4)))) == Lost(None, None)
    ended = option(order, 0, b"") + option(order, 7, bytes(8))
    assert read_lost(statistics(order, 0, ended)) == Lost(None, None)


def test_cut_anywhere() -> None:
    whole = statistics("<", 0, option("<", 5, (4).to_bytes(8, "little")), option("<", 7, (5).to_bytes(8, "little")))
    assert {read_lost(whole[:size]) for size in range(len(whole))} == {Lost(None, None), Lost(4, None)}
    assert read_lost(whole) == Lost(4, 5)


@given(st.binary(max_size=80))
def test_any_octets(octets: bytes) -> None:
    read_lost(octets)


@pytest.mark.parametrize("order", ["<", ">"])
def test_the_reader_keeps_the_last_of_each_interface(order: str) -> None:
    section = block(order, 0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1))
    interface = block(order, 1, struct.pack(f"{order}HHI", 1, 0, 0))
    lost = [statistics(order, 0, option(order, 7, struct.pack(f"{order}Q", count))) for count in (1, 8)]
    strange = statistics(order, 1, option(order, 7, struct.pack(f"{order}Q", 99)))  # of no interface there is
    huge = block(order, 5, struct.pack(f"{order}III", 0, 1, 2) + bytes(8000))
    reader = PcapngReader(Memory(), section + interface + lost[0] + lost[1] + strange + huge)
    while reader.step(Sink()):
        pass
    assert not reader.damage
    assert {number: read_lost(octets) for number, octets in reader.statistics.items()} == {0: Lost(None, 8)}


def test_another_section_begins_anew() -> None:
    section = block("<", 0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    interface = block("<", 1, struct.pack("<HHI", 1, 0, 0))
    reader = PcapngReader(Memory(), section + interface + statistics("<", 0) + section + interface)
    while reader.step(Sink()):
        pass
    assert reader.statistics == {}


def test_so_many_are_kept_and_no_more() -> None:
    """A made file may have 65,536 interfaces in each of many sections, and a block of 4 KiB for each of them."""
    section = block("<", 0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1))
    interfaces = block("<", 1, struct.pack("<HHI", 1, 0, 0)) * 5000
    blocks = b"".join([statistics("<", number) for number in range(5000)])
    reader = PcapngReader(Memory(), (section + interfaces + blocks) * 3)
    while reader.step(Sink()):
        pass
    assert not reader.damage
    assert (len(reader.statistics), len(reader.earlier_statistics)) == (4096, 4096)


@pytest.mark.parametrize("order", ["<", ">"])
def test_what_a_file_states_is_a_finding(order: str, tmp_path: Path) -> None:
    """All interfaces and sections count, of each interface the last block."""
    section = block(order, 0x0A0D0D0A, struct.pack(f"{order}IHHq", 0x1A2B3C4D, 1, 0, -1))
    interface = block(order, 1, struct.pack(f"{order}HHI", 1, 0, 0))
    dropped = [option(order, code, struct.pack(f"{order}Q", number)) for code, number in ((5, 7), (5, 120), (7, 2))]
    packet = block(order, 6, struct.pack(f"{order}5I", 0, 0, 1, 60, 60) + bytes(60))
    path = tmp_path / "lossy.pcapng"
    path.write_bytes(
        section + interface + interface + packet + statistics(order, 0, dropped[0]) + statistics(order, 0, dropped[1])
        + statistics(order, 1, *dropped[1:]) + section + interface + packet + statistics(order, 0, dropped[0])
    )  # fmt: skip
    analysis = dissect.analyze(path)
    (finding,) = [one for one in analysis.findings if one.slug == "capture.dropped"]
    stated = "247 packets dropped by the interface, 2 packets dropped by the operating system, as the file states"
    assert finding.detail == f"{path}: {stated}"


def test_a_file_that_states_no_loss(tmp_path: Path) -> None:
    path = tmp_path / "sound.pcapng"
    begin = block("<", 0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)) + block(
        "<", 1, struct.pack("<HHI", 1, 0, 0)
    )
    path.write_bytes(begin + statistics("<", 0, option("<", 5, bytes(8))))
    assert "capture.dropped" not in dissect.analyze(path).finding_counts
