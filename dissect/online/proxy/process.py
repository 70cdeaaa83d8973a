"""Runs the relay in a separate process, so that a slow dissection never delays the relayed data (the GIL is not shared).

The relay's process has the bounded queue (`dissect.online.proxy.tap`), and sends its content through a socket as fast as this
process reads. Data that does not fit into the queue is relayed, but not dissected, and counted there. The relay ends on
request, or when this process is gone.
"""

from __future__ import annotations

import contextlib
import os
import queue
import signal
import socket
import struct
import sys
import threading
import time
import warnings
from collections import deque
from typing import Final, NoReturn

import msgspec

from dissect.online.proxy.relay import Relay, RelayProblem
from dissect.online.proxy.tap import OVERHEAD, Passed, Tap, take_from
from dissect.packets.tcp.stream import Endpoint

#: At most this many octets wait in this process, plus an overhead for each message; more waits in the other process.
_MAX_HELD: Final = 4 * 1024 * 1024
_LENGTH: Final = struct.Struct(">I")
_PATIENCE_S: Final = 0.2
#: The nice value (nice(2)) of this process, so that the relay's process has priority.
_LATER: Final = 5
#: At most this many messages, and this many octets of them, are sent together.
_MOST: Final = 256
_PIECE: Final = 262_144


class _Message(msgspec.Struct, array_like=True):
    """A message from the relay: an event (``kind`` is empty for none), its counts, problems, and the error that ended it."""

    kind: str = ""
    link: int = 0
    time_ns: int = 0
    side: int = 0
    octets: bytes = b""
    skipped: int = 0
    ends: tuple[bytes, int, bytes, int] | None = None
    counts: tuple[int, int, int, int, int, int] | None = None
    problems: list[tuple[int, str]] = []
    over: bool = False
    error: str = ""


def possible() -> bool:
    """Return whether this system has fork."""
    return sys.platform != "win32"


class RelayProcess:
    """Runs ``relay``, which fills ``tap``, in another process from `start` to `stop`; no other thread may run before `start`.

    ``connections``, ``failed``, ``octets`` and ``problems`` are those of the relay, ``error`` is why it broke off. Like a tap,
    it returns events (`take`), and ``lost`` counts events that did not fit.
    """

    def __init__(self, relay: Relay, tap: Tap) -> None:
        self.listening = relay.listening
        self.connections = 0
        self.failed = 0
        self.octets = [0, 0]
        self.problems: deque[RelayProblem] = deque(maxlen=1000)
        self.lost = 0
        self.lost_octets = 0
        self.error = ""
        self._relay = relay
        self._tap = tap
        self._pid = 0
        self._queue: queue.SimpleQueue[Passed] = queue.SimpleQueue()
        self._given = 0
        self._taken = 0
        self._shut = False
        self._ours, self._theirs = socket.socketpair()
        self._thread = threading.Thread(target=self._receive, name="s7dissect-relayed", daemon=True)

    def start(self) -> None:
        """Begin to relay."""
        if sys.platform == "win32":
            raise NotImplementedError  # according to `possible`
        with warnings.catch_warnings():
            # Python warns of fork if there are threads. A fork with other threads is deprecated: the command has none yet, and
            # tests only have their own peers.
            warnings.simplefilter("ignore", DeprecationWarning)
            pid = os.fork()
        if not pid:
            self._ours.close()
            _serve(self._relay, self._tap, self._theirs)
        self._pid = pid
        self._theirs.close()
        with contextlib.suppress(OSError):
            os.nice(_LATER)  # relaying has priority
        self._relay.close()  # the sockets are the other process's
        self._thread.start()

    def stop(self) -> None:
        """Ask the relay to end. May be called from any thread and from a signal handler, and twice."""
        with contextlib.suppress(OSError):  # the relay may have ended
            self._ours.send(b"\0")

    def is_alive(self) -> bool:
        """Return whether the relay runs, or still has messages."""
        return self._thread.is_alive()

    def join(self, timeout: float | None = None) -> None:
        """Wait for its end."""
        if self._thread.ident is not None:
            self._thread.join(timeout)

    # ---- as a tap ---------------------------------------------------------------------------------------------------

    def take(self, wait_s: float) -> Passed | None:
        """Return the next event; wait up to ``wait_s`` seconds for it. None if there is none."""
        passed, size = take_from(self._queue, wait_s)
        self._taken += size
        return passed

    def shut(self) -> None:
        """Drop all further events, because they are no longer read. May be called by any thread."""
        self._shut = True

    # ---- the thread -------------------------------------------------------------------------------------------------

    def _receive(self) -> None:
        decode = msgspec.msgpack.Decoder(_Message).decode
        over = False
        try:
            with self._ours, self._ours.makefile("rb", buffering=_PIECE) as stream:
                while len(head := stream.read(_LENGTH.size)) == _LENGTH.size:
                    length = _LENGTH.unpack(head)[0]
                    octets = stream.read(length)
                    if len(octets) < length:
                        break  # the relay's process was killed while it sent
                    message = decode(octets)
                    self._take_in(message)
                    if message.over:
                        over = True
                        break
        except Exception as bug:  # noqa: BLE001 - a thread has nobody else who would hear it
            self.error = self.error or f"what its process told cannot be read: {bug}"
        finally:
            code = os.waitstatus_to_exitcode(os.waitpid(self._pid, 0)[1])
            if not over:
                how = f"was killed by signal {-code}" if code < 0 else f"ended with exit code {code}"
                self.error = self.error or f"its process {how}"

    def _take_in(self, message: _Message) -> None:
        if message.counts is not None:
            self.connections, self.failed, sent, came, self.lost, self.lost_octets = message.counts
            self.octets = [sent, came]
        for time_ns, text in message.problems:
            self.problems.append(RelayProblem(time_ns, text))
        self.error = message.error or self.error
        if not message.kind or self._shut:
            return
        while self._given - self._taken > _MAX_HELD and not self._shut:
            time.sleep(0.001)
        ends = None
        if message.ends is not None:
            client, client_port, server, server_port = message.ends
            ends = (Endpoint(client, client_port), Endpoint(server, server_port))
        self._given += len(message.octets) + OVERHEAD
        self._queue.put(
            Passed(message.kind, message.link, message.time_ns, message.side, message.octets, message.skipped, ends)
        )


