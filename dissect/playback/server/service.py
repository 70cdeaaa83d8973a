"""The fake PLC on its sockets: one thread, one selector, any client bounded in time, octets and number."""

from __future__ import annotations

import heapq
import os
import selectors
import threading
import time
from collections import deque
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from dissect.net.addresses import Address, Place, ProxyError, places_to_listen
from dissect.net.listener import Accepted, Listener
from dissect.net.sockets import close_with_reset
from dissect.playback.server.capture_writer import CLIENT, SERVER, CaptureWriter
from dissect.playback.server.faults import Fault, parse_fault
from dissect.playback.server.model import Recording
from dissect.playback.server.player import CYCLE, LAST, Stage
from dissect.playback.server.recording import ServerError, load_recording
from dissect.playback.server.request_log import Request, RequestLog
from dissect.playback.server.session import ABORT, CLOSE, ClientSession, Deed
from dissect.playback.server.socket import BrokenError, ClientSocket

if TYPE_CHECKING:
    from dissect.source.pcapng_writer import PcapngWriter

#: Clients at once; more wait in the system's queue.
MAX_CLIENTS: Final = 100
#: How long a client may take to ask for a connection, in seconds.
CONNECT_S: Final = 10.0
#: How long a client may leave what it is sent, in seconds.
TAKE_S: Final = 30.0
#: How long it waits for the client's end after its own, in seconds.
LEAVE_S: Final = 2.0
#: The longest that an answer may be made to take, in milliseconds.
MAX_LATENCY_MS: Final = 3_600_000
_LOOK_S: Final = 0.5
_DANGER: Final = "which would mistake it for a PLC"
_JOIN_S: Final = 10.0

_READ: Final = selectors.EVENT_READ
_WRITE: Final = selectors.EVENT_WRITE


def places_to_serve(address: Address, allow_remote: bool) -> list[Place]:
    """Return what to listen on; what other machines can reach only with ``allow_remote``. Raises `ServerError`."""
    try:
        return places_to_listen(address, allow_remote, _DANGER)
    except ProxyError as why:
        raise ServerError(str(why)) from None


