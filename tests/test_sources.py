"""What a program gives as a source: paths, open files, packets, an interface, octets of its own connection; threads."""

from __future__ import annotations

import asyncio
import gzip
import io
import os
import threading
import tracemalloc
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

import dissect
from dissect.online.live import iterating
from dissect.packets.source.given import Packet
from dissect.packets.source.live.reader import Drops, LiveReader
from dissect.packets.source.packet import PacketSink
from tests.layers.examples import BY_NUMBER

CAPTURES = Path(__file__).parents[1] / "captures"
CAPTURE = CAPTURES / "item-errors.pcapng"


class Sink(PacketSink):
    """Keeps packets as a program gives them."""

    def __init__(self) -> None:
        self.packets: list[Packet] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.packets.append((int(time_ns), int(link_type), buf[start:end], int(wire_length)))


def packets_of(path: Path) -> list[Packet]:
    from dissect.packets.source.files import open_capture

    sink, reader = Sink(), open_capture(path)
    while reader.step(sink):
        pass
    reader.close()
    return sink.packets


def said(events: Iterator[Any] | list[Any]) -> list[str]:
    return [repr(event) for event in events]


def test_every_kind_of_source_gives_the_same() -> None:
    expected = said(dissect.open(CAPTURE))
    packets = packets_of(CAPTURE)
    with CAPTURE.open("rb") as file:
        assert said(dissect.open(file)) == expected
        assert not file.closed
        file.seek(0)
        assert dissect.analyze(file).files[0].name == str(CAPTURE)
    octets = CAPTURE.read_bytes()
    assert said(dissect.open(io.BytesIO(octets))) == expected
    assert said(dissect.open(io.BytesIO(gzip.compress(octets)))) == expected
    assert said(dissect.open(packets)) == expected
    assert said(dissect.open(packet[:3] for packet in packets)) == expected
    seconds = [(datetime.fromtimestamp(0, UTC), packet[1], packet[2]) for packet in packets[:1]]
    pipeline = dissect.analyze([*seconds, (1.5, 1, b"")]).pipeline
    assert pipeline is not None
    assert pipeline.now_ns == 1_500_000_000
    assert dissect.analyze(io.BytesIO(octets)).files[0].name == "<BytesIO>"
    read, write = os.pipe()

    def feed() -> None:
        with os.fdopen(write, "wb") as begin:
            begin.write(octets)

    with os.fdopen(read, "rb") as end:
        threading.Thread(target=feed).start()
        assert said(dissect.open(end)) == expected


def test_several_kinds_at_once() -> None:
    both = dissect.analyze(CAPTURE, io.BytesIO(CAPTURE.read_bytes()))
    again = dissect.analyze(CAPTURE, CAPTURE)
    assert both.total == again.total
    assert [repr(row) for row in dissect.values(io.BytesIO(CAPTURE.read_bytes()))] == said(
        list(dissect.values(CAPTURE))
    )
    assert said(list(dissect.devices(io.BytesIO(CAPTURE.read_bytes())))) == said(list(dissect.devices(CAPTURE)))
    assert dissect.blocks(io.BytesIO(CAPTURE.read_bytes())) == []


def closed_file() -> io.BytesIO:
    file = io.BytesIO(CAPTURE.read_bytes())
    file.close()
    return file


@pytest.mark.parametrize(
    ("source", "message"),
    [
        (closed_file, "<BytesIO>: the file is closed"),
        (lambda: io.StringIO("a text"), "opened as a text"),
        (lambda: io.BytesIO(b"nothing of the kind, but long"), "<BytesIO>: not a capture file"),
        (io.BytesIO, "<BytesIO>: empty"),
        (lambda: [b"octets"], r"packet 1: expected \(time, link type, octets\), got bytes"),
        (lambda: [(1, 1, "text")], "packet 1: its octets are str"),
        (lambda: [(1, "ethernet", b"")], "packet 1: 'ethernet' is not a LINKTYPE number"),
        (lambda: [(0, 1, b""), (-1, 1, b"")], "packet 2: its time is beyond the range"),
        (lambda: [(float("nan"), 1, b"")], "packet 1: its time is beyond the range"),
        (lambda: [(datetime(2026, 1, 1), 1, b"")], "packet 1: its time has no time zone"),  # noqa: DTZ001
        (lambda: [(1, 1, b"four", 3)], "packet 1: its size on the wire"),
    ],
)
def test_what_is_no_source_raises_one_error(source: Callable[[], Any], message: str) -> None:
    with pytest.raises(dissect.CaptureError, match=message):
        list(dissect.open(source()))


def test_octets_and_numbers_are_no_sources() -> None:
    with pytest.raises(TypeError, match=r"io\.BytesIO"):
        list(dissect.open(b"octets"))  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="not int"):
        dissect.analyze(5)  # type: ignore[arg-type]


def test_packets_that_lie_about_their_link_are_only_said_to() -> None:
    for link_type in (0, 101, 113, 147, 65535):
        analysis = dissect.analyze([(packet[0], link_type, packet[2]) for packet in packets_of(CAPTURE)])
        assert analysis.total == 0
        assert analysis.pipeline is not None
        assert analysis.pipeline.frames == len(packets_of(CAPTURE))


# ---- an interface -----------------------------------------------------------------------------------------------------