# ---- the other process ------------------------------------------------------------------------------------------------


def _serve(relay: Relay, tap: Tap, to: socket.socket) -> NoReturn:
    """Relay in this process until the other process says to stop or is gone; then end this process."""
    code = 1
    try:
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)  # the other process handles signals, and stops this one
        error: list[str] = []
        done = threading.Event()
        sender = threading.Thread(target=_send, args=(relay, tap, to, done, error))
        sender.start()
        threading.Thread(target=_obey, args=(relay, to), daemon=True).start()
        # Relaying has priority over sending events: the sender's thread must release the interpreter soon.
        sys.setswitchinterval(0.000_1)
        try:
            relay.run()
        except Exception as bug:  # noqa: BLE001 - the other process says so
            error.append(f"{type(bug).__name__}: {bug}")
        done.set()
        sender.join()
        code = 0
    finally:
        os._exit(code)


def _obey(relay: Relay, to: socket.socket) -> None:
    """Stop the relay on request of the other process, or when that is gone."""
    with contextlib.suppress(OSError):
        to.recv(1)
    relay.stop()


def _send(relay: Relay, tap: Tap, to: socket.socket, done: threading.Event, error: list[str]) -> None:
    """Send the events in the tap until the relay has ended and everything is sent."""
    encode = msgspec.msgpack.Encoder().encode
    told: tuple[int, ...] = ()
    try:
        while True:
            over = done.is_set()  # checked before `take`, so that the last events are sent
            passed = tap.take(0 if over else _PATIENCE_S)
            pieces: list[bytes] = []
            size = 0
            while passed is not None:
                octets = encode(_message_of(passed))
                pieces += [_LENGTH.pack(len(octets)), octets]
                size += len(octets)
                passed = tap.take(0) if len(pieces) < _MOST and size < _PIECE else None
            counts = (relay.connections, relay.failed, relay.octets[0], relay.octets[1], tap.lost, tap.lost_octets)
            problems = [
                (one.time_ns, one.text) for one in [relay.problems.popleft() for _ in range(len(relay.problems))]
            ]
            last = over and not pieces
            if counts != told or problems or last:
                told = counts
                octets = encode(
                    _Message(counts=counts, problems=problems, over=last, error=error[0] if last and error else "")
                )
                pieces += [_LENGTH.pack(len(octets)), octets]
            if pieces:
                to.sendall(b"".join(pieces))
            if last:
                return
    except OSError:
        tap.shut()  # the other process is gone
        relay.stop()


def _message_of(passed: Passed) -> _Message:
    ends = None
    if passed.ends is not None:
        client, server = passed.ends
        ends = (client.address, client.port, server.address, server.port)
    return _Message(passed.kind, passed.link, passed.time_ns, passed.side, passed.octets, passed.skipped, ends)


class RelayThread:
    """Replaces `RelayProcess` on systems without fork: the relay in a thread, which shares the interpreter."""

    def __init__(self, relay: Relay, tap: Tap) -> None:
        self.listening = relay.listening
        self.problems = relay.problems
        self.octets = relay.octets
        self.error = ""
        self.stop = relay.stop
        self.take = tap.take
        self.shut = tap.shut
        self._relay = relay
        self._tap = tap
        self._thread = threading.Thread(target=self._work, name="s7dissect-relay", daemon=True)

    @property
    def connections(self) -> int:
        """The number of clients that reached the server."""
        return self._relay.connections

    @property
    def failed(self) -> int:
        """The number of clients that did not reach the server."""
        return self._relay.failed

    @property
    def lost(self) -> int:
        """The number of events that did not fit into the tap."""
        return self._tap.lost

    def start(self) -> None:
        """Begin to relay."""
        self._thread.start()

    def is_alive(self) -> bool:
        """Return whether the relay runs."""
        return self._thread.is_alive()

    def join(self, timeout: float | None = None) -> None:
        """Wait for its end."""
        if self._thread.ident is not None:
            self._thread.join(timeout)

    def _work(self) -> None:
        try:
            self._relay.run()
        except Exception as bug:  # noqa: BLE001 - a thread has nobody else who would hear it
            self.error = f"{type(bug).__name__}: {bug}"
