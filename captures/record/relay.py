"""A TCP relay that treats a session as bad cables, gateways and crashed peers do.

It listens on the captured port and talks to the real server on another port, TPKT by TPKT: it passes on the peers' own octets.
``Relay(port, server_port, fault)`` is for one connection; see ``FAULTS``.
"""

from __future__ import annotations

import contextlib
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator

DELAY = 1.5
"""Seconds an answer is held back by ``slow``."""
WORK = 0.06
"""Seconds every answer takes with ``busy``: longer than a delayed ACK, for which Nagle holds a second request back."""
FAULTY = 4
"""The TPKT of its direction that a fault befalls, counted from 0: the third one after CR/CC and Setup."""


def read_tpkts(connection: socket.socket) -> Iterator[bytes]:
    """The TPKTs of one direction, until the end of the stream."""
    held = b""
    while True:
        while len(held) < 4 or len(held) < struct.unpack_from(">H", held, 2)[0]:
            try:
                octets = connection.recv(65536)
            except OSError:
                return
            if not octets:
                return
            held += octets
        size = struct.unpack_from(">H", held, 2)[0]
        yield held[:size]
        held = held[size:]


def close_with_reset(connection: socket.socket) -> None:
    """RST instead of FIN, as from a peer that crashed and restarted."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    connection.close()


class Relay:
    """Accepts one client and connects it to the server; ``fault`` names the fault on the way."""

    def __init__(self, port: int, server_port: int, fault: str) -> None:
        self._request, self._answer = FAULTS[fault]
        self._listener = socket.create_server(("127.0.0.1", port))
        self._server_port = server_port
        self._held: list[bytes] = []
        self.client: socket.socket | None = None
        self.server: socket.socket | None = None
        self._threads = [threading.Thread(target=self._accept, daemon=True)]
        self._threads[0].start()

    def _accept(self) -> None:
        self.client, _ = self._listener.accept()
        self.server = socket.create_connection(("127.0.0.1", self._server_port))
        for connection in (self.client, self.server):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for source, sink, deed in (
            (self.client, self.server, self._request),
            (self.server, self.client, self._answer),
        ):
            thread = threading.Thread(target=self._pass_on, args=(source, sink, deed), daemon=True)
            self._threads.append(thread)
            thread.start()

    def _pass_on(self, source: socket.socket, sink: socket.socket, deed: Deed | None) -> None:
        for number, tpkt in enumerate(read_tpkts(source)):
            try:
                if deed is None:
                    sink.sendall(tpkt)
                else:
                    deed(self, sink, number, tpkt)
            except OSError:
                return
        with contextlib.suppress(OSError):
            sink.shutdown(socket.SHUT_WR)

    def close(self) -> None:
        """Close what is left open, in either direction."""
        self._listener.close()
        for connection in (self.client, self.server):
            if connection is not None:
                connection.close()

    def hold(self, sink: socket.socket, tpkt: bytes, size: int) -> None:
        """Collect ``size`` TPKTs, then send them in one segment."""
        self._held.append(tpkt)
        if len(self._held) == size:
            sink.sendall(b"".join(self._held))
            self._held.clear()


Deed = Callable[[Relay, socket.socket, int, bytes], None]


def cut_with_reset(relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """The request arrives, but that side never answers: RST to the client."""
    if number == FAULTY:
        assert relay.client is not None
        close_with_reset(relay.client)
    else:
        sink.sendall(tpkt)


def cut_with_fin(relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """The request arrives, and the server ends the connection properly without an answer."""
    if number == FAULTY:
        assert relay.client is not None
        relay.client.shutdown(socket.SHUT_WR)
    else:
        sink.sendall(tpkt)


def lose(_relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """From one answer on, all are dropped; the connection stays up."""
    if number != FAULTY:
        sink.sendall(tpkt)


def lose_all(_relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """From one answer on nothing comes back; the connection stays up."""
    if number < FAULTY:
        sink.sendall(tpkt)


def slow(_relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """One answer comes late."""
    if number == FAULTY:
        time.sleep(DELAY)
    sink.sendall(tpkt)


def busy(_relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """Every answer after CC and Setup takes a while, so that a client that does not wait has several requests open."""
    if number >= 2:
        time.sleep(WORK)
    sink.sendall(tpkt)


def twice(_relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """One answer is sent twice, as new TCP octets and not as a retransmission."""
    sink.sendall(tpkt)
    if number == FAULTY:
        sink.sendall(tpkt)


def slivers(_relay: Relay, sink: socket.socket, _number: int, tpkt: bytes) -> None:
    """Seven octets per segment: every TPKT spans several segments, and some headers are split."""
    for start in range(0, len(tpkt), 7):
        sink.sendall(tpkt[start : start + 7])
        time.sleep(0.001)


def batched(relay: Relay, sink: socket.socket, number: int, tpkt: bytes) -> None:
    """After CC and Setup, two answers at a time in one segment."""
    if number < 2:
        sink.sendall(tpkt)
    else:
        relay.hold(sink, tpkt, 2)


FAULTS: dict[str, tuple[Deed | None, Deed | None]] = {
    "cut-with-reset": (cut_with_reset, None),
    "cut-with-fin": (cut_with_fin, None),
    "lose": (None, lose),
    "lose-all": (None, lose_all),
    "slow": (None, slow),
    "busy": (None, busy),
    "twice": (None, twice),
    "slivers": (None, slivers),
    "batched": (None, batched),
}
"""What is done to (requests, answers); None passes them on as they are."""
