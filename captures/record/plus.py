"""Record S7comm-plus between the client and the server of the package s7commplus, through the relay of `s7dissect proxy`.

PYTHONPATH=. python captures/record/plus.py captures/s7plus/s7commplus.pcapng

Both ends are of one hand and looser than a PLC (captures/README.md), so that the recording shows how a session runs and is no
witness for the format.
"""

from __future__ import annotations

import contextlib
import re
import signal
import socket
import struct
import subprocess
import sys

LOOPBACK = "127.0.0.1"
VARIABLES = {"temperature": ("Real", 0), "pressure": ("Real", 4), "count": ("Int", 8)}


def free_port() -> int:
    """Return a port of this machine that nobody listens at."""
    with socket.create_server((LOOPBACK, 0)) as server:
        return int(server.getsockname()[1])


def talk(port: int) -> None:
    """Write, read one and two values, read what is not there, look around, read again three times."""
    from s7commplus.client import S7CommPlusClient

    client = S7CommPlusClient()
    client.connect(LOOPBACK, port=port)
    client.db_write(1, 0, struct.pack(">f", 21.5))
    client.db_read_multi([(1, 0, 4), (1, 4, 4)])
    with contextlib.suppress(Exception):
        client.db_read(7, 0, 4)
    client.get_cpu_state()
    client.explore()
    for _ in range(3):
        client.db_read(1, 0, 4)
    client.disconnect()


def main(path: str) -> None:
    """Record one session to ``path``."""
    from s7commplus.server import S7CommPlusServer

    server = S7CommPlusServer()
    server.register_db(1, VARIABLES)
    port = free_port()
    server.start(host=LOOPBACK, port=port)
    command = [
        sys.executable,
        "-m",
        "dissect",
        "proxy",
        "--listen",
        f"{LOOPBACK}:0",
        "--to",
        f"{LOOPBACK}:{port}",
        "-w",
        path,
    ]
    with subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True) as relay:
        assert relay.stderr is not None
        found = re.search(r"listening on [0-9.]+:([0-9]+),", relay.stderr.readline())
        assert found is not None
        talk(int(found[1]))
        relay.send_signal(signal.SIGTERM)
    server.stop()


if __name__ == "__main__":
    main(sys.argv[1])
