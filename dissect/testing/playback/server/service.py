"""The fake PLC on its sockets: one thread, one selector; time, data and number of clients are bounded."""

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

from dissect.online.net.addresses import Address, Place, ProxyError, places_to_listen
from dissect.online.net.listener import Accepted, Listener
from dissect.online.net.sockets import close_with_reset
from dissect.testing.playback.server.capture_writer import CLIENT, SERVER, CaptureWriter
from dissect.testing.playback.server.faults import Fault, parse_fault
from dissect.testing.playback.server.model import Recording
from dissect.testing.playback.server.player import CYCLE, LAST, Stage
from dissect.testing.playback.server.recording import ServerError, load_recording
from dissect.testing.playback.server.request_log import Request, RequestLog
from dissect.testing.playback.server.session import ABORT, CLOSE, Action, ClientSession
from dissect.testing.playback.server.socket import BrokenError, ClientSocket

if TYPE_CHECKING:
    from dissect.packets.source.pcapng_writer import PcapngWriter

#: Maximum number of clients; more wait in the system's queue.
MAX_CLIENTS: Final = 100
#: How long a client may take to request a connection, in seconds.
CONNECT_S: Final = 10.0
#: How long a client may leave sent data unread, in seconds.
TAKE_S: Final = 30.0
#: How long the server waits for the client's end after its own, in seconds.
LEAVE_S: Final = 2.0
#: Longest answer time that can be set, in milliseconds.
MAX_LATENCY_MS: Final = 3_600_000
_LOOK_S: Final = 0.5
_DANGER: Final = "which would mistake it for a PLC"
_JOIN_S: Final = 10.0

_READ: Final = selectors.EVENT_READ
_WRITE: Final = selectors.EVENT_WRITE


def places_to_serve(address: Address, allow_remote: bool) -> list[Place]:
    """Return the addresses to listen on; those that other machines can reach need ``allow_remote``. Raises `ServerError`."""
    try:
        return places_to_listen(address, allow_remote, _DANGER)
    except ProxyError as why:
        raise ServerError(str(why)) from None


