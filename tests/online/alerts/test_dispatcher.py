"""Queues are bounded, what is lost is counted and told, and a slow receiver holds up nothing but itself."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from dissect.online.alerts import Alert, AlertEngine, Dispatcher, spool
from dissect.online.alerts.actions import Action, DeliveryError, Posting
from dissect.online.alerts.dispatcher import SpoolLane
from dissect.online.alerts.loading import parse_rules
from dissect.online.alerts.spool import Spool
from dissect.wire.config.saving import save
from tests.online.alerts.rules_of import alert
from tests.output.baseline.wire import Client, Wire

WAIT = 20.0


class Held(Action):
    """Delivers one at a time when it is let."""

    def __init__(self, name: str = "held", parallel: int = 1) -> None:
        super().__init__(name, parallel)
        self.began = threading.Semaphore(0)
        self.go = threading.Semaphore(0)
        self.done: list[str] = []
        self.closed = False

    def deliver(self, one: Alert) -> None:
        self.began.release()
        if not self.go.acquire(timeout=WAIT) or self.closed:
            raise DeliveryError("broken off")
        self.done.append(one.text)

    def close(self) -> None:
        self.closed = True
        self.go.release(100)


class Failing(Action):
    def deliver(self, one: Alert) -> None:
        if one.text == "bug":
            raise ZeroDivisionError("of ours")
        raise DeliveryError("nobody \x1b there")


class Posted(Posting):
    """Keeps what is posted."""

    def __init__(self, name: str, parallel: int, spool: Path) -> None:
        super().__init__(name, parallel, spool)
        self.contents: list[bytes] = []

    def post(self, content: bytes) -> None:
        self.contents.append(content)


def test_a_slow_action_holds_up_no_other() -> None:
    held = Held()
    lines: list[str] = []
    dispatcher = Dispatcher({"held": held}, write=lines.append)
    for number in range(3):
        dispatcher.submit(alert(f"{number}", actions=("held", "stderr")))
    assert held.began.acquire(timeout=WAIT)
    held.go.release(3)
    dispatcher.close(WAIT)
    assert held.done == ["0", "1", "2"]
    assert [line.rsplit(" ", 1)[1] for line in lines] == ["0", "1", "2"]
    assert {name: counts.as_dict() for name, counts in dispatcher.counts.items()} == {
        "held": {"delivered": 3, "failed": 0, "dropped": 0},
        "stderr": {"delivered": 3, "failed": 0, "dropped": 0},
    }


def test_a_full_queue_drops_counts_and_tells() -> None:
    held = Held()
    told: list[str] = []
    now = 0.0
    dispatcher = Dispatcher({"held": held}, tell=told.append, most=2, clock=lambda: now)
    dispatcher.submit(alert("first", actions=("held",)))
    assert held.began.acquire(timeout=WAIT)
    for number in range(7):
        dispatcher.submit(alert(f"{number}", actions=("held",)))
    assert told == ["alerts: action held: 2 alerts are already waiting, dropped: warning rule: 0"]
    now = 61.0
    dispatcher.submit(alert("late", actions=("held",)))
    assert told[1:] == [
        "alerts: action held: 2 alerts are already waiting, dropped: warning rule: 5 (and 4 more times since the last report)"
    ]
    held.go.release(3)
    dispatcher.close(WAIT)
    assert held.done == ["first", "6", "late"]
    assert dispatcher.counts["held"].dropped == 6
    assert told[2:] == ["alerts: action held: 0 failed, 6 dropped, 3 delivered"]
    dispatcher.close()
    assert len(told) == 3


def test_the_heaviest_come_first_and_the_oldest_of_the_lightest_go() -> None:
    held = Held()
    told: list[str] = []
    dispatcher = Dispatcher({"held": held}, tell=told.append, most=4)
    dispatcher.submit(alert("first", actions=("held",)))
    assert held.began.acquire(timeout=WAIT)
    for number, severity in enumerate(("note", "warning", "note", "error", "warning", "error", "note")):
        dispatcher.submit(alert(f"{severity} {number}", actions=("held",), severity=severity))
    held.go.release(5)
    dispatcher.close(WAIT)
    assert held.done == ["first", "error 3", "error 5", "warning 1", "warning 4"]
    assert told[0] == "alerts: action held: 4 alerts are already waiting, dropped: note rule: note 0"
    assert dispatcher.counts["held"].dropped == 3


def test_so_many_at_a_time_and_no_more() -> None:
    held = Held(parallel=2)
    dispatcher = Dispatcher({"held": held})
    for number in range(5):
        dispatcher.submit(alert(f"{number}", actions=("held",)))
    assert held.began.acquire(timeout=WAIT)
    assert held.began.acquire(timeout=WAIT)
    assert not held.began.acquire(timeout=0.05)
    held.go.release(5)
    dispatcher.close(WAIT)
    assert sorted(held.done) == ["0", "1", "2", "3", "4"]


def test_what_does_not_end_is_broken_off() -> None:
    held = Held()
    told: list[str] = []
    dispatcher = Dispatcher({"held": held}, tell=told.append)
    for number in range(3):
        dispatcher.submit(alert(f"{number}", actions=("held",)))
    assert held.began.acquire(timeout=WAIT)
    dispatcher.close(0.05)
    assert held.done == []
    counts = dispatcher.counts["held"]
    assert (counts.failed, counts.dropped) == (1, 2)
    assert told[-1] == "alerts: action held: 1 failed, 2 dropped, 0 delivered"
    dispatcher.submit(alert("too late", actions=("held",)))
    assert counts.dropped == 3


def test_who_captures_does_not_wait_for_the_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writing, disk = threading.Semaphore(0), threading.Event()

    def slow(path: Path, content: bytes, mode: int) -> None:
        writing.release()
        assert disk.wait(WAIT)
        save(path, content, mode)

    monkeypatch.setattr(spool, "save", slow)
    posted = Posted("hook", 1, tmp_path)
    dispatcher = Dispatcher({"hook": posted}, tell=lambda _: None)
    dispatcher.submit(alert("0", actions=("hook",)))
    assert writing.acquire(timeout=WAIT)
    submitted = threading.Thread(target=lambda: dispatcher.submit(alert("1", actions=("hook",))), daemon=True)
    submitted.start()
    submitted.join(WAIT / 2)
    waits = submitted.is_alive()
    disk.set()
    dispatcher.close(WAIT)
    assert not waits
    assert len(posted.contents) == 2
    assert dispatcher.counts["hook"].as_dict() == {"delivered": 2, "failed": 0, "dropped": 0}
    assert not list(tmp_path.rglob("*.json"))


def test_failures_are_counted_and_told_now_and_then() -> None:
    told: list[str] = []
    with Dispatcher({"failing": Failing("failing")}, tell=told.append) as dispatcher:
        for _ in range(5):
            dispatcher.submit(alert(actions=("failing",)))
    assert told == [
        "alerts: action failing: nobody \\x1b there",
        "alerts: action failing: 5 failed, 0 dropped, 0 delivered",
    ]


def test_a_bug_does_not_end_the_thread() -> None:
    told: list[str] = []
    with Dispatcher({"failing": Failing("failing")}, tell=told.append) as dispatcher:
        dispatcher.submit(alert("bug", actions=("failing",)))
        dispatcher.submit(alert("bug", actions=("failing",)))
    assert told[0] == "alerts: action failing: ZeroDivisionError: of ours"
    assert dispatcher.counts["failing"].failed == 2


def test_who_hears_nothing_of_failures_does_not_stop_them() -> None:
    def deaf(line: str) -> None:
        raise OSError("closed")

    with Dispatcher({"failing": Failing("failing")}, write=deaf, tell=deaf) as dispatcher:
        dispatcher.submit(alert(actions=("failing", "stderr")))
    assert (dispatcher.counts["failing"].failed, dispatcher.counts["stderr"].failed) == (1, 1)


def test_from_the_wire_to_stderr(capsys: pytest.CaptureFixture[str]) -> None:
    rules = parse_rules('[[rule]]\nname = "writes"\nwhen = "finding"\nfinding = "security.write"\n')
    with Dispatcher(rules.actions) as dispatcher:
        engine = AlertEngine(rules, tell=dispatcher.submit)
        wire = Wire(engine)
        Client(wire).write(1.0)
        wire.finish()
        engine.finish()
    assert "ALERT warning  writes: " in capsys.readouterr().err


class Down(Posting):
    """A receiver that never answers."""

    def post(self, content: bytes) -> None:
        raise DeliveryError("nobody there")


def test_a_folder_that_could_not_be_used_at_the_start_is_used_again(tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.write_bytes(b"")  # a file is in the way
    now = [1000.0]
    told: list[str] = []
    dispatcher = Dispatcher({"hook": Down("hook", 1, folder)}, tell=told.append, clock=lambda: now[0])
    dispatcher.prepare()
    dispatcher.start()
    dispatcher.submit(alert("in memory", actions=("hook",)))
    soon(lambda: any("nobody there" in line for line in told))
    folder.unlink()
    dispatcher.submit(alert("too early", actions=("hook",)))
    soon(lambda: len(dispatcher_spool(dispatcher)) == 2)
    assert not list(tmp_path.rglob("*.json"))
    now[0] += 2
    dispatcher.submit(alert("on disk", actions=("hook",)))
    soon(lambda: len(list(tmp_path.rglob("*.json"))) == 1)
    dispatcher.close(0.0)
    assert any("memory only" in line or "are lost" in line for line in told)
    assert any("alerts wait in" in line and line.endswith("again") for line in told)
    assert dispatcher.counts["hook"].dropped == 2  # those in memory
    later = Posted("hook", 1, folder)
    with Dispatcher({"hook": later}, tell=told.append) as next_run:
        next_run.start()
        soon(lambda: bool(later.contents))
    assert [b"on disk" in content for content in later.contents] == [True]


def soon(holds: Callable[[], bool]) -> None:
    """Wait until something holds; fails when it does not in good time."""
    end = time.monotonic() + WAIT
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.01)


def dispatcher_spool(dispatcher: Dispatcher) -> Spool:
    lane = dispatcher._lanes["hook"]
    assert isinstance(lane, SpoolLane)
    return lane.spool
