"""Several interfaces as one source: in the order of time, each packet with its own interface, losses of each."""

from __future__ import annotations

import time
from collections import deque
from itertools import count
from random import Random

import pytest

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.online.live.run import LiveRun
from dissect.packets.source.live.reader import Drops, LiveReader
from dissect.packets.source.live.several import HOLD_NS, MAX_HELD, SeveralReader
from dissect.packets.source.packet import PacketSink

SECOND = 1_000_000_000


class Fake(LiveReader):
    """Gives the packets of each step; None ends it."""

    def __init__(self, name: str, steps: list[list[int] | None], size: int = 60, wait_ms: int = 0) -> None:
        super().__init__(name, "ring", wait_ms)
        self.steps = deque(steps)
        self.size = size
        self.lost = Drops(0, 0)
        self.stopped = self.closed = False

    def step(self, sink: PacketSink) -> bool:
        times = self.steps.popleft() if self.steps else None
        if times is None:
            return False
        for time_ns in times:
            self.packets += 1
            self.octets += self.size
            sink.frame(time_ns, b"x" * self.size + b"more", 0, self.size, self.size, 1)
        return True

    @property
    def drops(self) -> Drops:
        return self.lost

    def stop(self) -> None:
        self.stopped = True

    def close(self) -> None:
        self.closed = True


class Sink(PacketSink):
    def __init__(self) -> None:
        self.got: list[tuple[int, str, int]] = []
        self.reader: SeveralReader | None = None

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        assert self.reader is not None
        self.got.append((time_ns, self.reader.interface, end - start))


def read(*readers: Fake, clock: list[int] | None = None) -> tuple[SeveralReader, Sink]:
    now = iter(clock or [])
    several = SeveralReader(readers, lambda: next(now, 0))
    sink = Sink()
    sink.reader = several
    while several.step(sink):
        pass
    return several, sink


def test_packets_come_by_time_whatever_pieces_they_come_in() -> None:
    dice = Random(41)
    for _ in range(50):
        steps: list[list[list[int] | None]] = [[], []]
        now = 0
        clock = []
        waiting: list[list[int]] = [[], []]
        expected: list[tuple[int, str]] = []
        for _ in range(40):
            now += 20_000_000
            clock.append(now)
            for which in (0, 1):
                times = sorted(dice.randrange(now - 20_000_000, now) for _ in range(dice.randrange(4)))
                expected += [(time, "ab"[which]) for time in times]
                waiting[which] += times
                piece, waiting[which] = (waiting[which], []) if dice.random() < 0.5 else ([], waiting[which])
                steps[which].append(piece)
        for which in (0, 1):
            steps[which].append(waiting[which])
        several, sink = read(Fake("a", steps[0]), Fake("b", steps[1]), clock=[*clock, now])
        assert sorted(expected) == sorted([(time, name) for time, name, _ in sink.got])
        late = sum([later < earlier for (earlier, *_), (later, *_) in zip(sink.got, sink.got[1:], strict=False)])
        assert late <= 1  # only what a piece held back for longer than HOLD_NS
        assert several.packets == len(expected)


def test_what_is_held_is_given_out_in_time_and_at_the_end() -> None:
    hold = HOLD_NS["ring"]
    one, two = Fake("a", [[100], []]), Fake("b", [[50], [], None])
    reader = SeveralReader([one, two], iter([0, 100 + hold, 0]).__next__)
    sink = Sink()
    sink.reader = reader
    assert reader.step(sink)
    assert sink.got == []
    assert reader.step(sink)
    assert [(time, name) for time, name, _ in sink.got] == [(50, "b"), (100, "a")]
    assert not reader.step(sink)
    reader.stop()
    reader.close()
    assert (one.stopped, two.stopped, one.closed, two.closed) == (True, True, True, True)
    assert (one.wait_ms, reader.names) == (0, ["a", "b"])


def test_what_is_held_has_a_bound() -> None:
    size = 1 << 20
    count = 2 * MAX_HELD // size
    several = SeveralReader([Fake("a", [list(range(count)), []], size), Fake("b", [[], []])], lambda: 0)
    sink = Sink()
    sink.reader = several
    several.step(sink)
    assert len(sink.got) >= count // 2
    assert several._size <= MAX_HELD


