"""Servers for fetching captures: OpenSSH, nginx, an object store, each on a free port of loopback."""

from __future__ import annotations

import getpass
import os
import shutil
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import pytest

#: Seconds until a server that does not start fails the test.
_PATIENCE_S: Final = 60
LOOPBACK: Final = "127.0.0.1"


def free_port() -> int:
    """Return a port of loopback that nobody has."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        port: int = probe.getsockname()[1]
        return port


def _program(name: str) -> str:
    found = shutil.which(name) or shutil.which(name, path="/usr/sbin:/usr/local/sbin")
    if found is None:
        pytest.skip(f"no {name}: scripts/install-tools.sh installs it")
    return found


@contextmanager
def running(
    command: list[str], port: int, log: Path, environment: dict[str, str] | None = None
) -> Iterator[subprocess.Popen[bytes]]:
    """Run a server until the block is over; it is ended by its own id."""
    with log.open("wb") as said:
        process = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=said, stderr=said, env=environment)
    try:
        deadline = time.monotonic() + _PATIENCE_S
        while True:
            with socket.socket() as probe:
                if probe.connect_ex((LOOPBACK, port)) == 0:
                    break
            assert process.poll() is None, log.read_text(errors="replace")
            assert time.monotonic() < deadline, log.read_text(errors="replace")
            time.sleep(0.05)
        yield process
    finally:
        process.terminate()
        try:
            process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()


@contextmanager
def sftp_server(folder: Path) -> Iterator[int]:
    """Run OpenSSH's server with its own keys and configuration in ``folder``, and make it known to the user's SSH.

    ``folder/home`` is a home whose ``.ssh`` has the key for the login and the host as a known one.
    """
    sshd, keygen = _program("sshd"), _program("ssh-keygen")
    port = free_port()
    home = folder / "home" / ".ssh"
    home.mkdir(parents=True)
    host_key, user_key = folder / "host_key", home / "id_ed25519"
    for key in (host_key, user_key):
        subprocess.run([keygen, "-q", "-t", "ed25519", "-N", "", "-f", os.fspath(key)], check=True)
    public = host_key.with_suffix(".pub").read_text().split()
    (home / "known_hosts").write_text(f"[{LOOPBACK}]:{port} {public[0]} {public[1]}\n")
    allowed = folder / "authorized_keys"
    allowed.write_text(user_key.with_suffix(".pub").read_text())
    settings = folder / "sshd_config"
    settings.write_text(
        f"ListenAddress {LOOPBACK}:{port}\nHostKey {host_key}\nAuthorizedKeysFile {allowed}\nPidFile none\nStrictModes no\n"
        "PasswordAuthentication no\nKbdInteractiveAuthentication no\nUsePAM no\nPermitRootLogin prohibit-password\n"
        f"Subsystem sftp internal-sftp\nAllowUsers {getpass.getuser()}\n"
    )
    with running([sshd, "-D", "-e", "-f", os.fspath(settings)], port, folder / "sshd.log"):
        yield port


@contextmanager
def web_server(folder: Path, root: Path) -> Iterator[int]:
    """Run nginx on the files under ``root``; it refuses ``/closed``, and ``/asks`` requires user made with password up."""
    nginx = _program("nginx")
    port = free_port()
    work = folder / "nginx"
    work.mkdir()
    kinds = ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
    places = " ".join([f"{kind}_temp_path {work / kind};" for kind in kinds])
    settings = work / "nginx.conf"
    (work / "users").write_text("made:{PLAIN}up\n")
    settings.write_text(
        f"daemon off; master_process off; pid {work / 'pid'}; error_log {work / 'error.log'}; events {{ }}\n"
        f"http {{ access_log {work / 'access.log'}; {places}\n"
        f"  server {{ listen {LOOPBACK}:{port}; root {root}; location /closed {{ return 403; }}\n"
        f"    location /plain/ {{ alias {root}/; max_ranges 0; }}\n"
        f"    location /asks/ {{ alias {root}/; auth_basic plant; auth_basic_user_file {work / 'users'}; }} }} }}\n"
    )
    with running([nginx, "-p", os.fspath(work), "-c", os.fspath(settings)], port, work / "log"):
        yield port


@contextmanager
def object_store(folder: Path, **environment: str) -> Iterator[int]:
    """Run moto's S3 server; its contents end with it, and so do clients of it that fsspec keeps for reuse."""
    pytest.importorskip("moto.server", reason="no moto: pip install 's7dissect[test]'")
    s3fs = pytest.importorskip("s3fs", reason="no s3fs: pip install 's7dissect[test]'")
    port = free_port()
    command = [sys.executable, "-m", "moto.server", "-H", LOOPBACK, "-p", str(port)]
    with running(command, port, folder / "moto.log", {**os.environ, **environment}):
        s3fs.S3FileSystem.clear_instance_cache()
        try:
            yield port
        finally:
            s3fs.S3FileSystem.clear_instance_cache()
