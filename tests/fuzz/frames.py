"""Fuzz target ``frames``: packets of any link type, with anything in them.

The input is packets one after the other: an octet that chooses the link type (`LINKS`) and whether the capture cut the packet,
two octets of its size, its octets. The very first octet chooses whether checksums are verified.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from dissect.engine.pipeline import Options
from dissect.packets.tcp.ip import FragmentStore
from dissect.packets.tcp.segment import find_segment
from tests.fuzz.taking import Taker
from tests.properties.books import Result, check_books
from tests.properties.packets import EPOCH_NS, ETHERNET, LINUX_SLL, LINUX_SLL2, MS, NULL, RAW, Packet

LINKS: Final = (ETHERNET, NULL, RAW, LINUX_SLL, LINUX_SLL2, 12, 14, 108, 228, 229, 105, 147)
_CUT: Final = 0x80
_LATE: Final = 0x40  # some seconds after the packet before


def written(packets: Iterable[Packet]) -> bytes:
    """Return packets in the form of this target; packets of another link type are left out."""
    octets = bytearray(b"\0")
    for packet in packets:
        if packet.link_type in LINKS and len(packet.octets) < 0x10000:
            cut = _CUT if packet.wire_length > len(packet.octets) else 0
            octets.append(LINKS.index(packet.link_type) | cut)
            octets += len(packet.octets).to_bytes(2, "big") + packet.octets
    return bytes(octets)


def packets_of(octets: bytes) -> tuple[list[Packet], bool]:
    """Return the packets that ``octets`` describe, and whether their checksums are to be verified."""
    taker = Taker(octets)
    checksums = bool(taker.number() & 1)
    packets: list[Packet] = []
    time_ns = EPOCH_NS
    while taker.left:
        kind = taker.number()
        content = taker.octets(taker.number(2))
        time_ns += 7_000 * MS if kind & _LATE else MS
        wire = len(content) + (17 if kind & _CUT else 0)
        packets.append(Packet(time_ns, content, wire, LINKS[(kind & 0x3F) % len(LINKS)]))
    return packets, checksums


def frames(octets: bytes) -> None:
    """Any packets: each is reported once, a payload is never longer than its packets."""
    packets, checksums = packets_of(octets)
    result = Result(packets, Options(strict=True, checksums=checksums))
    check_books(result.pipeline, result.record)
    store = FragmentStore()
    room = 0
    for packet in packets:
        room += len(packet.octets)
        # There are other octets before and after a packet in the same buffer: they must not be read.
        buf = b"\x03\x00\x00" + packet.octets + b"\x45\x00\x00\x28"
        found = find_segment(buf, 3, 3 + len(packet.octets), packet.link_type, store, packet.time_ns, True, checksums)
        alone = find_segment(
            packet.octets, 0, len(packet.octets), packet.link_type, FragmentStore(), 0, True, checksums
        )
        assert found.missing >= 0
        assert len(found.octets) <= room
        if found.problem:
            assert found.protocol == 0 or found.problem == "bad_checksum"
        if not alone.problem:
            assert (found.key, found.octets, found.missing) == (alone.key, alone.octets, alone.missing)
