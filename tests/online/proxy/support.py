"""Shared by the tests of the proxy: a relay in a thread, plain sockets at both ends, and patience."""

from __future__ import annotations

import contextlib
import socket
import struct
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Final

from dissect.online.net.addresses import Address, Place, places_to_connect, places_to_listen
from dissect.online.proxy.relay import Relay
from dissect.online.proxy.source import RelayReader
from dissect.online.proxy.tap import Tap
from dissect.packets.source.packet import PacketSink

LOOPBACK: Final = "127.0.0.1"
PATIENCE_S: Final = 60.0


def eventually(true: Callable[[], bool]) -> None:
    """Wait until a condition is true; fail if it is not in time."""
    end = time.monotonic() + PATIENCE_S
    while not true():
        assert time.monotonic() < end
        time.sleep(0.005)


def at(port: int, host: str = LOOPBACK) -> list[Place]:
    return places_to_connect(Address(host, port))


@contextlib.contextmanager
def running(relay: Relay) -> Iterator[Relay]:
    thread = threading.Thread(target=relay.run)
    thread.start()
    try:
        yield relay
    finally:
        relay.stop()
        thread.join(PATIENCE_S)
        assert not thread.is_alive()


@contextlib.contextmanager
def relaying(targets: Sequence[Place], tap: Tap | None = None, host: str = LOOPBACK) -> Iterator[Relay]:
    places = places_to_listen(Address(host, 0), allow_remote=False)
    with running(Relay(places, targets, tap if tap is not None else Tap())) as relay:
        yield relay


def connected(relay: Relay) -> socket.socket:
    """Return a client of the relay."""
    place = relay.listening[0]
    client = socket.socket(place.family, socket.SOCK_STREAM)
    client.settimeout(PATIENCE_S)
    try:
        client.connect(place.address)
    except OSError:
        client.close()
        raise
    return client


@contextlib.contextmanager
def listening(host: str = LOOPBACK, backlog: int = 128) -> Iterator[socket.socket]:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.create_server((host, 0), family=family, backlog=backlog) as server:
        server.settimeout(PATIENCE_S)
        yield server


def has_ipv6() -> bool:
    try:
        with listening("::1"):
            return True
    except OSError:
        return False


def port_of(server: socket.socket) -> int:
    return int(server.getsockname()[1])


@contextlib.contextmanager
def pair(tap: Tap | None = None) -> Iterator[tuple[Relay, socket.socket, socket.socket]]:
    """A relay, and the sockets of a client and of the server that it connects."""
    with listening() as server, relaying(at(port_of(server)), tap) as relay, connected(relay) as client:
        accepted, _ = server.accept()
        accepted.settimeout(PATIENCE_S)
        with accepted:
            yield relay, client, accepted


def received(one: socket.socket) -> bytes:
    """Return all that comes until the end."""
    pieces = []
    while piece := one.recv(65536):
        pieces.append(piece)
    return b"".join(pieces)


def reset(one: socket.socket) -> None:
    one.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
    one.close()


def port_of_nobody() -> int:
    with listening() as server:
        return port_of(server)


class Frames(PacketSink):
    """Keeps frames."""

    def __init__(self) -> None:
        super().__init__()
        self.frames: list[tuple[int, bytes]] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        assert (wire_length, link_type) == (end - start, 1)
        self.frames.append((time_ns, buf[start:end]))


def frames_of(tap: Tap) -> list[bytes]:
    """Return the relayed data as frames."""
    reader, sink = RelayReader(tap), Frames()
    reader.stop()
    while reader.step(sink):
        pass
    return [octets for _, octets in sink.frames]


def tshark(path: Path, wanted: str = "", *fields: str, port: int = 102) -> list[list[str]]:
    """Return fields that tshark shows for the packets that match ``wanted``; checksums are verified, S7 is at ``port``."""
    checks = [part for name in ("ip", "tcp") for part in ("-o", f"{name}.check_checksum:TRUE")]
    chosen = ["-Y", wanted] if wanted else []
    checks += ["-d", f"tcp.port=={port},tpkt"]
    command = ["tshark", "-n", "-r", str(path), *checks, *chosen, "-T", "fields", "-e", "frame.number"]
    told = subprocess.run(
        [*command, *[part for field in fields for part in ("-e", field)]], capture_output=True, text=True, check=True
    )
    return [line.split("\t") for line in told.stdout.splitlines()]


#: What Wireshark would show in red: the proxy's output must have none of it.
WRONG: Final = "tcp.analysis.flags || _ws.malformed || tcp.checksum.status != 1 || ip.checksum.status != 1"