def test_what_is_held_when_it_is_closed_is_lost_and_counted() -> None:
    several = SeveralReader([Fake("a", [[1, 2, 3]]), Fake("b", [[4]])], lambda: 0)
    sink = Sink()
    sink.reader = several
    several.step(sink)
    assert (sink.got, several.drops) == ([], Drops(0, 0))
    several.close()
    several.close()
    assert several.drops == Drops(4, 0)
    assert several.drops_of == {"a": Drops(3, 0), "b": Drops(1, 0)}


def test_what_is_held_at_the_end_of_a_run_is_told() -> None:
    told = Told()
    run = LiveRun(SeveralReader([Fake("a", [[1, 2, 3]]), Fake("b", [[4]])], lambda: 0), told, clock=lambda: 0)
    run.step()
    run.finish()
    assert told.details == ["3 by the kernel on a (3 in all), 1 by the kernel on b (1 in all)"]
    assert (run.drops, run.problems.counts["drops"]) == (Drops(4, 0), 1)


def test_clocks_of_packets_keep_none_back() -> None:
    """Set back by an hour, or ahead of ours on one interface: everything is given out when it was held long enough."""
    hour, hold = 3600 * SECOND, HOLD_NS["ring"]
    before, after = [hour + one for one in range(4)], [[one] for one in range(10)]
    ahead = [[2 * hour + one] for one in range(10)]
    several = SeveralReader(
        [Fake("a", [before, *after]), Fake("b", [[], *ahead])], iter([at * hold // 2 for at in range(20)]).__next__
    )
    sink = Sink()
    sink.reader = several
    for step in range(11):
        several.step(sink)
        given = {time_ns for time_ns, *_ in sink.got}
        assert given >= set(before) or step < 2
        assert given >= {time_ns for times in (*after[: step - 2], *ahead[: step - 2]) for time_ns in times} or step < 3


def test_a_silent_interface_keeps_no_busy_one_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    """None of them waits by itself, and all rest only when none has anything."""
    rests: list[float] = []
    monkeypatch.setattr(time, "sleep", rests.append)
    monkeypatch.setattr(time, "monotonic", lambda: len(rests) * 0.02)
    busy, silent = Fake("a", [[one] for one in range(100)], wait_ms=50), Fake("b", [[]] * 200, wait_ms=50)
    several = SeveralReader([busy, silent], lambda: 0)
    sink = Sink()
    sink.reader = several
    for _ in range(100):
        several.step(sink)
    assert (rests, several.packets) == ([], 100)
    busy.steps.extend([[]] * 20)
    several.step(sink)
    assert len(rests) == 3  # of 20 ms each here, until 50 ms are over


def test_an_interface_that_ends_does_not_end_the_others() -> None:
    gone, stays = Fake("a", [[1], None]), Fake("b", [[2], [3], [4], None])
    gone.damage = "the interface a is gone"
    several, sink = read(gone, stays)
    assert [(time, name) for time, name, _ in sink.got] == [(1, "a"), (2, "b"), (3, "b"), (4, "b")]
    assert several.take_outages() == [("the interface a is gone; the other interfaces go on", False)]
    assert several.damage == "the interface a is gone"


class Told(Observer):
    """What findings say."""

    def __init__(self) -> None:
        super().__init__()
        self.details: list[str] = []

    def finding(self, finding: Finding) -> None:
        self.details.append(finding.detail)


def test_losses_are_told_of_each_interface() -> None:
    steps: list[list[int] | None] = [[1], [2], [], None]
    one, two = Fake("eth0", list(steps)), Fake("eth1", list(steps))
    now = [0]
    told = Told()
    run = LiveRun(SeveralReader([one, two], count(0, SECOND).__next__), told, clock=lambda: now[0])
    two.lost = Drops(7, None)
    now[0] += 2 * SECOND
    run.step()
    one.lost = Drops(2, 1)
    now[0] += 2 * SECOND
    run.step()
    run.step()  # what was held comes out
    two.lost = Drops(9, None)
    run.finish()
    assert told.details == [
        "7 by the kernel on eth1 (7 in all)",
        "2 by the kernel on eth0 (2 in all), 1 by the interface on eth0 (1 in all)",
        "2 by the kernel on eth1 (9 in all)",
    ]
    assert run.problems.counts["drops"] == 3
    assert run.drops == Drops(11, None)  # what one does not know is not known of all
    assert run.interfaces == ["eth0", "eth1"]
