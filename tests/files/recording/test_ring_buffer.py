"""The ring of capture files: when it turns, what it is called, what it leaves when it is killed, and what it refuses."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dissect.files.recording.ring_buffer import RingBuffer, RingLimits, parse_limits
from dissect.packets.source.files import open_capture
from tests.packets.source.craft import EPOCH, ETHERNET, NS, Recorder, drain, small_disk, step_to_the_end

TIME = EPOCH * NS
OCTETS = bytes(range(100))


def numbers(path: Path) -> list[int]:
    """Return the numbers of the packets in a file, which `put` gave them."""
    got = drain(open_capture(str(path)))
    return [int.from_bytes(frame.octets[:4], "big") for frame in got.frames]


def put(ring: RingBuffer, number: int, time_ns: int | None = None, size: int = 100) -> None:
    octets = b"before" + number.to_bytes(4, "big") + bytes(size - 4) + b"after"
    ring.frame(TIME + number * NS if time_ns is None else time_ns, octets, 6, len(octets) - 5, size, ETHERNET)


def names(directory: Path) -> list[str]:
    return sorted(path.name for path in directory.iterdir())


def test_all_packets_are_in_the_files_once_and_in_order(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path), RingLimits(octets=1000))
    for number in range(50):
        put(ring, number)
    ring.close()
    ring.close()
    files = sorted(tmp_path.iterdir())
    assert len(files) == 8
    assert [number for path in files for number in numbers(path)] == list(range(50))
    assert list(ring.finished) == files
    assert (ring.packets, ring.removed) == (50, 0)
    assert all(1000 <= path.stat().st_size < 1300 for path in files[:-1])


def test_a_file_is_called_after_its_number_and_the_time_of_its_first_packet(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path), RingLimits(duration_ns=10 * NS), "line 3/../x")
    put(ring, 0)
    assert ring.path == tmp_path / "line_3_.._x_00001_20231114T221320Z.pcapng.part"
    assert names(tmp_path) == ["line_3_.._x_00001_20231114T221320Z.pcapng.part"]
    put(ring, 11)
    assert names(tmp_path) == [
        "line_3_.._x_00001_20231114T221320Z.pcapng",
        "line_3_.._x_00002_20231114T221331Z.pcapng.part",
    ]
    ring.close()
    assert ring.path is None
    assert all(name.endswith(".pcapng") for name in names(tmp_path))


def test_it_turns_by_the_clock_of_the_capture(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path), RingLimits(duration_ns=10 * NS))
    for number in (0, 9, 10, 19, 20, 21):
        put(ring, number)
    ring.close()
    assert [numbers(path) for path in ring.finished] == [[0, 9], [10, 19], [20, 21]]


def test_a_silent_line_ends_a_file_and_begins_none(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path), RingLimits(duration_ns=10 * NS))
    ring.tick(TIME)
    assert names(tmp_path) == []
    put(ring, 0)
    ring.tick(TIME + 10 * NS - 1)
    assert len(ring.finished) == 0
    ring.tick(TIME + 10 * NS)
    assert len(ring.finished) == 1
    ring.tick(TIME + 90 * NS)
    ring.close()
    assert len(names(tmp_path)) == 1


def test_a_clock_that_is_set_back_does_not_hold_a_file_open(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path), RingLimits(duration_ns=10 * NS))
    put(ring, 0)
    put(ring, 1, TIME - 3600 * NS)
    put(ring, 2, TIME - 3590 * NS)
    ring.close()
    assert [numbers(path) for path in ring.finished] == [[0, 1], [2]]


@pytest.mark.parametrize("most", [1, 2, 5])
def test_the_oldest_files_go(tmp_path: Path, most: int) -> None:
    (tmp_path / "s7dissect_00001_20200101T000000Z.pcapng").write_bytes(b"of another run")
    ring = RingBuffer(str(tmp_path), RingLimits(octets=300, files=most))
    for number in range(40):
        put(ring, number)
        assert len(names(tmp_path)) <= most + 1
    ring.close()
    assert len(ring.finished) == most
    kept = [number for path in ring.finished for number in numbers(path)]
    assert kept == list(range(40 - len(kept), 40))
    assert (tmp_path / "s7dissect_00001_20200101T000000Z.pcapng").exists()


def test_a_file_of_an_earlier_run_is_never_overwritten(tmp_path: Path) -> None:
    for _ in range(2):
        ring = RingBuffer(str(tmp_path))
        put(ring, 0)
        ring.close()
    left = RingBuffer(str(tmp_path))
    put(left, 0)
    other = RingBuffer(str(tmp_path))
    put(other, 0)
    assert names(tmp_path) == [
        "s7dissect_00001_20231114T221320Z-2.pcapng",
        "s7dissect_00001_20231114T221320Z-3.pcapng.part",
        "s7dissect_00001_20231114T221320Z-4.pcapng.part",
        "s7dissect_00001_20231114T221320Z.pcapng",
    ]
    left.close()
    other.close()


def test_comments_and_interfaces_go_along(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path), application="s7dissect 1", os_name="Linux", batch=100_000)
    ring.comment("seen before")
    ring.add(TIME, OCTETS, 100, ETHERNET, "eth7")
    ring.add(TIME, OCTETS, 100, ETHERNET, "eth7")
    assert ring.path is not None
    assert len(drain(open_capture(str(ring.path))).frames) == 0
    ring.flush()
    assert len(drain(open_capture(str(ring.path))).frames) == 2
    ring.close()
    assert drain(open_capture(str(ring.finished[0]))).comments == [(1, "seen before")]
    assert b"eth7" in ring.finished[0].read_bytes()


def test_comments_without_packets_are_bounded(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path))
    for number in range(1000):
        ring.comment(str(number))
    put(ring, 0)
    ring.close()
    assert len(drain(open_capture(str(ring.finished[0]))).comments) == 64


def test_after_an_error_it_goes_on_in_another_file(tmp_path: Path) -> None:
    ring = RingBuffer(str(tmp_path))
    failed = []
    with small_disk(1000):
        for number in range(18):
            try:
                put(ring, number)
            except OSError as error:
                failed.append(str(error.filename))
        ring.close()
    parts = sorted(tmp_path.iterdir())
    assert failed == [str(path) for path in parts[:2]]
    assert [numbers(path) for path in parts] == [list(range(6)), list(range(7, 13)), list(range(14, 18))]
    assert len(list(tmp_path.glob("*.part"))) == 2
    assert (ring.packets, ring.lost, ring.lost_octets) == (16, 2, 200)
    comments = [list(drain(open_capture(str(path))).comments) for path in parts]
    assert [len(found) for found in comments] == [0, 1, 1]
    assert "1 packets before this one were not written" in str(comments[1])


CHILD = """
import sys
from dissect.files.recording.ring_buffer import RingBuffer, RingLimits
ring = RingBuffer(sys.argv[1], RingLimits(octets=200_000, files=int(sys.argv[2])))
number = 0
while True:
    octets = number.to_bytes(4, "big") + bytes(number % 3000)
    ring.frame(1_700_000_000_000_000_000 + number, octets, 0, len(octets), len(octets), 1)
    number += 1
