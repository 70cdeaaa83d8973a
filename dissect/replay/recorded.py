"""The session that is played, and the one that comes of it: both read the same way, in the order in which they began."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from dissect.conversation import Options
from dissect.golden.model import GoldenError, Link, Session
from dissect.golden.reading import SessionReader, is_golden, load_golden
from dissect.session import Run
from dissect.source.packet import CaptureError

if TYPE_CHECKING:
    from dissect.findings.carrier import Carrier
    from dissect.transactions.connection import Connection


class ReplayError(CaptureError):
    """A replay that cannot begin, or cannot reach its server: one line that says why and what to do."""


class OrderedReader(SessionReader):
    """Gathers a session; ``order`` are its connections as they began."""

    def __init__(self, name: str = "") -> None:
        super().__init__(name)
        self.order: list[Link] = []

    def connection_opened(self, connection: Connection) -> None:
        """Keep its place."""
        super().connection_opened(connection)
        self.order.append(self._link(connection))


class Recorded:
    """A session with its connections in the order in which they began; of a golden, in which they stand."""

    def __init__(self, session: Session, order: list[Link]) -> None:
        self.session = session
        known = {id(link) for link in session.links}
        self.links = [link for link in order if id(link) in known]
        told = {id(link) for link in self.links}
        self.links += [link for link in session.links if id(link) not in told]


def load_recorded(path: str | Path, carrier: Carrier | None = None) -> Recorded:
    """Read a capture or a golden. Raises `CaptureError` for what is neither, or a golden that is wrong."""
    if str(path) != "-" and Path(path).is_file() and is_golden(path):
        try:
            session = load_golden(path)
        except GoldenError as error:
            raise ReplayError(str(error)) from None
        return Recorded(session, session.links)
    reader = OrderedReader(str(path))
    run = Run([str(path)], reader, Options(carrier=carrier))
    try:
        while run.step():
            pass
    except GoldenError as error:
        raise ReplayError(str(error)) from None
    session = reader.finish([f"{file.name}: {file.damage}" for file in run.files if file.damage])
    return Recorded(session, reader.order)
