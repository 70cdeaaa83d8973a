"""Multiply a real capture: ``python -m benchmarks.multiply FILE N OUT``.

Each copy has the same conversations between other hosts: new IP addresses, new client ports, times shifted. Checksums are
changed only by the difference (RFC 1624), so right ones stay right and wrong ones stay wrong.
"""

from __future__ import annotations

import argparse
import sys
from heapq import merge
from pathlib import Path
from typing import TYPE_CHECKING

from benchmarks.readers import Packet, read_capture
from benchmarks.writers import CaptureWriter

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

_ETHERNET, _NULL, _RAW, _LOOP, _COOKED, _COOKED_2 = 1, 0, 101, 108, 113, 276
_TCP, _UDP = 6, 17
_CHECKSUM_AT = {_TCP: 16, _UDP: 6}
_EPHEMERAL = 1024
_PORT_STEP = 7919


def ip_offset(link_type: int, frame: bytes) -> int:
    """Return where the IP header begins, or -1 if there is none (on links that this tool knows)."""
    if link_type == _RAW:
        return 0
    if link_type in (_NULL, _LOOP):
        return 4
    at = {_ETHERNET: 12, _COOKED: 14, _COOKED_2: 0}.get(link_type, -1)
    if at < 0:
        raise ValueError(f"link type {link_type} is not known here; convert the capture to Ethernet first")
    kind = frame[at : at + 2]
    if link_type == _COOKED_2:
        return 20 if kind in (b"\x08\x00", b"\x86\xdd") else -1
    while kind in (b"\x81\x00", b"\x88\xa8"):
        at += 4
        kind = frame[at : at + 2]
    return at + 2 if kind in (b"\x08\x00", b"\x86\xdd") else -1


class Plan:
    """The positions of addresses, ports and checksums in one packet. ``payload`` is -1 if no ports may be changed."""

    __slots__ = ("address_size", "addresses", "ip", "payload", "protocol")

    def __init__(self, link_type: int, frame: bytes) -> None:
        self.ip = ip_offset(link_type, frame)
        self.addresses = self.payload = -1
        self.address_size = 4
        self.protocol = 0
        if self.ip < 0 or len(frame) <= self.ip:
            return
        version = frame[self.ip] >> 4
        if version == 4 and len(frame) >= self.ip + 20:
            self.addresses = self.ip + 12
            self.protocol = frame[self.ip + 9]
            # Only the first fragment has ports.
            first = not int.from_bytes(frame[self.ip + 6 : self.ip + 8], "big") & 0x1FFF
            self.payload = self.ip + 4 * (frame[self.ip] & 15) if first else -1
        elif version == 6 and len(frame) >= self.ip + 40:
            self.addresses = self.ip + 8
            self.address_size = 16
            self.protocol = frame[self.ip + 6]
            self.payload = self.ip + 40
        if self.protocol not in _CHECKSUM_AT or len(frame) < self.payload + 4:
            self.payload = -1


