from __future__ import annotations

from pathlib import Path

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.files.recording import event_capture
from dissect.files.recording.event_capture import EventCapture
from dissect.files.recording.ring_buffer import RingBuffer, RingLimits
from dissect.online.live.evidence import KeeperCompanion, RingCompanion
from dissect.packets.source.files import open_capture
from dissect.packets.source.live.reader import Drops
from tests.online.live.support import SECOND
from tests.packets.source.craft import drain
from tests.properties.packets import EPOCH_NS

NONE = Drops(0, 0)


def frames(path: Path) -> list[bytes]:
    return [frame.octets for frame in drain(open_capture(str(path))).frames]


def test_what_the_ring_gathered_is_readable_after_a_tick(tmp_path: Path) -> None:
    companion = RingCompanion(RingBuffer(str(tmp_path), batch=1 << 20))
    companion.packet(EPOCH_NS, bytes(60), 60, 1, "eth0")
    (path,) = tmp_path.iterdir()
    assert frames(path) == []
    companion.tick(EPOCH_NS + 1, NONE)
    assert frames(path) == [bytes(60)]
    companion.close()


def test_a_file_that_is_old_ends_on_a_silent_line(tmp_path: Path) -> None:
    companion = RingCompanion(RingBuffer(str(tmp_path), RingLimits(duration_ns=SECOND)))
    companion.packet(EPOCH_NS, bytes(60), 60, 1, "")
    companion.tick(EPOCH_NS + SECOND // 2, NONE)
    assert [path.suffix for path in tmp_path.iterdir()] == [".part"]
    companion.tick(EPOCH_NS + 2 * SECOND, NONE)
    assert [path.suffix for path in tmp_path.iterdir()] == [".pcapng"]
    companion.close()


def test_the_packets_around_a_finding_are_whole_on_a_silent_line(tmp_path: Path) -> None:
    companion = KeeperCompanion(EventCapture(str(tmp_path), SECOND, SECOND, slugs=["transaction.overdue"]))
    for number in range(4):
        companion.packet(EPOCH_NS + number * SECOND, bytes((number,)) * 60, 60, 1, "eth0")
    companion.finding(Finding(CATALOGUE["transaction.overdue"], 1, [4], EPOCH_NS + 3 * SECOND, "late"))
    companion.tick(EPOCH_NS + 3 * SECOND + 1, NONE)
    (path,) = tmp_path.iterdir()
    assert frames(path) == [bytes((2,)) * 60, bytes((3,)) * 60]
    companion.tick(EPOCH_NS + 5 * SECOND, NONE)
    (path,) = tmp_path.iterdir()
    assert path.suffix == ".pcapng"
    companion.close()


def test_the_files_that_had_to_go_are_counted_at_the_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(event_capture, "MAX_FILES", 3)
    companion = KeeperCompanion(EventCapture(str(tmp_path), 0, 0, slugs=["security.plc_stop"]))
    for number in range(1, 6):
        companion.packet(EPOCH_NS + number * SECOND, bytes(60), 60, 1, "")
        companion.finding(Finding(CATALOGUE["security.plc_stop"], 1, [number], EPOCH_NS + number * SECOND, ""))
        if number == 3:
            assert companion.remark == ""
    companion.close()
    assert companion.remark.startswith("keeping packets around findings: 2 of 5 files removed, the oldest of the hosts")
    assert len(list(tmp_path.iterdir())) == 3