class Line(LiveReader):
    """A line that is made up: the packets of a capture, a few at a time, then nothing until it is stopped."""

    def __init__(self, ends: bool = True) -> None:
        super().__init__("made up", "ring", 1)
        self._packets = packets_of(CAPTURE)
        self._ends = ends
        self.stopped = self.closed = False

    @property
    def drops(self) -> Drops:
        return Drops(3, 0)

    def step(self, sink: PacketSink) -> bool:
        for time_ns, link_type, octets, size in self._packets[:5]:  # type: ignore[misc]
            sink.frame(time_ns, octets, 0, len(octets), size, link_type)  # type: ignore[arg-type]
        del self._packets[:5]
        return bool(self._packets) or not (self._ends or self.stopped)

    def stop(self) -> None:
        self.stopped = True

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def line(monkeypatch: pytest.MonkeyPatch) -> Line:
    made = Line()
    monkeypatch.setattr(iterating, "open_live", lambda *_: made)
    return made


def transactions(events: Any) -> list[str]:
    return [repr(event) for event in events if isinstance(event, dissect.Transaction)]


EXPECTED = transactions(dissect.open(CAPTURE, pdus=False))


def test_an_interface_is_iterated(line: Line) -> None:
    with dissect.live("eth0", filter="tcp port 102") as events:
        assert transactions(events) == EXPECTED
        assert events.drops.kernel == 3
        assert events.packets == len(packets_of(CAPTURE))
        assert list(events) == []
    assert line.closed


def test_an_interface_is_iterated_asynchronously(line: Line) -> None:
    async def read() -> list[Any]:
        async with dissect.live("eth0", where='function contains "Read"') as events:
            return [event async for event in events]

    found = asyncio.run(read())
    assert 0 < len(transactions(found)) < len(EXPECTED)
    assert line.closed


def test_a_live_run_ends_in_order(monkeypatch: pytest.MonkeyPatch) -> None:
    endless = Line(ends=False)
    monkeypatch.setattr(iterating, "open_live", lambda *_: endless)
    events = dissect.live("eth0", pdus=False)
    threading.Timer(0.2, events.stop).start()
    assert transactions(events) == EXPECTED
    assert events.poll() == []
    events.close()
    endless = Line(ends=False)
    monkeypatch.setattr(iterating, "open_live", lambda *_: endless)
    with dissect.live("eth0") as broken_off:
        next(broken_off)
    assert endless.closed
    assert list(broken_off) == []


def test_an_interface_that_is_not_there_is_of_the_family() -> None:
    with pytest.raises(dissect.Error):
        dissect.live("no-such-interface")


# ---- octets of one's own ----------------------------------------------------------------------------------------------

CONNECT, CONFIRM, READ, ANSWER = (BY_NUMBER[number].octets for number in (13, 14, 28, 29))


def test_octets_of_a_connection_give_events() -> None:
    with dissect.stream(("10.0.0.1", 4000), ("10.0.0.2", 102)) as talk:
        assert talk.client_sent(CONNECT) == []
        assert talk.server_sent(CONFIRM) == []
        asked = talk.client_sent(READ, time_ns=2**62)
        assert isinstance(asked[0], dissect.Pdu)
        assert talk.server_sent(ANSWER[:9]) == []
        answered = talk.server_sent(ANSWER[9:])
        (transaction,) = [event for event in answered if isinstance(event, dissect.Transaction)]
        assert transaction.connection.client.host == "10.0.0.1"
        talk.client_closed()
        with pytest.raises(dissect.Error, match="has closed"):
            talk.client_sent(READ)
        (connection,) = [event for event in talk.close() if isinstance(event, dissect.Connection)]
        assert connection.pdus == 2
        assert talk.close() == []
        with pytest.raises(dissect.Error, match="closed"):
            talk.server_sent(ANSWER)


def test_octets_out_of_turn_and_a_stream_that_never_synchronises_stay_bounded() -> None:
    talk = dissect.stream(pdus=False)
    tracemalloc.start()
    for number in range(200):
        talk.server_sent(bytes([number]) * 65_536)
        talk.client_sent(b"\x03\x00" * 20_000)
        if number == 20:
            tracemalloc.reset_peak()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 16_000_000
    talk.close()
    late = dissect.stream(begun=True)
    assert late.server_sent(ANSWER)
    assert late.close()


def test_asyncio_readers_feed_a_stream() -> None:
    async def proxy() -> list[Any]:
        reader = asyncio.StreamReader()
        for start in range(0, len(READ), 7):
            reader.feed_data(READ[start : start + 7])
        reader.feed_eof()
        talk, found = dissect.stream(begun=True), []
        while octets := await reader.read(100):
            found += talk.client_sent(octets)
        return found + talk.close()

    assert [event.function_name for event in asyncio.run(proxy()) if isinstance(event, dissect.Pdu)] == ["Read Var"]


# ---- threads ----------------------------------------------------------------------------------------------------------


def test_pipelines_in_threads_give_what_they_give_alone() -> None:
    paths = sorted(CAPTURES.glob("*.pcapng"))[:8]
    alone = [said(dissect.open(path)) for path in paths]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda path: said(dissect.open(path)), [*paths, *paths]))
    assert together == alone + alone


def test_pcap_files_too() -> None:
    path = next(iter(sorted(CAPTURES.rglob("*.pcap"))))
    with path.open("rb") as file:
        assert dissect.analyze(file).total == dissect.analyze(path).total
