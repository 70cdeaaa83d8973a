"""A capture in a pipe: never kept waiting, whatever arrives, and however slowly."""

from __future__ import annotations

import contextlib
import gzip
import io
import os
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest

from dissect.packets.source.live import pipe as live_pipe
from dissect.packets.source.live.opening import open_live
from dissect.packets.source.live.pipe import PipeReader, PipeSource, PipeThread
from dissect.packets.source.packet import CaptureError
from tests.packets.source.live_support import Sink, drained

FRAMES = [bytes([number]) * (60 + number) for number in range(5)]
PCAP = struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1) + b"".join(
    struct.pack("<IIII", 1, number, len(frame), len(frame)) + frame for number, frame in enumerate(FRAMES)
)


def block(kind: int, body: bytes) -> bytes:
    size = 12 + len(body)
    return struct.pack("<II", kind, size) + body + struct.pack("<I", size)


PCAPNG = block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)) + block(1, struct.pack("<HHI", 1, 0, 0))
PCAPNG += b"".join(
    block(6, struct.pack("<IIIII", 0, 0, 1, len(frame), len(frame)) + frame + bytes(-len(frame) % 4))
    for frame in FRAMES
)


class Pipe:
    """Both ends of a pipe, and a reader at one."""

    def __init__(self) -> None:
        reading, self.writing = os.pipe()
        self.reader = PipeReader(PipeSource(reading, owned=True), "the pipe", "pipe", 10)
        self.sink = Sink()

    def write(self, octets: bytes) -> None:
        os.write(self.writing, octets)

    def step(self) -> bool:
        return self.reader.step(self.sink)

    def until(self, packets: int) -> None:
        """Read until so many came: a thread that reads may be behind."""
        self.reader.wait_ms = 10
        for _ in range(1000):
            if len(self.sink.got) >= packets:
                return
            assert self.step()
        raise AssertionError(f"{len(self.sink.got)} of {packets} packets came")

    def end(self) -> None:
        os.close(self.writing)
        self.writing = -1


@pytest.fixture(params=["polled", "by a thread"])
def pipe(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[Pipe]:
    """A pipe read as this system does, and as Windows has to."""
    if request.param == "by a thread":
        monkeypatch.setattr(live_pipe, "read_pipe", PipeThread)
    made = Pipe()
    yield made
    made.reader.close()
    if made.writing >= 0:
        made.end()


@pytest.mark.parametrize("whole", [PCAP, PCAPNG], ids=["pcap", "pcapng"])
def test_cut_at_every_octet(whole: bytes) -> None:
    for at in range(len(whole)):
        pipe = Pipe()
        pipe.reader.wait_ms = 0
        for part in (whole[:at], whole[at:]):
            pipe.write(part)
            for _ in range(3):
                assert pipe.step()
        pipe.end()
        assert drained(pipe.reader, pipe.sink)
        assert [got.octets for got in pipe.sink.got] == FRAMES
        assert (pipe.reader.packets, pipe.reader.octets, pipe.reader.damage) == (5, len(whole), "")


def test_an_octet_at_a_time(pipe: Pipe) -> None:
    pipe.reader.wait_ms = 0
    for at in range(len(PCAPNG)):
        pipe.write(PCAPNG[at : at + 1])
        assert pipe.step()
    pipe.until(len(FRAMES))
    assert [got.octets for got in pipe.sink.got] == FRAMES


def test_a_silent_pipe_is_not_waited_for(pipe: Pipe) -> None:
    assert all(pipe.step() for _ in range(20))
    pipe.write(PCAP[:-1])
    pipe.until(4)
    assert pipe.step()
    assert len(pipe.sink.got) == 4


def test_packets_are_told_as_they_come(pipe: Pipe) -> None:
    pipe.write(PCAP[: 24 + 16 + 60])
    pipe.until(1)
    assert [got.octets for got in pipe.sink.got] == FRAMES[:1]
    assert pipe.reader.packets == 1


def test_cut_off_is_told(pipe: Pipe) -> None:
    pipe.write(PCAP[:-1])
    pipe.end()
    assert drained(pipe.reader, pipe.sink)
    assert "cut off" in pipe.reader.damage
    assert len(pipe.sink.got) == 4


def test_stopped_with_what_the_pipe_holds(pipe: Pipe) -> None:
    pipe.write(PCAP)
    pipe.reader.stop()
    assert drained(pipe.reader, pipe.sink)
    assert len(pipe.sink.got) == 5
    assert pipe.reader.damage == ""
    assert not pipe.step()


def test_stopped_though_there_is_always_more(pipe: Pipe) -> None:
    os.set_blocking(pipe.writing, False)
    pipe.write(PCAP[:24])
    pipe.reader.stop()
    more = True
    while more:
        with contextlib.suppress(BlockingIOError):
            pipe.write(PCAP[24:] * 50)
        more = pipe.step()
    assert pipe.sink.got


def test_closing_twice_ends_it(pipe: Pipe) -> None:
    pipe.write(PCAP)
    pipe.step()
    pipe.reader.close()
    pipe.reader.close()
    assert not pipe.step()


def test_compressed(pipe: Pipe) -> None:
    pipe.write(gzip.compress(PCAP))
    pipe.end()
    assert drained(pipe.reader, pipe.sink)
    assert [got.octets for got in pipe.sink.got] == FRAMES


@pytest.mark.parametrize("octets", [b"", b"abc", b"no capture at all"])
def test_no_capture_is_told(octets: bytes, pipe: Pipe) -> None:
    pipe.write(octets)
    pipe.end()
    with pytest.raises(CaptureError, match="the pipe: "):
        drained(pipe.reader, pipe.sink)


def test_standard_input(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "x.pcap"
    file.write_bytes(PCAP)
    with file.open("rb") as stream:
        monkeypatch.setattr("sys.stdin", io.TextIOWrapper(stream))
        reader = open_live("-")
        sink = Sink()
        assert drained(reader, sink)
        assert len(sink.got) == 5
        assert reader.engine == "pipe"
        assert reader.drops == (None, None)


def test_no_standard_input(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stdin", None)
    with pytest.raises(CaptureError, match="closed"):
        open_live("-")
