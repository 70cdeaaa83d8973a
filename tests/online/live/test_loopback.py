"""Real traffic, captured while it passes: a python-snap7 server and its clients on loopback, by either engine."""

from __future__ import annotations

import contextlib
import re
import socket
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import snap7.error

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.files.session import Run
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.online.live.events import CLOSED, Event
from dissect.online.live.run import Companion
from dissect.online.live.session import Session
from dissect.packets.source.live.opening import open_live
from dissect.packets.source.pcapng_writer import PcapngWriter
from tests.engine.transactions.talk import CONFIRM, CONNECT, dbw, dt, granted, read, setup, write, written
from tests.online.live.support import SECOND, client, never, plc, program, taken
from tests.packets.source.live_support import ENGINES

FOREVER_NS = 3600 * SECOND


class Recorder(Companion):
    """Writes what passes to a file."""

    wants_packets = True

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.writer = PcapngWriter(str(path))

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        self.writer.packet(time_ns, octets, wire_length, link_type, (), interface)

    def close(self) -> None:
        self.writer.close()


class Offline(Observer):
    """What a file tells."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []
        self.findings: list[tuple[object, ...]] = []
        self.transactions = TransactionLines()

    def transaction(self, transaction: Transaction) -> None:
        self.lines.append(self.transactions.line(transaction))

    def finding(self, finding: Finding) -> None:
        self.findings.append(said(finding))


def said(finding: Finding) -> tuple[object, ...]:
    return finding.slug, finding.connection, tuple(finding.frames), finding.time_ns, finding.detail


def watched(port: int, engine: str, *companions: Companion, overdue_ns: int = FOREVER_NS) -> Session:
    session = Session(
        lambda: open_live("lo", f"tcp port {port}", engine),
        Options(strict=True, overdue_ns=overdue_ns),
        companions=companions,
        name="lo",
    )
    session.start()
    return session


def closed(count: int) -> Callable[[list[Event]], bool]:
    def until(events: list[Event]) -> bool:
        return sum(event.kind == CLOSED for event in events) == count

    return until


def intrude(port: int) -> None:
    """Another client, from another address, writes."""
    with socket.create_connection(("127.0.0.1", port), 10, ("127.0.0.2", 0)) as stream:
        for octets in (CONNECT, dt(setup(0)), dt(write(1, [dbw(1, 12)], written(4, b"\x03\x04")))):
            stream.sendall(octets)
            assert stream.recv(1000)


@pytest.mark.parametrize("engine", ENGINES)
def test_what_is_told_live_is_what_the_file_tells(engine: str, tmp_path: Path) -> None:
    path = tmp_path / "live.pcapng"
    with plc() as server:
        session = watched(server.port, engine, Recorder(path))
        with client(server.port) as panel:
            for octet in range(8):
                panel.db_read(1, octet, 4)
            panel.db_write(1, 10, bytearray(b"\x01\x02"))
            panel.get_cpu_state()
            with contextlib.suppress(snap7.error.S7Error):
                panel.db_read(99, 0, 4)
            intrude(server.port)
        events = taken(session, closed(2))
        session.close()
        events += taken(session, never)
    assert session.error is None
    assert session.run.failures == []

    offline = Offline()
    run = Run([str(path)], offline, Options(strict=True))
    while run.step():
        pass
    lines = TransactionLines()
    assert [lines.line(event.what) for event in events if isinstance(event.what, Transaction)] == offline.lines
    live = [said(event.what) for event in events if isinstance(event.what, Finding)]
    assert sorted(live, key=str) == sorted(offline.findings, key=str)
    assert run.pipeline.frames == session.status().packets > 30
    slugs = {finding[0] for finding in live}
    assert {"security.write", "security.new_writer", "session.unusual_port"} <= slugs
    functions = [event.what.function_name for event in events if isinstance(event.what, Transaction)]
    assert functions.count("Read Var") >= 9
    assert functions.count("Setup communication") == 2
    assert (session.status().drops.interface, session.status().lost_events) == (0, 0)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_server_that_stops_is_told(engine: str) -> None:
    with program() as (port, server):
        session = watched(port, engine)
        with client(port) as panel:
            panel.db_read(1, 0, 4)
            server.kill()
            server.wait()
            with contextlib.suppress(snap7.error.S7Error, OSError):
                panel.db_read(1, 0, 4)
        events = taken(session, closed(1))
        session.close()
    (connection,) = [event.what for event in events if event.kind == CLOSED]
    assert isinstance(connection, Connection)
    assert connection.ending is not None
    assert connection.role(connection.ending.side) == "server"


@contextlib.contextmanager
def mute() -> Iterator[tuple[int, threading.Event]]:
    """A server that sets up a connection, and answers nothing more until it is let: (its port, what lets it)."""
    speak = threading.Event()
    listening = socket.create_server(("127.0.0.1", 0))

    def serve() -> None:
        stream, _ = listening.accept()
        with stream:
            stream.recv(1000)
            stream.sendall(CONFIRM)
            stream.recv(1000)
            stream.sendall(dt(granted(0)))
            stream.recv(1000)
            speak.wait(30)

    thread = threading.Thread(target=serve, daemon=True)
    thread.start()
    try:
        yield int(listening.getsockname()[1]), speak
    finally:
        speak.set()
        listening.close()
        thread.join(10)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_request_without_answer_is_told_while_the_line_is_silent(engine: str) -> None:
    limit = 400_000_000
    with mute() as (port, speak), socket.create_connection(("127.0.0.1", port)) as stream:
        session = watched(port, engine, overdue_ns=limit)
        for octets in (CONNECT, dt(setup(0))):
            stream.sendall(octets)
            stream.recv(1000)
        stream.sendall(dt(read(1, dbw(10, 4))))
        events = taken(session, lambda events: bool(late(events)))
        assert not speak.is_set()  # nothing has happened since
        (finding,) = late(events)
        assert isinstance(finding.what, Finding)
        assert re.match(r"Read Var DB10\.DBW4: sent [0-9.]+ m?s ago in packet 7, still unanswered", finding.what.detail)
        assert session.status().open_requests == 1
        (connection,) = [event.what for event in events if isinstance(event.what, Connection)]
        assert finding.time_ns - connection.last_request_ns >= limit
        speak.set()
        stream.close()
        events += taken(session, closed(1))
        session.close()
    assert [event.what.outcome for event in events if isinstance(event.what, Transaction)] == [
        "answered",
        "unanswered",
    ]


def late(events: list[Event]) -> list[Event]:
    return [event for event in events if isinstance(event.what, Finding) and event.what.slug == "transaction.overdue"]
