"""`stream`: the events of a connection from the octets that a program sends and receives itself."""

from __future__ import annotations

import os
import time
from collections.abc import Sequence
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self, TypeAlias

from dissect.engine.options import Options
from dissect.engine.pipeline import Pipeline
from dissect.files.session import Event, EventQueue, KeyLogFiles, Reading, Tags, decoder_of, keys_of, naming_of
from dissect.online.proxy.packets import Conversation, endpoint_of
from dissect.packets.tcp.stream import Endpoint
from dissect.wire.copies import refuse
from dissect.wire.errors import Error

if TYPE_CHECKING:
    from dissect.meaning.select import Where
    from dissect.scd.dictionary import Dictionary

#: An end of a connection: (host, port), as `socket.getpeername` gives it.
Address: TypeAlias = "tuple[str, int] | tuple[str, int, int, int]"

_ETHERNET: Final = 1
_CLIENT: Final = 0
_SERVER: Final = 1


class StreamError(Error, ValueError):
    """Octets came after the end of their direction, or an end has an invalid address."""


class Stream:
    """A connection, fed with the octets of each direction: of a proxy, a gateway, an asyncio reader. Made by `stream`.

    `client_sent` and `server_sent` return the events that the octets complete; `close` returns those that are still open. Only
    memory that `Options.memory` bounds is used. Use one `Stream` in one thread or task.
    """

    def __init__(self, client: Address, server: Address, queue: EventQueue, pipeline: Pipeline, begun: bool) -> None:
        self._ends = _end("client", client), _end("server", server)
        self._talk = Conversation(*self._ends)
        self._queue = queue
        self._now_ns = 0
        self._over = False
        self._begun = begun
        self.pipeline = pipeline

    def __repr__(self) -> str:
        return f"Stream({self._ends[0]} → {self._ends[1]}{', closed' if self._over else ''})"

    def __reduce__(self) -> str:
        raise refuse("a Stream", "it follows a connection; copy the events that it gave")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def client_sent(self, octets: bytes, time_ns: int | None = None) -> list[Event]:
        """Take octets from the client; return the events that they complete. ``time_ns``: since 1970, the present by default.

        Raises `StreamError` after the end of the direction.
        """
        return self._sent(_CLIENT, octets, time_ns)

    def server_sent(self, octets: bytes, time_ns: int | None = None) -> list[Event]:
        """Take octets from the server, as `client_sent` does."""
        return self._sent(_SERVER, octets, time_ns)

    def client_closed(self, time_ns: int | None = None) -> list[Event]:
        """The client sends nothing more (FIN); the server still may."""
        return self._closed(_CLIENT, time_ns)

    def server_closed(self, time_ns: int | None = None) -> list[Event]:
        """The server sends nothing more (FIN); the client still may."""
        return self._closed(_SERVER, time_ns)

    def close(self) -> list[Event]:
        """Return the events that are still open, because no more octets of the connection will come. May be called twice."""
        if not self._over:
            self._over = True
            self.pipeline.finish()
        return self._take()

    def _sent(self, side: int, octets: bytes, time_ns: int | None) -> list[Event]:
        try:
            return self._feed([] if self._over and not octets else self._frames(side, octets), time_ns)
        except ValueError as error:
            raise StreamError(str(error)) from None

    def _frames(self, side: int, octets: bytes) -> list[bytes]:
        if self._over:
            raise StreamError("the stream is closed")
        first: list[bytes] = [] if self._begun else self._talk.opened()
        self._begun = True
        return first + self._talk.sent(side, bytes(octets))

    def _closed(self, side: int, time_ns: int | None) -> list[Event]:
        try:
            return self._feed(self._talk.closed(side), time_ns)
        except ValueError as error:
            raise StreamError(str(error)) from None

    def _feed(self, frames: Sequence[bytes], time_ns: int | None) -> list[Event]:
        # The clock of a computer may be set back; the order of arrival is certain.
        self._now_ns = max(self._now_ns, time.time_ns() if time_ns is None else time_ns)
        for frame in frames:
            self.pipeline.frame(self._now_ns, frame, 0, len(frame), len(frame), _ETHERNET)
        return self._take()

    def _take(self) -> list[Event]:
        found = self._queue.events
        self._queue.events = []
        return found


def _end(name: str, address: Address) -> Endpoint:
    """Return an end of a connection. Raises `StreamError` for an invalid address."""
    try:
        host, port, *_ = address
        end = endpoint_of((host, port))
    except (TypeError, ValueError):
        end = None
    if end is None or not 0 <= end.port <= 0xFFFF:
        raise StreamError(f"{name}: expected (IP address, port), got {address!r}")
    return end


def stream(
    client: Address = ("127.0.0.1", 49152),
    server: Address = ("127.0.0.1", 102),
    *,
    pdus: bool = True,
    begun: bool = False,
    slow_ns: int = 1_000_000_000,
    scd: str | os.PathLike[str] | Dictionary | None = None,
    bind: str | os.PathLike[str] | None = None,
    where: str | Where | None = None,
    tls_keys: KeyLogFiles = None,
    tags: Tags = None,
) -> Stream:
    """Return a connection from ``client`` to ``server``, to be fed with the octets of each direction; it returns events.

    The events are those of `dissect.open`, and so are the arguments besides the addresses. Packets are numbered as if the
    octets had been captured. ``begun``: the connection began before the first octets.
    """
    queue = EventQueue(pdus)
    options = Options(slow_ns, decoder=decoder_of(scd, bind), tls_keys=keys_of(tls_keys), naming=naming_of(tags))
    reading = Reading((), options, where)
    pipeline = Pipeline(reading.sieved(queue), options)
    reading.begin(pipeline, [], False)
    return Stream(client, server, queue, pipeline, begun)
