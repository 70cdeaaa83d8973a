"""Shared by the tests of the live sources: who may capture here, a separate network, frames, the filter machine."""

from __future__ import annotations

import ctypes
import ipaddress
import os
import shutil
import socket
import struct
import subprocess
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Final, NamedTuple

import pytest

from dissect.packets.source.live import dumpcap, ring
from dissect.packets.source.live.program import Instruction
from dissect.packets.source.live.reader import LiveReader
from dissect.packets.source.packet import PacketSink

_CLONE_NEWNET: Final = 0x40000000

needs_ring = pytest.mark.skipif(ring.trouble() is not None, reason=f"no packet socket here: {ring.trouble()}")
needs_dumpcap = pytest.mark.skipif(
    dumpcap.trouble("lo") is not None, reason=f"dumpcap cannot capture here: {dumpcap.trouble('lo')}"
)
#: Both engines, each where it can run.
ENGINES: Final = [pytest.param("ring", marks=needs_ring), pytest.param("dumpcap", marks=needs_dumpcap)]


class Got(NamedTuple):
    """One packet as a sink got it."""

    time_ns: int
    octets: bytes
    wire_length: int
    link_type: int


class Sink(PacketSink):
    """Remembers packets."""

    def __init__(self) -> None:
        self.got: list[Got] = []

    def frame(self, time_ns: int, buf: bytes, start: int, end: int, wire_length: int, link_type: int) -> None:
        self.got.append(Got(time_ns, buf[start:end], wire_length, link_type))


def until(reader: LiveReader, sink: Sink, count: int, seconds: float = 60) -> list[bytes]:
    """Read until there are this many packets, or for this long; return their octets."""
    end = time.monotonic() + seconds
    while len(sink.got) < count and time.monotonic() < end and reader.step(sink):
        pass
    return [packet.octets for packet in sink.got]


def drained(reader: LiveReader, sink: Sink, seconds: float = 60) -> bool:
    """Read to the end; return False if it does not come in time."""
    end = time.monotonic() + seconds
    while reader.step(sink):
        if time.monotonic() > end:
            return False
    return True


def in_namespace(task: Callable[[], None]) -> None:
    """Run ``task`` in a thread with its own network: a veth pair, ``va`` to ``vb``, both up."""
    if shutil.which("ip") is None:
        pytest.skip("no ip (iproute2) to make interfaces with")

    def run() -> None:
        if ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNET):
            pytest.skip(f"no network namespace: {os.strerror(ctypes.get_errno())}")
        for words in ("link set lo up", "link add va type veth peer name vb", "link set va up", "link set vb up"):
            made = subprocess.run(["ip", *words.split()], capture_output=True, text=True, check=False)
            if made.returncode:
                pytest.skip(f"ip {words}: {made.stderr.strip()}")
        task()

    with ThreadPoolExecutor(1) as thread:
        thread.submit(run).result()


def sender(interface: str) -> socket.socket:
    """Return a socket that sends whole frames."""
    out = socket.socket(socket.AF_PACKET, socket.SOCK_RAW)
    out.bind((interface, 0))
    return out


def ip_packet(source: str, target: str, protocol: int, payload: bytes, fragment: int = 0) -> bytes:
    """Return an IP packet; checksums are left out, because filters ignore them."""
    a, b = ipaddress.ip_address(source).packed, ipaddress.ip_address(target).packed
    if len(a) == 4:
        return struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(payload), 1, fragment, 64, protocol, 0) + a + b + payload
    return struct.pack(">IHBB", 0x60000000, len(payload), protocol, 64) + a + b + payload


def ethernet(packet: bytes, ethertype: int, tags: bytes = b"") -> bytes:
    """Return a frame of at least 60 octets, as Ethernet has them."""
    return (bytes.fromhex("020000000002 020000000001") + tags + ethertype.to_bytes(2, "big") + packet).ljust(60, b"\0")


def udp(payload: bytes, port: int = 4711, tags: bytes = b"") -> bytes:
    """Return a frame with a UDP datagram."""
    datagram = struct.pack(">HHHH", 5000, port, 8 + len(payload), 0) + payload
    return ethernet(ip_packet("10.0.0.1", "10.0.0.2", 17, datagram), 0x0800, tags)


def run_filter(program: list[Instruction], frame: bytes, tag: int | None = None) -> bool:
    """Run a program as the kernel does, and return whether it wants the frame. ``tag`` is the VLAN tag the kernel took out."""
    a = x = at = 0
    memory = [0] * 16
    ancillary = {0xFFFFF000 + 44: tag or 0, 0xFFFFF000 + 48: int(tag is not None)}
    while True:
        code, yes, no, k = program[at]
        at += 1
        kind = code & 7
        if kind == 6:
            return bool(a if code & 0x18 == 0x10 else k)
        if kind in {0, 1} and code & 0xE0 in {0x20, 0x40, 0xA0}:
            size = {0x00: 4, 0x08: 2, 0x10: 1}[code & 0x18]
            start = k + (x if code & 0xE0 == 0x40 else 0)
            if start in ancillary:
                a = ancillary[start]
                continue
            if start + size > len(frame):
                return False
            value = int.from_bytes(frame[start : start + size], "big")
            if code & 0xE0 == 0xA0:
                x = 4 * (value & 0xF)
            else:
                a = value
        elif kind in {0, 1}:
            value = {0x00: k, 0x60: memory[k & 15], 0x80: len(frame)}[code & 0xE0]
            a, x = (value, x) if kind == 0 else (a, value)
        elif kind in {2, 3}:
            memory[k] = a if kind == 2 else x
        elif kind == 4:
            other = x if code & 8 else k
            results = {0x00: a + other, 0x10: a - other, 0x40: a | other, 0x50: a & other}
            results |= {0x60: a << min(other, 32), 0x70: a >> min(other, 32), 0x20: a * other}
            a = results[code & 0xF0] & 0xFFFFFFFF
        elif kind == 5:
            other = x if code & 8 else k
            if code & 0xF0 == 0:
                at += k
            else:
                met = {0x10: a == other, 0x20: a > other, 0x30: a >= other, 0x40: bool(a & other)}[code & 0xF0]
                at += yes if met else no
        else:
            a, x = (x, x) if code & 0x80 else (a, a)
