"""The packets around a finding: what is kept before and after it, comments, overlapping triggers, bounds, kills."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.files.recording import event_capture as keeper_module
from dissect.files.recording.event_capture import EventCapture
from dissect.files.recording.recent import PACKET_COST
from dissect.packets.source.files import open_capture
from tests.packets.source.craft import EPOCH, ETHERNET, NS, Recorder, drain, step_to_the_end

TIME = EPOCH * NS
STOP = "security.plc_stop"
#: The comment of `found(STOP, …)`.
SAID = "s7dissect: error security.plc_stop: A client sent a PLC stop command. now (connection 3)"


def found(slug: str, *frames: int, detail: str = "now") -> Finding:
    return Finding(CATALOGUE[slug], 3, list(frames), TIME, detail)


def feed(keeper: EventCapture, seconds: range | list[int]) -> None:
    """Give it a packet a second, which holds its second."""
    for second in seconds:
        octets = b"xx" + second.to_bytes(4, "big") + bytes(60)
        keeper.frame(TIME + second * NS, octets, 2, len(octets), 66, ETHERNET)


def seconds(path: Path) -> list[int]:
    return [int.from_bytes(frame.octets[:4], "big") for frame in drain(open_capture(str(path))).frames]


def comments(path: Path) -> list[tuple[int, str]]:
    """Return (second of the packet, comment)."""
    got = drain(open_capture(str(path)))
    return [(int.from_bytes(got.frames[number - 1].octets[:4], "big"), text) for number, text in got.comments]


def test_what_was_before_and_after_is_kept(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 2 * NS, slugs=[STOP])
    feed(keeper, range(10))
    keeper.finding(found(STOP, 9, 10))
    feed(keeper, range(10, 20))
    assert [path.name for path in tmp_path.iterdir()] == ["security.plc_stop_20231114T221329.000000000Z.pcapng"]
    (path,) = keeper.finished
    assert seconds(path) == [6, 7, 8, 9, 10, 11]
    assert comments(path) == [(8, SAID), (9, SAID)]
    keeper.close()
    assert (keeper.frames, keeper.files, keeper.triggers, keeper.removed, keeper.untold) == (20, 1, 1, 0, 0)


def test_wireshark_shows_the_comments(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 2 * NS, slugs=[STOP], application="s7dissect 1")
    feed(keeper, range(10))
    keeper.finding(found(STOP, 9, detail="from \x1b[31m"))
    keeper.close()
    told = subprocess.run(
        ["tshark", "-r", str(keeper.finished[0]), "-T", "fields", "-e", "frame.number", "-e", "frame.comment"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout
    assert told.splitlines()[2].split("\t") == ["3", SAID.replace("now", "from \\x1b[31m")]


def test_what_does_not_trigger_is_a_comment_all_the_same(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 2 * NS, slugs=[STOP])
    feed(keeper, range(10))
    keeper.finding(found("transaction.slow", 2, 9))
    assert list(tmp_path.iterdir()) == []
    keeper.finding(found(STOP, 10))
    feed(keeper, [10])
    keeper.finding(found("transaction.refused", 11))
    keeper.close()
    slow, stop, refused = comments(keeper.finished[0])
    assert (slow[0], stop, refused[0]) == (8, (9, SAID), 10)
    assert "transaction.slow" in slow[1]
    assert "transaction.refused" in refused[1]


def test_a_trigger_while_a_file_is_open_keeps_it_open(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 2 * NS, slugs=[STOP])
    feed(keeper, range(10))
    keeper.finding(found(STOP, 10))
    feed(keeper, [10, 11])
    keeper.trigger("my alert", TIME, "an alert of mine", [12])
    feed(keeper, range(12, 20))
    keeper.close()
    (path,) = keeper.finished
    assert seconds(path) == list(range(6, 14))
    assert comments(path) == [(9, SAID), (11, "an alert of mine")]
    assert keeper.triggers == 2


def test_the_next_file_has_all_its_packets_too(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 1 * NS, slugs=[STOP])
    feed(keeper, range(5))
    keeper.finding(found(STOP, 5))
    feed(keeper, range(5, 8))
    keeper.finding(found(STOP, 8))
    keeper.close()
    assert [seconds(path) for path in keeper.finished] == [[1, 2, 3, 4, 5], [4, 5, 6, 7]]
    assert [comments(path) for path in keeper.finished] == [[(4, SAID)], [(4, SAID), (7, SAID)]]


def test_a_finding_about_packets_that_are_gone_is_told_with_the_one_at_hand(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 2 * NS, slugs=[STOP])
    feed(keeper, range(10))
    keeper.finding(found(STOP, 1, 2))
    keeper.close()
    assert comments(keeper.finished[0]) == [(9, f"{SAID} [about packets 1, 2, before this one]")]


def test_what_is_found_on_a_silent_line(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 5 * NS, slugs=[STOP])
    feed(keeper, range(10))
    keeper.finding(found(STOP, 10))
    (part,) = tmp_path.iterdir()
    assert seconds(part) == [6, 7, 8]
    keeper.settle()
    assert seconds(part) == [6, 7, 8, 9]
    keeper.finding(found("transaction.slow", 10))
    feed(keeper, [11])
    keeper.settle()
    keeper.finding(found("transaction.refused", 10))
    keeper.tick(TIME + 14 * NS)
    assert part.exists()
    keeper.tick(TIME + 14 * NS + 1)
    assert not part.exists()
    (path,) = keeper.finished
    told = comments(path)
    assert told[0] == (9, SAID)
    assert told[1][0] == 11
    assert told[1][1].endswith("[about packet 10, before this one]")
    assert keeper.untold == 1  # no packet came after it


def test_memory_is_bounded_and_the_file_says_so(tmp_path: Path) -> None:
    size = 64 + PACKET_COST
    keeper = EventCapture(str(tmp_path), 100 * NS, 0, max_octets=4 * size, slugs=[STOP])
    feed(keeper, range(10))
    keeper.finding(found(STOP, 10))
    keeper.close()
    (path,) = keeper.finished
    assert seconds(path) == [6, 7, 8, 9]
    assert b"so far 6 packets were dropped before their time was over" in path.read_bytes()


def test_a_packet_larger_than_the_memory_is_kept_when_it_triggers(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 100 * NS, 0, max_octets=10, slugs=[STOP])
    feed(keeper, range(3))
    keeper.finding(found(STOP, 3))
    keeper.close()
    assert comments(keeper.finished[0]) == [(2, SAID)]


def test_files_are_bounded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keeper_module, "MAX_FILES", 3)
    keeper = EventCapture(str(tmp_path), 0, 0, slugs=[STOP])
    for second in range(5):
        feed(keeper, [second])
        keeper.finding(found(STOP, second + 1))
    keeper.close()
    assert sorted([seconds(path) for path in tmp_path.iterdir()]) == [[2], [3], [4]]
    assert (keeper.triggers, keeper.files, keeper.removed) == (5, 5, 2)


def test_a_file_that_somebody_reads_goes_with_a_later_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows deletes no open file. It is counted when it is gone, and nothing else is kept less for it."""
    read: set[str] = set()
    unlink = Path.unlink

    def unlinked(path: Path, missing_ok: bool = False) -> None:
        if path.name in read:
            raise PermissionError(13, "used by another process", str(path))
        unlink(path, missing_ok)

    monkeypatch.setattr(Path, "unlink", unlinked)
    monkeypatch.setattr("dissect.files.recording.removing.locks.MANDATORY", True)
    monkeypatch.setattr(keeper_module, "MAX_FILES", 3)
    keeper = EventCapture(str(tmp_path), 0, 0, slugs=[STOP])

    def trigger(second: int) -> None:
        feed(keeper, [second])
        keeper.finding(found(STOP, second + 1))

    trigger(0)
    trigger(1)
    read.update(path.name for path in tmp_path.iterdir() if not path.name.endswith(".part"))
    assert len(read) == 1
    for second in range(2, 6):
        trigger(second)
    keeper.settle()
    assert sorted([seconds(path) for path in keeper.finished if path.exists()]) == [[0], [3], [4]]
    assert keeper.removed == 2
    read.clear()
    trigger(6)
    keeper.close()
    assert sorted([seconds(path) for path in tmp_path.iterdir()]) == [[4], [5], [6]]
    assert (keeper.triggers, keeper.files, keeper.removed) == (7, 7, 4)


