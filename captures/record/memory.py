"""The initial memory of the server for the recordings."""

from __future__ import annotations

import struct

from snap7.type import SrvArea

AREAS = {
    (SrvArea.DB, 1): 600,
    (SrvArea.DB, 2): 100,
    (SrvArea.DB, 10): 64,
    (SrvArea.MK, 0): 128,
    (SrvArea.PE, 0): 128,
    (SrvArea.PA, 0): 128,
    (SrvArea.TM, 0): 64,
    (SrvArea.CT, 0): 64,
}
"""Octets of each area; octet n holds n modulo 256, but for DB2, which holds ``TYPED``."""
TYPED = struct.pack(
    ">?b2shHiIf8s", True, -5, b"OK", -1234, 54321, -123456789, 4000000000, 3.5, b"\x06\x04Pump\x00\x00"
).ljust(100, b"\x00")


def memory_of(area: SrvArea, index: int) -> bytes:
    """The initial contents of an area."""
    return TYPED if (area, index) == (SrvArea.DB, 2) else bytes(n % 256 for n in range(AREAS[area, index]))
