"""A small reader of whole capture files, for captures that are multiplied: it keeps the file in memory."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pathlib import Path

#: (time in ns, octets captured, octets on the wire)
Packet = tuple[int, bytes, int]


def read_capture(path: Path) -> tuple[int, list[Packet]]:
    """Return the link type and the packets of a pcap (µs, ns) or pcapng file of either octet order.

    Raises ValueError if the file is not a capture, is damaged, or has packets of several link types.
    """
    octets = path.read_bytes()
    try:
        link_type, packets = _read_pcapng(octets) if octets[:4] == b"\x0a\x0d\x0d\x0a" else _read_pcap(octets)
    except (struct.error, IndexError, ValueError) as error:
        raise ValueError(f"{path}: {error}; give one whole pcap or pcapng file") from error
    if not packets:
        raise ValueError(f"{path}: no packets in it")
    return link_type, packets


def _read_pcap(octets: bytes) -> tuple[int, list[Packet]]:
    magics = {0xA1B2C3D4: 1000, 0xA1B23C4D: 1}
    for order in "<>":
        unit = magics.get(struct.unpack_from(order + "I", octets)[0])
        if unit is None:
            continue
        link_type = struct.unpack_from(order + "I", octets, 20)[0] & 0xFFFF
        record = struct.Struct(order + "IIII")
        packets: list[Packet] = []
        at = 24
        while at < len(octets):
            seconds, part, size, wire = record.unpack_from(octets, at)
            at += 16
            packets.append((seconds * 1_000_000_000 + part * unit, octets[at : at + size], wire))
            at += size
        return link_type, packets
    raise ValueError("neither pcap nor pcapng by its first octets")


def _resolution(order: str, options: bytes) -> int:
    """Return the time units a second of an interface, from its options."""
    at = 0
    while at + 4 <= len(options):
        code, size = struct.unpack_from(order + "HH", options, at)
        if code == 9 and size == 1:
            exponent = options[at + 4]
            return 1 << (exponent & 0x7F) if exponent & 0x80 else 10**exponent
        at += 4 + size + (-size % 4)
    return 1_000_000


def _read_pcapng(octets: bytes) -> tuple[int, list[Packet]]:
    packets: list[Packet] = []
    links: list[tuple[int, int]] = []
    seen: set[int] = set()
    order = "<"
    at = 0
    while at < len(octets):
        kind = struct.unpack_from("<I", octets, at)[0]
        if kind == 0x0A0D0D0A:
            order = "<" if octets[at + 8 : at + 12] == b"\x4d\x3c\x2b\x1a" else ">"
            links = []
        kind, total = struct.unpack_from(order + "II", octets, at)
        if total < 12:
            raise struct.error(f"block of {total} octets")
        body = octets[at + 8 : at + total - 4]
        if kind == 1:
            links.append((struct.unpack_from(order + "H", body)[0], _resolution(order, body[8:])))
        elif kind == 6:
            interface, high, low, size, wire = struct.unpack_from(order + "IIIII", body)
            link_type, units = links[interface]
            seen.add(link_type)
            packets.append(((high << 32 | low) * 1_000_000_000 // units, body[20 : 20 + size], wire))
        at += total
    if len(seen) > 1:
        raise ValueError(f"packets of several link types ({sorted(seen)}); multiply one interface at a time")
    return seen.pop() if seen else 1, packets
