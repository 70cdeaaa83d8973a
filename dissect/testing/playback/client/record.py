"""Records the exchange as packets: passes them to the pipeline, which builds a session as for any capture, and to a file."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from dissect.engine.pipeline import Options, Pipeline
from dissect.online.proxy.packets import Conversation, endpoint_of
from dissect.packets.tcp.link import ETHERNET
from dissect.testing.golden.model import Link, Session
from dissect.testing.golden.reading import SessionReader

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.packets.source.pcapng_writer import PcapngWriter


class Record:
    """Records packets. If the file cannot be written, the replay goes on without it; ``trouble`` says why.

    When it is finished, ``links`` are its connections by their first packets, because addresses may be used again.
    """

    def __init__(self, name: str, writer: PcapngWriter | None = None, decoder: PayloadDecoder | None = None) -> None:
        self.trouble = ""
        self.links: dict[int, Link] = {}
        self._reader = SessionReader(name)
        self._pipeline = Pipeline(self._reader, Options(decoder=decoder))
        self._writer = writer
        self._count = 0
        self._frames = 0
        # Wall-clock time at the beginning, then advanced by a clock that never goes back.
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def conversation(self, client: tuple[Any, ...], server: tuple[Any, ...]) -> RecordedConnection:
        """Begin a connection between two socket addresses."""
        self._count += 1
        return RecordedConnection(
            self, Conversation(endpoint_of(client), endpoint_of(server), self._count), self._frames + 1
        )

    def put(self, frames: list[bytes]) -> None:
        """Take packets at the current time."""
        now_ns = time.monotonic_ns() + self._offset_ns
        self._frames += len(frames)
        for frame in frames:
            self._pipeline.frame(now_ns, frame, 0, len(frame), len(frame), ETHERNET)
        if self._writer is None or self.trouble:
            return
        try:
            for frame in frames:
                self._writer.packet(now_ns, frame, len(frame), ETHERNET, name="replay")
        except OSError as why:
            self.trouble = why.strerror or str(why)

    def finish(self) -> Session:
        """End the recording and return the session."""
        if self._writer is not None:
            try:
                self._writer.close()
            except OSError as why:
                self.trouble = self.trouble or why.strerror or str(why)
        self._pipeline.finish()
        session = self._reader.finish()
        self.links = {link.span.first_frame: link for link in session.links if link.span is not None}
        return session


class RecordedConnection:
    """A connection that is recorded. ``first_frame`` is the number of its first packet, from 1."""

    def __init__(self, record: Record, conversation: Conversation, first_frame: int) -> None:
        self.first_frame = first_frame
        self._record = record
        self._conversation = conversation
        self._closed: set[int] = set()
        self._over = False
        record.put(conversation.opened())

    def sent(self, side: int, octets: bytes) -> None:
        """Record octets sent by a side (0 is ours)."""
        if not self._over and side not in self._closed:
            self._record.put(self._conversation.sent(side, octets))

    def closed(self, side: int) -> None:
        """Record that a side closed its direction."""
        if not self._over and side not in self._closed:
            self._closed.add(side)
            self._record.put(self._conversation.closed(side))

    def reset(self, side: int) -> None:
        """Record a reset by a side."""
        if not self._over:
            self._over = True
            self._record.put(self._conversation.reset(side))
