"""Written pcapng files: what our reader and Wireshark read of them, blocks that are never half, a disk that is full."""

from __future__ import annotations

import os
import random
import signal
import stat
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.source import pcapng_writer
from dissect.packets.source.files import open_capture
from dissect.packets.source.pcapng_writer import (
    PcapngWriter,
    comment_octets,
    interface_block,
    packet_block,
    section_block,
)
from tests.meaning.report.support import UNSAFE
from tests.packets.source.craft import (
    EPOCH,
    ETHERNET,
    NS,
    SLL,
    Frame,
    Recorder,
    drain,
    reader_of,
    small_disk,
    step_to_the_end,
)

TIME = EPOCH * NS + 123_456_789
#: An Ethernet frame of a protocol nobody knows, which Wireshark shows without complaint.
ETHER = b"\x02\x00\x00\x00\x00\x01\x02\x00\x00\x00\x00\x02\x88\xb5" + bytes(46)


def read(path: Path) -> Recorder:
    reader = open_capture(str(path))
    recorder = drain(reader)
    assert (reader.damage, reader.rejected, reader.notes) == ("", 0, [])
    return recorder


def shown(path: Path, *fields: str) -> list[list[str]]:
    """Return what tshark shows of each packet; it must not complain."""
    told = subprocess.run(
        ["tshark", "-r", str(path), "-n", "-T", "fields", *[part for field in fields for part in ("-e", field)]],
        capture_output=True,
        text=True,
        check=True,
    )
    complaints = [line for line in told.stderr.splitlines() if not line.startswith("Running as user")]
    assert complaints == []
    return [line.split("\t") for line in told.stdout.splitlines()]


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    writer = PcapngWriter(str(path), "x86_64", "Linux", "s7dissect", "cut out")
    writer.packet(TIME, ETHER, len(ETHER), ETHERNET, ["one", "two\nlines Ω"], "eth0")
    writer.packet(TIME - 5, b"\x01\x02\x03", 99, SLL)
    writer.packet(TIME + 1, ETHER, 0, ETHERNET, (), "eth1")
    writer.close()
    writer.close()
    assert writer.closed
    assert (writer.packets, writer.octets) == (3, path.stat().st_size)
    got = read(path)
    assert got.frames == [
        Frame(TIME, ETHER, len(ETHER), ETHERNET),
        Frame(TIME - 5, b"\x01\x02\x03", 99, SLL),
        Frame(TIME + 1, ETHER, len(ETHER), ETHERNET),
    ]
    assert got.comments == [(1, "one"), (1, "two\nlines Ω")]
    assert stat.S_IMODE(path.stat().st_mode) & 0o007 == 0


