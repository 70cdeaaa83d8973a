"""`LiveRun`: reads a live source into a pipeline, advances its clock, reports lost packets, and ends the run.

The clock of the capture shows the time of the latest packet. Between packets it advances with the monotonic clock of this
machine, so that silence is noticed even if the clock of the capturing machine is wrong.

`Fanout` is an observer that passes events on to several others. One that fails is reported once and dropped; the others
continue.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Final, NamedTuple

from mypy_extensions import i64

from dissect.engine.acts.act import Act
from dissect.engine.findings.bounds import COUNTED
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options, Pipeline
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.naming import Naming
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.payloads import ScdMessage
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.transaction import Transaction
from dissect.online.alerts.problems import DROPS, INTERFACE, STOPPED
from dissect.online.live.problems import Problem, Problems, WriterState
from dissect.packets.source.live.reader import Drops, LiveReader, in_all
from dissect.packets.source.live.several import SeveralReader
from dissect.packets.source.packet import PacketSink, Reader, SourceFile
from dissect.wire.text import reason

#: Is called with an observer that failed, and its exception.
Failed = Callable[[Observer, Exception], None]


class Fanout(Observer):
    """Passes every event on to ``observers``, in their order; PDUs and TPDUs only to those that want them.

    ``failed`` is called once for an observer that raises, which then gets no further events.
    """

    def __init__(self, observers: Iterable[Observer], failed: Failed) -> None:
        super().__init__()
        self._observers = list(observers)
        self._failed = failed
        self.wants_pdus = any([observer.wants_pdus for observer in self._observers])
        self.wants_tpdus = any([observer.wants_tpdus for observer in self._observers])
        self.wants_every_finding = any([observer.wants_every_finding for observer in self._observers])

    @property
    def observers(self) -> list[Observer]:
        """The observers that have not failed."""
        return list(self._observers)

    def drop(self, observer: Observer, error: Exception) -> None:
        """Pass no further events to ``observer``, which failed, unless it will retry."""
        if isinstance(error, OSError) and isinstance(observer, Companion) and observer.recover(error):
            return
        if observer in self._observers:
            self._observers = [one for one in self._observers if one is not observer]
            self._failed(observer, error)

    def _each(self, tell: Callable[[Observer], None], observers: Iterable[Observer]) -> None:
        for observer in observers:
            try:
                tell(observer)
            except Exception as error:  # noqa: BLE001 - whatever it is, it must not cost the others what happens
                self.drop(observer, error)

    def connection_opened(self, connection: Connection) -> None:
        """Pass the event on; the other methods do the same."""
        self._each(lambda one: one.connection_opened(connection), self._observers)

    def connection_closed(self, connection: Connection) -> None:
        """Pass the event on."""
        self._each(lambda one: one.connection_closed(connection), self._observers)

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Pass the event on to observers that want it."""
        self._each(
            lambda one: one.tpdu(frame, time_ns, side, octets), [one for one in self._observers if one.wants_tpdus]
        )

    def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """Pass the event on to observers that want it."""
        self._each(
            lambda one: one.ibh_packet(frame, time_ns, side, octets),
            [one for one in self._observers if one.wants_tpdus],
        )

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Pass the event on to observers that want it."""
        self._each(
            lambda one: one.pdu(frame, time_ns, side, octets, cut), [one for one in self._observers if one.wants_pdus]
        )

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Pass the event on to observers that want it."""
        self._each(
            lambda one: one.plus_pdu(frame, time_ns, side, octets, cut),
            [one for one in self._observers if one.wants_pdus],
        )

    def scd(self, frame: int, time_ns: int, side: Side, found: ScdMessage) -> None:
        """Pass the event on to observers that want it."""
        self._each(lambda one: one.scd(frame, time_ns, side, found), [one for one in self._observers if one.wants_pdus])

    def transaction(self, transaction: Transaction) -> None:
        """Pass the event on."""
        self._each(lambda one: one.transaction(transaction), self._observers)

    def operation(self, operation: Operation) -> None:
        """Pass the event on."""
        self._each(lambda one: one.operation(operation), self._observers)

    def act(self, act: Act) -> None:
        """Pass the event on."""
        self._each(lambda one: one.act(act), self._observers)

    def fact(self, fact: Fact) -> None:
        """Pass the event on."""
        self._each(lambda one: one.fact(fact), self._observers)

    def finding(self, finding: Finding) -> None:
        """Pass the event on."""
        observers = self._observers
        if self.wants_every_finding and (finding.bare or finding.room == COUNTED):
            observers = [one for one in observers if one.wants_every_finding]
        self._each(lambda one: one.finding(finding), observers)

    def repeated(self, finding: Finding) -> None:
        """Pass the event on."""
        self._each(lambda one: one.repeated(finding), self._observers)

    def comment(self, frame: int, text: str) -> None:
        """Pass the event on."""
        self._each(lambda one: one.comment(frame, text), self._observers)


