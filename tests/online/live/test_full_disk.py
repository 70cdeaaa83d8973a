"""A disk that is full and has room again: what writes goes on, and what was not written is counted exactly."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.support import simple
from tests.online.live.small_disk import on_a_small_disk

RING = """
from dissect.online.live.evidence import RingCompanion
from dissect.files.recording.ring_buffer import RingBuffer, RingLimits
companion = RingCompanion(RingBuffer(FOLDER, LIMITS, batch=4096), CLOCK)
problems = companion.problems = Problems()
given = 0

def put(count):
    global given
    for _ in range(count):
        try:
            companion.packet(TIME + given * 1_000_000, octets(given), 100, 1, "eth0")
        except OSError as error:
            assert companion.recover(error)
        given += 1
        if given % 10 == 0:
            try:
                companion.tick(TIME + given * 1_000_000, NONE)
            except OSError as error:
                assert companion.recover(error)
"""


def test_a_ring_goes_on_when_there_is_room_again(tmp_path: Path) -> None:
    got = on_a_small_disk(
        tmp_path,
        256,
        RING.replace("LIMITS", "RingLimits()")
        + """
put(100)
fill(left=8192)
put(500)
state = companion.state
CLOCK.now += 5
put(10)
free()
CLOCK.now += 70
put(100)
companion.close()
print(json.dumps([given, numbers(), companion.ring.packets, companion.lost, companion.written[0],
    state.well, companion.state.well, [problem.text for problem in problems.take()], companion.summary]))
""",
    )
    given, found, packets, lost, files, well, well_again, told, summary = got
    assert found == sorted(set(found))
    assert (packets, lost) == (len(found), [given - len(found), 100 * (given - len(found))])
    assert 100 < len(found) < given
    assert found[-100:] == list(range(given - 100, given))
    assert (files, well, well_again) == (1, False, True)
    assert len(told) == 2
    assert "No space left on device; it will be tried again" in told[0]
    assert (
        told[1] == f"the ring of files is written again after 75.00 s; {lost[0]} packets ({lost[1]} bytes) not written"
    )
    assert summary.startswith(f"the ring of files: {lost[0]} packets ({lost[1]} bytes) not written in 75.00 s: ")


def test_a_ring_with_a_number_of_files_frees_its_oldest_and_loses_nothing(tmp_path: Path) -> None:
    got = on_a_small_disk(
        tmp_path,
        256,
        RING.replace("LIMITS", "RingLimits(octets=20_000, files=100)")
        + """
put(1000)
fill()
put(1000)
companion.close()
print(json.dumps([given, numbers(), companion.lost, companion.ring.removed, len(problems.take())]))
""",
    )
    given, found, lost, removed, told = got
    assert (lost, told) == ([0, 0], 0)
    assert found == list(range(given - len(found), given))
    assert removed > 5


def test_so_much_stays_free(tmp_path: Path) -> None:
    got = on_a_small_disk(
        tmp_path,
        1024,
        """
import shutil
from dissect.files.recording.ring_buffer import RingBuffer, RingLimits
ring = RingBuffer(FOLDER, RingLimits(octets=20_000, files=100), keep_free=400_000)
least = 10**9
for number in range(20_000):
    ring.add(TIME + number, octets(number), 100, 1)
    if number % 100 == 0:
        ring.look_at_room(TIME + number)
        least = min(least, shutil.disk_usage(FOLDER).free)
ring.close()
fill()
ring.look_at_room(TIME)
fill()
try:
    ring.add(TIME, octets(0), 100, 1)
except OSError as error:
    said = error.strerror
print(json.dumps([least, ring.lost, said, len(list(FOLDER.glob("*.pcapng")))]))
""",
    )
    least, lost, said, left = got
    assert least >= 400_000
    assert (lost, said, left) == (1, "less is free than --keep-free asks for", 0)


KEEPER = """
from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.online.live.evidence import KeeperCompanion
from dissect.files.recording.event_capture import EventCapture
S = 1_000_000_000
companion = KeeperCompanion(EventCapture(FOLDER, BEFORE * S, 100 * S, slugs=["transaction.overdue"]), CLOCK)
problems = companion.problems = Problems()
given = 0

def put(count):
    global given
    for _ in range(count):
        given += 1
        for what in (lambda: companion.packet(TIME + given * S, octets(given), 100, 1, "eth0"),
                     lambda: companion.tick(TIME + given * S, NONE)):
            try:
                what()
            except OSError as error:
                assert companion.recover(error)

def trigger():
    try:
        companion.finding(Finding(CATALOGUE["transaction.overdue"], 1, [given], TIME + given * S, "late"))
    except OSError as error:
        assert companion.recover(error)
"""


def test_packets_around_a_finding_are_written_from_memory_when_there_is_room_again(tmp_path: Path) -> None:
    got = on_a_small_disk(
        tmp_path,
        128,
        f"BEFORE = 30\n{KEEPER}"
        """
