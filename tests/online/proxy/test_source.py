"""What passes as packets for the pipeline: the same as a capture would have told, live, and bounded."""

from __future__ import annotations

import contextlib
import random
from collections.abc import Iterator
from pathlib import Path

import pytest
import snap7
import snap7.error

from dissect.engine.findings.reporter import Finding
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.online.live.events import CLOSED, Event
from dissect.online.live.session import Session
from dissect.online.proxy.capture_file import CaptureFile
from dissect.online.proxy.packets import endpoint_of
from dissect.online.proxy.relay import Relay
from dissect.online.proxy.source import RelayReader
from dissect.online.proxy.tap import REFUSED, UNANSWERED, Tap
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcapng_writer import PcapngWriter
from tests.online.live.support import client, never, plc, taken
from tests.online.live.test_loopback import Offline, said
from tests.online.proxy.support import (
    WRONG,
    Frames,
    at,
    eventually,
    frames_of,
    pair,
    port_of_nobody,
    relaying,
    reset,
    tshark,
)

ENDS = (endpoint_of(("127.0.0.1", 5000)), endpoint_of(("127.0.0.1", 102)))


@contextlib.contextmanager
def dissected(port: int, path: Path | None = None, overdue_ns: int = 0) -> Iterator[tuple[Relay, Session, int]]:
    """A relay to ``port`` and the session that dissects what passes; its reader ends after the relay."""
    tap = Tap()
    reader = RelayReader(tap)
    companions = [CaptureFile(PcapngWriter(str(path)))] if path is not None else []
    session = Session(lambda: reader, Options(strict=True, overdue_ns=overdue_ns), companions=companions)
    session.start()
    try:
        with relaying(at(port), tap) as relay:
            yield relay, session, relay.listening[0].address[1]
    finally:
        reader.stop()
        eventually(lambda: not session.running)


def transactions(events: list[Event]) -> list[Transaction]:
    return [event.what for event in events if isinstance(event.what, Transaction)]


def test_both_ends_and_the_capture_and_wireshark_tell_the_same(tmp_path: Path) -> None:
    path = tmp_path / "proxy.pcapng"
    with plc() as server:
        with dissected(server.port, path) as (relay, session, port):
            with client(port) as panel:
                known = [bytes(panel.db_read(1, octet, 4)) for octet in range(8)]
                panel.db_write(1, 10, bytearray(b"\x01\x02"))
                assert panel.db_read(1, 10, 2) == b"\x01\x02"
                with pytest.raises(snap7.error.S7Error):
                    panel.db_read(99, 0, 4)
            with client(port) as panel:
                panel.db_read(1, 0, 1)
            eventually(lambda: relay.active == 0)
        assert server.server.get_status()
        events = taken(session, never)
    assert (session.error, session.run.failures) == (None, [])

    told = transactions(events)
    reads = [one for one in told if one.function_name == "Read Var"]
    writes = [one for one in told if one.function_name == "Write Var"]
    assert [one.s7_results[0].data for one in reads[:8]] == known
    assert [one.s7_results[0].data for one in writes] == [b"\x01\x02"]
    assert [one.has_errors for one in reads] == [False] * 9 + [True, False]
    assert len({one.connection.number for one in told}) == 2
    assert all(one.latency_ns is not None and one.latency_ns > 0 for one in reads)

    offline = Offline()
    run = Run([str(path)], offline, Options(strict=True))
    while run.step():
        pass
    lines = TransactionLines()
    assert [lines.line(one) for one in told] == offline.lines
    live = [said(event.what) for event in events if isinstance(event.what, Finding)]
    assert sorted(live, key=str) == sorted(offline.findings, key=str)

    assert tshark(path, WRONG, port=server.port) == []
    jobs = tshark(path, "s7comm.header.rosctr == 1", port=server.port)
    assert len(jobs) == len(
        [one for one in told if one.function_name in {"Read Var", "Write Var", "Setup communication"}]
    )