_SECOND: Final = 1_000_000_000
_NO_DROPS: Final = Drops(None, None)
#: How often lost packets are fetched from the source, and companions get a tick, by the clock of this machine.
_DROPS_EVERY_NS: Final = _SECOND
_TICK_NS: Final = 50_000_000
#: After this long the bounds on the number of findings are reset.
_RENEW_NS: Final = 60 * _SECOND
#: The least silence before the end of a run that counts as silence.
_SILENCE_NS: Final = _SECOND
#: For at most this long after `LiveRun.stop`, packets that already arrived are still read.
_DRAIN_NS: Final = 2 * _SECOND
#: At most this many messages on failed companions are kept.
_MAX_FAILURES: Final = 100


class Limits(NamedTuple):
    """When a run ends by itself: after a time by the clock of this machine, or a number of packets; 0 means no limit."""

    duration_ns: int = 0
    packets: int = 0


class Companion(Observer):
    """Accompanies a run: an observer that also gets ticks and, with ``wants_packets``, each packet before the pipeline does.

    A companion that raises gets no further events and is closed; the run continues. One whose `recover` returns True stays. A
    companion reports its problems to ``problems``, which `LiveRun` sets.
    """

    name = "companion"
    wants_packets = False

    def __init__(self) -> None:
        super().__init__()
        self.problems = Problems()

    @property
    def state(self) -> WriterState | None:
        """The state of a companion that writes files, for metrics; None for others. May be read from a different thread."""
        return None

    @property
    def summary(self) -> str:
        """The error summary at the end of the run, empty for none: the command fails with it."""
        return ""

    @property
    def remark(self) -> str:
        """Further remarks at the end of the run, empty for none; these are not failures."""
        return ""

    def recover(self, error: OSError) -> bool:
        """Return whether it stays after an error of the system, because it will retry."""
        return False

    def problem(self, problem: Problem) -> None:
        """Take a problem of the run, or its end."""

    def renew(self) -> None:
        """Begin new files, so that the files written so far are complete and may be taken away."""

    def begin(self, pipeline: Pipeline) -> None:
        """The run begins with ``pipeline``."""

    def packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int, interface: str) -> None:
        """Take a packet, before the pipeline gets it."""

    def tick(self, now_ns: int, drops: Drops) -> None:
        """Called often: ``now_ns`` is the time by the clock of the capture, ``drops`` the packets lost so far."""

    def close(self) -> None:
        """The run is over: write the rest, and close files."""


def _state(companion: Companion) -> WriterState:
    state = companion.state
    assert state is not None
    return state


class _Door(PacketSink):
    """Gives each packet to the companions that want it, then to the pipeline; accepts nothing after the limit of packets."""

    def __init__(self, run: LiveRun, most: int) -> None:
        self._run = run
        self._pipeline = run.pipeline
        self._most = most

    def frame(self, time_ns: i64, buf: bytes, start: i64, end: i64, wire_length: i64, link_type: i64) -> None:
        if self._most and self._pipeline.frames >= self._most:
            return
        self._run.show_packet(int(time_ns), buf[start:end], int(wire_length), int(link_type))
        self._pipeline.frame(time_ns, buf, start, end, wire_length, link_type)

    def comment(self, text: str) -> None:
        self._pipeline.comment(text)

    def secrets(self, text: bytes) -> None:
        self._pipeline.secrets(text)


