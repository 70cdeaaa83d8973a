"""Ring and keeper beside a pipeline, as a live command runs them: what a real finding leaves on the disk."""

from __future__ import annotations

from pathlib import Path

from mypy_extensions import i64

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.files.recording.event_capture import EventCapture
from dissect.files.recording.ring_buffer import RingBuffer, parse_limits
from dissect.packets.source.files import open_capture
from dissect.packets.source.packet import PacketSink
from tests.packets.source.craft import drain

ROOT = Path(__file__).resolve().parents[3]


class Telling(Observer):
    """Passes findings on to a keeper."""

    def __init__(self, keeper: EventCapture) -> None:
        super().__init__()
        self.keeper = keeper

    def finding(self, finding: Finding) -> None:
        self.keeper.finding(finding)


class Fork(PacketSink):
    """Gives each packet to several sinks, one after the other."""

    def __init__(self, *sinks: PacketSink) -> None:
        self.sinks = sinks

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        for sink in self.sinks:
            sink.frame(time_ns, buf, start, end, wire_length, link_type)


def test_a_stop_of_a_plc_is_kept_with_what_was_around_it(tmp_path: Path) -> None:
    source = ROOT / "captures" / "plc-control.pcapng"
    keeper = EventCapture(str(tmp_path / "kept"), 300_000, 300_000, slugs=["security.plc_stop"])
    ring = RingBuffer(str(tmp_path / "ring"), parse_limits(["filesize:1", "files:100"]))
    pipeline = Pipeline(Telling(keeper))
    reader = open_capture(str(source))
    while reader.step(Fork(ring, keeper, pipeline)):
        pass
    pipeline.finish()
    keeper.close()
    ring.close()

    everything = drain(open_capture(str(source))).frames
    ringed = [frame for path in ring.finished for frame in drain(open_capture(str(path))).frames]
    assert ringed == everything
    assert len(ring.finished) > 2
    assert keeper.triggers == 2
    stops = asked = 0
    for path in sorted((tmp_path / "kept").iterdir()):
        got = drain(open_capture(str(path)))
        first = everything.index(got.frames[0])
        assert got.frames == everything[first : first + len(got.frames)]
        for number, text in got.comments:
            if "security.plc_stop" in text:
                stops += 1
                asked += b"P_PROGRAM" in got.frames[number - 1].octets
    assert (stops, asked) == (4, 2)  # two requests and their answers