class Server:
    """A PLC that answers from a recording (docs/serve.md).

        with Server("pump.pcapng") as server:
            client.connect("127.0.0.1", 0, 1, server.port)
        assert not server.unmatched

    ``repeat``: which answer comes when the recorded ones to a request are used up, ``last`` the last one again, ``cycle`` the
    first one. ``memory``: reads return written data. ``latency_ms``: the answer time, None for the recorded one. ``faults``:
    one or several faults (`parse_fault`). ``writer`` records the traffic. The server listens at once; it raises `ServerError`
    if it cannot, `ValueError` for an invalid fault or latency.
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
        parsed = [parse_fault(fault) if isinstance(fault, str) else fault for fault in several]
        self.log = RequestLog(Stage(self.recording, repeat, memory), parsed, latency_ms)
        self.connections = 0
        self.error: Exception | None = None
        self._capture = CaptureWriter(writer) if writer is not None else None
        self._clients: set[ClientSocket] = set()
        self._plans: list[tuple[float, int, ClientSocket, Action]] = []
        self._count = 0
        self._thread: threading.Thread | None = None
        try:
            self._listener = Listener(places, MAX_CLIENTS, self.log.problems.append)
        except ProxyError as why:
            if self._capture is not None:
                self._capture.close()
            raise ServerError(str(why)) from None
        self.listening = self._listener.listening

    # ---- for users ------------------------------------------------------------------------------------------------

    @property
    def host(self) -> str:
        """The address on which it listens."""
        return str(self.listening[0].address[0])

    @property
    def port(self) -> int:
        """The port on which it listens, perhaps one that the system chose."""
        return int(self.listening[0].address[1])

    @property
    def requests(self) -> list[Request]:
        """The requests, in order of arrival (the last 10,000)."""
        return self.log.requests

    @property
    def unmatched(self) -> list[Request]:
        """The requests without a recorded match (the last 1,000)."""
        return self.log.unmatched

    @property
    def problems(self) -> deque[str]:
        """Problems for the user, one line each; whoever reports them removes them from the left."""
        return self.log.problems

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
        """Wait for its end; return True when it has ended."""
        if self._thread is not None:
            self._thread.join(timeout_s)
        return self._thread is None or not self._thread.is_alive()

    def close(self) -> None:
        """Disconnect all clients and end the thread. May be called twice."""
        self.stop()
        if self._thread is None:
            self._close()
        else:
            self._thread.join(_JOIN_S)

    def stop(self) -> None:
        """Request its end. May be called from any thread and from a signal handler, and twice."""
        self._listener.stop()

    def _work(self) -> None:
        try:
            self.run()
        except Exception as error:  # noqa: BLE001 - a thread has nobody else who would hear it
            self.error = error

    # ---- the loop ---------------------------------------------------------------------------------------------------

    def run(self) -> None:
        """Serve until `stop` is called."""
        try:
            while not self._listener.stopping:
                for what, events in self._listener.wait(self._patience()):
                    if isinstance(what, Accepted):
                        self._welcome(what)
                    elif what in self._clients:  # an earlier event may have ended it
                        self._work_on(what, events)
                self._due(time.monotonic())
        finally:
            self._close()

    def _patience(self) -> float | None:
        if not self._clients and self._listener.is_open:
            return None
        due = self._plans[0][0] if self._plans else float("inf")
        due = min([due, *[client.not_before for client in self._clients if client.not_before]])
        return min(max(due - time.monotonic(), 0), _LOOK_S)

    def _welcome(self, accepted: Accepted) -> None:
        self.connections += 1
        peer = ClientSession(self.connections, self.log)
        client = ClientSocket(self.connections, accepted.socket, peer, time.monotonic() + CONNECT_S, self._capture)
        self._clients.add(client)
        if self._capture is not None:
            self._capture.opened(client.number, accepted.name, accepted.socket.getsockname())
        self._watch(client)
        self._listener.count(len(self._clients))

    def _work_on(self, client: ClientSocket, events: int) -> None:
        try:
            if events & _READ and client.wants_read:
                octets = client.read()
                if octets is not None:
                    self._take(client, octets)
            self._flush(client)
        except BrokenError:
            self._drop(client, CLIENT)
        except Exception as bug:  # noqa: BLE001 - whatever is wrong with one client must not cost the others theirs
            self.problems.append(f"connection {client.number} is aborted: {type(bug).__name__}: {bug}")
            self._drop(client, SERVER)

    def _take(self, client: ClientSocket, octets: bytes) -> None:
        if client.leaving:
            return
        if octets:
            actions = client.peer.feed(octets)
        else:  # a client that has closed its direction may still read
            client.peer.over = True
            actions = [Action(CLOSE, last=True)]
        now = time.monotonic()
        for action in actions:
            client.held += len(action.octets)
            due = max(now + action.delay_s, client.latest) if action.last else now + action.delay_s
            if due > now:
                self._count += 1
                client.planned += 1
                client.latest = max(client.latest, due)
                heapq.heappush(self._plans, (due, self._count, client, action))
            else:
                client.put(action, now)

    def _flush(self, client: ClientSocket) -> None:
        end = client.flush(time.monotonic())
        if end == ABORT:
            self._drop(client, SERVER)
            return
        if end == CLOSE:
            client.leave(time.monotonic() + LEAVE_S)
        if client.leaving and client.finished:
            self._part(client)
        else:
            self._watch(client)

    def _watch(self, client: ClientSocket) -> None:
        events = (_READ if client.wants_read else 0) | (_WRITE if client.queue and not client.not_before else 0)
        self._listener.watch(client.socket, client.events, events, client)
        client.events = events

    def _due(self, now: float) -> None:
        """Do what is due now, and check clients without events for timeouts."""
        while self._plans and self._plans[0][0] <= now:
            _, _, client, action = heapq.heappop(self._plans)
            if client in self._clients:
                client.planned -= 1
                client.put(action, now)
                self._work_on(client, 0)
        for client in list(self._clients):
            if client.leaving:
                if now > client.leaving:
                    self._part(client)
            elif client.not_before:
                if now >= client.not_before:
                    self._work_on(client, 0)
            elif client.queue and now - client.moved > TAKE_S:
                self.problems.append(f"connection {client.number} is ended: it accepted no data for {TAKE_S:g} s")
                self._drop(client, SERVER)
            elif now > client.deadline and not client.peer.connected:
                self.problems.append(f"connection {client.number} is ended: no connect request within {CONNECT_S:g} s")
                self._drop(client, SERVER)
        self._listener.count(len(self._clients))

    # ---- ends -------------------------------------------------------------------------------------------------------

    def _drop(self, client: ClientSocket, side: int) -> None:
        if self._capture is not None:
            self._capture.reset(client.number, side)
        self._forget(client)
        close_with_reset(client.socket)

    def _part(self, client: ClientSocket) -> None:
        self._forget(client)
        client.socket.close()

    def _forget(self, client: ClientSocket) -> None:
        self._clients.discard(client)
        if client.planned:
            self._plans = [plan for plan in self._plans if plan[2] is not client]
            heapq.heapify(self._plans)
        if self._capture is not None:
            self._capture.forget(client.number)
        self._listener.unwatch(client.socket)

    def _close(self) -> None:
        for client in list(self._clients):
            if self._capture is not None:
                self._capture.closed(client.number, SERVER)
            self._part(client)
        self._listener.close()
        if self._capture is not None:
            self._capture.close()
            if self._capture.trouble:
                self.problems.append(f"the capture file is incomplete: {self._capture.trouble}")
                self._capture.trouble = ""