class LiveRun:
    """Reads ``source`` into a pipeline that feeds ``observer`` and the ``companions``.

    Any `Reader` will do, but only a `LiveReader` can be silent and lose packets. ``drops`` are the packets lost so far;
    whenever it grows, there is a finding. ``failures`` are messages on companions that were dropped, ``remarks`` those of
    companions at the end. Call `step` until it returns False. ``clock`` is a monotonic clock in nanoseconds.
    """

    def __init__(
        self,
        source: Reader,
        observer: Observer,
        options: Options | None = None,
        *,
        companions: Sequence[Companion] = (),
        limits: Limits | None = None,
        name: str = "",
        clock: Callable[[], int] = time.monotonic_ns,
    ) -> None:
        self._source = source
        self._live = source if isinstance(source, LiveReader) else None
        self._fanout = Fanout([observer, *companions], self._note_failure)
        self._limits = limits if limits is not None else Limits()
        self._clock = clock
        self.pipeline = Pipeline(self._fanout if companions else observer, options)
        self.file = SourceFile(name, 1)
        self.drops: Drops = self._live.drops if self._live is not None else _NO_DROPS
        self._drops_of = self._live.drops_of if self._live is not None else {}
        self.failures: list[str] = []
        self.remarks: list[str] = []
        self.ended = False
        self.stop_asked = False
        self._between: deque[Callable[[], None]] = deque()
        self._companions = list(companions)
        self._wanting = [companion for companion in companions if companion.wants_packets]
        self._sink: PacketSink = self.pipeline
        if self._wanting or self._limits.packets:
            self._sink = _Door(self, self._limits.packets)
        self.problems = Problems()
        self.problems.listen(self._pass_on)
        for companion in companions:
            companion.problems = self.problems
            companion.begin(self.pipeline)
            if companion.state is not None:
                self.problems.writers.append(partial(_state, companion))
        now = clock()
        self._begun = now
        self._anchor = now  # when the latest packet came, by the clock of this machine
        self._looked = now
        self._ticked = now
        self._renewed = now
        self._stopped = 0

    @property
    def octets(self) -> int:
        """Octets read so far."""
        return int(self._source.octets)

    @property
    def notes(self) -> list[str]:
        """The notes of a live source so far; those of a file are in ``file.notes`` once it was read."""
        return self._source.notes if self._live is not None else []

    @property
    def now_ns(self) -> int:
        """The time by the clock of the capture; before the first packet, by that of this machine."""
        if not self.pipeline.frames:
            return time.time_ns()
        packet_ns = int(self.pipeline.now_ns)
        return packet_ns + self._clock() - self._anchor if self._live is not None else packet_ns

    # ---- reading ----------------------------------------------------------------------------------------------------

    def step(self) -> bool:
        """Read what has arrived, or wait a moment; return False when the run is over and every connection is closed.

        Raises `CaptureError` when the input from a pipe is not a capture.
        """
        if self.ended:
            return False
        if self.stop_asked and not self._begin_stop():
            self.finish()
            return False
        while self._between:
            self._changed_by(self._between.popleft())
        frames = self.pipeline.frames
        more = self._source.step(self._sink)
        now = self._clock()
        if self.pipeline.frames != frames:
            self._anchor = now
        elif self._live is not None and frames:
            self.pipeline.tick(self.now_ns)
        if now - self._ticked >= _TICK_NS:
            self._tick(now)
        if not more:
            self.finish()
            return False
        if self._full(now):
            self.stop()
        return True

    def between(self, change: Callable[[], None]) -> None:
        """Call ``change`` between two packets, in the thread that reads. May be called from any thread."""
        self._between.append(change)

    def _changed_by(self, change: Callable[[], None]) -> None:
        try:
            change()
        except Exception as error:  # noqa: BLE001 - what fails beside the analysis must not end it
            self.problems.tell(STOPPED, f"a change failed: {reason(error)}")

    def renew(self) -> None:
        """Let the companions begin new files. Call it by way of `between`."""
        for companion in self._companions:
            try:
                companion.renew()
            except Exception as error:  # noqa: BLE001 - what fails beside the analysis must not end it
                self._fanout.drop(companion, error)

    def name_values(self, naming: Naming | None) -> None:
        """Name values by ``naming`` from now on, on open connections as well. Call it by way of `between`."""
        exchange = self.pipeline.exchange
        exchange.naming = naming
        for side in self.pipeline.table.all_open():
            side.connection.naming = naming.of(side.connection) if naming is not None else None

    def stop(self) -> None:
        """Stop capturing; `step` reads what already arrived, then ends. May be called from a signal handler."""
        self.stop_asked = True

    def finish(self) -> None:
        """Close the source, every connection, and the companions; may be called early, and twice."""
        if self.ended:
            return
        self.ended = True
        self._source.close()
        self._look_at_drops()
        file, source = self.file, self._source
        file.packets = self.pipeline.frames
        file.octets = source.octets
        file.damage = source.damage
        file.rejected = source.rejected
        file.notes = list(source.notes)
        if file.loss:
            self.pipeline.note_damage(f"{file.name}: {file.loss}")
        lost = source.stated_loss()
        if lost:
            self.pipeline.note_dropped(f"{file.name}: {lost}, as the file states")
        self._let_silence_count()
        self.pipeline.finish()
        for companion in self._companions:
            self._close(companion)
        self.failures += [companion.summary for companion in self._companions if companion.summary]
        self.remarks = [companion.remark for companion in self._companions if companion.remark]

    def _let_silence_count(self) -> None:
        """After silence, end at the present time: open requests have waited until now, not only until the last packet.

        A recording that came through a pipe ends with its last packet.
        """
        silence = self._clock() - self._anchor
        if self._live is None or not self.pipeline.frames or silence < _SILENCE_NS:
            return
        self.pipeline.counters.now_ns = self.now_ns
        self._anchor += silence

    def show_packet(self, time_ns: int, octets: bytes, wire_length: int, link_type: int) -> None:
        """Give a packet to the companions that want it."""
        for companion in self._wanting:
            try:
                companion.packet(time_ns, octets, wire_length, link_type, self._source.interface)
            except Exception as error:  # noqa: BLE001 - what fails beside the analysis must not end it
                self._fanout.drop(companion, error)

    # ---- when time passes -------------------------------------------------------------------------------------------

    def _pass_on(self, problem: Problem) -> None:
        for companion in self._companions:
            try:
                companion.problem(problem)
            except Exception as error:  # noqa: BLE001 - as above
                self._fanout.drop(companion, error)

    def _tick(self, now: int) -> None:
        self._ticked = now
        if now - self._looked >= _DROPS_EVERY_NS:
            self._looked = now
            self._look_at_drops()
        if now - self._renewed >= _RENEW_NS:
            self._renewed = now
            self.pipeline.exchange.reporter.renew()
        for companion in self._companions:
            try:
                companion.tick(self.now_ns, self.drops)
            except Exception as error:  # noqa: BLE001 - as above
                self._fanout.drop(companion, error)

    def _look_at_drops(self) -> None:
        if self._live is None:
            return
        before, self._drops_of = self._drops_of, self._live.drops_of
        self.drops = in_all(self._drops_of.values())
        self.problems.down_seconds = self._live.down_seconds
        for text, over in self._live.take_outages():
            self.problems.tell(INTERFACE, text, over)
        told = [
            f"{lost - (known or 0)} by the {who}{self._on(name)} ({lost} in all)"
            for name, drops in self._drops_of.items()
            for who, lost, known in zip(("kernel", "interface"), drops, before.get(name, _NO_DROPS), strict=True)
            if lost is not None and lost > (known or 0)
        ]
        if told:
            self.problems.tell(DROPS, f"packets were lost: {', '.join(told)}", shown=False)  # the finding is shown
            self.pipeline.note_dropped(", ".join(told))
            self.pipeline.exchange.report_findings()

    def _on(self, name: str) -> str:
        """Return how a sentence names the interface, if there are several."""
        return f" on {name}" if len(self._drops_of) > 1 else ""

    @property
    def interfaces(self) -> list[str]:
        """The interfaces, if there are several."""
        return self._source.names if isinstance(self._source, SeveralReader) else []

    @property
    def interface(self) -> str:
        """The interface that captured the present packet, empty if that is not known."""
        return self._source.interface

    # ---- the end ----------------------------------------------------------------------------------------------------

    def _full(self, now: int) -> bool:
        limits = self._limits
        if limits.packets and self.pipeline.frames >= limits.packets:
            return True
        return bool(limits.duration_ns) and now - self._begun >= limits.duration_ns

    def _begin_stop(self) -> bool:
        """Stop the source; return False when no further packets can come."""
        if self._live is None:
            return False
        now = self._clock()
        if not self._stopped:
            self._stopped = now
            self._live.stop()
        return now - self._stopped < _DRAIN_NS

    def _note_failure(self, observer: Observer, error: Exception) -> None:
        """Note that an observer failed, and give it no further packets."""
        name = observer.name if isinstance(observer, Companion) else type(observer).__name__
        told = f"{name} failed and was switched off: {reason(error)}"
        if len(self.failures) < _MAX_FAILURES:
            self.failures.append(told)
        self._wanting = [one for one in self._wanting if one is not observer]
        if isinstance(observer, Companion) and observer in self._companions:
            self._companions = [one for one in self._companions if one is not observer]
            self._close(observer)
        self.problems.tell(STOPPED, told)

    def _close(self, companion: Companion) -> None:
        try:
            companion.close()
        except Exception as error:  # noqa: BLE001 - as above
            if not any([told.startswith(f"{companion.name} failed") for told in self.failures]):
                told = f"{companion.name} failed at the end: {reason(error)}"
                self.failures.append(told)
                self.problems.tell(STOPPED, told)
