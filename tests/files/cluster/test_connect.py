"""How long is waited for a scheduler: those that are not what they should be are sockets of the test."""

from __future__ import annotations

import os
import socket
import threading

import pytest

from dissect.files.cluster import connect
from dissect.files.cluster.connect import ClusterError, Patience
from dissect.files.cluster.workers import workers_of
from dissect.packets.source.remote import bounded
from tests.cli.support import run
from tests.packets.source.servers import LOOPBACK

pytest.importorskip("distributed", reason="no distributed: pip install 's7dissect[test]'")


def test_all_there_is_to_wait_for_is_less_than_ten_seconds() -> None:
    assert connect.ANSWER_S + connect._CLOSE_S < 10


def test_the_time_is_one_for_all_who_are_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connect, "ANSWER_S", 0.05)
    patience = Patience()
    assert 0 < patience.left <= 0.05
    never = threading.Event()
    with pytest.raises(TimeoutError):
        bounded(never.wait, patience.left)
    assert patience.left == 0
    with pytest.raises(TimeoutError):
        bounded(never.wait, patience.left)
    never.set()
    assert bounded(lambda: 3, 60) == 3
    with pytest.raises(KeyError):
        bounded(lambda: os.environ["S7DISSECT_NO_SUCH"], 60)


def test_a_port_that_accepts_and_stays_silent(
    capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Dask would wait for its greeting for ever."""
    monkeypatch.setattr(connect, "ANSWER_S", 0.5)
    with socket.socket() as silent:
        silent.bind((LOOPBACK, 0))
        silent.listen(8)
        address = f"tcp://{LOOPBACK}:{silent.getsockname()[1]}"
        said = (
            f"Error: {address}: a program listens there, but it did not answer as a Dask scheduler within 0.5 seconds\n"
        )
        for arguments in (("cluster-check", address), ("analyze", "--separate", "x.pcap", "--cluster", address)):
            ran = run(capfdbinary, *arguments)
            assert (ran.code, ran.out, ran.err) == (2, "", said)


class _Mute:
    """A client whose scheduler stopped answering."""

    def __init__(self) -> None:
        self.over = threading.Event()

    def scheduler_info(self, n_workers: int) -> dict[str, object]:
        assert n_workers == -1
        self.over.wait()
        return {}


def test_a_scheduler_that_stops_answering(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(connect, "ANSWER_S", 0.05)
    mute = _Mute()
    with pytest.raises(ClusterError, match=r"^the scheduler did not list its workers within 0\.05 seconds$"):
        workers_of(mute, Patience())
    mute.over.set()
