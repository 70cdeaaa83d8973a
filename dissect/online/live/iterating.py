"""`live`: the events of an interface, for a program to iterate over."""

from __future__ import annotations

import asyncio
import os
from collections import deque
from collections.abc import AsyncIterator, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Final, Self

from dissect.engine.options import Options
from dissect.files.session import Event, EventQueue, KeyLogFiles, Reading, Tags, decoder_of, keys_of, naming_of
from dissect.online.live.run import Limits, LiveRun
from dissect.packets.source.live.opening import open_live
from dissect.packets.source.live.reader import Drops
from dissect.wire.copies import refuse

if TYPE_CHECKING:
    from dissect.engine.observer import Observer
    from dissect.meaning.select import Where
    from dissect.packets.source.packet import Reader
    from dissect.scd.dictionary import Dictionary

_SECOND: Final = 10**9


class Live:
    """The events of an interface, as they happen: a context manager, an iterator and an async iterator. Made by `live`.

    Reading happens while the program waits for the next event; packets that arrive in the meantime wait in the kernel's buffer.
    Packets that do not fit there are lost and counted (``drops``; there is also a finding ``capture.dropped``). After `stop`,
    which any thread and a signal handler may call, the iteration still returns the events of packets that already arrived, then
    those of open connections, and then ends. Use one `Live` in one thread or task.
    """

    def __init__(self, source: Reader, queue: EventQueue, observer: Observer, options: Options, limits: Limits) -> None:
        self._queue = queue
        self._events: deque[Event] = deque()
        self._run = LiveRun(source, observer, options, limits=limits)
        self._over = False

    @property
    def drops(self) -> Drops:
        """How many packets were lost so far, in the kernel and at the interface; None if that is not known."""
        return self._run.drops

    @property
    def packets(self) -> int:
        """How many packets were read so far."""
        return int(self._run.pipeline.frames)

    @property
    def run(self) -> LiveRun:
        """The run, with its pipeline."""
        return self._run

    def __repr__(self) -> str:
        return f"Live({self.packets} packets{', ended' if self._over else ''})"

    def __reduce__(self) -> str:
        raise refuse("a Live", "it reads an interface")

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await asyncio.to_thread(self.close)

    def __iter__(self) -> Iterator[Event]:
        return self

    def __next__(self) -> Event:
        while not self._events:
            if self._over:
                raise StopIteration
            self._step()
        return self._events.popleft()

    def __aiter__(self) -> AsyncIterator[Event]:
        return self

    async def __anext__(self) -> Event:
        while not self._events:
            if self._over:
                raise StopAsyncIteration
            await asyncio.to_thread(self._step)
        return self._events.popleft()

    def poll(self) -> list[Event]:
        """Wait a moment (50 ms) at most, and return the events that came; empty for none, and after the end."""
        if not self._events and not self._over:
            self._step()
        found = list(self._events)
        self._events.clear()
        return found

    def stop(self) -> None:
        """End the reading: the events of packets that already arrived are still returned.

        May be called by any thread, and twice.
        """
        self._run.stop()

    def close(self) -> None:
        """Stop, and release the interface. Events that were not taken are dropped."""
        self._run.stop()
        if not self._over:
            self._over = True
            self._run.finish()
        self._events.clear()
        self._queue.events.clear()

    def _step(self) -> None:
        if self._over:
            return
        more = self._run.step()
        if not more:
            self._over = True
            self._run.finish()
        self._events.extend(self._queue.events)
        self._queue.events.clear()


def live(
    interface: str,
    *,
    filter: str = "",  # noqa: A002 - what it is called everywhere else
    pdus: bool = True,
    seconds: float = 0,
    packets: int = 0,
    engine: str = "auto",
    overdue_ns: int = 0,
    slow_ns: int = 1_000_000_000,
    scd: str | os.PathLike[str] | Dictionary | None = None,
    bind: str | os.PathLike[str] | None = None,
    checksums: bool = False,
    where: str | Where | None = None,
    tls_keys: KeyLogFiles = None,
    tags: Tags = None,
) -> Live:
    """Return the events of an interface as they happen, like `dissect.open`: iterate over them, also with ``async for``.

    ``filter`` is a capture filter ("tcp port 102"; empty: everything). ``interface`` may also be ``-``, a capture on standard
    input, or a named pipe. The run ends by itself after so many ``seconds`` or ``packets`` (0: no limit). ``engine`` is
    dumpcap, ring or auto (docs/live.md). ``overdue_ns``: a request that is open for longer is a finding at once. The other
    arguments are those of `dissect.open`. Raises `dissect.packets.source.live.reader.LiveError`, a `CaptureError`, with advice,
    if the interface cannot be opened.
    """
    queue = EventQueue(pdus)
    options = Options(
        slow_ns,
        decoder=decoder_of(scd, bind),
        overdue_ns=overdue_ns,
        checksums=checksums,
        tls_keys=keys_of(tls_keys),
        naming=naming_of(tags),
    )
    reading = Reading((), options, where)
    source = open_live(interface, filter, engine)
    limits = Limits(round(seconds * _SECOND), packets)
    found = Live(source, queue, reading.sieved(queue), options, limits)
    reading.begin(found.run.pipeline, [], False)
    return found
