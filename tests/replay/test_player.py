"""One connection played: what follows what, what is not waited for, and when a server is given up."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from dissect.metrics.address import Address
from dissect.replay import Settings, load_recorded
from dissect.replay.plan import USUAL_SETUP
from dissect.s7.message import parse_pdu
from dissect.server.service import Server
from tests.properties import messages
from tests.properties.messages import dt
from tests.replay.support import ALL, CAPTURES, free_port, mixed, play, texts
from tests.report.support import WORD, begun, read, saved

SOON = Settings(timeout_s=0.1)


class Wire:
    """The server's end of a connection, told what to say by a test."""

    def __init__(self, one: socket.socket) -> None:
        self.socket = one
        self.asked: list[bytes] = []
        self._held = b""

    def tpkt(self) -> bytes:
        """Return the next TPKT, empty at the end."""
        while len(self._held) < 4 or len(self._held) < int.from_bytes(self._held[2:4], "big"):
            octets = self.socket.recv(65536)
            if not octets:
                return b""
            self._held += octets
        size = int.from_bytes(self._held[2:4], "big")
        packet, self._held = self._held[:size], self._held[size:]
        return packet

    def confirm(self) -> None:
        """Take the CR and confirm it."""
        self.tpkt()
        self.socket.sendall(messages.connect(0xD0))

    def pdu(self) -> bytes:
        """Return the next PDU, empty at the end."""
        octets = self.tpkt()[7:]
        if octets:
            self.asked.append(octets)
        return octets

    def say(self, octets: bytes) -> None:
        """Send a PDU."""
        self.socket.sendall(dt(octets))

    def set_up(self, length: int = 480, amq: int = 1) -> None:
        """Confirm, and grant a setup."""
        self.confirm()
        self.say(messages.setup(messages.ACK_DATA, parse_pdu(self.pdu()).pdu_ref, amq, length))


@contextmanager
def serving(script: Callable[[Wire], None]) -> Iterator[tuple[Address, list[Wire]]]:
    """Let ``script`` be the server of one connection."""
    wires: list[Wire] = []
    failures: list[BaseException] = []

    def work(listener: socket.socket) -> None:
        one, _ = listener.accept()
        one.settimeout(20)
        with one:
            wires.append(Wire(one))
            try:
                script(wires[0])
                while wires[0].pdu():
                    pass
            except ConnectionError:
                pass
            except BaseException as error:  # noqa: BLE001 - told by the thread that waits
                failures.append(error)

    with socket.create_server(("127.0.0.1", 0)) as listener:
        thread = threading.Thread(target=work, args=(listener,), daemon=True)
        thread.start()
        yield Address("127.0.0.1", int(listener.getsockname()[1])), wires
        thread.join(20)
    if failures:
        raise failures[0]


def answer(wire: Wire, octets: bytes, content: bytes = b"\x04\xd2") -> None:
    """Answer a read."""
    wire.say(messages.read_answer(parse_pdu(octets).pdu_ref, [WORD], [content]))


def reads(path: Path, count: int) -> Path:
    """Write a capture of reads: transaction 1 is the setup."""
    talk = begun()
    for ref in range(1, count + 1):
        read(talk, ref)
    return saved(path, talk.close(0).close(1).packets())


def test_every_request_is_sent_once_and_only_after_the_answer_before_it(tmp_path: Path) -> None:
    open_at_once: list[int] = []

    def script(wire: Wire) -> None:
        wire.set_up()
        wire.socket.settimeout(0.05)
        for _ in range(3):
            octets = wire.pdu()
            with pytest.raises(TimeoutError):
                open_at_once.append(len(wire.pdu()))
            answer(wire, octets)
        wire.socket.settimeout(20)

    with serving(script) as (address, wires):
        outcome = play(reads(tmp_path / "a.pcapng", 3), address)
    assert texts(outcome) == []
    assert not open_at_once
    references = [parse_pdu(octets).pdu_ref for octets in wires[0].asked]
    assert references == [1, 2, 3, 4]


def test_requests_that_were_open_together_are_so_again_when_asked_for(tmp_path: Path) -> None:
    talk = begun(amq=2)
    for refs in ((1, 2), (3, 4)):
        for ref in refs:
            talk.send(0, dt(messages.read_job(ref, [WORD])))
        for ref in refs:
            talk.send(1, dt(messages.read_answer(ref, [WORD], [b"\x04\xd2"])))
    path = saved(tmp_path / "two.pcapng", talk.close(0).close(1).packets())

    def script(wire: Wire) -> None:
        wire.set_up(amq=2)
        for _ in range(2):
            both = [wire.pdu(), wire.pdu()]
            for octets in reversed(both):
                answer(wire, octets)

    with serving(script) as (address, _):
        outcome = play(path, address, settings=Settings(pipelined=True))
    assert texts(outcome) == []
    assert outcome.answered == 5


