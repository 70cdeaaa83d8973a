"""A line that is made up, and a clock that is told: what passes when nothing comes, what was lost, when it ends."""

from __future__ import annotations

import time
from pathlib import Path

import pytest

from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.online.live.run import Companion, Limits, LiveRun
from dissect.packets.source.files import open_capture
from dissect.packets.source.live.reader import Drops
from tests.meaning.report.support import WORD, begun, read, saved
from tests.online.live.support import SECOND, Clock, Line
from tests.properties import messages
from tests.properties.messages import dt
from tests.properties.packets import Flow, Packet


class Told(Observer):
    """Keeps what it is told."""

    def __init__(self) -> None:
        super().__init__()
        self.transactions: list[Transaction] = []
        self.findings: list[Finding] = []
        self.closed: list[Connection] = []

    def transaction(self, transaction: Transaction) -> None:
        self.transactions.append(transaction)

    def finding(self, finding: Finding) -> None:
        self.findings.append(finding)

    def connection_closed(self, connection: Connection) -> None:
        self.closed.append(connection)

    def slugs(self) -> list[str]:
        return [finding.slug for finding in self.findings]


def asked(count: int = 1) -> list[Packet]:
    """A connection with requests that are not answered."""
    talk = begun()
    for ref in range(1, count + 1):
        talk.send(0, dt(messages.read_job(ref, [WORD])))
    return talk.packets()


def run_of(line: Line, **more: object) -> tuple[LiveRun, Told]:
    told = Told()
    options = Options(strict=True, overdue_ns=2 * SECOND)
    return LiveRun(line, told, options, name="fake0", clock=line.clock, **more), told  # type: ignore[arg-type]


def steps(run: LiveRun, count: int) -> None:
    for _ in range(count):
        assert run.step()


# ---- time -----------------------------------------------------------------------------------------------------------


def test_a_request_is_told_while_the_line_is_silent() -> None:
    packets = asked()
    run, told = run_of(Line(Clock(), [packets]))
    steps(run, 40)  # the first step brings the packets, 39 more are 1.95 s
    assert told.findings == []
    steps(run, 1)
    (finding,) = told.findings
    assert (finding.slug, finding.frames) == ("transaction.overdue", [len(packets)])
    assert finding.time_ns == packets[-1].time_ns + 2 * SECOND
    steps(run, 200)
    assert told.slugs() == ["transaction.overdue"]


@pytest.mark.parametrize("silent_steps", [10, 200])
def test_what_is_open_at_the_end_has_waited_until_then(silent_steps: int) -> None:
    """Of a line that was silent for long; less than a second is what reading takes, and that of a pipe is no time at all."""
    packets = asked()
    run, told = run_of(Line(Clock(), [packets]))
    steps(run, 1 + silent_steps)
    run.stop()
    while run.step():
        pass
    ending = told.closed[0].ending
    assert ending is not None
    waited = ending.time_ns - packets[-1].time_ns
    if silent_steps == 10:
        assert waited == 0
    else:
        assert 10 * SECOND <= waited <= 13 * SECOND
        assert run.now_ns == ending.time_ns


def test_a_closed_connection_is_told_while_the_line_is_silent() -> None:
    run, told = run_of(Line(Clock(), [read(begun(), 1).close().packets()]))
    steps(run, 1)
    assert told.closed == []
    steps(run, 25)
    assert len(told.closed) == 1


def test_the_clock_is_that_of_the_packets_whatever_time_it_is_here() -> None:
    packets = asked()
    line = Line(Clock(), [packets])
    run, _ = run_of(line)
    assert abs(run.now_ns - time.time_ns()) < 60 * SECOND  # nothing was captured yet
    steps(run, 1)
    assert run.now_ns == packets[-1].time_ns
    line.clock.now += 7 * SECOND
    assert run.now_ns == packets[-1].time_ns + 7 * SECOND


def test_packets_that_come_a_little_late_are_no_step_back() -> None:
    packets = read(begun(), 1).packets()
    run, told = run_of(Line(Clock(), [packets[:-1], [], [], [], packets[-1:]]))
    steps(run, 8)
    assert told.findings == []
    assert [transaction.outcome for transaction in told.transactions] == ["answered", "answered"]


def test_before_the_first_packet_no_time_passes_for_the_pipeline() -> None:
    run, told = run_of(Line(Clock(), [[], [], asked()]))
    steps(run, 3)
    assert run.pipeline.first_ns == asked()[0].time_ns
    assert told.findings == []


