"""Connections that were open together are played together: what was answered before something is answered before it."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import pytest

from dissect.online.net.addresses import Address, Place
from dissect.protocols.s7.message import parse_pdu
from dissect.testing.golden import golden_text, read_session
from dissect.testing.golden.model import Link, Session, Span
from dissect.testing.playback.client import ReplayError, Settings, expect_few, load_recorded, make_plan
from dissect.testing.playback.client.channel import connect
from dissect.testing.playback.client.plan import Part
from dissect.testing.playback.client.player import HALF_LOADED, NOT_LOADED
from dissect.testing.playback.client.schedule import CONNECT, MAX_OPEN, Clock, moments, open_at_once
from dissect.testing.playback.client.watch import Watch
from dissect.testing.playback.server.service import Server
from tests.meaning.report.support import WORD, begun, read, saved
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.properties.packets import Flow, Segment, captured
from tests.testing.playback.client.support import ALL, CAPTURES, play, texts
from tests.testing.playback.client.test_download import BEGIN, ENDED, INSERT, job
from tests.testing.playback.client.test_player import Wire, answer

EPOCH = 1_700_000_000_000_000_000
MS = 1_000_000
SOON = Settings(timeout_s=0.1)


def item(number: int) -> Item:
    return Item(0x04, 1, number, 0x84, 0)


class Woven:
    """Connections A and B, written down together: each call takes what a talk has more than before."""

    def __init__(self, amq: int = 1) -> None:
        self.talks = [begun(Flow(ports=(port, 102)), amq) for port in (40_002, 40_001)]
        self.segments: list[Segment] = []
        self._taken = [0, 0]
        self.take(0)
        self.take(1)

    def take(self, which: int) -> None:
        new = self.talks[which].segments[self._taken[which] :]
        self._taken[which] += len(new)
        self.segments += new

    def read(self, which: int, number: int) -> None:
        read(self.talks[which], number, item(number))
        self.take(which)

    def ask(self, which: int, number: int) -> None:
        self.talks[which].send(0, dt(messages.read_job(number, [item(number)])))
        self.take(which)

    def tell(self, which: int, number: int) -> None:
        self.talks[which].send(1, dt(messages.read_answer(number, [item(number)], [b"\x04\xd2"])))
        self.take(which)

    def close(self, which: int) -> None:
        self.talks[which].close(0)
        self.take(which)

    def saved(self, path: Path, step_ns: int = MS) -> Path:
        return saved(path, captured(self.segments, EPOCH, step_ns))


def two(path: Path) -> Path:
    """A and B are set up; then A reads 1, B reads 2, A 3, B 4 and ends, A reads 5 and ends."""
    woven = Woven()
    for which, number in ((0, 1), (1, 2), (0, 3), (1, 4)):
        woven.read(which, number)
    woven.close(1)
    woven.read(0, 5)
    woven.close(0)
    return woven.saved(path)


def arrived(server: Server) -> list[tuple[int, int]]:
    """Return connection and DB number of the reads that came, in their order."""
    reads = [(request.connection, parse_pdu(request.octets)) for request in server.requests]
    return [(number, pdu.parameters.items[0].db) for number, pdu in reads if pdu.function == 0x04]


# ---- the order ------------------------------------------------------------------------------------------------------


def test_moments_are_in_the_order_of_the_recording_or_one_connection_after_another(tmp_path: Path) -> None:
    parts = make_plan(load_recorded(two(tmp_path / "a.pcapng")))
    together = [(moment.part, moment.at) for moment in moments(parts, False)]
    begins = [(0, CONNECT), (0, 0), (1, CONNECT), (1, 0)]
    assert together == [*begins, (0, 1), (1, 1), (0, 2), (1, 2), (1, 3), (0, 3), (0, 4)]
    assert [(moment.part, moment.at) for moment in moments(parts, True)] == [
        *[(0, at) for at in range(-1, 5)],
        *[(1, at) for at in range(-1, 4)],
    ]
    times = [moment.time_ns or 0 for moment in moments(parts, False)]
    assert times == sorted(times)


def test_what_was_open_together_is_played_together(tmp_path: Path) -> None:
    path = two(tmp_path / "a.pcapng")
    with Server(path) as server:
        outcome = play(path, server)
        assert arrived(server) == [(1, 1), (2, 2), (1, 3), (2, 4), (1, 5)]
    assert texts(outcome) == []
    assert outcome.connections == 2
    with Server(path) as server:
        outcome = play(path, server, settings=Settings(one_by_one=True))
        assert arrived(server) == [(1, 1), (1, 3), (1, 5), (2, 2), (2, 4)]
    assert texts(outcome) == []


def test_of_a_golden_nobody_knows_what_was_open_together(tmp_path: Path) -> None:
    path = two(tmp_path / "a.pcapng")
    golden = tmp_path / "a.s7.txt"
    golden.write_text(golden_text(read_session(path)), "utf-8")
    with Server(path) as server:
        outcome = play(golden, server)
        assert [number for number, _ in arrived(server)] in ([1, 1, 1, 2, 2], [1, 1, 2, 2, 2])
    assert texts(outcome) == []


def test_one_of_them_is_played_alone(tmp_path: Path) -> None:
    path = two(tmp_path / "a.pcapng")
    number = next(link.number for link in load_recorded(path).links if len(link.transactions) == 3)
    with Server(path) as server:
        outcome = play(path, server, numbers=[number])
        assert arrived(server) == [(1, 2), (1, 4)]
    assert texts(outcome) == []


@pytest.mark.parametrize("name", ["two-clients", "many-open", "crafted/vlan", "crafted/link-types"])
@pytest.mark.parametrize("pipelined", [False, True])
def test_recorded_connections_are_played_together_as_well(name: str, pipelined: bool) -> None:
    path = CAPTURES / f"{name}.pcapng"
    plan = make_plan(load_recorded(path))
    with Server(path) as server:
        outcome = play(path, server, settings=Settings(pipelined=pipelined))
    assert texts(outcome) == []
    assert outcome.problems == []
    assert outcome.connections == len(plan)


# ---- two at once, on a server that is told what to say -------------------------------------------------------------


@contextmanager
def serving(*scripts: Callable[[Wire], None]) -> Iterator[Address]:
    """Let each script be the server of one connection, in the order in which they come."""
    failures: list[BaseException] = []

    def work(one: socket.socket, script: Callable[[Wire], None]) -> None:
        one.settimeout(20)
        with one:
            try:
                wire = Wire(one)
                script(wire)
                while wire.pdu():
                    pass
            except ConnectionError:
                pass
            except BaseException as error:  # noqa: BLE001 - told by the thread that waits
                failures.append(error)

    def accept(listener: socket.socket) -> None:
        for script in scripts:
            one, _ = listener.accept()
            threads.append(threading.Thread(target=work, args=(one, script), daemon=True))
            threads[-1].start()

    with socket.create_server(("127.0.0.1", 0)) as listener:
        threads = [threading.Thread(target=accept, args=(listener,), daemon=True)]
        threads[0].start()
        yield Address("127.0.0.1", int(listener.getsockname()[1]))
        for thread in threads:
            thread.join(20)
    if failures:
        raise failures[0]


def test_nothing_is_asked_before_what_was_answered_before_it(tmp_path: Path) -> None:
    """A is asked, B is asked, A answers, and B is asked once more: B's second request waits for A's answer."""
    woven = Woven(amq=3)
    woven.ask(0, 1)
    woven.ask(1, 2)
    woven.tell(0, 1)
    woven.ask(1, 3)
    woven.tell(1, 2)
    woven.tell(1, 3)
    woven.close(1)
    woven.close(0)
    path = woven.saved(tmp_path / "a.pcapng")
    both_open = threading.Event()
    answered = threading.Event()

    def script_a(wire: Wire) -> None:
        wire.set_up(amq=3)
        octets = wire.pdu()
        assert both_open.wait(20)
        answered.set()
        answer(wire, octets)

    def script_b(wire: Wire) -> None:
        wire.set_up(amq=3)
        first = wire.pdu()
        wire.socket.settimeout(0.05)
        with pytest.raises(TimeoutError):
            wire.pdu()
        assert not answered.is_set()
        wire.socket.settimeout(20)
        both_open.set()
        second = wire.pdu()
        assert answered.is_set()
        answer(wire, second)
        answer(wire, first)

    with serving(script_a, script_b) as address:
        outcome = play(path, address, settings=Settings(pipelined=True, timeout_s=20))
    assert texts(outcome) == []
    assert outcome.answered == 5


def test_without_pipelining_one_request_is_open_at_a_time_on_all_of_them(tmp_path: Path) -> None:
    woven = Woven()
    woven.ask(0, 1)
    woven.ask(1, 2)
    woven.tell(1, 2)
    woven.tell(0, 1)
    woven.close(0)
    woven.close(1)
    path = woven.saved(tmp_path / "a.pcapng")
    answered = threading.Event()

    def script_a(wire: Wire) -> None:
        wire.set_up()
        octets = wire.pdu()
        time.sleep(0.02)
        answered.set()
        answer(wire, octets)

    def script_b(wire: Wire) -> None:
        wire.set_up()
        octets = wire.pdu()
        assert answered.is_set()
        answer(wire, octets)

    with serving(script_a, script_b) as address:
        assert texts(play(path, address, settings=Settings(timeout_s=20))) == []


def test_a_connection_that_breaks_does_not_stop_the_others(tmp_path: Path) -> None:
    def broken(wire: Wire) -> None:
        wire.set_up()
        answer(wire, wire.pdu())
        raise ConnectionError

    def good(wire: Wire) -> None:
        wire.set_up()
        for _ in range(2):
            answer(wire, wire.pdu())

    path = two(tmp_path / "a.pcapng")
    numbers = [link.number for link in load_recorded(path).as_begun]
    with serving(broken, good) as address:
        outcome = play(path, address)
    assert len(outcome.problems) == 1
    assert outcome.problems[0].startswith(f"connection {numbers[0]}: ")
    assert {one.connection for one in outcome.not_sent} <= {numbers[0]}
    (other,) = [link for link in outcome.came.links if len(link.transactions) == 3 and link.ended_by == "client"]
    assert {each.outcome for each in other.transactions} == {"answered"}
    assert not [each for each in outcome.differences() if each.connection == numbers[1]]


def test_one_that_never_answers_does_not_stop_the_others(tmp_path: Path) -> None:
    woven = Woven()
    for number in range(1, 7):
        woven.read(0, number)
        woven.read(1, number + 10)
    woven.close(0)
    woven.close(1)

    def good(wire: Wire) -> None:
        wire.set_up()
        for _ in range(6):
            answer(wire, wire.pdu())

    with serving(lambda wire: wire.set_up(), good) as address:
        outcome = play(woven.saved(tmp_path / "a.pcapng"), address, settings=SOON)
    assert len(outcome.problems) == 1
    assert "3 requests in a row were not answered in time" in outcome.problems[0]
    assert len(outcome.not_sent) == 3
    assert outcome.answered == 8


def test_nothing_is_controlled_on_another_connection_after_a_download_that_went_wrong(tmp_path: Path) -> None:
    """A loads a block that the PLC now refuses; B was to link it in and to start the PLC, and reads."""
    loads, other = begun(Flow(ports=(40_002, 102))), begun(Flow(ports=(40_001, 102)))
    loads.send(0, dt(job(1, BEGIN))).send(1, dt(messages.pdu(messages.ACK_DATA, 1, b"\x1a")))
    loads.send(1, dt(job(0x300, ENDED))).send(0, dt(messages.pdu(messages.ACK_DATA, 0x300, b"\x1c")))
    other.send(0, dt(job(1, INSERT))).send(1, dt(messages.pdu(messages.ACK_DATA, 1, b"\x28")))
    segments = loads.segments[:] + read(other, 2).close(0).segments + loads.close(0).segments[-3:]
    path = saved(tmp_path / "a.pcapng", captured(segments, EPOCH, MS))
    asked: list[int] = []

    def refuses(wire: Wire) -> None:
        wire.set_up()
        wire.say(messages.pdu(messages.ACK, parse_pdu(wire.pdu()).pdu_ref, b"", error=0xD241))

    def reads(wire: Wire) -> None:
        wire.set_up()
        octets = wire.pdu()
        asked.append(parse_pdu(octets).function)
        answer(wire, octets)

    with serving(refuses, reads) as address:
        outcome = play(path, address, ALL)
    assert asked == [0x04]
    assert [one.reason for one in outcome.withheld] == [HALF_LOADED]
    assert len(outcome.problems) == 1
    assert NOT_LOADED in outcome.problems[0]


def test_what_comes_on_one_while_another_is_waited_for_is_recorded_when_it_came(tmp_path: Path) -> None:
    """B answers at once, while A is waited for: B's answer time is not A's."""
    woven = Woven()
    woven.ask(0, 1)
    woven.ask(1, 2)
    woven.tell(0, 1)
    woven.tell(1, 2)
    woven.close(0)
    woven.close(1)

    def slow(wire: Wire) -> None:
        wire.set_up()
        octets = wire.pdu()
        assert told.wait(20)
        time.sleep(0.1)
        answer(wire, octets)

    def quick(wire: Wire) -> None:
        wire.set_up()
        answer(wire, wire.pdu())
        told.set()

    told = threading.Event()
    with serving(slow, quick) as address:
        outcome = play(woven.saved(tmp_path / "a.pcapng"), address, settings=Settings(pipelined=True, timeout_s=20))
    assert texts(outcome) == []
    ends = [each for link in outcome.came.links for each in link.transactions if each.function == 0x04]
    late = {(each.time_ns or 0) + (each.latency_ns or 0) for each in ends}
    assert max(late) - min(late) >= 50 * MS


# ---- how many -------------------------------------------------------------------------------------------------------


def plan_of(spans: list[Span]) -> list[Part]:
    """Return a plan of connections that were refused, so that there is nothing to ask."""
    session = Session("a.pcapng")
    for number, span in enumerate(spans, 1):
        link = Link()
        link.span = span
        link.number, link.called, link.refused, link.protocol = number, b"\x01\x02", "by the server", "S7comm"
        session.links.append(link)
    return make_plan(session)


def test_ten_thousand_connections_one_after_another_are_one_at_a_time() -> None:
    plan = plan_of([Span(number, 10 * number, 0, 10 * number + 9, 0) for number in range(10_000)])
    assert open_at_once(plan) == 1
    expect_few(plan)


def test_more_than_there_may_be_sockets_are_refused_before_anything_is_sent(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    plan = plan_of([Span(number, number + 1, 0, 10_000, 0) for number in range(3000)])
    assert open_at_once(plan) == 3000
    with pytest.raises(ReplayError, match=f"3000 connections were open at once .* at most {MAX_OPEN} .* --one-by-one"):
        expect_few(plan)
    expect_few(plan[:MAX_OPEN])
    monkeypatch.setattr("dissect.testing.playback.client.schedule.MAX_OPEN", 1)
    path = two(tmp_path / "a.pcapng")
    with Server(path) as server:
        with pytest.raises(ReplayError, match="2 connections were open at once"):
            play(path, server)
        assert server.connections == 0
        assert texts(play(path, server, settings=Settings(one_by_one=True))) == []


def test_connections_without_times_are_one_at_a_time() -> None:
    plan = plan_of([Span(1, 1, 0, 9, 0), Span(2, 2, 0, 8, 0)])
    assert open_at_once(plan) == 2
    plan[0].span = None
    assert open_at_once(plan) == 1
    assert open_at_once([]) == 0


def test_sockets_are_given_back_when_a_connection_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    segments: list[Segment] = []
    for port in range(40_000, 40_030):
        segments += read(begun(Flow(ports=(port, 102))), 1).close(0).segments
    path = saved(tmp_path / "a.pcapng", captured(segments, EPOCH, MS))
    sockets: list[socket.socket] = []
    most = 0

    def counted(places: Sequence[Place], timeout_s: float) -> socket.socket:
        nonlocal most
        sockets.append(connect(places, timeout_s))
        most = max(most, sum([one.fileno() >= 0 for one in sockets]))
        return sockets[-1]

    monkeypatch.setattr("dissect.testing.playback.client.player.connect", counted)
    with Server(path) as server:
        assert texts(play(path, server)) == []
    assert (len(sockets), most) == (30, 1)


# ---- the clock ------------------------------------------------------------------------------------------------------


def test_turns_are_those_of_the_recording() -> None:
    clock = Clock(0.5)
    first = clock.turn(EPOCH)
    assert clock.turn(EPOCH + 2_000_000_000) == pytest.approx(first + 1, abs=1e-6)
    assert clock.turn(EPOCH - 2_000_000_000) < first
    assert clock.turn(None) == 0
    assert Clock(None).turn(EPOCH) == 0


def test_pauses_between_connections_are_kept_unless_they_are_played_one_by_one(tmp_path: Path) -> None:
    woven = Woven()
    woven.read(0, 1)
    woven.close(0)
    woven.read(1, 2)
    woven.close(1)
    path = woven.saved(tmp_path / "a.pcapng", 10 * MS)
    with Server(path) as server:
        began = time.monotonic_ns()
        outcome = play(path, server, settings=Settings(pace=1))
        spent = time.monotonic_ns() - began
    assert texts(outcome) == []
    assert spent >= 10 * MS * (len(woven.segments) - 3)


def test_a_connection_that_is_over_is_not_paused_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It was recorded over hours; the server ends it at once."""
    talk = begun()
    for number in range(1, 5):
        read(talk, number, WORD)
    path = saved(tmp_path / "a.pcapng", talk.close(0).packets(EPOCH, 1000_000 * MS))
    recorded = load_recorded(path)
    first = recorded.as_begun[0]
    assert first.span is not None
    first.transactions[0].time_ns = first.span.first_ns

    def sleep(_: Watch, until: float, stops: Callable[[], bool]) -> None:
        assert stops() or until < time.monotonic() + 60

    def gone(wire: Wire) -> None:
        wire.confirm()
        raise ConnectionError

    monkeypatch.setattr(Watch, "sleep", sleep)
    with serving(gone) as address:
        outcome = play(recorded, address, settings=Settings(pace=1))
    assert len(outcome.not_sent) >= 4