def of(server: str, frame: int) -> Finding:
    finding = found(STOP, frame)
    finding.client, finding.server = "10.0.0.1", server
    return finding


def test_a_flood_of_two_hosts_does_not_cost_the_evidence_of_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeper_module, "MAX_FILES", 4)
    keeper = EventCapture(str(tmp_path), 0, 0, slugs=[STOP])
    for second in range(20):
        feed(keeper, [second])
        keeper.finding(of({3: "10.0.0.3", 5: "10.0.0.5"}.get(second, "10.0.0.2"), second + 1))
    keeper.close()
    assert sorted([seconds(path) for path in tmp_path.iterdir()]) == [[3], [5], [18], [19]]
    assert (keeper.files, keeper.removed) == (20, 16)


def test_files_are_bounded_by_size_and_the_latest_stays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keeper_module, "MAX_ALL_OCTETS", 1000)
    keeper = EventCapture(str(tmp_path), 0, 0, slugs=[STOP])
    for second in range(20):
        feed(keeper, [second])
        keeper.finding(of(f"10.0.0.{second}", second + 1))
    keeper.close()
    kept = sorted(tmp_path.iterdir())
    assert sum([path.stat().st_size for path in kept]) <= 1000
    assert seconds(kept[-1]) == [19]
    assert keeper.removed == 20 - len(kept) > 0
    monkeypatch.setattr(keeper_module, "MAX_ALL_OCTETS", 1)
    for name in kept:
        name.unlink()
    keeper = EventCapture(str(tmp_path), 0, 0, slugs=[STOP])
    feed(keeper, [1])
    keeper.finding(of("10.0.0.1", 1))
    keeper.close()
    assert len(list(tmp_path.iterdir())) == 1


