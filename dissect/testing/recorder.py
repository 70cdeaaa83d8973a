"""`s7_record`: a relay on a local port that records its traffic as a capture."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import TYPE_CHECKING, Final

from dissect import __version__
from dissect.meaning.report import words
from dissect.online.net.addresses import PLC_PORT, Address, places_to_connect, places_to_listen, read_address
from dissect.online.proxy.relay import Relay
from dissect.online.proxy.source import RelayReader
from dissect.online.proxy.tap import Tap
from dissect.packets.source.packet import PacketSink
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.testing.captures import MISTAKES

if TYPE_CHECKING:
    from dissect.testing.golden.model import Session

#: The local address, for recorders and for bare ports.
LOOPBACK: Final = "127.0.0.1"
#: Seconds that `Recorder.capture` waits for clients to disconnect.
PATIENCE_S: Final = 5.0
_STEP_S: Final = 0.005
_WAIT_MS: Final = 50


class RecordError(Exception):
    """A recording failed; the message says why and what to do."""


def address_of(to: object) -> Address:
    """Return an address given as (host, port), ``HOST:PORT``, a local port, or an object with a ``port``.

    Raises TypeError for anything else.
    """
    __tracebackhide__ = True
    if isinstance(to, str):
        return read_address(to, PLC_PORT)
    if isinstance(to, tuple) and len(to) == 2:
        return Address(str(to[0]), int(to[1]))
    if isinstance(to, int):
        return Address(LOOPBACK, to)
    port = getattr(to, "port", None)
    if isinstance(port, int):
        return Address(str(getattr(to, "host", LOOPBACK)), port)
    raise TypeError(
        f"to={to!r}: give the address of the PLC: (host, port), 'HOST:PORT', a port, or a server of s7_server"
    )


class _Keeper(PacketSink):
    def __init__(self, writer: PcapngWriter) -> None:
        super().__init__()
        self._writer = writer

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self._writer.packet(time_ns, buf[start:end], wire_length, link_type, name="s7_record")


class Recorder:
    """A relay to a PLC. Clients connect to ``host`` and ``port``; `capture` ends it and returns the file at ``path``."""

    def __init__(self, to: object, path: Path) -> None:
        """Start to listen. Raises `ProxyError` if that fails, or the look-up of the PLC's name."""
        __tracebackhide__ = True
        self.path = path
        tap = Tap()
        targets = places_to_connect(address_of(to))
        self._relay = Relay(places_to_listen(Address(LOOPBACK, 0), allow_remote=False), targets, tap)
        self.host = LOOPBACK
        self.port = int(self._relay.listening[0].address[1])
        try:
            self._writer = PcapngWriter(str(path), application=f"s7dissect {__version__} s7_record", overwrite=True)
        except OSError:
            self._relay.close()
            raise
        self._tap = tap
        self._reader = RelayReader(tap, "s7_record", _WAIT_MS)
        self._errors: list[Exception] = []
        self._ended = False
        self._threads = [
            threading.Thread(target=self._work, name="s7_record-relay", daemon=True),
            threading.Thread(target=self._keep, name="s7_record-file", daemon=True),
        ]
        for thread in self._threads:
            thread.start()

    @property
    def problems(self) -> list[str]:
        """Problems that no packet shows, for example an unreachable PLC."""
        return [problem.text for problem in self._relay.problems]

    def capture(self, wait_s: float = PATIENCE_S) -> Path:
        """End the recording and return the capture; later calls return it again.

        Connected clients have ``wait_s`` to disconnect, so that the capture shows the end of their connections. Raises
        RecordError if they stay connected, or if packets were lost. Call `close` first for a capture without the ends of
        connections.
        """
        __tracebackhide__ = True
        if not self._ended:
            end = time.monotonic() + wait_s
            while self._relay.active and time.monotonic() < end:
                time.sleep(_STEP_S)
            active = self._relay.active
            self.close()
            if active:
                raise RecordError(
                    f"{words.count(active, 'client')} did not disconnect within {wait_s:g} s, so the capture lacks the end "
                    "of their connections: disconnect the clients before you call capture(), or call close() first"
                )
        for error in self._errors:
            raise RecordError(f"the recording stopped: {error}") from error
        if self._tap.lost:
            raise RecordError(f"{self._tap.lost} segments were relayed but not recorded: the recorder was too slow")
        return self.path

    def session(self, wait_s: float = PATIENCE_S) -> Session:
        """End the recording and return it as a session, which can be compared with a golden."""
        from dissect.testing.golden.reading import read_session

        return read_session(self.capture(wait_s))

    def close(self) -> None:
        """End the recording at once and disconnect all clients. May be called twice."""
        if self._ended:
            return
        self._ended = True
        self._relay.stop()
        self._threads[0].join()
        self._reader.stop()
        self._threads[1].join()

    def _work(self) -> None:
        try:
            self._relay.run()
        except Exception as error:  # noqa: BLE001 - nothing else would report an error in a thread
            self._errors.append(error)

    def _keep(self) -> None:
        keeper = _Keeper(self._writer)
        try:
            while self._reader.step(keeper):
                pass
        except Exception as error:  # noqa: BLE001 - as above
            self._errors.append(error)
        finally:
            self._reader.close()
            self._close_file()

    def _close_file(self) -> None:
        try:
            self._writer.close()
        except OSError as error:
            self._errors.append(error)


class Recorders:
    """Makes recorders: ``s7_record(to=("127.0.0.1", 102))``. They end with the test."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._made: list[Recorder] = []

    def __call__(self, to: object) -> Recorder:
        """Start to record the traffic to the PLC at ``to`` (see `address_of`)."""
        __tracebackhide__ = True
        try:
            recorder = Recorder(to, self._folder / f"recorded-{len(self._made) + 1}.pcapng")
        except MISTAKES as mistake:
            raise mistake.with_traceback(None) from None
        self._made.append(recorder)
        return recorder

    def problems(self) -> list[str]:
        """Return problems that no packet shows, each once."""
        return list(dict.fromkeys([problem for recorder in self._made for problem in recorder.problems]))

    def close(self) -> None:
        """End all recorders."""
        for recorder in self._made:
            recorder.close()