def test_findings_are_detailed_again_after_a_minute() -> None:
    def refused(minute: int) -> list[Packet]:
        talk = begun(Flow(ports=(50000 + minute, 102)))
        for ref in range(1, 121):
            read(talk, ref, content=0x0A)
        return [packet._replace(time_ns=packet.time_ns + minute * 60 * SECOND) for packet in talk.packets()]

    run, told = run_of(Line(Clock(), [refused(0), *[[] for _ in range(1300)], refused(2)]))
    steps(run, 1)
    assert told.slugs() == ["transaction.item_error"] * 100
    told.findings.clear()
    steps(run, 1301)
    assert told.slugs().count("transaction.item_error") == 100
    assert run.pipeline.finding_counts["transaction.item_error"] == 240


# ---- loss -----------------------------------------------------------------------------------------------------------


def test_lost_packets_are_told_when_they_grow() -> None:
    line = Line(Clock(), [asked()])
    run, told = run_of(line)
    steps(run, 25)
    assert run.drops == Drops(0, 0)
    line.lost = Drops(12, 0)
    steps(run, 25)
    line.lost = Drops(15, 2)
    steps(run, 25)
    steps(run, 100)
    assert [finding.detail for finding in told.findings if finding.slug == "capture.dropped"] == [
        "12 by the kernel (12 in all)",
        "3 by the kernel (15 in all), 2 by the interface (2 in all)",
    ]
    assert run.drops == Drops(15, 2)


@pytest.mark.parametrize(("lost", "doubtful"), [(Drops(12, 0), True), (Drops(0, 3), True), (Drops(0, 0), False)])
def test_a_server_is_not_blamed_for_what_the_capture_lost(lost: Drops, doubtful: bool) -> None:
    """The answer may be among the packets that were dropped since the request."""
    line = Line(Clock(), [asked()])
    run, told = run_of(line)
    steps(run, 2)
    line.lost = lost
    steps(run, 48)
    run.stop()
    while run.step():
        pass
    said = {finding.slug: finding.detail for finding in told.findings}
    for slug in ("transaction.overdue", "transaction.unanswered"):
        assert said[slug].endswith("; packets were lost while capturing, the answer perhaps among them") is doubtful


def test_packets_that_were_lost_before_a_request_are_no_excuse() -> None:
    packets = asked()
    line = Line(Clock(), [packets[:-1]])
    run, told = run_of(line)
    line.lost = Drops(12, 0)
    steps(run, 25)
    line.batches = [[packets[-1]._replace(time_ns=packets[-1].time_ns + 3 * SECOND)]]
    steps(run, 60)
    (overdue,) = [finding for finding in told.findings if finding.slug == "transaction.overdue"]
    assert overdue.detail.endswith("still unanswered")


def test_what_was_not_known_before_is_told_at_the_end() -> None:
    """dumpcap says only at its end how many packets the kernel dropped."""

    class Late(Line):
        def close(self) -> None:
            super().close()
            self.lost = Drops(7, None)

    line = Late(Clock(), [asked()], ends=True)
    line.lost = Drops(None, None)
    run, told = run_of(line)
    while run.step():
        pass
    assert run.drops == Drops(7, None)
    assert "7 by the kernel (7 in all)" in [finding.detail for finding in told.findings]


def test_unknown_is_not_none() -> None:
    line = Line(Clock(), [asked()])
    line.lost = Drops(None, None)
    run, told = run_of(line)
    steps(run, 30)
    assert run.drops == Drops(None, None)
    assert "capture.dropped" not in told.slugs()


# ---- the end --------------------------------------------------------------------------------------------------------


def test_it_ends_with_its_source() -> None:
    line = Line(Clock(), [asked()], ends=True)
    line.damage = "the interface fake0 is gone"
    run, told = run_of(line)
    steps(run, 1)
    assert not run.step()
    assert not run.step()
    assert line.closed == 1
    assert (run.ended, run.file.packets, run.file.damage) == (True, 8, "the interface fake0 is gone")
    assert len(told.closed) == 1
    assert [finding.detail for finding in told.findings if finding.slug == "capture.damaged"] == [
        "fake0: the interface fake0 is gone"
    ]


