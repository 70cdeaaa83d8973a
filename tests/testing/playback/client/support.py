"""Shared by the tests of the replay: a session that a fake PLC serves and that is played to it."""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from dissect.online.net.addresses import Address
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.golden.model import Session
from dissect.testing.playback.client import (
    Permissions,
    ReplayOutcome,
    Settings,
    load_recorded,
    make_plan,
    places_of,
    replay,
)
from dissect.testing.playback.server.recording import Recording, load_recording
from dissect.testing.playback.server.service import Server
from tests.conftest import ROOT
from tests.meaning.report.support import WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import dt

CAPTURES: Final = ROOT / "captures"
#: All of our own recordings, by their names below the folder.
NAMES: Final = sorted(
    [
        path.relative_to(CAPTURES).as_posix()
        for folder in (CAPTURES, CAPTURES / "crafted")
        for path in folder.glob("*.pcap*")
    ]
)
ALL: Final = Permissions(write=True, control=True)
#: For recordings with lost answers: the fake PLC does not have them either.
HASTY: Final = Settings(lost_s=0.001)


def play(
    path: Path | Session,
    server: Server | Address,
    permissions: Permissions | None = None,
    settings: Settings | None = None,
    numbers: Sequence[int] = (),
    called: bytes | tuple[int, int] | None = None,
    writer: PcapngWriter | None = None,
) -> ReplayOutcome:
    """Play a recording to a server."""
    address = Address("127.0.0.1", server.port) if isinstance(server, Server) else server
    recorded = path if isinstance(path, Session) else load_recorded(path)
    plan = make_plan(recorded, numbers, called)
    return replay(recorded, plan, places_of(address, False), address, permissions, settings, writer)


def texts(outcome: ReplayOutcome) -> list[str]:
    """Return the changes, one per line."""
    return [difference.text for difference in outcome.differences()]


def changed(path: Path, connection: int, step: int, was: bytes, is_: bytes) -> Recording:
    """Return a recording to be served in which one answer is changed."""
    recording = load_recording(path)
    answer = recording.scripts[connection].steps[step].answer
    assert answer.count(was) == 1
    recording.scripts[connection].steps[step].answer = answer.replace(was, is_)
    return recording


def mixed(path: Path) -> Path:
    """Write a capture with reads, a write and a stop: transactions 1 (setup), 2 read, 3 write, 4 stop, 5 read."""
    talk = read(begun(), 1)
    talk.send(0, dt(messages.write_job(2, [WORD], [b"\x00\x07"]))).send(1, dt(messages.write_answer(2, [0xFF])))
    stop = b"\x29\0\0\0\0\0\x09P_PROGRAM"
    talk.send(0, dt(messages.pdu(messages.JOB, 3, stop))).send(1, dt(messages.pdu(messages.ACK_DATA, 3, b"\x29")))
    return saved(path, read(talk, 4).close(0).close(1).packets())


@contextlib.contextmanager
def real_server() -> Iterator[Address]:
    """Start the python-snap7 server that the captures were recorded with, memory and all."""
    port = free_port()
    command = [sys.executable, str(CAPTURES / "record" / "serve.py"), str(port)]
    found = {
        name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"
    }  # it imports the modules beside it
    quiet = subprocess.DEVNULL
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=quiet, env=found) as process:
        assert process.stdout is not None
        try:
            assert process.stdout.readline() == b"ready\n"
            yield Address("127.0.0.1", port)
        finally:
            process.communicate()


def free_port() -> int:
    """Return a port of this machine on which nobody listens now."""
    import socket

    with socket.create_server(("127.0.0.1", 0)) as one:
        return int(one.getsockname()[1])