class Multiplier:
    """Makes copies of one capture's packets; copy 0 is changed too, so that all are alike."""

    def __init__(self, link_type: int, packets: list[Packet]) -> None:
        self._packets = packets
        self._plans = [Plan(link_type, frame) for _, frame, _ in packets]
        self._places: dict[bytes, int] = {}
        for plan, (_, frame, _) in zip(self._plans, packets, strict=True):
            if plan.addresses >= 0:
                for at in (plan.addresses, plan.addresses + plan.address_size):
                    self._places.setdefault(frame[at : at + plan.address_size], len(self._places))

    def address(self, old: bytes, copy: int) -> bytes:
        """Return the address that replaces ``old`` in a copy; group addresses stay."""
        place = copy * len(self._places) + self._places[old] + 1
        if len(old) == 16:
            return old if old[0] == 0xFF else b"\xfd\x53\x37" + place.to_bytes(13, "big")
        if old[0] >= 224:
            return old
        if place >= 1 << 24:
            raise ValueError("more hosts than 10.0.0.0/8 has addresses; ask for fewer copies")
        return b"\x0a" + place.to_bytes(3, "big")

    @staticmethod
    def port(ports: tuple[int, int], copy: int) -> tuple[int, int]:
        """Return the ports of a copy: the larger one is the client's and changes, the service port stays."""
        high = max(ports)
        if high < _EPHEMERAL:
            return ports
        new = _EPHEMERAL + (high - _EPHEMERAL + (copy + 1) * _PORT_STEP) % (0x10000 - _EPHEMERAL)
        return (new, ports[1]) if ports[0] == high else (ports[0], new)

    def copy(self, copy: int, shift_ns: int) -> Iterator[Packet]:
        """Yield the packets of one copy."""
        for plan, (time_ns, frame, wire) in zip(self._plans, self._packets, strict=True):
            octets = self._changed(plan, frame, copy) if plan.addresses >= 0 else frame
            yield time_ns + shift_ns, octets, wire

    def _changed(self, plan: Plan, frame: bytes, copy: int) -> bytes:
        octets = bytearray(frame)
        size = plan.address_size
        for at in (plan.addresses, plan.addresses + size):
            octets[at : at + size] = self.address(frame[at : at + size], copy)
        end = plan.addresses + 2 * size
        difference = words(octets[plan.addresses : end]) - words(frame[plan.addresses : end])
        if size == 4:
            adjust(octets, plan.ip + 10, difference)
        at = plan.payload
        if at >= 0:
            ports = int.from_bytes(frame[at : at + 2], "big"), int.from_bytes(frame[at + 2 : at + 4], "big")
            new = self.port(ports, copy)
            octets[at : at + 4] = (new[0] << 16 | new[1]).to_bytes(4, "big")
            place = at + _CHECKSUM_AT[plan.protocol]
            adjust(octets, place, difference + sum(new) - sum(ports), optional=plan.protocol == _UDP)
        return bytes(octets)


def words(octets: bytes | bytearray) -> int:
    """Return the sum of the 16-bit words of ``octets``, modulo 65535 (RFC 1071)."""
    return int.from_bytes(octets, "big") % 0xFFFF


def adjust(octets: bytearray, at: int, difference: int, *, optional: bool = False) -> None:
    """Change the checksum at ``at`` after words grew by ``difference``; an ``optional`` checksum of zero was not computed."""
    if at + 2 > len(octets):
        return
    old = int.from_bytes(octets[at : at + 2], "big")
    if old == 0 and optional:
        return
    # A sum of words is never zero, so a multiple of 65535 is 65535 itself and its complement 0 (in UDP written as 65535).
    new = -(0xFFFF - old + difference) % 0xFFFF
    octets[at : at + 2] = (new or (0xFFFF if optional else 0)).to_bytes(2, "big")


def multiply(path: Path, copies: int, out: Path, apart_ns: int = 10_000_000) -> int:
    """Write ``copies`` copies of the capture at ``path`` to ``out``, each beginning ``apart_ns`` after the one before.

    Returns the number of packets. The source is kept in memory, the result is not. Raises ValueError for a source that cannot
    be multiplied.
    """
    link_type, packets = read_capture(path)
    multiplier = Multiplier(link_type, packets)
    streams = [multiplier.copy(number, number * apart_ns) for number in range(copies)]
    with out.open("wb") as file:
        writer = CaptureWriter(file, "pcap-ns", link_type)
        for time_ns, octets, wire in merge(*streams, key=lambda packet: packet[0]):
            writer.write(time_ns, octets, wire)
        writer.flush()
    return writer.packets


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.multiply", description=__doc__)
    parser.add_argument("file", type=Path, help="a pcap or pcapng file")
    parser.add_argument("copies", type=int)
    parser.add_argument("out", type=Path, help="the capture to write (pcap, ns)")
    parser.add_argument("--apart", type=float, default=10.0, metavar="MS", help="time between copies (default 10 ms)")
    options = parser.parse_args(arguments)
    if options.copies < 1:
        parser.error("copies: at least 1")
    try:
        packets = multiply(options.file, options.copies, options.out, int(options.apart * 1_000_000))
    except (OSError, ValueError) as error:
        print(f"multiply: {error}", file=sys.stderr)
        return 2
    print(f"{packets} packets in {options.copies} copies")
    return 0


if __name__ == "__main__":
    sys.exit(main())
