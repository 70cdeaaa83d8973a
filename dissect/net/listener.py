"""Where clients come in: listens, accepts as many as there is room for, and can be woken and stopped from outside.

Its loop is its owner's, who also registers sockets of his own with ``selector``.
"""

from __future__ import annotations

import errno
import selectors
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any, Final, NamedTuple

from dissect.net.addresses import Place, ProxyError, listen_on
from dissect.net.sockets import prepare

#: How long no client is accepted after the system had no more sockets, in seconds.
PAUSE_S: Final = 1.0
_NO_MORE: Final = frozenset((errno.EMFILE, errno.ENFILE, errno.ENOBUFS, errno.ENOMEM))
_READ: Final = selectors.EVENT_READ


class Accepted(NamedTuple):
    """A client that was accepted, its socket prepared, and its end as ``accept`` gives it."""

    socket: socket.socket
    name: tuple[Any, ...]


class Listener:
    """Listens at ``places``, at once (`ProxyError` when it cannot).

    ``most`` clients are let in; more wait in the system's queue. ``tell`` is given a line when somebody has to wait.
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
        with suppress(OSError):  # it is awake, or gone
            self._wake.send(b"\0")

    def wait(self, patience: float | None) -> Iterator[tuple[Any, int]]:
        """Yield what happens within ``patience`` seconds (None: however long it takes): what was registered, and its events.

        For somebody who came in a `Accepted`, and 0.
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
        except OSError:  # gone again
            client.close()
            return None
        return Accepted(client, name)

    def count(self, inside: int) -> None:
        """Let in more, or nobody for now: so many are inside. To be said when somebody came, and from time to time."""
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
        """Watch a socket for ``events`` (0: for none) where it was watched for ``before``."""
        if events == before:
            return
        if not before:
            self.selector.register(one, events, owner)
        elif events:
            self.selector.modify(one, events, owner)
        else:
            self.selector.unregister(one)

    def unwatch(self, one: socket.socket) -> None:
        """Take a socket out of the selector; nothing happens when it is not in there."""
        with suppress(KeyError, ValueError):  # it was not watched, or is closed
            self.selector.unregister(one)

    def close(self) -> None:
        """Listen no more. May be called twice."""
        for listener in self._listeners:
            listener.close()
        self.selector.close()
        self._wake.close()
        self._woken.close()