def test_wireshark_reads_it(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    writer = PcapngWriter(str(path), "a box", "some OS", "s7dissect 9", "why")
    writer.packet(TIME, ETHER, 60, ETHERNET, ["первый", "second \x1b[31m"], "eth0")
    writer.packet(TIME + 1, ETHER, 1500, ETHERNET, (), "eth1")
    writer.statistics(ETHERNET, "eth1", 10, 4)
    writer.close()
    assert shown(path, "frame.number", "frame.time_epoch", "frame.len", "frame.interface_name", "frame.comment") == [
        ["1", "1700000000.123456789", "60", "eth0", "первый,second \\x1b[31m"],
        ["2", "1700000000.123456790", "1500", "eth1", ""],
    ]
    about = subprocess.run(["capinfos", str(path)], capture_output=True, text=True, check=True).stdout
    for said in ("a box", "some OS", "s7dissect 9", "why", "Name = eth1", "Time precision = nanoseconds (9)"):
        assert said in about
    assert "Number of packets = 1" in about
    assert "Number of stat entries = 1" in about


def test_statistics_tell_when_how_many_and_what_was_lost(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    writer = PcapngWriter(str(path))
    writer.packet(7, ETHER, 60, ETHERNET)
    writer.packet(5, ETHER, 60, ETHERNET)
    writer.packet(9, ETHER, 60, SLL)
    writer.statistics(ETHERNET, "", 300, 20)
    writer.interface(228)
    writer.close()
    octets = path.read_bytes()
    statistics = [block for kind, block in blocks(octets) if kind == 5]
    assert [struct.unpack_from("<III", block, 8) for block in statistics] == [(0, 0, 7), (1, 0, 9)]
    first, second = (options(block[20:-4]) for block in statistics)
    assert first == {2: (0, 5), 3: (0, 7), 4: (300, 0), 5: (20, 0), 8: (2, 0)}
    assert second == {2: (0, 9), 3: (0, 9), 8: (1, 0)}


def blocks(octets: bytes) -> Iterator[tuple[int, bytes]]:
    at = 0
    while at < len(octets):
        kind, total = struct.unpack_from("<II", octets, at)
        assert total % 4 == 0
        assert struct.unpack_from("<I", octets, at + total - 4) == (total,)
        yield kind, octets[at : at + total]
        at += total
    assert at == len(octets)


def options(octets: bytes) -> dict[int, tuple[int, int]]:
    found = {}
    at = 0
    while (head := struct.unpack_from("<HH", octets, at)) != (0, 0):
        assert head[1] == 8
        found[head[0]] = struct.unpack_from("<II", octets, at + 4)
        at += 12
    assert at + 4 == len(octets)
    return found


@given(
    time_ns=st.integers(0, 2**63 - 1),
    octets=st.binary(max_size=200),
    more=st.integers(0, 2000),
    comments=st.lists(st.text(min_size=1, max_size=30), max_size=4),
    name=st.text(max_size=300),
    link_type=st.integers(0, 0xFFFF),
)
def test_any_packet_is_read_back(
    time_ns: int, octets: bytes, more: int, comments: list[str], name: str, link_type: int
) -> None:
    written = section_block() + interface_block(link_type, name)
    written += packet_block(0, time_ns, octets, len(octets) + more, comments)
    reader = reader_of(written)
    got = drain(reader)
    assert (reader.damage, reader.rejected, reader.notes) == ("", 0, [])
    assert got.frames == [Frame(time_ns, octets, len(octets) + more, link_type)]
    assert got.comments == [(1, comment_octets(text).decode()) for text in comments if comment_octets(text)]


@given(st.text(alphabet=st.characters(), max_size=50))
def test_no_comment_steers_a_terminal(text: str) -> None:
    told = comment_octets(text).decode()
    assert UNSAFE.search(told.replace("\n", "")) is None


def test_the_name_of_the_interface_comes_back() -> None:
    written = section_block() + interface_block(ETHERNET, "eth0") + interface_block(ETHERNET)
    reader = reader_of(written + packet_block(0, 1, ETHER, 60) + packet_block(1, 2, ETHER, 60))
    names = []

    class Asking(Recorder):
        def frame(self, *packet: object) -> None:
            names.append(reader.interface)

    step_to_the_end(reader, Asking())
    assert names == ["eth0", ""]


def test_comments_have_bounds() -> None:
    long = "ж" * 40_000
    assert len(comment_octets(long)) <= 65_535
    assert comment_octets(long).decode().endswith("ж…")
    got = drain(reader_of(section_block() + interface_block(1) + packet_block(0, 1, ETHER, 60, [long] * 10)))
    assert len(got.comments) == 4
    assert got.comments[-1][1] == "7 more comments were dropped"


def test_a_packet_larger_than_a_block_is_refused() -> None:
    with pytest.raises(ValueError, match="larger than a pcapng block"):
        packet_block(0, 1, bytes(16 * 1024 * 1024), 0)
    with pytest.raises(ValueError, match="not a link type"):
        interface_block(65536)


@pytest.mark.parametrize(("time_ns", "kept"), [(-1, 0), (2**63 - 1, 2**63 - 1)])
def test_a_time_that_does_not_fit_is_put_to_the_nearest(time_ns: int, kept: int) -> None:
    got = drain(reader_of(section_block() + interface_block(1) + packet_block(0, time_ns, ETHER, 60)))
    assert got.frames[0].time_ns == kept


def test_names_beyond_what_readers_keep_go_the_packets_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pcapng_writer, "MAX_INTERFACES", 3)
    path = tmp_path / "out.pcapng"
    writer = PcapngWriter(str(path))
    for number in range(20):
        writer.packet(number, ETHER, 60, ETHERNET, (), f"eth{number}")
    writer.close()
    assert len(read(path).frames) == 20
    assert [kind for kind, _ in blocks(path.read_bytes())].count(1) == 4


def test_an_existing_file_is_not_overwritten_unasked(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    path.write_bytes(b"precious")
    with pytest.raises(FileExistsError, match=r"out\.pcapng"):
        PcapngWriter(str(path))
    assert path.read_bytes() == b"precious"
    PcapngWriter(str(path), overwrite=True).close()
    assert read(path).frames == []


def test_each_block_is_in_the_file_when_it_was_written(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    writer = PcapngWriter(str(path))
    for number in range(5):
        writer.packet(number, ETHER, 60, ETHERNET)
        assert len(read(path).frames) == number + 1
    writer.abandon()
    writer.abandon()
    assert len(read(path).frames) == 5
    with pytest.raises(ValueError, match="closed"):
        writer.packet(1, ETHER, 60, ETHERNET)


def test_a_batch_is_written_when_it_is_full_and_when_asked(tmp_path: Path) -> None:
    path = tmp_path / "out.pcapng"
    writer = PcapngWriter(str(path), batch=500)
    seen = []
    for number in range(12):
        writer.packet(number, ETHER, 60, ETHERNET)
        seen.append(len(read(path).frames))
    assert seen == [0, 0, 0, 0, 0, 6, 6, 6, 6, 6, 6, 12]
    writer.flush()
    assert len(read(path).frames) == 12
    writer.packet(12, ETHER, 60, ETHERNET)
    writer.abandon()
    assert len(read(path).frames) == 12


@pytest.mark.parametrize("batch", [0, 300])
def test_a_full_disk_is_told_and_leaves_whole_blocks(tmp_path: Path, batch: int) -> None:
    path = tmp_path / "out.pcapng"
    written = 0
    with small_disk(1000):
        writer = PcapngWriter(str(path), batch=batch)
        with pytest.raises(OSError, match=r"too large.*out\.pcapng") as told:  # noqa: PT012 - which packet is the point
            for _ in range(100):
                writer.packet(written, ETHER, 60, ETHERNET)
                written += 1
        assert told.value.filename == str(path)
        writer.close()
    assert 600 < path.stat().st_size <= 1000
    assert len(read(path).frames) == written if batch == 0 else 0 < len(read(path).frames) <= written


def test_a_device_without_room_is_told() -> None:
    with pytest.raises(OSError, match=r"No space left.*/dev/full"):
        PcapngWriter("/dev/full", overwrite=True)


def test_a_missing_folder_is_told(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"none/out\.pcapng"):
        PcapngWriter(str(tmp_path / "none" / "out.pcapng"))


CHILD = """
import sys
from dissect.packets.source.pcapng_writer import PcapngWriter
writer = PcapngWriter(sys.argv[1])
number = 0
while True:
    number += 1
    writer.packet(number, number.to_bytes(4, "big") * (number % 5000), 0, 1, ["packet %d" % number])
"""


@pytest.mark.parametrize("seed", range(5))
def test_a_kill_at_any_moment_leaves_a_readable_file(tmp_path: Path, seed: int) -> None:
    path = tmp_path / "out.pcapng"
    enough = random.Random(seed).randrange(1, 20_000_000)
    with subprocess.Popen([sys.executable, "-c", CHILD, str(path)]) as child:
        try:
            end = time.monotonic() + 60
            while (not path.exists() or path.stat().st_size < enough) and time.monotonic() < end:
                time.sleep(0.0005)
        finally:
            os.kill(child.pid, signal.SIGKILL)
    reader = open_capture(str(path))
    got = Recorder()
    step_to_the_end(reader, got)
    reader.close()
    count = len(got.frames)
    assert path.stat().st_size >= enough
    assert reader.rejected == 0
    assert reader.damage == "" or "cut off" in reader.damage
    assert [frame.octets[:4] for frame in got.frames] == [
        number.to_bytes(4, "big") if number % 5000 else b"" for number in range(1, count + 1)
    ]
    told = subprocess.run(["capinfos", "-c", "-M", "-T", "-r", str(path)], capture_output=True, text=True, check=False)
    assert told.stdout.split("\t")[1].strip() == str(count)


def test_standard_output_is_written_and_stays_open(tmp_path: Path) -> None:
    code = (
        "import os\n"
        "from dissect.packets.source.pcapng_writer import PcapngWriter\n"
        "writer = PcapngWriter('-')\n"
        "writer.packet(1, b'abcd', 4, 1)\n"
        "writer.close()\n"
        "os.fstat(1)\n"
    )
    octets = subprocess.run([sys.executable, "-c", code], capture_output=True, check=True).stdout
    assert [frame.octets for frame in drain(reader_of(octets)).frames] == [b"abcd"]
