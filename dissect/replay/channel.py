"""The client's end of a transport connection on its socket: TSDUs out, TSDUs in, and everything into the record."""

from __future__ import annotations

import errno
import socket
import struct
import time
from collections import deque
from collections.abc import Sequence
from typing import Final

from dissect.iso.cotp import Assembler, Tpdu, parse_tpdu
from dissect.iso.tables import CC, DR, DT, ER
from dissect.iso.tpkt import HEADER, Framer
from dissect.proxy.addresses import Place
from dissect.replay.record import Record, Talk
from dissect.server.answers import data_tpdus, tpkt

#: Octets read at once, and messages that wait to be looked at.
_PIECE: Final = 65_536
_MAX_WAITING: Final = 10_000
_DEFAULT_SIZE: Final = 65_531
#: How long the server may leave what it is sent, in seconds.
_SEND_S: Final = 30.0
_RESET: Final = struct.pack("ii", 1, 0)

OURS: Final = 0
THEIRS: Final = 1


class UnreachableError(Exception):
    """No TCP connection could be made: why."""


def connect(places: Sequence[Place], timeout_s: float) -> socket.socket:
    """Return a socket that is connected to the first of ``places`` that takes it. Raises `UnreachableError`."""
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
    """A connection. ``ended`` says how the server ended it (empty while it has not); nothing can be sent then.

    ``refused`` tells that the connect request was answered with DR or ER.
    """

    def __init__(self, one: socket.socket, record: Record) -> None:
        self.ended = ""
        self.refused = False
        self.their_reference = 0
        self._gone = False  # the server sends nothing any more
        self._socket = one
        self._talk: Talk = record.conversation(one.getsockname(), one.getpeername())
        self._framer = Framer()
        self._framer.synced = True
        self._assembler = Assembler()
        self._waiting: deque[bytes] = deque()
        self._confirmation: Tpdu | None = None
        self._tpdu_size = _DEFAULT_SIZE

    @property
    def name(self) -> str:
        """Our end, as sessions name it."""
        return self._talk.client

    def open(self, connect_request: bytes, until: float) -> bool:
        """Send the CR; True when it was confirmed before ``until`` (monotonic, seconds)."""
        asked = parse_tpdu(connect_request).tpdu_size
        self._send(tpkt(connect_request))
        while self._confirmation is None and not self.ended and self._read(until):
            pass
        confirmation = self._confirmation
        if confirmation is None:
            return False
        self.their_reference = max(confirmation.field("src_ref"), 0)
        self._tpdu_size = min([size for size in (asked, confirmation.tpdu_size) if size] or [_DEFAULT_SIZE])
        return True

    def send(self, tsdu: bytes) -> bool:
        """Send a TSDU, in as many DTs as the negotiated size takes; False when that cannot be done any more."""
        return self._send(data_tpdus(tsdu, self._tpdu_size))

    def send_tpdu(self, octets: bytes) -> bool:
        """Send a TPDU as it is; False when that cannot be done any more."""
        return self._send(tpkt(octets))

    def receive(self, until: float) -> bytes | None:
        """Return the next TSDU; None when none came before ``until``, or none can come any more."""
        while not self._waiting:
            if self.ended or not self._read(until):
                return None
        return self._waiting.popleft()

    # ---- the end ----------------------------------------------------------------------------------------------------

    def close(self, until: float) -> None:
        """Send no more, take what the server still says, and leave."""
        if not self._gone:
            try:
                self._socket.shutdown(socket.SHUT_WR)
                self._talk.closed(OURS)
            except OSError:
                self._broken()
            self.await_end(until)
        self._talk.closed(OURS)
        self._socket.close()

    def reset(self) -> None:
        """Break off."""
        if not self._gone:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _RESET)
            self._talk.reset(OURS)
        self._socket.close()

    def await_end(self, until: float, tcp: bool = True) -> None:
        """Take what comes until the server ends the connection; unless ``tcp``, a DR or ER is an end as well."""
        while not (self._gone or (self.ended and not tcp)) and self._read(until):
            self._waiting.clear()

    # ---- octets -----------------------------------------------------------------------------------------------------

    def _send(self, octets: bytes) -> bool:
        if self.ended:
            return False
        # Before it leaves: the answer must not be older than the request.
        self._talk.sent(OURS, octets)
        try:
            self._socket.settimeout(_SEND_S)
            self._socket.sendall(octets)
        except OSError:
            self._broken()
            return False
        return True

    def _read(self, until: float) -> bool:
        """Read some octets; False when none came before ``until``."""
        left = until - time.monotonic()
        if left <= 0:
            return False
        try:
            self._socket.settimeout(left)
            octets = self._socket.recv(_PIECE)
        except TimeoutError:
            return False
        except OSError as why:
            if why.errno != errno.EAGAIN:
                self._broken()
            return True
        if not octets:
            self.ended = self.ended or "closed by the server"
            self._gone = True
            self._talk.closed(THEIRS)
            return True
        self._talk.sent(THEIRS, octets)
        self._take(octets)
        return True

    def _broken(self) -> None:
        self.ended = self.ended or "reset by the server"
        self._gone = True
        self._talk.reset(THEIRS)

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
                if tsdu and len(self._waiting) < _MAX_WAITING:
                    self._waiting.append(tsdu)
