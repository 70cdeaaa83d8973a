"""Packets of a live line as pcapng, with findings as comments: which packet gets which, and when it is written."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.files.recording.recent import MAX_COMMENTS
from dissect.online.live.commented import CommentedStream
from dissect.online.live.run import LiveRun
from dissect.packets.source.files import open_capture
from dissect.packets.source.live.reader import Drops
from dissect.packets.source.pcapng_writer import PcapngWriter
from tests.meaning.report.support import WORD, begun, read
from tests.online.live.support import Clock, Line
from tests.packets.source.craft import drain

MS: Final = 1_000_000
NONE: Final = Drops(None, None)


def found(*frames: int, detail: str = "seen") -> Finding:
    return Finding(CATALOGUE["transaction.item_error"], 1, list(frames), 0, detail)


def told(path: Path) -> list[list[str]]:
    """Return the comments of each packet of a file."""
    recorder = drain(open_capture(str(path)))
    comments: list[list[str]] = [[] for _ in recorder.frames]
    for number, text in recorder.comments:
        comments[number - 1].append(text)
    return comments


class Stream:
    """A stream into a file, given packets at times in milliseconds."""

    def __init__(self, path: Path, max_octets: int = 1 << 20) -> None:
        self.path = path
        self.writer = PcapngWriter(path)
        self.stream = CommentedStream(self.writer, 200 * MS, max_octets)

    def packets(self, *times: int) -> None:
        for time in times:
            self.stream.packet(time * MS, b"x" * 60, 60, 1, "eth0")


def test_a_live_line_has_the_comments_of_a_file(tmp_path: Path) -> None:
    packets = read(read(begun(), 1), 2, WORD, 0x0A).packets()
    path = tmp_path / "live.pcapng"
    stream = CommentedStream(PcapngWriter(path))
    run = LiveRun(Line(Clock(), [packets[:5], packets[5:]], ends=True), Observer(), companions=[stream])
    while run.step():
        pass
    assert (run.failures, stream.error, stream.late) == ([], None, [])
    comments = told(path)
    assert [len(one) for one in comments] == [0] * 9 + [1, 1]
    assert comments[9] == comments[10]
    assert comments[9][0].startswith("s7dissect: warning transaction.item_error: ")
    assert [frame.octets for frame in drain(open_capture(str(path))).frames] == [packet.octets for packet in packets]


def test_a_packet_waits_for_its_comments_and_no_longer(tmp_path: Path) -> None:
    stream = Stream(tmp_path / "a.pcapng")
    stream.packets(0, 100)
    assert stream.writer.packets == 0
    stream.stream.finding(found(1, 2))
    stream.stream.tick(199 * MS, NONE)
    assert stream.writer.packets == 0
    stream.stream.tick(200 * MS, NONE)
    assert stream.writer.packets == 1
    stream.stream.finding(found(1, 2, detail="again"))  # the first has gone, the other has not
    stream.packets(1000)
    stream.stream.close()
    assert [len(one) for one in told(stream.path)] == [1, 2, 0]


def test_what_is_found_late_goes_to_the_next_packet_and_says_what_it_is_about(tmp_path: Path) -> None:
    stream = Stream(tmp_path / "a.pcapng")
    stream.packets(0, 1000)
    stream.stream.finding(found(1))  # the latest is still held
    stream.stream.tick(2000 * MS, NONE)
    stream.stream.finding(found(1, 2))
    stream.stream.finding(Finding(CATALOGUE["capture.dropped"], 0, [], 0, "3 packets"))
    stream.packets(3000)
    stream.stream.close()
    first, second, third = told(stream.path)
    assert first == []
    assert [one.rpartition(" [")[2] for one in second] == ["about packet 1]"]
    assert [one.rpartition(" [")[2] for one in third] == ["about packets 1, 2]", "about the capture]"]


def test_what_no_packet_comes_for_is_kept_within_bounds(tmp_path: Path) -> None:
    stream = Stream(tmp_path / "a.pcapng")
    for number in range(MAX_COMMENTS + 3):
        stream.stream.finding(found(detail=str(number)))
    stream.stream.close()
    assert (len(stream.stream.late), stream.stream.dropped) == (MAX_COMMENTS, 3)


@pytest.mark.parametrize("times", [(5000, 0, 50), (0, 5000)])
def test_a_clock_that_jumps_holds_nothing(tmp_path: Path, times: tuple[int, ...]) -> None:
    stream = Stream(tmp_path / "a.pcapng")
    stream.packets(*times)
    assert stream.writer.packets == 1


def test_memory_is_bounded_and_no_packet_is_lost_for_it(tmp_path: Path) -> None:
    stream = Stream(tmp_path / "a.pcapng", max_octets=2000)
    stream.packets(*[0] * 100)
    assert stream.writer.packets == 96  # of 460 octets each
    stream.stream.close()
    assert len(told(stream.path)) == 100


def test_a_failure_is_kept_and_ends_the_writing(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)
    stream = Stream(pipe)
    stream.packets(0, 1000)
    assert (stream.stream.error, stream.writer.packets) == (None, 1)
    os.close(reading)
    stream.packets(2000)
    assert isinstance(stream.stream.error, BrokenPipeError)
    stream.packets(3000, 4000)
    stream.stream.close()
    assert stream.writer.packets == 1
