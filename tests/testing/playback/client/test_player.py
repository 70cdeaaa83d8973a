"""One connection played: what follows what, what is not waited for, and when a server is given up."""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from dissect.online.net.addresses import Address
from dissect.protocols.s7.message import parse_pdu
from dissect.testing.playback.client import Settings, load_recorded
from dissect.testing.playback.client.plan import USUAL_SETUP
from dissect.testing.playback.server.service import Server
from tests.meaning.report.support import WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import captured
from tests.testing.playback.client.support import ALL, CAPTURES, free_port, mixed, play, texts

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
        for _ in range(3):
            octets = wire.pdu()
            wire.socket.settimeout(0.05)
            with pytest.raises(TimeoutError):
                open_at_once.append(len(wire.pdu()))
            wire.socket.settimeout(20)
            answer(wire, octets)

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
    assert "the server sent 1 time; it was not answered" in outcome.summary()
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
                wire.socket.settimeout(20)
                return

    with serving(script) as (address, _):
        outcome = play(reads(tmp_path / "a.pcapng", 1), address, settings=SOON)
    assert outcome.requests == 2


# ---- what was not answered when it was recorded ---------------------------------------------------------------------


def unanswered(path: Path, count: int, *, lost: bool = False, after: bool = True) -> Path:
    """Write a capture in which reads 1 to ``count`` get no answer (``lost``: the capture misses it), then one does."""
    talk = begun()
    for ref in range(1, count + 1):
        talk.send(0, dt(messages.read_job(ref, [WORD])))
        if lost:
            talk.skip(1, len(dt(messages.read_answer(ref, [WORD], [b"\0\0"]))))
            talk.ack(0)
    if after:
        read(talk, count + 1)
    return saved(path, talk.close(0).close(1).packets())


def quiet(wire: Wire, count: int) -> None:
    """Answer the setup, no read up to ``count``, and the one after."""
    wire.set_up()
    for _ in range(count):
        wire.pdu()
    answer(wire, wire.pdu())


@pytest.mark.parametrize("lost", [False, True])
def test_requests_that_were_not_answered_then_do_not_count_as_not_answered_now(lost: bool, tmp_path: Path) -> None:
    path = unanswered(tmp_path / "a.pcapng", 9, lost=lost)
    assert len({each.outcome for each in load_recorded(path).links[0].transactions}) == 2
    with serving(lambda wire: quiet(wire, 9)) as (address, _):
        outcome = play(path, address, settings=Settings(lost_s=0.01, timeout_s=20))
    assert texts(outcome) == []
    assert (outcome.problems, outcome.requests, outcome.answered) == ([], 11, 2)


def test_an_answer_that_comes_late_is_that_of_its_request_and_of_no_other(tmp_path: Path) -> None:
    """Each answer comes only after the next request."""
    path = reads(tmp_path / "a.pcapng", 3)

    def script(wire: Wire) -> None:
        wire.set_up()
        before = wire.pdu()
        for number in (2, 3):
            octets = wire.pdu()
            answer(wire, before, bytes((0, number - 1)))
            before = octets
        answer(wire, before, b"\0\3")

    with serving(script) as (address, _):
        outcome = play(path, address, settings=Settings(timeout_s=0.4))
    assert [line.rpartition("is ")[2] for line in texts(outcome)] == ["1", "2", "3"]
    assert (outcome.problems, outcome.answered) == ([], 4)


def test_an_answer_that_the_recording_lost_is_waited_for_and_not_compared(tmp_path: Path) -> None:
    path = unanswered(tmp_path / "a.pcapng", 4, lost=True)

    def script(wire: Wire) -> None:
        wire.set_up()
        for number in range(5):
            octets = wire.pdu()
            wire.socket.settimeout(0.03)
            with pytest.raises(TimeoutError):
                wire.pdu()
            wire.socket.settimeout(20)
            answer(wire, octets, bytes((4, 0xD2)) if number == 4 else bytes((7, number)))

    with serving(script) as (address, _):
        outcome = play(path, address, settings=Settings(lost_s=20, timeout_s=20))
    assert texts(outcome) == []
    assert (outcome.answered, outcome.problems) == (6, [])


def test_one_that_the_server_did_not_answer_is_compared_when_it_answers_now(tmp_path: Path) -> None:
    path = unanswered(tmp_path / "a.pcapng", 1)

    def script(wire: Wire) -> None:
        wire.set_up()
        answer(wire, wire.pdu())
        answer(wire, wire.pdu())

    with serving(script) as (address, _):
        outcome = play(path, address)
    assert [each.transaction for each in outcome.differences()] == [2]
    assert outcome.answered == 3


def test_where_nothing_of_the_server_was_recorded_everything_is_asked_and_nothing_compared(tmp_path: Path) -> None:
    talk = begun()
    for ref in range(1, 8):
        read(talk, ref)
    one_side = [segment for segment in talk.close(0).segments if segment.side == 0]
    path = saved(tmp_path / "a.pcapng", captured(one_side))
    (link,) = load_recorded(path).links
    assert {each.outcome for each in link.transactions} == {"unanswered"}

    def script(wire: Wire) -> None:
        wire.set_up()
        for _ in range(7):
            answer(wire, wire.pdu())

    with serving(script) as (address, _):
        outcome = play(path, address)
    assert texts(outcome) == []
    assert (outcome.answered, outcome.not_sent) == (8, [])
    with serving(lambda wire: wire.confirm()) as (address, wires):
        outcome = play(path, address, settings=Settings(lost_s=0.01))
    assert texts(outcome) == []
    assert (len(wires[0].asked), outcome.answered, outcome.problems) == (8, 0, [])
