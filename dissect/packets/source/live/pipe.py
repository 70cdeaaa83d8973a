"""`PipeReader`: reads a capture from a pipe while it is made, with the readers of files but without waiting for long."""

from __future__ import annotations

import os
import queue
import select
import sys
import threading
import time
from typing import Final, Protocol

from dissect.packets.source.files import find_reader
from dissect.packets.source.live.reader import LiveError, LiveReader
from dissect.packets.source.packet import READING_FAILED, PacketSink, Reader
from dissect.packets.source.pcap import CHUNK, PCAP_MAGICS
from dissect.packets.source.pcapng import PCAPNG_MAGIC

#: How many octets show what a capture is.
_HEAD: Final = 12
#: How many pieces the thread reads ahead.
_AHEAD: Final = 4
#: How long a stopped reader continues to read data in the pipe, in seconds.
_STOP_S: Final = 0.2


class PipeOctets(Protocol):
    """Reads a pipe with a limit of time."""

    def read(self, size: int, wait_s: float | None) -> bytes | None:
        """Return up to ``size`` octets, none at the end, None when none came within ``wait_s`` seconds. Raises OSError."""

    def close(self) -> None:
        """Stop reading. The descriptor stays open: its owner closes it. May be called twice."""


if sys.platform != "win32":

    class _Polled:
        def __init__(self, descriptor: int) -> None:
            self._descriptor = descriptor
            self._poll = select.poll()
            self._poll.register(descriptor, select.POLLIN)

        def read(self, size: int, wait_s: float | None) -> bytes | None:
            """As `PipeOctets.read`."""
            if wait_s is not None and not self._poll.poll(wait_s * 1000):
                return None
            try:
                return os.read(self._descriptor, size)
            except BlockingIOError:
                return None

        def close(self) -> None:
            """As `PipeOctets.close`."""


class PipeThread:
    """Reads a pipe ahead in a thread, because on Windows there is no other way to wait for a pipe with a time limit."""

    def __init__(self, descriptor: int) -> None:
        # A duplicate: if the original is closed while the thread waits, its number may be given to another file.
        self._descriptor = os.dup(descriptor)
        self._closed = False
        self._pieces: queue.Queue[bytes | OSError] = queue.Queue(_AHEAD)
        self._thread = threading.Thread(target=self._fill, name="s7dissect-pipe", daemon=True)
        self._rest = b""
        self._ended = False

    def read(self, size: int, wait_s: float | None) -> bytes | None:
        """As `PipeOctets.read`."""
        if self._ended:
            return b""
        if not self._rest:
            if self._thread.ident is None:
                self._thread.start()
            try:
                piece = self._pieces.get(wait_s is None or wait_s > 0, wait_s)
            except queue.Empty:
                return None
            if isinstance(piece, OSError):
                self._ended = True
                raise piece
            self._ended = not piece
            self._rest = piece
        piece, self._rest = self._rest[:size], self._rest[size:]
        return piece

    def close(self) -> None:
        """As `PipeOctets.close`. A thread that waits for octets ends when some arrive, or the pipe ends."""
        if not self._closed and self._thread.ident is None:
            os.close(self._descriptor)
        self._closed = True

    def _fill(self) -> None:
        piece: bytes | OSError = b""
        more = True
        while more and not self._closed:
            try:
                piece = os.read(self._descriptor, CHUNK)
                more = bool(piece)
            except OSError as error:
                piece, more = error, False
            self._put(piece)
        os.close(self._descriptor)

    def _put(self, piece: bytes | OSError) -> None:
        while not self._closed:
            try:
                self._pieces.put(piece, timeout=_STOP_S)
            except queue.Full:
                continue
            return


def read_pipe(descriptor: int) -> PipeOctets:
    """Return an object that reads the pipe ``descriptor`` on this system."""
    if sys.platform != "win32":
        return _Polled(descriptor)
    return PipeThread(descriptor)


class StillNothingError(Exception):
    """The time is up and the pipe is still empty. The readers keep their data, and continue from there next time."""


