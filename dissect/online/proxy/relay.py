"""The relay: accepts clients, connects each to the server, and passes on what they send. It uses one thread and one selector.

It has no S7 code. A `Tap` gets every piece after it was passed on, and cannot affect the relay.

At most one piece waits in each direction. While it waits, nothing more is read from its sender, so that TCP slows a sender down
when its receiver stops reading. A FIN is relayed as a FIN, a reset as a reset.
"""

from __future__ import annotations

import errno
import os
import selectors
import socket
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from dissect.online.net.addresses import Place, ProxyError, expect_no_circle
from dissect.online.net.listener import Accepted, Listener
from dissect.online.net.sockets import close_with_reset, prepare
from dissect.online.proxy.packets import endpoint_of
from dissect.online.proxy.tap import REFUSED, UNANSWERED, Tap

#: At most this many octets are read at once, and wait in one direction.
PIECE: Final = 65_536

_NOTHING: Final = memoryview(b"")


class ResetError(Exception):
    """A side has reset the connection, or can no longer be reached."""

    def __init__(self, side: int) -> None:
        super().__init__(f"side {side}")
        self.side = side


class End:
    """One side of a link: its socket, and the octets that wait to be sent to it.

    ``finished``: this side has closed its direction. ``told``: the other side's FIN was passed on to this side.
    """

    __slots__ = ("events", "finished", "link", "side", "socket", "told", "waiting")

    def __init__(self, link: Link, side: int, of: socket.socket) -> None:
        self.link = link
        self.side = side
        self.socket = of
        self.waiting: memoryview = _NOTHING
        self.finished = False
        self.told = False
        self.events = 0  # the events that the selector watches it for

    @property
    def peer(self) -> End:
        """The other end."""
        return self.link.ends[1 - self.side]

    @property
    def wants_read(self) -> bool:
        """Whether more may be read from this side: everything that it sent before was passed on."""
        return not self.finished and not self.peer.waiting

    def read(self) -> bytes | None:
        """Return what this side sent, empty at the end of its stream; None if there is nothing now. Raises `ResetError`."""
        try:
            octets = self.socket.recv(PIECE)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            raise ResetError(self.side) from None
        if not octets:
            self.finished = True
        return octets

    def send(self, octets: bytes) -> None:
        """Send octets to this side; nothing else may be waiting. Raises `ResetError`."""
        self.waiting = memoryview(octets)
        self.flush()

    def flush(self) -> None:
        """Send as much of the waiting octets as the system takes; then, if need be, pass on the end. Raises `ResetError`."""
        try:
            if self.waiting:
                self.waiting = self.waiting[self.socket.send(self.waiting) :]
            if self.peer.finished and not self.waiting and not self.told:
                self.told = True
                self.socket.shutdown(socket.SHUT_WR)
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            raise ResetError(self.side) from None

    def broken(self) -> bool:
        """Return whether this side was reset; called if the selector does not watch it."""
        try:
            return self.socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) != 0
        except OSError:
            return True


class Link:
    """A client at ``ends[0]`` and the server at ``ends[1]``."""

    __slots__ = ("ends", "number")

    def __init__(self, number: int, client: socket.socket, server: socket.socket) -> None:
        self.number = number
        self.ends = (End(self, 0, client), End(self, 1, server))

    @property
    def done(self) -> bool:
        """Whether both sides have finished, and each was sent the other's FIN."""
        return self.ends[0].told and self.ends[1].told


def trouble(one: socket.socket) -> int:
    """Return the errno that prevents further reading; 0 while octets can be read or may still come.

    ``SO_ERROR`` is not used: it would report a reset before octets that can still be read, and clear it for the later read.
    """
    try:
        one.recv(1, socket.MSG_PEEK)
    except (BlockingIOError, InterruptedError):
        return 0
    except OSError as why:
        if why.errno == errno.ENOTCONN:
            return one.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) or errno.ENOTCONN
        return why.errno or errno.EIO
    return 0


#: Greatest number of clients at once; more wait in the system's queue.
MAX_LINKS: Final = 400
#: How long a server may take to accept, in seconds, for each of its addresses.
CONNECT_S: Final = 10.0
#: Ends that the selector does not watch are checked every this many seconds.
_LOOK_S: Final = 0.1
_MAX_PROBLEMS: Final = 1000
_UNDER_WAY: Final = frozenset((errno.EINPROGRESS, errno.EWOULDBLOCK, errno.EAGAIN))

_READ: Final = selectors.EVENT_READ
_WRITE: Final = selectors.EVENT_WRITE


