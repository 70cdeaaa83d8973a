"""One client and one server, and what goes from either to the other.

At most one piece waits in each direction, and while it does nothing more is read from its sender, so the sender feels what its
receiver does not take: that is all the back-pressure there is, the rest is TCP's. The end of a stream and a reset are passed
on as such.
"""

from __future__ import annotations

import errno
import socket
from typing import Final

#: Octets that are read at once, and wait at most in one direction.
PIECE: Final = 65_536

_NOTHING: Final = memoryview(b"")


class ResetError(Exception):
    """A side has broken the connection off, or cannot be reached any more."""

    def __init__(self, side: int) -> None:
        super().__init__(f"side {side}")
        self.side = side


class End:
    """The socket of one side, what waits to be sent to it, and how far it is done.

    ``finished``: that side sends no more. ``told``: it knows that the other side sends no more.
    """

    __slots__ = ("events", "finished", "link", "side", "socket", "told", "waiting")

    def __init__(self, link: Link, side: int, of: socket.socket) -> None:
        self.link = link
        self.side = side
        self.socket = of
        self.waiting: memoryview = _NOTHING
        self.finished = False
        self.told = False
        self.events = 0  # what the selector watches it for

    @property
    def peer(self) -> End:
        """The other end."""
        return self.link.ends[1 - self.side]

    @property
    def wants_read(self) -> bool:
        """True when more may be read from it: what it sent before is all gone."""
        return not self.finished and not self.peer.waiting

    def read(self) -> bytes | None:
        """Return what it sent, empty at its end; None when there is nothing now. Raises `ResetError`."""
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
        """Send what nothing waits before. Raises `ResetError`."""
        self.waiting = memoryview(octets)
        self.flush()

    def flush(self) -> None:
        """Send what waits, as far as it is taken; pass on the end when nothing is left. Raises `ResetError`."""
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
        """Tell whether it was reset; asked for where the selector watches for nothing."""
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
        """True when both sides have finished, and know it of each other."""
        return self.ends[0].told and self.ends[1].told


def trouble(one: socket.socket) -> int:
    """Return why nothing can be read any more, as an errno; 0 while something can be, or may still come.

    ``SO_ERROR`` would tell of a reset although there are octets to be read before it, and take it away from who reads them.
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