def test_a_request_that_is_not_answered_is_told_and_the_next_one_is_asked(tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.set_up()
        wire.pdu()
        answer(wire, wire.pdu())

    with serving(script) as (address, _):
        outcome = play(reads(tmp_path / "a.pcapng", 2), address, settings=SOON)
    assert (outcome.requests, outcome.answered) == (3, 2)
    assert [difference.kind for difference in outcome.differences()] == ["answers"]
    assert "transaction 2, READ DB10.DBW4: was 1234, is unanswered" in texts(outcome)[0]


def test_a_server_that_never_answers_is_given_up_and_the_rest_is_told(tmp_path: Path) -> None:
    with serving(lambda wire: wire.set_up()) as (address, wires):
        outcome = play(reads(tmp_path / "a.pcapng", 9), address, settings=SOON)
    assert len(wires[0].asked) == 4
    assert [one.transaction for one in outcome.not_sent] == [5, 6, 7, 8, 9, 10]
    assert outcome.problems == ["connection 1: 3 requests in a row were not answered in time"]
    assert {difference.transaction for difference in outcome.differences()} == set(range(2, 11))


@pytest.mark.parametrize("breaks", [False, True])
def test_a_connection_that_is_lost_leaves_the_rest_unsent(breaks: bool, tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.set_up()
        answer(wire, wire.pdu())
        if breaks:
            wire.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        wire.socket.close()
        raise ConnectionError

    with serving(script) as (address, _):
        outcome = play(reads(tmp_path / "a.pcapng", 4), address)
    left = [one.transaction for one in outcome.not_sent]
    assert left in ([3, 4, 5], [4, 5])  # the request may leave before the end arrives
    assert outcome.problems
    assert "by the server" in outcome.problems[0]
    assert any("end: was fin by the client, is" in line and "by the server" in line for line in texts(outcome))


def test_what_a_server_asks_is_never_answered(tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.set_up()
        octets = wire.pdu()
        wire.say(messages.pdu(messages.JOB, 0x4711, b"\x1b\0\0\0\0\0\0\0\x09_0A00001P"))
        answer(wire, octets)

    with serving(script) as (address, wires):
        outcome = play(reads(tmp_path / "a.pcapng", 2), address, ALL, SOON)
    assert outcome.server_jobs == 1
    assert all(parse_pdu(octets).rosctr == 1 for octets in wires[0].asked)
    assert "the server asked 1 time; it was not answered" in outcome.summary()
    assert any("added" in line for line in texts(outcome))


def test_nothing_is_sent_when_the_setup_is_refused(tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.confirm()
        wire.say(messages.pdu(2, parse_pdu(wire.pdu()).pdu_ref, b"", error=0x8104))

    with serving(script) as (address, wires):
        outcome = play(reads(tmp_path / "a.pcapng", 2), address)
    assert len(wires[0].asked) == 1
    assert outcome.problems == ["connection 1: the Setup communication was not granted"]
    assert [one.transaction for one in outcome.not_sent] == [2, 3]


def test_nothing_is_sent_when_the_connect_request_is_refused(tmp_path: Path) -> None:
    def script(wire: Wire) -> None:
        wire.tpkt()
        wire.socket.sendall(messages.disconnect(1))

    with serving(script) as (address, wires):
        outcome = play(mixed(tmp_path / "a.pcapng"), address)
    assert wires[0].asked == []
    assert outcome.problems == ["connection 1: the connect request was refused"]
    assert [one.transaction for one in outcome.not_sent] == [1, 2, 5]
    assert [one.transaction for one in outcome.withheld] == [3, 4]


def test_a_server_that_nobody_reaches_is_told_after_the_attempts(tmp_path: Path) -> None:
    address = Address("127.0.0.1", free_port())
    outcome = play(mixed(tmp_path / "a.pcapng"), address, settings=Settings(retries=1))
    assert (outcome.connections, outcome.unreachable, outcome.requests) == (0, 1, 0)
    assert "Connection refused" in outcome.problems[0]
    assert [one.transaction for one in outcome.withheld] == [3, 4]


def test_where_no_setup_was_recorded_one_of_our_own_is_sent() -> None:
    path = CAPTURES / "mid-stream.pcapng"
    with Server(path) as server:
        outcome = play(path, server)
        first = parse_pdu(server.requests[0].octets)
    assert first.parameters.setup is not None
    assert first.parameters.setup.pdu_length == USUAL_SETUP.pdu_length
    assert texts(outcome) == []
    assert outcome.requests == 1 + len([each for each in load_recorded(path).links[0].transactions if each.request])


def test_a_flood_does_not_keep_a_replay_from_ending(tmp_path: Path) -> None:
    push = dt(messages.userdata(0, 0, 4, 5, bytes(40))) * 200

    def script(wire: Wire) -> None:
        wire.set_up()
        wire.socket.settimeout(0.05)
        while True:
            try:
                wire.socket.sendall(push)
            except TimeoutError:
                return

    with serving(script) as (address, _):
        outcome = play(reads(tmp_path / "a.pcapng", 1), address, settings=SOON)
    assert outcome.requests == 2
