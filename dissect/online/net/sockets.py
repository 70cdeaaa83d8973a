"""Options of TCP connections, shared by the packages that accept and relay them."""

from __future__ import annotations

import socket
import struct
from contextlib import suppress
from typing import Final

#: SO_LINGER with time 0: close with a reset, even if octets are still to be sent.
_AT_ONCE: Final = struct.pack("ii", 1, 0)


def prepare(one: socket.socket) -> None:
    """Set a connection's options: non-blocking, no delay (Nagle), keep-alives, urgent data in line."""
    one.setblocking(False)
    one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    one.setsockopt(socket.SOL_SOCKET, socket.SO_OOBINLINE, 1)


def close_with_reset(one: socket.socket) -> None:
    """Close a connection with a RST."""
    with suppress(OSError):  # the connection is broken already
        one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _AT_ONCE)
    one.close()
