"""The socket of one client: what waits to be sent to it, piece by piece, and what it may still say."""

from __future__ import annotations

import socket
from collections import deque
from typing import Final

from dissect.playback.server.capture_writer import CLIENT, SERVER, CaptureWriter
from dissect.playback.server.session import ABORT, CLOSE, SEND, ClientSession, Deed

#: Octets that are read at once.
PIECE: Final = 16_384
#: Octets that may wait for a client that does not read, or for their time: more is not read from it then.
MAX_HELD: Final = 1 << 20
#: Between pieces of an answer that comes in several segments, in seconds.
PAUSE_S: Final = 0.001


class BrokenError(Exception):
    """The client has broken the connection off, or cannot be reached any more."""


class ClientSocket:
    """A connected client. ``held`` counts octets that wait; ``not_before`` is when the next piece may be sent, 0 for now.

    ``finished`` tells that the client sends no more.
    """

    __slots__ = (
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
        "tape",
    )

    def __init__(
        self, number: int, one: socket.socket, peer: ClientSession, deadline: float, tape: CaptureWriter | None
    ) -> None:
        self.number = number
        self.socket = one
        self.peer = peer
        self.deadline = deadline  # by when it must have asked for a connection
        self.events = 0  # what the selector watches it for
        self.finished = False
        self.held = 0
        self.moved = 0.0  # when it last took something
        self.planned = 0  # deeds whose time has not come
        self.latest = 0.0  # when the last of them is due
        self.leaving = 0.0  # we have said our last: by when it must have said its own, 0 before
        self.not_before = 0.0
        self.queue: deque[Deed] = deque()
        self.tape = tape

    @property
    def wants_read(self) -> bool:
        """True when more may be read from it; what comes behind our end is read to be thrown away."""
        if self.leaving:
            return not self.finished
        return not self.peer.over and self.held < MAX_HELD

    def read(self) -> bytes | None:
        """Return what it sent, empty at its end; None when there is nothing now. Raises `BrokenError`."""
        try:
            octets = self.socket.recv(PIECE)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            raise BrokenError from None
        self.finished = not octets
        if self.tape is not None:
            if octets:
                self.tape.sent(self.number, CLIENT, octets)
            else:
                self.tape.closed(self.number, CLIENT)
        return octets

    def leave(self, until: float) -> None:
        """Send no more, and wait for the end of the client. Raises `BrokenError`.

        To close at once would be a reset as soon as anything has come that nobody read, or comes: another end than was
        recorded, and one that takes from some clients what they have not read yet.
        """
        self.queue.clear()
        try:
            self.socket.shutdown(socket.SHUT_WR)
        except OSError:
            raise BrokenError from None
        if self.tape is not None:
            self.tape.closed(self.number, SERVER)
        self.leaving = until

    def put(self, deed: Deed, now: float) -> None:
        """Take what is to be done now, behind all that waits."""
        if not self.queue:
            self.moved = now
        size = deed.pieces
        if deed.kind == SEND and size:
            for at in range(0, len(deed.octets), size):
                self.queue.append(deed._replace(octets=deed.octets[at : at + size]))
        else:
            self.queue.append(deed)

    def flush(self, now: float) -> str:
        """Do what waits as far as it can be done; return `CLOSE` or `ABORT` when that comes next. Raises `BrokenError`."""
        if now >= self.not_before:
            self.not_before = 0.0
        while self.queue and not self.not_before:
            deed = self.queue[0]
            if deed.kind != SEND:
                return deed.kind
            try:
                sent = self.socket.send(deed.octets)
            except (BlockingIOError, InterruptedError):
                return ""
            except OSError:
                raise BrokenError from None
            if self.tape is not None:
                self.tape.sent(self.number, SERVER, deed.octets[:sent])
            self.held -= sent
            self.moved = now
            if sent < len(deed.octets):
                self.queue[0] = deed._replace(octets=deed.octets[sent:])
                return ""
            self.queue.popleft()
            if deed.pieces:
                self.not_before = now + PAUSE_S
        return ""


__all__ = ["ABORT", "CLOSE", "MAX_HELD", "PAUSE_S", "PIECE", "BrokenError", "ClientSocket"]
