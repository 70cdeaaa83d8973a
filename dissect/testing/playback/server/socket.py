"""The socket of one client: the data that wait to be sent, piece by piece, and its time limits."""

from __future__ import annotations

import socket
from collections import deque
from typing import Final

from dissect.testing.playback.server.capture_writer import CLIENT, SERVER, CaptureWriter
from dissect.testing.playback.server.session import ABORT, CLOSE, SEND, Action, ClientSession

#: Octets that are read at once.
PIECE: Final = 16_384
#: Octets that may wait for a client that does not read, or for their time; beyond it, nothing more is read from it.
MAX_HELD: Final = 1 << 20
#: Time between pieces of an answer that is split into several segments, in seconds.
PAUSE_S: Final = 0.001


class BrokenError(Exception):
    """The client has reset the connection, or can no longer be reached."""


class ClientSocket:
    """A connected client.

    ``held`` counts octets that wait; ``not_before`` is the time at which the next piece may be sent, 0 for now. ``finished``:
    the client has closed its direction.
    """

    __slots__ = (
        "capture",
        "deadline",
        "events",
        "finished",
        "held",
        "latest",
        "leaving",
        "moved",
        "not_before",
        "number",
        "peer",
        "planned",
        "queue",
        "socket",
    )

    def __init__(
        self, number: int, one: socket.socket, peer: ClientSession, deadline: float, capture: CaptureWriter | None
    ) -> None:
        self.number = number
        self.socket = one
        self.peer = peer
        self.deadline = deadline  # time limit for its connect request
        self.events = 0  # the events that the selector watches
        self.finished = False
        self.held = 0
        self.moved = 0.0  # when it last accepted data
        self.planned = 0  # actions that are not due yet
        self.latest = 0.0  # when the last of them is due
        self.leaving = 0.0  # time limit for its end after ours, 0 before our end
        self.not_before = 0.0
        self.queue: deque[Action] = deque()
        self.capture = capture

    @property
    def wants_read(self) -> bool:
        """True if more may be read from it; data after our end are read and discarded."""
        if self.leaving:
            return not self.finished
        return not self.peer.over and self.held < MAX_HELD

    def read(self) -> bytes | None:
        """Return received octets, empty at its end; None if there are none now. Raises `BrokenError`."""
        try:
            octets = self.socket.recv(PIECE)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            raise BrokenError from None
        self.finished = not octets
        if self.capture is not None:
            if octets:
                self.capture.sent(self.number, CLIENT, octets)
            else:
                self.capture.closed(self.number, CLIENT)
        return octets

    def leave(self, until: float) -> None:
        """Close our direction, and wait for the client's end. Raises `BrokenError`.

        To close the socket at once would reset the connection if data are unread or still arrive: a different end from the
        recorded one, and some clients would lose data that they have not read yet.
        """
        self.queue.clear()
        try:
            self.socket.shutdown(socket.SHUT_WR)
        except OSError:
            raise BrokenError from None
        if self.capture is not None:
            self.capture.closed(self.number, SERVER)
        self.leaving = until

    def put(self, action: Action, now: float) -> None:
        """Take an action for now, after all that waits."""
        if not self.queue:
            self.moved = now
        size = action.pieces
        if action.kind == SEND and size:
            for at in range(0, len(action.octets), size):
                self.queue.append(action._replace(octets=action.octets[at : at + size]))
        else:
            self.queue.append(action)

    def flush(self, now: float) -> str:
        """Perform the waiting actions as far as possible; return `CLOSE` or `ABORT` when that is next. Raises `BrokenError`."""
        if now >= self.not_before:
            self.not_before = 0.0
        while self.queue and not self.not_before:
            action = self.queue[0]
            if action.kind != SEND:
                return action.kind
            try:
                sent = self.socket.send(action.octets)
            except (BlockingIOError, InterruptedError):
                return ""
            except OSError:
                raise BrokenError from None
            if self.capture is not None:
                self.capture.sent(self.number, SERVER, action.octets[:sent])
            self.held -= sent
            self.moved = now
            if sent < len(action.octets):
                self.queue[0] = action._replace(octets=action.octets[sent:])
                return ""
            self.queue.popleft()
            if action.pieces:
                self.not_before = now + PAUSE_S
        return ""


__all__ = ["ABORT", "CLOSE", "MAX_HELD", "PAUSE_S", "PIECE", "BrokenError", "ClientSocket"]