def test_a_file_that_grows_too_large_gives_way(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(keeper_module, "MAX_FILE_OCTETS", 1000)
    keeper = EventCapture(str(tmp_path), 0, 100 * NS, slugs=[STOP])
    for second in range(20):
        feed(keeper, [second])
        keeper.finding(found(STOP, second + 1))
    keeper.close()
    assert len(keeper.finished) == keeper.files > 1
    assert [second for path in keeper.finished for second in seconds(path)] == list(range(20))


def test_triggers_of_one_moment_and_another_run_get_names_of_their_own(tmp_path: Path) -> None:
    for name in ("../etc/passwd", "../etc/passwd", ".hidden\x00\n", "", "длинное" * 100):
        keeper = EventCapture(str(tmp_path), 0, 0)
        feed(keeper, [0])
        keeper.trigger(name, TIME)
        keeper.close()
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "__20231114T221320.000000000Z-2.pcapng",
        "__20231114T221320.000000000Z.pcapng",
        "_etc_passwd_20231114T221320.000000000Z-2.pcapng",
        "_etc_passwd_20231114T221320.000000000Z.pcapng",
        "hidden__20231114T221320.000000000Z.pcapng",
    ]


def test_a_clock_set_back_does_not_hold_a_file_open(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 2 * NS, slugs=[STOP])
    feed(keeper, [5000])
    keeper.finding(found(STOP, 1))
    feed(keeper, [1, 2])
    assert [seconds(path) for path in keeper.finished] == [[5000]]


def test_comments_of_the_capture_stay(tmp_path: Path) -> None:
    keeper = EventCapture(str(tmp_path), 3 * NS, 2 * NS, slugs=[STOP])
    keeper.comment("was there")
    feed(keeper, [0])
    keeper.finding(found(STOP, 1))
    keeper.finding(found(STOP, 1))
    keeper.close()
    assert comments(keeper.finished[0]) == [(0, "was there"), (0, SAID)]


def test_times_before_and_after_are_not_negative(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="less than 0"):
        EventCapture(str(tmp_path), -1, 0)


CHILD = """
import sys
from dissect.files.recording.event_capture import EventCapture
keeper = EventCapture(sys.argv[1], 50, 100)
number = 0
while True:
    octets = number.to_bytes(4, "big") + bytes(number % 3000)
    keeper.frame(number, octets, 0, len(octets), len(octets), 1)
    number += 1
    if number % 200 == 0:
        keeper.trigger("found", number, "packet %d" % number, [number])
"""


@pytest.mark.parametrize("enough", [1, 7, 13])
def test_a_kill_at_any_moment_leaves_readable_files(tmp_path: Path, enough: int) -> None:
    with subprocess.Popen([sys.executable, "-c", CHILD, str(tmp_path)]) as child:
        try:
            end = time.monotonic() + 60
            while len(list(tmp_path.glob("found_*"))) < enough and time.monotonic() < end:
                time.sleep(0.0005)
        finally:
            os.kill(child.pid, signal.SIGKILL)
    paths = list(tmp_path.glob("found_*"))
    assert len(paths) >= enough
    for path in paths:
        reader = open_capture(str(path))
        got = Recorder()
        step_to_the_end(reader, got)
        reader.close()
        assert reader.rejected == 0
        assert reader.damage == "" or (path.suffix == ".part" and "cut off" in reader.damage)
        kept = [int.from_bytes(frame.octets[:4], "big") for frame in got.frames]
        assert kept == list(range(kept[0], kept[0] + len(kept))) if kept else path.suffix == ".part"
        if path.suffix == ".pcapng":
            assert len(kept) == 151
            assert got.comments == [(51, f"packet {kept[50] + 1}")]
