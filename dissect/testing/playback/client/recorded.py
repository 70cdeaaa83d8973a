"""The session to play, from a capture or a golden, in the order in which its connections began."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from dissect.packets.source.packet import CaptureError
from dissect.testing.golden.model import GoldenError, Session
from dissect.testing.golden.reading import read_session

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder


class ReplayError(CaptureError):
    """A replay that cannot begin, or cannot reach its server; the message says in one line why and what to do."""


def load_recorded(path: str | os.PathLike[str], decoder: PayloadDecoder | None = None) -> Session:
    """Read a capture or a golden. Raises `CaptureError` for any other file, `ReplayError` for a wrong golden."""
    try:
        return read_session(path, decoder=decoder)
    except GoldenError as error:
        raise ReplayError(str(error)) from None