"""


@pytest.mark.parametrize(("seed", "files"), [(1, 0), (2, 0), (3, 4), (4, 1)])
def test_a_kill_at_any_moment_leaves_readable_files(tmp_path: Path, seed: int, files: int) -> None:
    enough = random.Random(seed).randrange(2, 40)
    with subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path), str(files)]) as child:
        try:
            end = time.monotonic() + 60
            while time.monotonic() < end:
                if any(int(path.name.split("_")[1]) >= enough for path in tmp_path.glob("s7dissect_*")):
                    break
                time.sleep(0.0005)
        finally:
            os.kill(child.pid, signal.SIGKILL)
    kept: list[int] = []
    paths = sorted(tmp_path.glob("s7dissect_*"))
    for path in paths:
        reader = open_capture(str(path))
        got = Recorder()
        step_to_the_end(reader, got)
        reader.close()
        assert reader.rejected == 0
        assert reader.damage == "" or (path.suffix == ".part" and "cut off" in reader.damage)
        kept += [int.from_bytes(frame.octets[:4], "big") for frame in got.frames]
    assert len(list(tmp_path.glob("*.part"))) <= 1
    assert kept or files == 1  # the only file may just have been begun
    if not kept:
        return
    assert kept == list(range(kept[0], kept[0] + len(kept)))
    assert len(paths) <= files + 1 if files else kept[0] == 0


def test_limits_are_those_of_dumpcap() -> None:
    limits = parse_limits(["filesize:1000", "duration:1.5", "files:24"])
    assert (limits.octets, limits.duration_ns, limits.files) == (1_000_000, 1_500_000_000, 24)
    none = parse_limits([])
    assert (none.octets, none.duration_ns, none.files) == (0, 0, 0)


@pytest.mark.parametrize(
    ("word", "said"),
    [
        ("filesize", "number from 1 to"),
        ("filesize:0", "number from 1 to"),
        ("filesize:1.5", "a whole number"),
        ("filesize:-3", "number"),
        ("filesize:\u0661", "number"),
        ("duration:0", "a number from 0.001"),
        ("duration:nan", "a number"),
        ("duration:1e3", "a number"),
        ("files:1000000", "to 100000"),
        ("packets:7", "not one of filesize:KB, duration:SECONDS, files:NUMBER"),
        ("", "not one of"),
    ],
)
def test_wrong_limits_are_told(word: str, said: str) -> None:
    with pytest.raises(ValueError, match=said):
        parse_limits([word])


def test_a_number_of_files_alone_says_nothing() -> None:
    with pytest.raises(ValueError, match="filesize:KB or duration:SECONDS"):
        parse_limits(["files:3"])


# ---- earlier runs ---------------------------------------------------------------------------------------------------


def ran(
    directory: Path, first: int, count: int = 12, octets: int = 400, files: int = 3, kill: bool = False
) -> RingBuffer:
    """Run a ring that writes packets from ``first`` on; a ``kill`` leaves its last file as it is."""
    ring = RingBuffer(str(directory), RingLimits(octets=octets, files=files), application="s7dissect 1")
    for number in range(first, first + count):
        put(ring, number)
    if kill:
        if ring._writer is not None:
            ring._writer.abandon()
    else:
        ring.close()
    return ring


def test_a_ring_is_bounded_over_restarts(tmp_path: Path) -> None:
    for run in range(5):
        ran(tmp_path, run * 12, kill=run % 2 == 1)
        assert len(names(tmp_path)) <= 3
    kept = [number for name in names(tmp_path) for number in numbers(tmp_path / name)]
    assert kept == list(range(60 - len(kept), 60))


def test_what_kills_leave_behind_counts(tmp_path: Path) -> None:
    for run in range(9):
        ran(tmp_path, run, count=1, kill=True)
    assert [name.endswith(".part") for name in names(tmp_path)] == [True] * 3
    assert [number for name in names(tmp_path) for number in numbers(tmp_path / name)] == [6, 7, 8]


def test_octets_of_earlier_runs_count_too(tmp_path: Path) -> None:
    ran(tmp_path, 0, count=4000, octets=1_000_000)
    assert len(names(tmp_path)) == 1
    ring = ran(tmp_path, 5000, count=1, octets=300, files=1)
    assert [numbers(tmp_path / name) for name in names(tmp_path)] == [[5000]]
    assert ring.removed == 1
    for number in range(6):
        ran(tmp_path, 6000 + 4000 * number, count=4000, octets=1_000_000)
    ran(tmp_path, 90_000, count=1, octets=1000)
    assert sum(path.stat().st_size for path in tmp_path.iterdir()) <= 3 * (1000 + 512 * 1024)
    assert 90_000 in numbers(tmp_path / names(tmp_path)[-1])


def test_only_what_a_ring_of_this_name_made_is_removed(tmp_path: Path) -> None:
    ran(tmp_path, 0, count=1)
    (made,) = tmp_path.iterdir()
    other = RingBuffer(str(tmp_path), RingLimits(octets=300, files=3), name="other")
    put(other, 1)
    other.close()
    strangers = {
        "s7dissect_00001_20200101T000000Z.pcapng": b"not ours",
        "s7dissect_00002_20200101T000000Z.pcapng": made.read_bytes().replace(b"ring s7dissect", b"ring s7dissecT"),
        "s7dissect_00003_20200101T000000Z.pcapng.bak": made.read_bytes(),
        "notes.txt": b"",
    }  # fmt: skip
    for name, octets in strangers.items():
        (tmp_path / name).write_bytes(octets)
    elsewhere = tmp_path.parent / "elsewhere.pcapng"
    elsewhere.write_bytes(made.read_bytes())
    (tmp_path / "s7dissect_00004_20200101T000000Z.pcapng").symlink_to(elsewhere)
    (tmp_path / "s7dissect_00005_20200101T000000Z.pcapng").mkdir()
    os.mkfifo(tmp_path / "s7dissect_00006_20200101T000000Z.pcapng")
    before = set(names(tmp_path)) - {made.name}
    ran(tmp_path, 100, count=50, files=1)
    assert before <= set(names(tmp_path))
    assert len(names(tmp_path)) == len(before) + 1
    assert elsewhere.exists()


def test_a_file_that_another_ring_writes_is_left_alone(tmp_path: Path) -> None:
    busy = RingBuffer(str(tmp_path), RingLimits(octets=100_000, files=2))
    put(busy, 0)
    ran(tmp_path, 10, files=1)
    put(busy, 1)
    busy.close()
    assert numbers(busy.finished[0]) == [0, 1]


def test_a_ring_without_an_end_takes_no_earlier_file_for_its_own(tmp_path: Path) -> None:
    for run in range(4):
        ran(tmp_path, run, count=1, files=0)
    assert len(names(tmp_path)) == 4


def test_the_capture_filter_stands_in_the_interfaces(tmp_path: Path) -> None:
    ring = RingBuffer(tmp_path, RingLimits(octets=1000))
    ring.capture_filter = "tcp port 102\x1b"
    for number in range(40):
        ring.add(1 + number, bytes(60), 60, 1, f"eth{number % 2}")
    ring.close()
    assert len(ring.finished) > 1
    shown = b"\0tcp port 102\\x1b"  # a text of libpcap's; control characters are escaped
    option = b"\x0b\0" + len(shown).to_bytes(2, "little") + shown
    for path in ring.finished:
        assert path.read_bytes().count(option) == 2
        assert len(drain(open_capture(str(path))).frames) > 0


def test_where_an_open_file_cannot_be_removed_it_goes_with_the_next_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows: Wireshark shows a file of the ring, or a thread hashes it. Elsewhere a refusal is an error."""
    read: set[str] = set()
    unlink = Path.unlink

    def unlinked(path: Path, missing_ok: bool = False) -> None:
        if path.name in read:
            raise PermissionError(13, "used by another process", str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", unlinked)
    monkeypatch.setattr("dissect.files.recording.removing.locks.MANDATORY", True)
    ring = RingBuffer(str(tmp_path), RingLimits(octets=300, files=2))
    for number in range(6):
        put(ring, number)
    read.add(first := names(tmp_path)[0])
    for number in range(6, 20):
        put(ring, number)
    kept = names(tmp_path)
    assert first in kept
    assert len(kept) == 3
    read.clear()
    for number in range(20, 30):
        put(ring, number)
    assert first not in names(tmp_path)
    assert len(names(tmp_path)) == 2
    ring.close()
    assert (ring.lost, ring.removed) == (0, ring.files - 2)
    monkeypatch.setattr("dissect.files.recording.removing.locks.MANDATORY", False)
    ring = RingBuffer(str(tmp_path), RingLimits(octets=300, age_ns=NS))
    read.update(names(tmp_path))
    for number in range(2):
        put(ring, number)
    with pytest.raises(PermissionError):
        ring.look_at_room(time.time_ns() + 10**6 * NS)
    read.clear()
    ring.close()
