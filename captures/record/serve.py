"""A snap7 server with known memory. Runs in either environment: python-snap7 2 is the Snap7 library in C++, 3 is pure Python.

    python serve.py PORT [MAX_CLIENTS]

Prints ``ready`` when it listens and ends when its standard input does.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
import logging
import struct
import sys

from snap7.server import Server
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


def main() -> None:
    """Serve until standard input ends."""
    port = int(sys.argv[1])
    # What the server tells of a refused request belongs to the session, not to the recorder's screen.
    logging.disable(logging.CRITICAL)
    pure = importlib.metadata.version("python-snap7").startswith("3.")
    server = Server(log=False, max_clients=int(sys.argv[2])) if pure and len(sys.argv) > 2 else Server(log=False)
    held = []
    for (area, index), size in AREAS.items():
        octets = TYPED if (area, index) == (SrvArea.DB, 2) else bytes(n % 256 for n in range(size))
        memory = (ctypes.c_uint8 * size)(*octets)
        held.append(memory)
        server.register_area(area, index, memory)
    server.start(port)
    print("ready", flush=True)
    sys.stdin.read()
    server.stop()


if __name__ == "__main__":
    main()