def test_time_passes_on_a_silent_line() -> None:
    """A request without answer is told while nothing passes."""
    connect = bytes.fromhex("0300001611e00000000100c0010ac1020100c2020102")
    confirm = connect[:5] + b"\xd0" + connect[6:]
    setup = bytes.fromhex("0300001902f08032010000000000080000f0000001000101e0")
    tap = Tap()
    reader = RelayReader(tap)
    session = Session(lambda: reader, Options(strict=True, overdue_ns=10_000_000))
    session.start()
    with pair(tap) as (_, mine, theirs):
        for one, other, octets in ((mine, theirs, connect), (theirs, mine, confirm), (mine, theirs, setup)):
            one.sendall(octets)
            assert other.recv(100) == octets

        def overdue(events: list[Event]) -> bool:
            return any(isinstance(event.what, Finding) and event.what.slug == "transaction.overdue" for event in events)

        assert overdue(taken(session, overdue))
        reset(theirs)
        events = taken(session, lambda events: any(event.kind == CLOSED for event in events))
    (connection,) = [event.what for event in events if event.kind == CLOSED]
    assert isinstance(connection, Connection)
    assert connection.ending is not None
    assert (connection.tcp.ended, connection.role(connection.ending.side)) == ("reset", "server")
    reader.stop()
    eventually(lambda: not session.running)


def test_a_server_that_is_not_there_is_a_refused_connection(tmp_path: Path) -> None:
    path = tmp_path / "refused.pcapng"
    with dissected(port_of_nobody(), path) as (relay, _, port):
        with pytest.raises((snap7.error.S7Error, OSError)):
            snap7.client.Client().connect("127.0.0.1", 0, 2, port)
        eventually(lambda: relay.failed == 1)
    assert [row[1:] for row in tshark(path, "", "tcp.flags.syn", "tcp.flags.reset")] == [["1", "0"], ["0", "1"]]
    assert tshark(path, WRONG) == []


def test_an_unanswered_attempt_is_one_packet() -> None:
    tap = Tap()
    tap.failed(UNANSWERED, 1, ENDS, 5)
    tap.failed(REFUSED, 2, ENDS, 6)
    assert len(frames_of(tap)) == 1 + 2


def test_a_dissection_that_breaks_off_does_not_stop_the_relay() -> None:
    class Broken(PacketSink):
        def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
            raise RuntimeError("a bug")

    tap = Tap()
    reader = RelayReader(tap)
    with pair(tap) as (_, mine, theirs):
        eventually(lambda: tap.held > 0)
        with pytest.raises(RuntimeError, match="a bug"):
            reader.step(Broken())
        reader.close()
        for _ in range(100):
            mine.sendall(bytes(10_000))
            assert len(theirs.recv(10_000, 0x100)) == 10_000  # MSG_WAITALL
        held = tap.held
        mine.sendall(b"x")
        assert theirs.recv(10) == b"x"
        assert tap.held == held
    assert not reader.step(Frames())


def test_what_a_slow_dissection_misses_is_a_hole_and_is_told(tmp_path: Path) -> None:
    tap = Tap(max_octets=100_000)
    tap.opened(1, ENDS, 1)
    for number in range(100):
        tap.sent(1, 0, random.Random(number).randbytes(5000), 2 + number)
    reader, sink = RelayReader(tap), Frames()
    assert reader.step(sink)
    tap.sent(1, 0, b"there again", 200)
    tap.closed(1, 0, 201)
    reader.stop()
    while reader.step(sink):
        pass
    assert (reader.drops.kernel, reader.drops.interface) == (82, None)
    assert reader.packets == len(sink.frames) == 3 + 18 + 1 + 2
    path = tmp_path / "hole.pcapng"
    writer = PcapngWriter(str(path))
    for time_ns, octets in sink.frames:
        writer.packet(time_ns, octets, len(octets), 1)
    writer.close()
    assert len(tshark(path, "tcp.analysis.lost_segment")) == 1


def test_nothing_is_kept_of_connections_that_are_gone() -> None:
    tap = Tap()
    reader, sink = RelayReader(tap, wait_ms=1), Frames()
    for link in range(1, 2000):
        tap.opened(link, ENDS, link)
        tap.sent(link, 0, b"x", link)
        tap.closed(link, 0, link)
        if link % 2:
            tap.closed(link, 1, link)
        else:
            tap.reset(link, 1, link)
        tap.forget(link, link)
    while tap.held:
        assert reader.step(sink)
    assert reader._conversations == {}
    assert tap._followed == set()
    assert tap._skipped == {}
    assert len(sink.frames) == 3 * 1999 + 1999 + 2 * 1999 + 2 * 1000 + 999
