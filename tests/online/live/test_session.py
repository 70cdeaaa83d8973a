"""A run in a thread: what happens is handed over at once, never more than fits, and whatever goes wrong is told."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from dissect.engine.pipeline import Options
from dissect.engine.transactions.transaction import Transaction
from dissect.online.live.events import CLOSED, FINDING, OPENED, OPERATION, PROBLEM, TRANSACTION, Event
from dissect.online.live.run import Companion, Limits
from dissect.online.live.session import Session
from dissect.packets.source.files import open_capture
from dissect.packets.source.live.reader import Drops
from dissect.packets.source.packet import CaptureError, PacketSink, Reader
from tests.meaning.report.support import begun, read, saved
from tests.online.live.support import Clock, Line, never, taken
from tests.properties.packets import Packet


def packets(count: int = 2) -> list[Packet]:
    talk = begun()
    for ref in range(1, count + 1):
        read(talk, ref, content=0x0A if ref == 2 else b"\x04\xd2")
    return talk.close().packets()


def to_the_end(session: Session) -> list[Event]:
    return taken(session, never)


def test_everything_is_handed_over_in_order() -> None:
    session = Session(lambda: Line(Clock(), [packets()], ends=True), Options(strict=True), name="fake0")
    session.start()
    events = to_the_end(session)
    assert [event.kind for event in events] == [
        OPENED,
        TRANSACTION,
        OPERATION,
        TRANSACTION,
        TRANSACTION,
        FINDING,
        CLOSED,
    ]
    times = [event.time_ns for event in events]
    assert times == sorted(times)
    assert not session.running
    assert session.waiting == 0
    assert (session.error, session.lost, session.engine) == (None, {}, "fake")
    assert session.run.ended


def test_how_it_stands() -> None:
    line = Line(Clock(), [packets()], ends=True)
    line.lost = Drops(3, None)
    session = Session(lambda: line, Options(strict=True))
    session.start()
    to_the_end(session)
    status = session.status()
    assert (status.packets, status.octets) == (len(packets()), line.octets)
    assert (status.connections, status.connections_open, status.open_requests) == (1, 0, 0)
    assert (status.transactions, status.unanswered, status.with_errors, status.findings) == (3, 0, 1, 1)
    assert (status.drops, status.waiting_events, status.lost_events) == (Drops(3, None), 0, 0)
    assert status.now_ns >= packets()[-1].time_ns


def test_what_does_not_fit_is_counted_transactions_first() -> None:
    count = 500
    session = Session(lambda: Line(Clock(), [packets(count)], ends=True), Options(strict=True), max_events=10)
    session.start()
    while session.running:
        time.sleep(0.01)
    assert session.waiting <= 10 + 3
    events = to_the_end(session)
    kinds = [event.kind for event in events]
    assert kinds.count(TRANSACTION) + session.lost[TRANSACTION] == count + 1
    assert session.lost.keys() == {TRANSACTION}
    assert kinds[-1] == CLOSED
    assert session.status().lost_events == session.lost[TRANSACTION]


def test_a_file_waits_for_whoever_takes_its_events(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.pcapng", packets(500))
    session = Session(lambda: open_capture(str(path)), max_events=10)
    session.start()
    events = taken(session, never)
    assert [event.kind for event in events].count(TRANSACTION) == 501
    assert session.lost == {}


def test_a_file_that_waits_can_be_stopped(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.pcapng", packets(500))
    session = Session(lambda: open_capture(str(path)), max_events=10)
    session.start()
    while session.waiting < 10:
        time.sleep(0.01)
    assert session.running
    session.close()
    assert not session.running


def test_a_poll_takes_no_more_than_asked() -> None:
    session = Session(lambda: Line(Clock(), [packets()], ends=True), Options(strict=True))
    session.start()
    first = session.poll(20, 2)
    assert [event.kind for event in first] == [OPENED, TRANSACTION]
    assert len(to_the_end(session)) == 5


def test_it_is_stopped_from_outside() -> None:
    line = Line(Clock(), [packets()])
    session = Session(lambda: line)
    session.start()
    taken(session, lambda events: any(event.kind == FINDING for event in events))
    assert session.running
    session.close()
    assert not session.running
    assert (line.stopped, line.closed) == (1, 1)
    session.close()
    session.stop()


def test_it_may_be_stopped_before_it_has_begun() -> None:
    session = Session(lambda: Line(Clock(), [packets()]))
    session.stop()
    session.start()
    to_the_end(session)
    assert not session.running


def test_what_the_source_notes_is_told_when_it_does() -> None:
    """An interface that is down captures nothing: a silent line must not be all that is seen of it."""
    line = Line(Clock(), [packets()])
    session = Session(lambda: line, kinds=[])
    session.start()
    for note in ("eth0 went down", "eth0 went down"):
        line.notes = [*line.notes, note]
        (event,) = taken(session, bool)
        assert (event.kind, event.what) == (PROBLEM, note)
    session.close()
    assert session.waiting == 0


def test_a_source_that_cannot_be_opened_is_told_at_once() -> None:
    def refuse() -> Reader:
        raise CaptureError("no permission")

    session = Session(refuse)
    with pytest.raises(CaptureError, match="no permission"):
        session.start()
    assert not session.running
    session.close()
    with pytest.raises(RuntimeError, match="not started"):
        session.run  # noqa: B018 - what is asked for is the error


def test_what_goes_wrong_in_the_thread_is_kept() -> None:
    class Broken(Line):
        def step(self, sink: PacketSink) -> bool:
            if not self.batches:
                raise CaptureError("not a capture file")
            return super().step(sink)

    line = Broken(Clock(), [packets()])
    session = Session(lambda: line)
    session.start()
    kinds = [event.kind for event in to_the_end(session)]
    assert str(session.error) == "not a capture file"
    assert kinds[-1] == CLOSED  # what was known is told
    assert line.closed == 1


def test_a_companion_that_fails_is_an_event() -> None:
    class Failing(Companion):
        name = "evidence"

        def transaction(self, transaction: Transaction) -> None:
            raise OSError(28, "No space left on device")

    session = Session(lambda: Line(Clock(), [packets()], ends=True), companions=[Failing()])
    session.start()
    problems = [event.what for event in to_the_end(session) if event.kind == PROBLEM]
    assert problems == ["evidence failed and was switched off: No space left on device"]


def test_limits_are_handed_on(tmp_path: Path) -> None:
    path = saved(tmp_path / "a.pcapng", packets(20))
    session = Session(lambda: open_capture(str(path)), limits=Limits(packets=9), name="a")
    session.start()
    to_the_end(session)
    assert session.status().packets == 9
    assert session.engine == "file"


def test_what_nobody_wants_is_counted_and_not_made() -> None:
    session = Session(lambda: Line(Clock(), [packets()], ends=True), Options(strict=True), kinds=(FINDING, PROBLEM))
    session.start()
    assert [event.kind for event in to_the_end(session)] == [FINDING]
    status = session.status()
    assert (status.connections, status.connections_open, status.transactions, status.lost_events) == (1, 0, 3, 0)
