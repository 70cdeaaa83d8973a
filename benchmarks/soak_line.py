"""A line of our own for the soak: a veth pair in a network namespace that only this process and its children see."""

from __future__ import annotations

import ctypes
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path
from typing import Final

#: Frames go in here and are watched there.
NEAR: Final = "soak0"
FAR: Final = "soak1"

_NEW_NETWORK: Final = 0x40000000
_COUNTERS: Final = Path("/proc/net/dev")
_SOCKETS: Final = Path("/proc/net/packet")


class NoLineError(Exception):
    """There can be no line here; the message says why."""


def enter() -> None:
    """Move this process into a network namespace with the pair, both ends up. Raises NoLineError if that is not allowed.

    Neither end has an address, so only our own packets are on the line, and both ends are gone with the last process.
    """
    program = shutil.which("ip") or shutil.which("ip", path="/usr/sbin:/sbin")
    if program is None:
        raise NoLineError("no ip (of iproute2) to make interfaces with")
    if ctypes.CDLL(None, use_errno=True).unshare(_NEW_NETWORK):
        raise NoLineError(f"no network namespace: {os.strerror(ctypes.get_errno())}")
    for words in (
        f"link add {NEAR} type veth peer name {FAR}",
        f"link set {NEAR} addrgenmode none",
        f"link set {FAR} addrgenmode none",
        f"link set {NEAR} up",
        f"link set {FAR} up",
    ):
        made = subprocess.run([program, *words.split()], capture_output=True, text=True, check=False)
        if made.returncode:
            raise NoLineError(f"ip {words}: {made.stderr.strip()}")


def arrived() -> tuple[int, int]:
    """Return how many packets the kernel received on the watched end so far, and how many it dropped before any reader."""
    for line in _COUNTERS.read_text(encoding="ascii").splitlines():
        name, _, numbers = line.partition(":")
        if name.strip() == FAR:
            fields = [int(number) for number in numbers.split()]
            return fields[1], fields[3]
    raise NoLineError(f"{FAR} is gone")


def watched() -> frozenset[str]:
    """Return the sockets (by inode) that now capture on the watched end."""
    index = str(socket.if_nametoindex(FAR))
    rows = [line.split() for line in _SOCKETS.read_text(encoding="ascii").splitlines()[1:]]
    return frozenset(row[8] for row in rows if row[4] == index)


def wait_for_watcher(settled_s: float, limit_s: float = 30.0) -> bool:
    """Wait until the same socket has been capturing for ``settled_s``; False if there is none within ``limit_s``."""
    end = time.monotonic() + limit_s
    known: frozenset[str] = frozenset()
    since = time.monotonic()
    while time.monotonic() < end:
        now = watched()
        if now != known:
            known, since = now, time.monotonic()
        elif known and time.monotonic() - since >= settled_s:
            return True
        time.sleep(0.05)
    return False
