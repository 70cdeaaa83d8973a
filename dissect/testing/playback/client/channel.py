"""The client's end of a transport connection on its socket: sends and receives TSDUs, and records everything."""

from __future__ import annotations

import socket
import struct
import time
from collections import deque
from collections.abc import Sequence
from typing import Final

from dissect.online.net.addresses import Place
from dissect.protocols.iso.build import build_tpkt, build_tsdu
from dissect.protocols.iso.cotp import Assembler, Tpdu, parse_tpdu
from dissect.protocols.iso.tables import CC, DR, DT, ER
from dissect.protocols.iso.tpkt import HEADER, Framer
from dissect.testing.playback.client.record import Record, RecordedConnection
from dissect.testing.playback.client.watch import Watch

#: Octets read at once, and maximum size of unprocessed messages: beyond it, reading stops and the server has to wait.
_PIECE: Final = 65_536
_MAX_WAITING: Final = 1 << 20
_DEFAULT_SIZE: Final = 65_531
#: How long the server may leave sent data unread, in seconds.
_SEND_S: Final = 30.0
_RESET: Final = struct.pack("ii", 1, 0)

OURS: Final = 0
THEIRS: Final = 1


class UnreachableError(Exception):
    """No TCP connection could be made; the message says why."""


def connect(places: Sequence[Place], timeout_s: float) -> socket.socket:
    """Return a socket connected to the first of ``places`` that accepts. Raises `UnreachableError`."""
    reason = "nowhere to connect to"
    for place in places:
        one = socket.socket(place.family, socket.SOCK_STREAM)
        try:
            one.settimeout(timeout_s)
            one.connect(place.address)
            one.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        except OSError as why:
            one.close()
            reason = f"{place}: {why.strerror or why}"
        else:
            return one
    raise UnreachableError(reason)


class Channel:
    """A connection. ``ended`` says how the server ended it, empty while it is open; nothing can be sent after that.

    ``refused``: the server answered the connect request with DR or ER. While a channel waits, ``watch`` reads the others.
    """

    def __init__(self, one: socket.socket, record: Record, watch: Watch | None = None) -> None:
        self.ended = ""
        self.refused = False
        self.their_reference = 0
        self._gone = False  # the server has closed its direction
        self._socket = one
        self._talk: RecordedConnection = record.conversation(one.getsockname(), one.getpeername())
        self._framer = Framer()
        self._framer.synced = True
        self._assembler = Assembler()
        self._waiting: deque[bytes] = deque()
        self._held = 0  # their size
        self._paused = False  # too many to continue reading
        self._confirmation: Tpdu | None = None
        self._tpdu_size = _DEFAULT_SIZE
        self._watch = watch or Watch()
        self._watch.add(one, self._arrived)

    @property
    def first_frame(self) -> int:
        """Number of its first packet in the record."""
        return self._talk.first_frame

    def open(self, connect_request: bytes, until: float) -> bool:
        """Send the CR; return True if it was confirmed before ``until`` (monotonic, seconds)."""
        requested_size = parse_tpdu(connect_request).tpdu_size
        self._send(build_tpkt(connect_request))
        while self._confirmation is None and not self.ended and self._read(until):
            pass
        confirmation = self._confirmation
        if confirmation is None:
            return False
        self.their_reference = max(confirmation.field("src_ref"), 0)
        self._tpdu_size = min([size for size in (requested_size, confirmation.tpdu_size) if size] or [_DEFAULT_SIZE])
        return True

    def send(self, tsdu: bytes) -> bool:
        """Send a TSDU in DTs of the negotiated size; return False if the connection has ended."""
        return self._send(build_tsdu(tsdu, self._tpdu_size))

    def send_tpdu(self, octets: bytes) -> bool:
        """Send a TPDU unchanged; return False if the connection has ended."""
        return self._send(build_tpkt(octets))

    def receive(self, until: float) -> bytes | None:
        """Return the next TSDU; None if none arrives before ``until``, or the connection has ended."""
        while not self._waiting:
            if self.ended or not self._read(until):
                return None
        tsdu = self._waiting.popleft()
        self._used(len(tsdu))
        return tsdu

    def poll(self) -> None:
        """Read what has already arrived."""
        self._watch.read(0)

    # ---- the end ----------------------------------------------------------------------------------------------------

    def close(self, until: float) -> None:
        """Close our direction, read the rest from the server, and close the socket."""
        if not self._gone:
            try:
                self._socket.shutdown(socket.SHUT_WR)
                self._talk.closed(OURS)
            except OSError:
                self._broken()
            self.await_end(until)
        self._talk.closed(OURS)
        self._leave()

    def reset(self) -> None:
        """Reset the connection."""
        if not self._gone:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            self._talk.reset(OURS)
        self._leave()

    def await_end(self, until: float, tcp: bool = True) -> None:
        """Read until the server ends the connection; unless ``tcp``, a DR or ER also counts as an end."""
        self._forget()
        while not (self._gone or (self.ended and not tcp)) and self._read(until):
            self._forget()

    def _forget(self) -> None:
        self._waiting.clear()
        self._used(self._held)

    def _leave(self) -> None:
        self._gone = True
        self._watch.remove(self._socket)
        self._socket.close()

    # ---- octets -----------------------------------------------------------------------------------------------------

    def _send(self, octets: bytes) -> bool:
        if self.ended:
            return False
        # Before it is sent: the answer must not be recorded earlier than the request.
        self._talk.sent(OURS, octets)
        try:
            self._socket.settimeout(_SEND_S)
            self._socket.sendall(octets)
        except OSError:
            self._broken()
            return False
        return True

    def _read(self, until: float) -> bool:
        """Read from this socket or others; return False if nothing arrived before ``until``."""
        return time.monotonic() < until and self._watch.read(until)

    def _arrived(self) -> None:
        """Read what has arrived, or the end of the server's direction."""
        try:
            self._socket.settimeout(0)
            octets = self._socket.recv(_PIECE)
        except BlockingIOError:
            return
        except OSError:
            self._broken()
            return
        if octets:
            self._talk.sent(THEIRS, octets)
            self._take(octets)
            return
        self.ended = self.ended or "closed by the server"
        self._gone = True
        self._watch.remove(self._socket)
        self._talk.closed(THEIRS)

    def _broken(self) -> None:
        self.ended = self.ended or "reset by the server"
        self._gone = True
        self._watch.remove(self._socket)
        self._talk.reset(THEIRS)

    def _used(self, octets: int) -> None:
        """Note that messages of this size were processed."""
        self._held -= octets
        if self._paused and self._held < _MAX_WAITING and not self._gone:
            self._paused = False
            self._watch.add(self._socket, self._arrived)

    def _take(self, octets: bytes) -> None:
        framer = self._framer
        framer.push(octets, 0, True)
        packets, framer.packets = framer.packets, []
        framer.faults = []
        for packet in packets:
            tpdu = parse_tpdu(packet[HEADER:])
            if tpdu.type == CC:
                self._confirmation = self._confirmation or tpdu
            elif tpdu.type in {DR, ER}:
                self.refused = self._confirmation is None
                self.ended = f"ended by the server ({tpdu.name})"
            elif tpdu.type == DT:
                tsdu = self._assembler.push(tpdu.data, tpdu.field("eot") == 1)
                if tsdu:
                    self._waiting.append(tsdu)
                    self._held += len(tsdu)
        if self._held >= _MAX_WAITING and not self._paused:
            self._paused = True
            self._watch.remove(self._socket)
