"""The relay in a process of its own: it passes on whatever becomes of the dissection, says what it left out, ends with us."""

from __future__ import annotations

import os
import signal
import socket
import threading
import time
import warnings
from collections.abc import Iterator

import pytest

from dissect.online.net.addresses import Address, places_to_connect, places_to_listen
from dissect.online.proxy import process as module
from dissect.online.proxy.process import RelayProcess
from dissect.online.proxy.relay import Relay
from dissect.online.proxy.tap import CLOSED, GONE, OPENED, SENT, Passed, Tap

LOOPBACK = "127.0.0.1"
WAIT_S = 60.0


@pytest.fixture
def echo() -> Iterator[int]:
    """A server that sends back what it gets."""

    def talk(one: socket.socket) -> None:
        with one:
            while octets := one.recv(65536):
                one.sendall(octets)

    def serve() -> None:
        while True:
            try:
                one, _ = listener.accept()
            except OSError:
                return
            threading.Thread(target=talk, args=(one,), daemon=True).start()

    with socket.create_server((LOOPBACK, 0)) as listener:
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield int(listener.getsockname()[1])
        listener.shutdown(socket.SHUT_RDWR)
        thread.join(WAIT_S)


@pytest.fixture
def nice(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Keep the tests as nice as they are; return what was asked for."""
    asked: list[int] = []
    monkeypatch.setattr(os, "nice", asked.append)
    return asked


def started(port: int, max_octets: int) -> RelayProcess:
    tap = Tap(max_octets)
    relay = Relay(places_to_listen(Address(LOOPBACK, 0), False), places_to_connect(Address(LOOPBACK, port)), tap)
    made = RelayProcess(relay, tap)
    made.start()
    return made


def sent_and_back(side: RelayProcess, octets: bytes) -> bytes:
    with socket.create_connection((LOOPBACK, int(side.listening[0].address[1])), timeout=WAIT_S) as client:
        sender = threading.Thread(target=client.sendall, args=(octets,))
        sender.start()
        came = bytearray()
        while len(came) < len(octets):
            piece = client.recv(65536)
            assert piece
            came += piece
        sender.join()
        return bytes(came)


def drained(side: RelayProcess) -> list[Passed]:
    told = []
    end = time.monotonic() + WAIT_S
    while (side.is_alive() or side._given > side._taken) and time.monotonic() < end:
        if (passed := side.take(0.05)) is not None:
            told.append(passed)
    return told


def test_what_passes_is_told_in_order(echo: int, nice: list[int]) -> None:
    side = started(echo, 1 << 20)
    octets = os.urandom(100_000)
    assert sent_and_back(side, octets) == octets
    side.stop()
    told = drained(side)
    side.join(WAIT_S)
    assert (told[0].kind, told[-1].kind) == (OPENED, GONE)
    assert {passed.kind for passed in told} <= {OPENED, SENT, CLOSED, GONE, "reset"}
    for one in (0, 1):
        assert b"".join([passed.octets for passed in told if passed.kind == SENT and passed.side == one]) == octets
    assert (side.connections, side.octets, side.lost, side.error) == (1, [100_000, 100_000], 0, "")
    assert nice == [5]


@pytest.mark.parametrize(
    ("told", "error"),
    [
        (b"\x00\x00\x03\xe8\x9b\xa4abcd", "its process ended with exit code 9"),
        (b"\x00\x00", "its process ended with exit code 9"),
        (b"\x00\x00\x00\x01\xc1", "what its process told cannot be read: "),
    ],
)
def test_what_is_cut_off_is_no_clean_end(told: bytes, error: str, echo: int) -> None:
    tap = Tap(1000)
    relay = Relay(places_to_listen(Address(LOOPBACK, 0), False), places_to_connect(Address(LOOPBACK, echo)), tap)
    side = RelayProcess(relay, tap)
    relay.close()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)  # of the thread of the echo
        side._pid = os.fork()
    if not side._pid:
        side._theirs.sendall(told)  # as a kill in the middle of it leaves it
        os._exit(9)
    side._theirs.close()
    side._thread.start()
    side.join(WAIT_S)
    assert side.error.startswith(error)
    with pytest.raises(ChildProcessError):
        os.waitpid(side._pid, os.WNOHANG)


def test_it_passes_on_though_nobody_takes_and_says_what_was_left_out(
    echo: int, nice: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Far more than both queues and the socket between them hold, and not one octet is taken until it has all passed."""
    monkeypatch.setattr(module, "_MAX_HELD", 100_000)
    side = started(echo, 200_000)
    octets = os.urandom(8_000_000)
    assert sent_and_back(side, octets) == octets
    side.stop()
    told = drained(side)
    side.join(WAIT_S)
    sent = [passed for passed in told if passed.kind == SENT]
    assert 0 < sum([len(passed.octets) for passed in sent]) < 16_000_000
    assert side.lost > 0
    assert side.lost_octets + sum([len(passed.octets) for passed in sent]) == 16_000_000
    assert (told[0].kind, told[-1].kind) == (OPENED, GONE)


def test_a_relay_that_is_killed_is_told(echo: int, nice: list[int]) -> None:
    side = started(echo, 1 << 20)
    os.kill(side._pid, signal.SIGKILL)
    side.join(WAIT_S)
    assert side.error == "its process was killed by signal 9"


def test_it_ends_when_nobody_is_there_any_more(echo: int, nice: list[int]) -> None:
    side = started(echo, 1 << 20)
    side._ours.shutdown(socket.SHUT_RDWR)  # as the end of this process does
    side.join(WAIT_S)
    assert not side.is_alive()
