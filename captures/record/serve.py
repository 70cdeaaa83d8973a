"""A snap7 server with known memory. Runs in either environment: python-snap7 2 is the Snap7 library in C++, 3 is pure Python.

    python serve.py PORT [MAX_CLIENTS]

Prints ``ready`` when it listens and ends when its standard input does.
"""

from __future__ import annotations

import ctypes
import importlib.metadata
import logging
import sys

from memory import AREAS, memory_of
from snap7.server import Server


def main() -> None:
    """Serve until standard input ends."""
    port = int(sys.argv[1])
    # The server's messages about refused requests belong to the session, not on the recorder's screen.
    logging.disable(logging.CRITICAL)
    pure = importlib.metadata.version("python-snap7").startswith("3.")
    server = Server(log=False, max_clients=int(sys.argv[2])) if pure and len(sys.argv) > 2 else Server(log=False)
    held = []
    for (area, index), size in AREAS.items():
        memory = (ctypes.c_uint8 * size)(*memory_of(area, index))
        held.append(memory)
        server.register_area(area, index, memory)
    server.start(port)
    print("ready", flush=True)
    sys.stdin.read()
    server.stop()


if __name__ == "__main__":
    main()
