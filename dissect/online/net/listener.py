"""`Listener`: listens, accepts as many clients as allowed, and can be woken and stopped from other threads.

Its owner runs the loop, and may register further sockets with ``selector``.
"""

from __future__ import annotations

import errno
import selectors
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

from dissect.online.net.addresses import Place, ProxyError, listen_on
from dissect.online.net.sockets import prepare

#: After the system ran out of sockets, no client is accepted for this many seconds.
PAUSE_S: Final = 1.0
_NO_MORE: Final = frozenset((errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM))
_READ: Final = selectors.EVENT_READ


class Accepted(NamedTuple):
    """An accepted client: its prepared socket, and its address in the form of ``accept``."""

    socket: socket.socket
    name: tuple[Any, ...]


class Listener:
    """Listens at ``places``, from the beginning; raises `ProxyError` if it cannot.

    Up to ``most`` clients are accepted; more wait in the system's queue. ``tell`` is called with a message when clients have to
    wait.
    """

    def __init__(self, places: Sequence[Place], most: int, tell: Callable[[str], None]) -> None:
        self.selector = selectors.DefaultSelector()
        self.stopping = False
        self.is_open = True
        self._most = most
        self._tell = tell
        self._paused_until = 0.0
        self._listeners: list[socket.socket] = []
        self._wake, self._woken = socket.socketpair()
        try:
            for place in places:
                self._listeners.append(listen_on(place))
        except ProxyError:
            self.close()
            raise
        self._wake.setblocking(False)
        self._woken.setblocking(False)
        self.selector.register(self._woken, _READ, None)
        for listener in self._listeners:
            self.selector.register(listener, _READ, listener)
        self.listening = [Place(listener.family, listener.getsockname()) for listener in self._listeners]

    def stop(self) -> None:
        """Ask the owner to end. May be called from any thread and from a signal handler, and twice."""
        self.stopping = True
        with suppress(OSError):  # the socket is full, so `wait` will wake up, or it is closed
            self._wake.send(b"\0")

    def wait(self, patience: float | None) -> Iterator[tuple[Any, int]]:
        """Wait up to ``patience`` seconds (None: no limit); yield (registered object, events) for each socket that is ready.

        For a new client it yields (`Accepted`, 0).
        """
        for key, events in self.selector.select(patience):
            if key.fileobj is self._woken:
                self._woken.recv(4096)
            elif key.data in self._listeners:
                visitor = self._accept(key.data) if self.is_open else None
                if visitor is not None:
                    yield visitor, 0
            else:
                yield key.data, events

    def _accept(self, listener: socket.socket) -> Accepted | None:
        try:
            client, name = listener.accept()
        except OSError as why:
            if why.errno in _NO_MORE:
                self._tell(f"accepting no clients for a moment: {why.strerror}")
                self._paused_until = time.monotonic() + PAUSE_S
                self._set(False)
            return None
        try:
            prepare(client)
        except OSError:  # the client is gone already
            client.close()
            return None
        return Accepted(client, name)

    def count(self, inside: int) -> None:
        """Stop or resume accepting: ``inside`` clients are connected. Call it for each new client, and from time to time."""
        if self.is_open and inside >= self._most:
            self._tell(f"{inside} clients are connected; more must wait until one disconnects")
            self._set(False)
        elif not self.is_open and inside < self._most and time.monotonic() >= self._paused_until:
            self._set(True)

    def _set(self, wanted: bool) -> None:
        self.is_open = wanted
        for listener in self._listeners:
            if wanted:
                self.selector.register(listener, _READ, listener)
            else:
                self.selector.unregister(listener)

    def watch(self, one: socket.socket, before: int, events: int, owner: object) -> None:
        """Watch a socket for ``events`` (0: none); so far it was watched for ``before``."""
        if events == before:
            return
        if not before:
            self.selector.register(one, events, owner)
        elif events:
            self.selector.modify(one, events, owner)
        else:
            self.selector.unregister(one)

    def unwatch(self, one: socket.socket) -> None:
        """Remove a socket from the selector, if it is registered."""
        with suppress(KeyError, ValueError):  # the socket was not watched, or is closed
            self.selector.unregister(one)

    def close(self) -> None:
        """Stop listening, and close the sockets. May be called twice."""
        for listener in self._listeners:
            listener.close()
        self.selector.close()
        self._wake.close()
        self._woken.close()