class Server:
    """A PLC that says what a recording says (docs/serve.md).

        with Server("pump.pcapng") as server:
            client.connect("127.0.0.1", 0, 1, server.port)
        assert not server.unmatched

    ``repeat``: what comes when all recorded answers to a request were given, ``last`` the last one again, ``cycle`` the first
    one. ``memory``: reads give what was written. ``latency_ms``: how long an answer takes, None for as long as it was
    recorded. ``faults``: what is to go wrong (`parse_fault`), one or several. ``writer`` records what passes. Listening begins
    at once; raises `ServerError` when it cannot, `ValueError` for a fault or a latency that is none.
    """

    def __init__(
        self,
        recording: Recording | str | os.PathLike[str],
        port: int = 0,
        host: str = "127.0.0.1",
        *,
        allow_remote: bool = False,
        repeat: str = LAST,
        memory: bool = False,
        latency_ms: float | None = 0,
        faults: Sequence[Fault | str] | Fault | str = (),
        writer: PcapngWriter | None = None,
    ) -> None:
        if repeat not in {LAST, CYCLE}:
            raise ValueError(f"repeat is {LAST!r} or {CYCLE!r}, not {repeat!r}")
        if not 0 <= port <= 0xFFFF:
            raise ValueError(f"{port} is not a port")
        places = places_to_serve(Address(host, port), allow_remote)
        self.recording = recording if isinstance(recording, Recording) else load_recording(recording)
        if latency_ms is not None and not 0 <= latency_ms <= MAX_LATENCY_MS:
            raise ValueError(f"latency_ms={latency_ms}: give 0 to {MAX_LATENCY_MS}, or None for what was recorded")
        several = [faults] if isinstance(faults, (str, Fault)) else faults
        told = [parse_fault(fault) if isinstance(fault, str) else fault for fault in several]
        self.desk = RequestLog(Stage(self.recording, repeat, memory), told, latency_ms)
        self.connections = 0
        self.error: Exception | None = None
        self._tape = CaptureWriter(writer) if writer is not None else None
        self._lines: set[ClientSocket] = set()
        self._plans: list[tuple[float, int, ClientSocket, Deed]] = []
        self._count = 0
        self._thread: threading.Thread | None = None
        try:
            self._door = Listener(places, MAX_CLIENTS, self.desk.problems.append)
        except ProxyError as why:
            if self._tape is not None:
                self._tape.close()
            raise ServerError(str(why)) from None
        self.listening = self._door.listening

    # ---- what a user asks -------------------------------------------------------------------------------------------

    @property
    def host(self) -> str:
        """The address where it listens."""
        return str(self.listening[0].address[0])

    @property
    def port(self) -> int:
        """The port where it listens, the one that the system chose where it was to."""
        return int(self.listening[0].address[1])

    @property
    def requests(self) -> list[Request]:
        """What was asked, in the order in which it came (the last 10,000)."""
        return self.desk.requests

    @property
    def unmatched(self) -> list[Request]:
        """What nothing like was recorded of (the last 1,000)."""
        return self.desk.unmatched

    @property
    def problems(self) -> deque[str]:
        """What a user should hear of, a line each; taken from its left by whoever tells it."""
        return self.desk.problems

    def __enter__(self) -> Self:
        self.start()
        return self

    def __exit__(self, kind: type[BaseException] | None, _: BaseException | None, __: TracebackType | None) -> None:
        self.close()
        if self.error is not None and kind is None:
            raise self.error

    def start(self) -> None:
        """Serve in a thread of its own."""
        self._thread = threading.Thread(target=self._work, name="s7dissect-serve", daemon=True)
        self._thread.start()

    def wait(self, timeout_s: float) -> bool:
        """Wait for its end; True when it has come."""
        if self._thread is not None:
            self._thread.join(timeout_s)
        return self._thread is None or not self._thread.is_alive()

    def close(self) -> None:
        """Disconnect everybody and end the thread. May be called twice."""
        self.stop()
        if self._thread is None:
            self._close()
        else:
            self._thread.join(_JOIN_S)

    def stop(self) -> None:
        """Ask it to end. May be called from any thread and from a signal handler, and twice."""
        self._door.stop()

    def _work(self) -> None:
        try:
            self.run()
        except Exception as error:  # noqa: BLE001 - a thread has nobody else who would hear it
            self.error = error

    # ---- the loop ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Serve until `stop` is called."""
        try:
            while not self._door.stopping:
                for what, events in self._door.wait(self._patience()):
                    if isinstance(what, Accepted):
                        self._welcome(what)
                    elif what in self._lines:  # an event before this one may have ended it
                        self._work_on(what, events)
                self._due(time.monotonic())
        finally:
            self._close()

    def _patience(self) -> float | None:
        if not self._lines and self._door.is_open:
            return None
        due = self._plans[0][0] if self._plans else float("inf")
        due = min([due, *[line.not_before for line in self._lines if line.not_before]])
        return min(max(due - time.monotonic(), 0), _LOOK_S)

    def _welcome(self, client: Accepted) -> None:
        self.connections += 1
        peer = ClientSession(self.connections, self.desk)
        line = ClientSocket(self.connections, client.socket, peer, time.monotonic() + CONNECT_S, self._tape)
        self._lines.add(line)
        if self._tape is not None:
            self._tape.opened(line.number, client.name, client.socket.getsockname())
        self._watch(line)
        self._door.count(len(self._lines))

    def _work_on(self, line: ClientSocket, events: int) -> None:
        try:
            if events & _READ and line.wants_read:
                octets = line.read()
                if octets is not None:
                    self._take(line, octets)
            self._flush(line)
        except BrokenError:
            self._drop(line, CLIENT)
        except Exception as bug:  # noqa: BLE001 - whatever is wrong with one client must not cost the others theirs
            self.problems.append(f"connection {line.number} is aborted: {type(bug).__name__}: {bug}")
            self._drop(line, SERVER)

    def _take(self, line: ClientSocket, octets: bytes) -> None:
        if line.leaving:
            return
        if octets:
            deeds = line.peer.feed(octets)
        else:  # who has no more to say may still listen
            line.peer.over = True
            deeds = [Deed(CLOSE, last=True)]
        now = time.monotonic()
        for deed in deeds:
            line.held += len(deed.octets)
            due = max(now + deed.delay_s, line.latest) if deed.last else now + deed.delay_s
            if due > now:
                self._count += 1
                line.planned += 1
                line.latest = max(line.latest, due)
                heapq.heappush(self._plans, (due, self._count, line, deed))
            else:
                line.put(deed, now)

    def _flush(self, line: ClientSocket) -> None:
        end = line.flush(time.monotonic())
        if end == ABORT:
            self._drop(line, SERVER)
            return
        if end == CLOSE:
            line.leave(time.monotonic() + LEAVE_S)
        if line.leaving and line.finished:
            self._part(line)
        else:
            self._watch(line)

    def _watch(self, line: ClientSocket) -> None:
        events = (_READ if line.wants_read else 0) | (_WRITE if line.queue and not line.not_before else 0)
        self._door.watch(line.socket, line.events, events, line)
        line.events = events

    def _due(self, now: float) -> None:
        """Do what is planned for now, and see to those whom nothing happens to."""
        while self._plans and self._plans[0][0] <= now:
            _, _, line, deed = heapq.heappop(self._plans)
            if line in self._lines:
                line.planned -= 1
                line.put(deed, now)
                self._work_on(line, 0)
        for line in list(self._lines):
            if line.leaving:
                if now > line.leaving:
                    self._part(line)
            elif line.not_before:
                if now >= line.not_before:
                    self._work_on(line, 0)
            elif line.queue and now - line.moved > TAKE_S:
                self.problems.append(f"connection {line.number} is ended: it accepted no data for {TAKE_S:g} s")
                self._drop(line, SERVER)
            elif now > line.deadline and not line.peer.connected:
                self.problems.append(f"connection {line.number} is ended: no connect request within {CONNECT_S:g} s")
                self._drop(line, SERVER)
        self._door.count(len(self._lines))

    # ---- ends -------------------------------------------------------------------------------------------------------

    def _drop(self, line: ClientSocket, side: int) -> None:
        if self._tape is not None:
            self._tape.reset(line.number, side)
        self._forget(line)
        close_with_reset(line.socket)

    def _part(self, line: ClientSocket) -> None:
        self._forget(line)
        line.socket.close()

    def _forget(self, line: ClientSocket) -> None:
        self._lines.discard(line)
        if line.planned:
            self._plans = [plan for plan in self._plans if plan[2] is not line]
            heapq.heapify(self._plans)
        if self._tape is not None:
            self._tape.forget(line.number)
        self._door.unwatch(line.socket)

    def _close(self) -> None:
        for line in list(self._lines):
            if self._tape is not None:
                self._tape.closed(line.number, SERVER)
            self._part(line)
        self._door.close()
        if self._tape is not None:
            self._tape.close()
            if self._tape.trouble:
                self.problems.append(f"the capture file is incomplete: {self._tape.trouble}")
                self._tape.trouble = ""
