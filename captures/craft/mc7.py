"""Blocks of an S7-300 of our own making: code, declarations, values, tables, header and footer (reference/mc7)."""

from __future__ import annotations

import struct
from typing import Final

STL, DB_LANGUAGE = 1, 5
OB, DB, FC = 0x08, 0x0A, 0x0C
DAY: Final = 14_500
"""2023-09-13, in days since 1984-01-01."""


class Network:
    """Code of one network, and where in it jumps stand, in octets."""

    def __init__(self, octets: str, *jumps: int) -> None:
        self.octets = bytes.fromhex(octets)
        self.jumps = jumps


def block(
    kind: int, number: int, code: bytes, interface: bytes, networks: bytes = b"", language: int = STL,
    changed: tuple[int, int] = (DAY, DAY), local: int = 0, texts: tuple[str, str, str] = ("meier", "plant", ""),
) -> bytes:  # fmt: skip
    """Return a block as it is transferred; ``changed`` are the days of code and interface, the time of day is 08:30."""
    of_day = (8 * 60 + 30) * 60_000
    size = 36 + len(code) + len(interface) + len(networks) + 36
    times = b"".join([struct.pack(">IH", of_day, day) for day in changed])
    head = struct.pack(">2sBBBBHII", b"pp", 1, 1, language, kind, number, size, 0) + times
    head += struct.pack(">HHHH", len(interface), len(networks), local, len(code))
    foot = b"".join([text.encode("ascii").ljust(8, b"\0") for text in texts])
    foot += b"\x12\x00" + (sum(code) & 0xFFFF).to_bytes(2, "big") + bytes(8)
    return head + code + interface + networks + foot


def declared(kind: int, number: int, declarations: str) -> bytes:
    """Return an interface without start values."""
    octets = bytes.fromhex(declarations)
    whole = struct.pack("<BHHH", kind, number, len(octets), 0) + octets
    return whole + bytes(len(whole) % 2)


def code_block(kind: int, number: int, networks: list[Network], declarations: str, **more: object) -> bytes:
    """Return a block of code with its tables of networks and jumps."""
    code = b"".join([network.octets for network in networks]) + b"\x65\x00"
    jumps, at = [], 0
    for network in networks:
        jumps += [(at + jump) // 2 for jump in network.jumps]
        at += len(network.octets)
    sizes = [len(network.octets) for network in networks]
    table = struct.pack(f"<{2 + len(sizes) + len(jumps)}H", len(sizes), *sizes, len(jumps), *jumps)
    return block(kind, number, code, declared(1, 0, declarations), table, **more)  # type: ignore[arg-type]


OB1_TEMP: Final = "0205" * 6 + "0505" * 3 + "0e05"
"""The start information of OB 1: six BYTE, three INT, DATE_AND_TIME."""
LOCK: Final = Network("C100 FFB80006 2002 7E420002 1314 0000", 2)
"""A I0.1, JCN over OPN DB2, L DBW2, T MW20 to NOP 0."""
OB1: Final = code_block(OB, 1, [Network("C000 300C1350 2401 F801 D884"), LOCK], OB1_TEMP, local=20)
"""A I0.0, L S5T#35S, SD T1, A T1, = Q4.0; then the lock."""
STOPS: Final = Network("C701 FFB80006 FB74002E 700B0002 0000", 2)
"""A I1.7, JCN over a call of SFC 46."""
OB1_CHANGED: Final = code_block(
    OB, 1, [Network("C000 300C1100 2401 F801 D884"), LOCK, STOPS], OB1_TEMP, local=20, changed=(DAY + 62, DAY)
)
"""The time is 10 s, and a third network stops the CPU."""
VALUES: Final = bytes.fromhex("0100 0007 002A 03E9 FFFFFF38 00000000 41480000 0603") + b"V-3\0\0\0"
"""Of the DB of captures/tags: open, state 7, position 42, cycles 1001, balance -200, pressure 12.5, name V-3."""
DB2: Final = block(
    DB, 2, VALUES, declared(5, 0, "1104 09 0104 0104 0404 0504 0404 0704 0704 0804 1304 06".replace(" ", "")), b"",
    DB_LANGUAGE, texts=("meier", "plant", "VALVE"),
)  # fmt: skip
FC3: Final = code_block(FC, 3, [Network("C200 D984")], "0101 0102", changed=(DAY + 62, DAY + 62))
