"""Captures and key logs on disk."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from dissect.packets.source.pcapng_writer import PcapngWriter
from tests.engine.transactions.talk import Talk, dt
from tests.protocols.s7plus.pdus import INIT_SSL, asked, framed, told
from tests.protocols.tls.talks import Wire


class Film:
    """Takes the packets of a talk in place of a pipeline, and writes them to a file."""

    def __init__(self, path: Path, secrets: bytes = b"") -> None:
        self.frames = 0
        self._writer = PcapngWriter(str(path))
        if secrets:
            self._writer.secrets(secrets)

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.frames += 1
        self._writer.packet(time_ns, buf[start:end], wire_length, link_type)

    def finish(self) -> None:
        self._writer.close()


def filmed(path: Path, found: Wire, secrets: bytes = b"") -> Path:
    """Write a connection to a file: InitSSL and its answer, then TLS; ``secrets`` go into a Decryption Secrets Block."""
    talk = Talk()
    film: Any = Film(path, secrets)
    talk.pipeline = film
    talk.hello()
    talk.connect()
    talk.ask(framed(asked(1, INIT_SSL, 0, 0x30, bytes(4)), 1))
    talk.tell(framed(told(1, INIT_SSL), 1))
    for side, octets in found.flights:
        for at in range(0, len(octets), 1000):
            talk.packet(side, dt(octets[at : at + 1000]))
    talk.close()
    return path