class RelayProblem(NamedTuple):
    """A problem that no packet shows; ``time_ns`` is nanoseconds since 1970."""

    time_ns: int
    text: str


class _Attempt:
    """A client that waits until the server has accepted its connection."""

    __slots__ = ("client", "client_name", "deadline", "number", "place", "refused", "rest", "server")

    def __init__(self, number: int, client: Accepted, places: Sequence[Place]) -> None:
        self.number = number
        self.client = client.socket
        self.client_name = client.name
        self.rest = list(places)
        self.place = places[0]
        self.server: socket.socket | None = None
        self.deadline = 0.0
        self.refused = False


class Relay:
    """Relays clients that connect to one of ``places`` to the first of ``targets`` that accepts.

    It listens at once (or raises `ProxyError`); `run` works until `stop`. ``connections`` counts clients that reached the
    server, ``failed`` those that did not, ``octets`` what clients and servers sent. Consumers take ``problems`` from the left.
    """

    def __init__(self, places: Sequence[Place], targets: Sequence[Place], tap: Tap) -> None:
        self.connections = 0
        self.failed = 0
        self.octets = [0, 0]
        self.problems: deque[RelayProblem] = deque(maxlen=_MAX_PROBLEMS)
        self._targets = list(targets)
        self._tap = tap
        self._numbers = 0
        self._links: set[Link] = set()
        self._attempts: set[_Attempt] = set()
        self._quiet: set[End] = set()  # ends that the selector does not watch now
        self._door = Listener(places, MAX_LINKS, self._note)
        self._selector = self._door.selector
        try:
            expect_no_circle(self.listening, self._targets)
        except ProxyError:
            self.close()
            raise

    @property
    def listening(self) -> list[Place]:
        """The places where it listens, with the port that the system chose for port 0."""
        return self._door.listening

    @property
    def active(self) -> int:
        """The number of clients that are connected now, including those whose server has not accepted yet."""
        return len(self._links) + len(self._attempts)

    def stop(self) -> None:
        """Ask the relay to end and disconnect all. May be called from any thread and from a signal handler, and twice."""
        self._door.stop()

    def run(self) -> None:
        """Relay until `stop` is called."""
        try:
            looked = 0.0
            while not self._door.stopping:
                for what, events in self._door.wait(self._patience()):
                    self._happened(what, events)
                now = time.monotonic()
                if now - looked >= _LOOK_S:
                    looked = now
                    self._look(now)
        finally:
            self.close()

    def _patience(self) -> float | None:
        waiting = self._quiet or self._attempts or not self._door.is_open
        return _LOOK_S if waiting else None

    def _happened(self, what: object, events: int) -> None:
        if isinstance(what, End):
            if what.link in self._links:  # an earlier event may have ended the link
                self._work(what, events)
        elif isinstance(what, _Attempt):
            if what in self._attempts:
                self._connected(what)
        elif isinstance(what, Accepted):
            self._welcome(what)

    def _note(self, text: str) -> None:
        self.problems.append(RelayProblem(time.time_ns(), text))

    # ---- beginnings -------------------------------------------------------------------------------------------------

    def _welcome(self, client: Accepted) -> None:
        self._numbers += 1
        attempt = _Attempt(self._numbers, client, self._targets)
        self._attempts.add(attempt)
        self._try_next(attempt, "")
        self._door.count(self.active)

    def _try_next(self, attempt: _Attempt, why: str) -> None:
        """Connect to the next address of the server; if there is none left, reset the client."""
        while attempt.rest:
            attempt.place = attempt.rest.pop(0)
            try:
                attempt.server = server = socket.socket(attempt.place.family, socket.SOCK_STREAM)
                prepare(server)
                code = server.connect_ex(attempt.place.address)
            except OSError as error:
                code = error.errno or errno.EIO
            if code in _UNDER_WAY or code == 0:
                assert attempt.server is not None
                attempt.deadline = time.monotonic() + CONNECT_S
                self._selector.register(attempt.server, _WRITE, attempt)
                return
            why = self._failed(attempt, code)
        self._tell_unreached(attempt, why)
        self._give_up(attempt)

    def _failed(self, attempt: _Attempt, code: int) -> str:
        """Close the socket to an address that did not work; return the reason in words."""
        attempt.refused = code in {errno.ECONNREFUSED, errno.ECONNRESET}
        if attempt.server is not None:
            attempt.server.close()
            attempt.server = None
        return os.strerror(code)

    def _tell_unreached(self, attempt: _Attempt, why: str) -> None:
        self.failed += 1
        ends = (endpoint_of(attempt.client_name), endpoint_of(attempt.place.address))
        self._tap.failed(REFUSED if attempt.refused else UNANSWERED, attempt.number, ends, time.time_ns())
        self._note(f"{attempt.place} cannot be reached: {why}; client {ends[0]} is disconnected")

    def _give_up(self, attempt: _Attempt) -> None:
        if attempt.server is not None:
            self._door.unwatch(attempt.server)
            close_with_reset(attempt.server)
        close_with_reset(attempt.client)
        self._attempts.discard(attempt)

    def _connected(self, attempt: _Attempt) -> None:
        """Handle the result of a connection attempt: the server has accepted, or refused."""
        server = attempt.server
        assert server is not None
        self._door.unwatch(server)
        code = trouble(server)
        if code:
            self._try_next(attempt, self._failed(attempt, code))
            return
        self._attempts.discard(attempt)
        self.connections += 1
        link = Link(attempt.number, attempt.client, server)
        self._links.add(link)
        ends = (endpoint_of(attempt.client_name), endpoint_of(attempt.place.address))
        self._tap.opened(link.number, ends, time.time_ns())
        for end in link.ends:
            self._watch(end)

    # ---- passing on -------------------------------------------------------------------------------------------------

    def _work(self, end: End, events: int) -> None:
        try:
            if events & _WRITE:
                end.flush()
            if events & _READ and end.wants_read:
                self._pass_on(end)
        except ResetError as reset:
            self._reset(end.link, reset.side)
            return
        except Exception as bug:  # noqa: BLE001 - whatever is wrong with one connection must not cost the others theirs
            self._note(f"connection {end.link.number} is aborted: {type(bug).__name__}: {bug}")
            self._reset(end.link, end.side)
            return
        if end.link.done:
            self._close(end.link)
            return
        self._watch(end)
        self._watch(end.peer)

    def _pass_on(self, end: End) -> None:
        """Read once, send at once, and only then give the octets to the tap."""
        octets = end.read()
        if octets is None:
            return
        now = time.time_ns()
        reset: ResetError | None = None
        try:
            if octets:
                end.peer.send(octets)
            else:
                end.peer.flush()
        except ResetError as error:
            reset = error
        if octets:
            self.octets[end.side] += len(octets)
            self._tap.sent(end.link.number, end.side, octets, now)
        else:
            self._tap.closed(end.link.number, end.side, now)
        if reset is not None:
            raise reset

    def _watch(self, end: End) -> None:
        """Let the selector watch an end for the events it needs; an end that needs none is only checked from time to time."""
        events = (_READ if end.wants_read else 0) | (_WRITE if end.waiting else 0)
        if events == end.events:
            if not events:
                self._quiet.add(end)
            return
        if events:
            self._quiet.discard(end)
        else:
            self._quiet.add(end)
        self._door.watch(end.socket, end.events, events, end)
        end.events = events

    # ---- ends -------------------------------------------------------------------------------------------------------

    def _reset(self, link: Link, side: int) -> None:
        """A side was reset: reset the other side, too."""
        self._tap.reset(link.number, side, time.time_ns())
        self._let_go(link, close_with_reset)

    def _close(self, link: Link) -> None:
        self._let_go(link, socket.socket.close)

    def _let_go(self, link: Link, close: Callable[[socket.socket], None]) -> None:
        self._tap.forget(link.number, time.time_ns())
        for end in link.ends:
            self._quiet.discard(end)
            self._door.unwatch(end.socket)
            close(end.socket)
        self._links.discard(link)

    def _look(self, now: float) -> None:
        """Check events that the selector does not report: resets of unwatched ends, and connection attempts that timed out."""
        for end in list(self._quiet):
            if end.link in self._links and end.broken():
                self._reset(end.link, end.side)
        for attempt in list(self._attempts):
            if trouble(attempt.client):
                self._give_up(attempt)
            elif now > attempt.deadline and attempt.server is not None:
                self._door.unwatch(attempt.server)
                self._try_next(attempt, self._failed(attempt, errno.ETIMEDOUT))
        self._door.count(self.active)

    def close(self) -> None:
        """Disconnect all; links with octets that were not passed on are reset, so that the receiver notices the loss.

        `run` does this at its end; call it for a relay that never ran.
        """
        for attempt in list(self._attempts):
            self._give_up(attempt)
        for link in list(self._links):
            waiting = link.ends[0].waiting or link.ends[1].waiting
            self._let_go(link, close_with_reset if waiting else socket.socket.close)
        self._door.close()
