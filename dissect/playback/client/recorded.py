"""The session that is played, and the one that comes of it: both read the same way, in the order in which they began."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from dissect.engine.pipeline import Options
from dissect.golden.model import GoldenError, Link, Session
from dissect.golden.reading import SessionReader, is_golden, load_golden
from dissect.session import Run
from dissect.source.packet import CaptureError
from dissect.transactions.ending import OPEN

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.transactions.connection import Connection


class ReplayError(CaptureError):
    """A replay that cannot begin, or cannot reach its server: one line that says why and what to do."""


class Span(NamedTuple):
    """Where a connection begins and ends in its capture: packets by number, and their times in nanoseconds since 1970.

    Where its end was not captured, that is the last packet of it.
    """

    first_frame: int
    first_ns: int
    last_frame: int
    last_ns: int


class OrderedReader(SessionReader):
    """Gathers a session; ``order`` are its connections as they began, ``spans`` (by ``id`` of the link) where each stood."""

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self.order: list[Link] = []
        self.spans: dict[int, Span] = {}

    def connection_opened(self, connection: Connection) -> None:
        """Keep its place."""
        super().connection_opened(connection)
        self.order.append(self._link(connection))

    def connection_closed(self, connection: Connection) -> None:
        """Keep where it stood, now that its end is known."""
        super().connection_closed(connection)
        tcp, ending = connection.tcp, connection.ending
        last = (int(tcp.last_frame), int(tcp.last_ns))
        if ending is not None and ending.how != OPEN and ending.frame:
            last = (int(ending.frame), int(ending.time_ns))
        self.spans[id(self._link(connection))] = Span(int(tcp.first_frame), int(tcp.first_ns), *last)


class Recorded:
    """A session with its connections in the order in which they began; of a golden, in which they stand.

    ``spans`` (by ``id`` of the link) tell where each stood in its capture; a golden has none.
    """

    def __init__(self, session: Session, order: list[Link], spans: Mapping[int, Span] | None = None) -> None:
        self.session = session
        known = {id(link) for link in session.links}
        self.links = [link for link in order if id(link) in known]
        told = {id(link) for link in self.links}
        self.links += [link for link in session.links if id(link) not in told]
        self.spans = {number: span for number, span in (spans or {}).items() if number in known}


def load_recorded(path: str | os.PathLike[str], decoder: PayloadDecoder | None = None) -> Recorded:
    """Read a capture or a golden. Raises `CaptureError` for what is neither, or a golden that is wrong."""
    if os.fspath(path) != "-" and Path(path).is_file() and is_golden(path):
        try:
            session = load_golden(path)
        except GoldenError as error:
            raise ReplayError(str(error)) from None
        return Recorded(session, session.links)
    reader = OrderedReader(os.fspath(path))
    run = Run([os.fspath(path)], reader, Options(decoder=decoder))
    try:
        while run.step():
            pass
    except GoldenError as error:
        raise ReplayError(str(error)) from None
    session = reader.finish([f"{file.name}: {file.loss}" for file in run.files if file.loss])
    return Recorded(session, reader.order, reader.spans)