class PipeSource:
    """The octets of a pipe. `read` waits for them until ``deadline`` (by `time.monotonic`), then raises `StillNothingError`.

    Otherwise it is an `OctetSource`. With ``deadline`` None it waits without limit. An ``owned`` descriptor is closed with the
    source.
    """

    def __init__(self, descriptor: int, owned: bool) -> None:
        self.damage = ""
        self.deadline: float | None = 0.0
        self._descriptor = descriptor
        self._owned = owned
        self._head = b""
        self._taken = 0
        self._pipe = read_pipe(descriptor)

    def gather_head(self) -> bool:
        """Read enough octets to recognise the capture, or up to the end of the pipe; return False when time is up before."""
        try:
            while len(self._head) < _HEAD:
                piece = self._more(CHUNK)
                if not piece:
                    break
                self._head += piece
        except StillNothingError:
            return False
        return True

    def starts_timed(self) -> bool:
        """Return whether this is an uncompressed capture: only that can be read up to a deadline, unlike compressed data."""
        return self._head[:4] in PCAP_MAGICS or self._head[:4] == PCAPNG_MAGIC

    def read(self, size: int) -> bytes:
        """Return up to ``size`` octets, none at the end; `StillNothingError` when none come in time."""
        if self._head:
            head = self._head
            self._head = b""
            return head
        return self._more(size)

    def close(self) -> None:
        """Release the descriptor. May be called twice."""
        self._pipe.close()
        if self._owned and self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor = -1

    def _more(self, size: int) -> bytes:
        if self.damage or self._descriptor < 0:
            return b""
        try:
            piece = self._pipe.read(size, None if self.deadline is None else max(self.deadline - time.monotonic(), 0.0))
        except OSError as error:
            self.damage = f"{READING_FAILED} {self._taken}: {error.strerror or error}"
            return b""
        if piece is None:
            raise StillNothingError
        self._taken += len(piece)
        return piece


class PipeReader(LiveReader):
    """Reads a capture from a pipe; it may have any format that files have, which its first octets show."""

    def __init__(self, source: PipeSource, name: str, engine: str, wait_ms: int) -> None:
        super().__init__("" if engine == "pipe" else name, engine, wait_ms)
        self._name = name
        self._source = source
        self._inner: Reader | None = None
        self._stop_at: float | None = None
        self._ended = False

    def step(self, sink: PacketSink) -> bool:
        """Deliver what arrives within ``wait_ms``, about 64 KiB at most; return False at the end of the pipe, or once stopped.

        `CaptureError` when it is not a capture. A compressed capture may take longer than ``wait_ms``.
        """
        if self._ended:
            return False
        self._source.deadline = time.monotonic() + self.wait_ms / 1000
        more = True
        try:
            if self._inner is None:
                self._begin()
            if self._inner is not None:
                more = self._inner.step(sink)
        except StillNothingError:
            more = self._stop_at is None
        if self._stop_at is not None and time.monotonic() >= self._stop_at:
            more = False
        self._take_over()
        if not more:
            self._ended = True
            self.close()
        return more

    def stop(self) -> None:
        """End after the present content of the pipe; the program that writes into it then finds the pipe closed."""
        if self._stop_at is None:
            self._stop_at = time.monotonic() + _STOP_S

    def close(self) -> None:
        """Release the pipe. May be called twice."""
        self._ended = True
        if self._inner is not None:
            self._inner.close()
        self._source.close()

    def _begin(self) -> None:
        if not self._source.gather_head():
            raise StillNothingError
        if not self._source.starts_timed():
            self._source.deadline = None
        self._inner = find_reader(self._source, self._name)

    def _take_over(self) -> None:
        """Take over the counts and notes of the reader that reads the pipe's content."""
        inner = self._inner
        if inner is not None:
            self.packets = inner.packets
            self.octets = inner.octets
            self.damage = inner.damage
            self.rejected = inner.rejected
            self.notes = inner.notes
            self.interface = inner.interface or self.interface


def open_stdin(wait_ms: int) -> PipeReader:
    """Return a reader of the capture on standard input, such as ``ssh gateway tcpdump -U -w -`` writes.

    Raises `LiveError` when that is closed or a terminal.
    """
    if sys.stdin is None:
        raise LiveError("standard input: closed")
    if sys.stdin.isatty():
        raise LiveError("standard input: a terminal; pipe a capture into it")
    return PipeReader(PipeSource(sys.stdin.fileno(), owned=False), "standard input", "pipe", wait_ms)
