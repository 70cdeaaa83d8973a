"""Octets of IBH-NetLink packets, composed without the package; `SEEN` are those known from libnodave."""

from __future__ import annotations

import struct
from typing import Final

from tests.engine.transactions.talk import dbw, read, words

REQUEST: Final = 0x82
INDICATION: Final = 0x2C2


def packet(
    octets: bytes, r_flags: int = 0, s_flags: int = 0, number: int = 0, channels: tuple[int, int] = (7, 255)
) -> bytes:
    return bytes((*channels, len(octets), number)) + struct.pack("<HH", s_flags, r_flags) + octets


def short(function: int, octets: bytes = b"", number: int = 1, station: int = 2) -> bytes:
    """A packet to the gateway."""
    body = bytes((function, number)) + octets
    return packet(bytes((20, 20, station, 0, len(body))) + body, REQUEST, number=4)


def long(function: int, octets: bytes = b"", number: int = 1, station: int = 2) -> bytes:
    """A packet from the gateway."""
    body = bytes((function, number)) + octets
    return packet(bytes((20, 20, station, 0, 0, 0x22, len(body))) + body, INDICATION, channels=(255, 7))


CLAIM: Final = packet(b"\x15\xff\xf0\xf0\xf0\xf0", 0x97, number=1)
CLAIMED: Final = packet(b"\x15\x00", s_flags=0x97, number=1, channels=(255, 7))
RECEIPT: Final = packet(b"\x14\x00\x03\x01\x09", s_flags=0x82, number=2, channels=(255, 7))
DISCONNECT: Final = packet(b"\x14\x14\x02\x00\x01\x80", REQUEST, number=8)
ASK: Final = short(0xF1, read(1, dbw(1, 0)))
TELL: Final = long(0xF1, words(1, 42))
ACK: Final = short(0xB0, b"\x07")

#: Octets on the wire, kind, function, meaning.
SEEN: Final[list[tuple[str, str, int, str]]] = [
    ("00ff03000000040003 0702", "service", -1, "bus parameters asked"),
    ("07ff080100009600 0000000000000a01", "service", -1, "stations asked"),
    ("0010010000000100 0f", "service", -1, "device asked"),
    ("07ff060100009700 15fff0f0f0f0", "service", -1, "connection asked"),
    ("ff07020197000000 1400", "service", -1, "connection answered"),
    ("07ff110200008200 14000201 0c e0 0400800002000201000100", "mpi_connect", 0xE0, "MPI connect request"),
    ("ff0713000000c202 151402000022 0c d0 0400800002000201000100", "mpi_confirm", 0xD0, "MPI connect confirm"),
    ("07ff070300008200 15140200 02 05 01", "mpi_go_ahead", 0x05, "MPI go ahead"),
    ("ff0709000000c202 151402000022 02 05 01", "mpi_go_ahead", 0x05, "MPI go ahead"),
    ("ff07050282000000 1400030109", "receipt", -1, "receipt"),
    ("07ff080500008200 15140200 03 b0 0100", "mpi_ack", 0xB0, "MPI acknowledge"),
    ("07ff060800008200 14140200 01 80", "mpi_disconnect", 0x80, "MPI disconnect"),
    ("07ff050300008200 ffff020000", "mpi_other", -1, "MPI request asked"),
    ("ff07000000000000", "other", -1, "none"),
]
