"""Writes the fake PLC's traffic to a capture file, packet by packet."""

from __future__ import annotations

import time
from typing import Any, Final

from dissect.online.proxy.packets import Conversation, endpoint_of
from dissect.packets.source.pcapng_writer import PcapngWriter
from dissect.packets.tcp.link import ETHERNET

CLIENT: Final = 0
SERVER: Final = 1


class CaptureWriter:
    """Writes to ``writer``. If the file cannot be written (the disk is full), the server goes on without it."""

    def __init__(self, writer: PcapngWriter) -> None:
        self.trouble = ""
        self._writer = writer
        self._talks: dict[int, Conversation] = {}
        self._done: dict[int, set[int]] = {}  # sides that have closed

    def opened(self, number: int, client: tuple[Any, ...], server: tuple[Any, ...]) -> None:
        """Record that a client connected."""
        talk = Conversation(endpoint_of(client), endpoint_of(server), number)
        self._talks[number] = talk
        self._done[number] = set()
        self._write(talk.opened())

    def sent(self, number: int, side: int, octets: bytes) -> None:
        """Record octets sent by ``side`` (0 the client, 1 the server)."""
        if number in self._talks and side not in self._done[number]:
            self._write(self._talks[number].sent(side, octets))

    def closed(self, number: int, side: int) -> None:
        """Record that ``side`` closed its direction."""
        if number in self._talks and side not in self._done[number]:
            self._done[number].add(side)
            self._write(self._talks[number].closed(side))

    def reset(self, number: int, side: int) -> None:
        """Record a reset by ``side``."""
        talk = self._talks.pop(number, None)
        self._done.pop(number, None)
        if talk is not None:
            self._write(talk.reset(side))

    def forget(self, number: int) -> None:
        """Drop the state of a connection that has ended."""
        self._talks.pop(number, None)
        self._done.pop(number, None)

    def close(self) -> None:
        """End the file."""
        try:
            self._writer.close()
        except OSError as why:
            self.trouble = self.trouble or (why.strerror or str(why))

    def _write(self, frames: list[bytes]) -> None:
        if self.trouble:
            return
        try:
            now_ns = time.time_ns()
            for frame in frames:
                self._writer.packet(now_ns, frame, len(frame), ETHERNET, name="serve")
        except OSError as why:
            self.trouble = why.strerror or str(why)
