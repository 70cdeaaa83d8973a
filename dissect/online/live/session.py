"""`Session`: a live run in a thread of its own, with a bounded queue of events for display.

The thread that captures must never wait for the reader of the events, or packets would be lost. So when the queue is full
because events are taken too slowly, events are only counted: transactions first, others when the reserve is full, too. Only if
the source is a file, which loses nothing, does the thread wait.

    session = Session(lambda: open_live("eth0"), Options(overdue_ns=2_000_000_000))
    session.start()
    while session.running or session.waiting:
        for event in session.poll(0.2):
            ...
    session.close()
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Collection, Sequence
from typing import Final, NamedTuple

from dissect.engine.pipeline import Options
from dissect.meaning.report.contract import connection_as_dict
from dissect.meaning.report.words import Places
from dissect.online.live.events import KINDS, PROBLEM, TRANSACTION, Collector, Event
from dissect.online.live.run import Companion, Limits, LiveRun
from dissect.packets.source.live.reader import Drops, LiveReader
from dissect.packets.source.packet import Reader

#: This many events may wait to be taken, and this many more that are not transactions.
MAX_EVENTS: Final = 20_000
_RESERVE: Final = 5_000
#: While the reading of a file waits for events to be taken, it checks every this many seconds whether it should stop.
_PATIENCE_S: Final = 0.1


class Status(NamedTuple):
    """The state of a session. ``lost_events`` were not taken in time; ``open_requests`` have no answer yet."""

    now_ns: int
    packets: int
    octets: int
    drops: Drops
    connections: int
    connections_open: int
    open_requests: int
    transactions: int
    unanswered: int
    with_errors: int
    findings: int
    waiting_events: int
    lost_events: int


class Session:
    """Reads the source that ``open_source`` opens, in a thread, from `start` until its end or until `stop`.

    ``error`` is the message of the error that ended it, None without one. ``lost`` counts events that were not taken in time,
    by kind. Events outside of ``kinds`` are only counted; a ``PROBLEM`` is always made.
    """

    def __init__(
        self,
        open_source: Callable[[], Reader],
        options: Options | None = None,
        *,
        companions: Sequence[Companion] = (),
        limits: Limits | None = None,
        name: str = "",
        max_events: int = MAX_EVENTS,
        kinds: Collection[str] = KINDS,
    ) -> None:
        self._open_source = open_source
        self._options = options
        self._companions = companions
        self._limits = limits
        self._name = name
        self._max_events = max_events
        self._events: deque[Event] = deque()
        self._changed = threading.Condition()
        places = Places([], False)
        self._collector = Collector(
            lambda connection: connection_as_dict(connection, places),
            kinds,
            options is not None and options.decoder is not None,
        )
        self._run: LiveRun | None = None
        self._thread: threading.Thread | None = None
        self._stop_asked = False
        self._notes_told = 0
        self._patient = False
        self.engine = ""
        self.error: Exception | None = None
        self.lost: dict[str, int] = {}

    # ---- for whoever shows it ---------------------------------------------------------------------------------------

    @property
    def run(self) -> LiveRun:
        """The run. Raises RuntimeError before `start`."""
        if self._run is None:
            raise RuntimeError("the session was not started")
        return self._run

    @property
    def running(self) -> bool:
        """Whether the thread still runs: not everything was read and reported."""
        return self._thread is not None and self._thread.is_alive()

    @property
    def waiting(self) -> int:
        """How many events wait to be taken."""
        return len(self._events)

    def start(self) -> None:
        """Open the source and start the thread. Raises `CaptureError`, if possible with advice, if that fails."""
        source = self._open_source()
        self._patient = not isinstance(source, LiveReader)
        self.engine = source.engine if isinstance(source, LiveReader) else "file"
        run = LiveRun(
            source,
            self._collector,
            self._options,
            companions=self._companions,
            limits=self._limits,
            name=self._name,
        )
        self._collector.now_ns = lambda: int(run.pipeline.now_ns)
        if run.interfaces:
            self._collector.interface = lambda: run.interface
        self._run = run
        if self._stop_asked:
            run.stop()
        self._thread = threading.Thread(target=self._work, name="s7dissect-live", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ask the run to end; what already arrived is still read. May be called from a signal handler, and twice."""
        self._stop_asked = True
        if self._run is not None:
            self._run.stop()

    def poll(self, wait_s: float = 0.0, most: int = 1000) -> list[Event]:
        """Take up to ``most`` events; wait up to ``wait_s`` seconds for the first one. Empty if none came."""
        with self._changed:
            if not self._events and wait_s > 0 and self.running:
                self._changed.wait(wait_s)
            count = min(most, len(self._events))
            taken = [self._events.popleft() for _ in range(count)]
            self._changed.notify_all()
            return taken

    def say(self, text: str, kind: str = PROBLEM) -> None:
        """Add a sentence: a ``PROBLEM`` of the monitor itself, or an ``ALERT``. May be called from any thread."""
        event = Event(kind, self.run.now_ns, text)
        with self._changed:
            if len(self._events) < self._max_events + _RESERVE:
                self._events.append(event)
            else:
                self.lost[kind] = self.lost.get(kind, 0) + 1
            self._changed.notify()

    def close(self, wait_s: float = 10.0) -> None:
        """Stop, and wait for the end."""
        self.stop()
        if self._thread is not None:
            self._thread.join(wait_s)

    def status(self) -> Status:
        """Return the present state."""
        run, counts = self.run, self._collector
        return Status(
            now_ns=run.now_ns,
            packets=int(run.pipeline.frames),
            octets=run.octets,
            drops=run.drops,
            connections=int(counts.opened),
            connections_open=int(counts.opened - counts.closed),
            open_requests=int(run.pipeline.exchange.dialogue.open),
            transactions=int(counts.transactions),
            unanswered=int(counts.unanswered),
            with_errors=int(counts.with_errors),
            findings=sum(run.pipeline.finding_counts.values()),
            waiting_events=len(self._events),
            lost_events=sum(self.lost.values()),
        )

    # ---- the thread -------------------------------------------------------------------------------------------------

    def _work(self) -> None:
        run = self.run
        try:
            while run.step():
                self._hand_over(run)
        except Exception as error:  # noqa: BLE001 - whoever shows it has to say so; here nobody would hear it
            self.error = error
        try:
            run.finish()
        except Exception as error:  # noqa: BLE001 - as above
            self.error = self.error or error
        self._hand_over(run)
        with self._changed:
            self._changed.notify_all()

    def _hand_over(self, run: LiveRun) -> None:
        fresh = self._collector.taken()
        fresh += [Event(PROBLEM, run.now_ns, problem.text) for problem in run.problems.take()]
        for note in run.notes[self._notes_told :]:
            fresh.append(Event(PROBLEM, run.now_ns, note))
            self._notes_told += 1
        if not fresh:
            return
        with self._changed:
            if len(self._events) + len(fresh) <= self._max_events:
                self._events.extend(fresh)
                fresh = []
            for event in fresh:
                while self._patient and len(self._events) >= self._max_events and not self._stop_asked:
                    self._changed.wait(_PATIENCE_S)
                bound = self._max_events + (0 if event.kind == TRANSACTION else _RESERVE)
                if len(self._events) < bound:
                    self._events.append(event)
                else:
                    self.lost[event.kind] = self.lost.get(event.kind, 0) + 1
            self._changed.notify()
