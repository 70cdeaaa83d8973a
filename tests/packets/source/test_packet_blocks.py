"""Packets as blocks, gathered: the same octets as one block after the other, and what is told of their interface."""

from __future__ import annotations

from pathlib import Path

import pytest

from dissect.packets.source.packet_blocks import MAX_COUNT, InterfaceStatistics, PacketBlocks, plain_block
from dissect.packets.source.pcapng_writer import PcapngWriter, packet_block

PACKETS = [(1_700_000_000_000_000_007, b"\1" * 61, 90), (5, b"", 0), (MAX_COUNT + 3, b"\2" * 60, 60)]


def test_a_block_whole() -> None:
    block = plain_block(2, 0x1_0000_0003, b"\xaa" * 5, 4)
    expected = "06000000 28000000 02000000 01000000 03000000 05000000 05000000 aaaaaaaaaa000000 28000000"
    assert block == bytes.fromhex(expected)
    assert block == packet_block(2, 0x1_0000_0003, b"\xaa" * 5, 4)


def test_blocks_together() -> None:
    told = InterfaceStatistics()
    blocks = PacketBlocks(1, told)
    for packet in PACKETS:
        blocks.add(*packet)
    assert (blocks.packets, blocks.octets) == (3, 96 + 32 + 92)
    assert blocks.take() == b"".join([packet_block(1, *packet) for packet in PACKETS])
    assert (blocks.packets, blocks.octets, blocks.take()) == (0, 0, b"")
    assert (told.packets, told.first_ns, told.last_ns) == (3, 5, MAX_COUNT)


def test_a_packet_that_no_reader_believes() -> None:
    blocks = PacketBlocks(0, InterfaceStatistics())
    with pytest.raises(ValueError, match="larger than a pcapng block may be"):
        blocks.add(1, bytes(16 * 1024 * 1024), 0)
    assert (blocks.packets, blocks.octets) == (0, 0)


def test_a_file_of_either_way_is_the_same(tmp_path: Path) -> None:
    single, together = (PcapngWriter(str(tmp_path / name)) for name in ("single", "together"))
    for time_ns, octets, wire_length in PACKETS:
        single.packet(time_ns, octets, wire_length, 1)
    blocks = together.blocks(1)
    together.put(blocks)  # nothing yet
    for packet in PACKETS:
        blocks.add(*packet)
    together.put(blocks)
    assert (together.packets, together.octets) == (single.packets, single.octets)
    for writer in (single, together):
        writer.close()
    assert (tmp_path / "together").read_bytes() == (tmp_path / "single").read_bytes()