put(20)
fill()
trigger()
put(10)
owed = companion.keeper.owes
free()
CLOCK.now += 2
put(50)
companion.close()
print(json.dumps([owed, numbers(), companion.lost, [problem.text for problem in problems.take()]]))
""",
    )
    owed, found, lost, told = got
    assert owed
    assert found == list(range(1, 81))
    assert lost == [0, 0]
    assert told[1] == "keeping packets around findings is written again after 2.00 s; nothing was lost"


def test_packets_around_a_finding_that_left_memory_are_counted(tmp_path: Path) -> None:
    got = on_a_small_disk(
        tmp_path,
        128,
        f"BEFORE = 5\n{KEEPER}"
        """
put(20)
fill()
trigger()
put(40)
free()
CLOCK.now += 2
put(30)
first = companion.lost
fill()
put(100)
trigger()
put(120)
companion.close()
print(json.dumps([numbers(), first, companion.lost, companion.state.well]))
""",
    )
    found, first, lost, well = got
    assert found[0] > 20
    assert first == [found[0] - 15, 100 * (found[0] - 15)]  # wanted from packet 15 on: 5 s before the 20th
    wanted = set(range(15, 121)) | set(range(185, 291))  # each until 100 s after its trigger
    assert lost == [len(wanted) - len(found), 100 * (len(wanted) - len(found))]
    assert not well


def test_a_single_file_goes_on_behind_its_last_whole_packet(tmp_path: Path) -> None:
    got = on_a_small_disk(
        tmp_path,
        128,
        """
from dissect.online.proxy.capture_file import CaptureFile
from dissect.packets.source.pcapng_writer import PcapngWriter
companion = CaptureFile(PcapngWriter(FOLDER / "all.pcapng", batch=1000), CLOCK)
problems = companion.problems = Problems()
for number in range(300):
    if number == 100:
        fill()
    if number == 200:
        free()
        CLOCK.now += 2
    try:
        companion.packet(TIME + number, octets(number), 100, 1, "eth0")
    except OSError as error:
        assert companion.recover(error)
companion.close()
print(json.dumps([numbers(), companion.lost, len(problems.take())]))
""",
    )
    found, lost, told = got
    assert found == sorted(set(found))
    assert lost == [300 - len(found), 100 * (300 - len(found))]
    assert found[-100:] == list(range(200, 300))
    assert told == 2


def test_tables_go_on_and_their_lost_rows_are_counted(tmp_path: Path) -> None:
    script = """
import tempfile
from dissect.output.export.rotating import RotatingSink
from dissect.output.export.tables import TABLES
tempfile.tempdir = "/tmp"
table = TABLES["findings"]
sink = RotatingSink(FOLDER, [table], {})
sink.prepare()
width = len(table.stored)
row = (None,) * width

def rows(count):
    return [row] * count

sink.take(table, rows(10))
sink.rotate(TIME)
fill()
sink.take(table, rows(7))
sink.rotate(TIME + 10**9)
failed = sink.error is not None
sink.take(table, rows(5))
try:
    sink.probe()
except OSError:
    failed = failed and True
free()
sink.probe()
sink.take(table, rows(3))
sink.rotate(TIME + 2 * 10**9)
import pyarrow.parquet as parquet
found = sorted(FOLDER.rglob("*.parquet"))
print(json.dumps([failed, sink.lost, sink.files, [parquet.read_metadata(path).num_rows for path in found],
    [path.name for path in FOLDER.rglob("*") if path.is_file() and path.suffix != ".parquet"]]))
"""
    failed, lost, files, rows, rest = on_a_small_disk(tmp_path, 512, script)
    assert (failed, lost, files) == (True, 12, 2)
    assert sorted(rows) == [3, 10]
    assert rest == []


@pytest.mark.parametrize("left", [0, 20_000, 60_000])
def test_an_export_to_sqlite_says_that_the_disk_is_full(left: int, tmp_path: Path) -> None:
    capture = simple(tmp_path / "capture.pcapng", 400)
    disk = tmp_path / "disk"
    disk.mkdir()
    got = on_a_small_disk(
        disk,
        128,
        f"""
import contextlib, io
from dissect.cli.main import main
fill({left})
said, code = io.StringIO(), 0
with contextlib.redirect_stderr(said):
    try:
        main(["export", {str(capture)!r}, "-o", f"{{FOLDER}}/a.sqlite"])
    except SystemExit as end:
        code = end.code
print(json.dumps([code, said.getvalue(), sorted(path.name for path in FOLDER.iterdir())]))
""",
    )
    code, said, files = got
    assert code == 5
    assert "full" in said or "No space left" in said
    assert "Traceback" not in said
    assert files == ["ballast"]
