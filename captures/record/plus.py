"""Record S7comm-plus between the client and the server of the package s7commplus, through the relay of `s7dissect proxy`.

PYTHONPATH=. python captures/record/plus.py captures/s7plus/s7commplus.pcapng PYTHONPATH=. python captures/record/plus.py --tls
captures/s7plus/s7commplus-tls.pcapng

With ``--tls`` the session continues in TLS, and editcap puts the keys that the server logged into the capture, as a Decryption
Secrets Block. They open only this one session between two programs, and its certificate is made for it.

Both ends come from one author and are less strict than a PLC (captures/README.md), so the recording shows the course of a
session, but is no evidence for the format.
"""

from __future__ import annotations

import argparse
import contextlib
import datetime
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

LOOPBACK = "127.0.0.1"
VARIABLES = {"temperature": ("Real", 0), "pressure": ("Real", 4), "count": ("Int", 8)}
SUBJECT = "PLC_1/Communication"


def free_port() -> int:
    """Return a port of this machine that nobody listens at."""
    with socket.create_server((LOOPBACK, 0)) as server:
        return int(server.getsockname()[1])


def write_certificate(path: Path) -> None:
    """Write a new key and a certificate that it signs itself, as a CPU does, to ``path`` (PEM)."""
    from cryptography import x509
    from cryptography.hazmat.primitives import hashes, serialization
    from cryptography.hazmat.primitives.asymmetric import rsa

    key = rsa.generate_private_key(65537, 2048)
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, SUBJECT)])
    begins = datetime.datetime(2025, 1, 1, tzinfo=datetime.UTC)
    builder = x509.CertificateBuilder(name, name, key.public_key(), 4711, begins, begins.replace(year=2055))
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    path.write_bytes(private + builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM))


def serve(server: Any, port: int, folder: Path, tls: bool) -> None:
    """Start a server; with ``tls`` its key log is written to ``folder``/keys.

    The package has no option for a key log, so its context is changed from outside.
    """
    server.register_db(1, VARIABLES)
    if not tls:
        server.start(host=LOOPBACK, port=port)
        return
    pem = folder / "pem"
    write_certificate(pem)
    server.start(host=LOOPBACK, port=port, use_tls=True, tls_cert=str(pem), tls_key=str(pem))
    server._ssl_context.keylog_filename = str(folder / "keys")  # noqa: SLF001 - there is no other way in


def talk(port: int, tls: bool) -> None:
    """Write, read one and two values, read a missing one, explore, read again three times."""
    from s7commplus.client import S7CommPlusClient

    client = S7CommPlusClient()
    client.connect(LOOPBACK, port=port, use_tls=tls)
    client.db_write(1, 0, struct.pack(">f", 21.5))
    client.db_read_multi([(1, 0, 4), (1, 4, 4)])
    with contextlib.suppress(Exception):
        client.db_read(7, 0, 4)
    client.get_cpu_state()
    client.explore()
    for _ in range(3):
        client.db_read(1, 0, 4)
    client.disconnect()


def relayed(port: int, path: Path, tls: bool) -> None:
    """Run the session through a relay that writes it to ``path``."""
    command = [sys.executable, "-m", "dissect", "proxy", "--listen", f"{LOOPBACK}:0", "--to", f"{LOOPBACK}:{port}"]
    with subprocess.Popen(
        [*command, "-w", str(path)], stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True
    ) as relay:
        assert relay.stderr is not None
        found = re.search(r"listening on [0-9.]+:([0-9]+),", relay.stderr.readline())
        assert found is not None
        talk(int(found[1]), tls)
        relay.send_signal(signal.SIGTERM)


def main() -> None:
    """Record one session."""
    from s7commplus.server import S7CommPlusServer

    parser = argparse.ArgumentParser(description="Record a session of the package s7commplus.")
    parser.add_argument("path", type=Path, help="the capture to write")
    parser.add_argument("--tls", action="store_true", help="with TLS, and the session keys in the capture")
    options = parser.parse_args()
    port = free_port()
    server = S7CommPlusServer()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        serve(server, port, folder, options.tls)
        made = folder / "session.pcapng" if options.tls else options.path
        try:
            relayed(port, made, options.tls)
        finally:
            server.stop()
        if options.tls:
            secrets = f"tls,{folder / 'keys'}"
            subprocess.run(["editcap", "--inject-secrets", secrets, str(made), str(options.path)], check=True)


if __name__ == "__main__":
    main()
