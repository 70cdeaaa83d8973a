"""Options of TCP connections that the rooms which accept and relay them share."""

from __future__ import annotations

import socket
import struct
from contextlib import suppress
from typing import Final

#: Close with a reset, whatever is still to be sent.
_AT_ONCE: Final = struct.pack("ii", 1, 0)


def prepare(one: socket.socket) -> None:
    """Set a connection's options: nothing is held back, urgent octets stay where they are, who is gone is noticed."""
    one.setblocking(False)
    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_OOBINLINE, 1)


def close_with_reset(one: socket.socket) -> None:
    """Close a connection with a RST."""
    with suppress(OSError):  # it is broken already
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
    one.close()