def test_it_is_stopped_and_takes_what_had_arrived() -> None:
    line = Line(Clock(), [asked(), [], []])
    run, told = run_of(line)
    run.stop()
    while run.step():
        pass
    assert line.stopped == 1
    assert run.pipeline.frames == 8
    assert len(told.closed) == 1


def test_a_source_that_does_not_end_is_left() -> None:
    class Endless(Line):
        def stop(self) -> None:
            """Never ends."""

    line = Endless(Clock())
    run, _ = run_of(line)
    run.stop()
    begun_at = line.clock.now
    while run.step():
        pass
    assert 2 * SECOND <= line.clock.now - begun_at < 3 * SECOND
    assert line.closed == 1


@pytest.mark.parametrize("most", [1, 5, 8])
def test_it_ends_after_so_many_packets_exactly(most: int) -> None:
    run, _ = run_of(Line(Clock(), [asked()]), limits=Limits(packets=most))
    while run.step():
        pass
    assert run.pipeline.frames == run.file.packets == most


def test_it_ends_after_a_time() -> None:
    line = Line(Clock(), [asked()])
    run, _ = run_of(line, limits=Limits(duration_ns=3 * SECOND))
    begun_at = line.clock.now
    while run.step():
        pass
    assert 3 * SECOND <= line.clock.now - begun_at < 4 * SECOND


def test_a_file_has_no_silence_and_is_stopped_at_once(tmp_path: Path) -> None:
    packets = asked()
    reader = open_capture(str(saved(tmp_path / "a.pcapng", packets)))
    told = Told()
    run = LiveRun(reader, told, Options(strict=True, overdue_ns=SECOND))
    assert run.step()
    assert run.now_ns == packets[-1].time_ns
    run.stop()
    assert not run.step()
    assert run.drops == Drops(None, None)
    assert "transaction.overdue" not in told.slugs()


# ---- companions -----------------------------------------------------------------------------------------------------


class Beside(Companion):
    """Keeps what it is given; fails at one thing."""

    name = "evidence"

    def __init__(self, fails_at: str = "", packets: bool = True) -> None:
        super().__init__()
        self.wants_packets = packets
        self.fails_at = fails_at
        self.log: list[str] = []
        self.seen: list[tuple[int, bytes, int, int, str]] = []
        self.ticks: list[tuple[int, Drops]] = []
        self.closed = 0

    def _maybe(self, what: str) -> None:
        self.log.append(what)
        if what == self.fails_at:
            raise OSError(28, "No space left on device")

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        self.seen.append((time_ns, octets, wire_length, link_type, interface))
        self._maybe("packet")

    def transaction(self, transaction: Transaction) -> None:
        self._maybe("transaction")

    def tick(self, now_ns: int, drops: Drops) -> None:
        self.ticks.append((now_ns, drops))
        self._maybe("tick")

    def close(self) -> None:
        self.closed += 1
        self._maybe("close")


def test_a_companion_sees_packets_first_then_what_they_mean() -> None:
    packets = read(begun(), 1).packets()
    beside = Beside()
    run, told = run_of(Line(Clock(), [packets], ends=True), companions=[beside])
    while run.step():
        pass
    assert [(one[0], one[1], one[4]) for one in beside.seen] == [
        (packet.time_ns, packet.octets, "fake0") for packet in packets
    ]
    assert [what for what in beside.log if what != "tick"] == ["packet"] * 7 + ["transaction"] + ["packet"] * 2 + [
        "transaction",
        "close",
    ]
    assert beside.ticks[0] == (packets[-1].time_ns, Drops(0, 0))
    assert len(told.transactions) == 2
    assert run.failures == []


@pytest.mark.parametrize("what", ["packet", "transaction", "tick"])
def test_a_companion_that_fails_is_told_of_and_closed_and_the_run_goes_on(what: str) -> None:
    failing, good = Beside(what), Beside()
    run, told = run_of(Line(Clock(), [read(begun(), 1).packets()], ends=True), companions=[failing, good])
    while run.step():
        pass
    assert run.failures == ["evidence failed and was switched off: No space left on device"]
    assert failing.log.count(what) == 1
    assert (failing.closed, good.closed) == (1, 1)
    assert len(good.seen) == 9
    assert len(told.transactions) == 2


def test_a_companion_may_fail_at_the_end_too() -> None:
    run, told = run_of(Line(Clock(), [asked()], ends=True), companions=[Beside("close")])
    while run.step():
        pass
    assert run.failures == ["evidence failed at the end: No space left on device"]
    assert len(told.closed) == 1
