"""Blocks of the kernel's ring, made here octet by octet."""

from __future__ import annotations

import struct

from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.source.ring_blocks import deliver_block
from tests.packets.source.live_support import Sink

FIRST = 48
FRAME = bytes.fromhex("020000000002 020000000001 0800") + b"what IP says"


def packet(
    octets: bytes,
    wire: int | None = None,
    status: int = 1,
    tci: int = 0,
    tpid: int = 0,
    kind: int = 0,
    last: bool = False,
) -> bytes:
    """Return a packet with its ``tpacket3_hdr`` and ``sockaddr_ll``, as linux/if_packet.h lays them out."""
    mac = 82
    size = (mac + len(octets) + 7) & ~7
    wire = len(octets) if wire is None else wire
    head = struct.pack(
        "=IIIIIIHH", 0 if last else size, 1_700_000_000, 987_654_321, len(octets), wire, status, mac, mac + 14
    )
    head += struct.pack("=IIHH8x", 0, tci, tpid, 0)
    address = struct.pack("=H", 17) + struct.pack(">H", 0x0800) + struct.pack("=iHBB8s", 1, 1, kind, 6, b"")
    return (head + address).ljust(mac, b"\0") + octets + bytes(size - mac - len(octets))


def block(*packets: bytes) -> bytes:
    return bytes(FIRST) + b"".join(packets)


def delivered(octets: bytes, count: int, link_type: int = 1, skip_outgoing: bool = False) -> Sink:
    sink = Sink()
    assert deliver_block(octets, FIRST, count, sink, link_type, skip_outgoing) == len(sink.got)
    return sink


def test_packets_one_after_another() -> None:
    sink = delivered(block(packet(FRAME), packet(FRAME[:20], wire=1500), packet(FRAME + b"!", last=True)), 3)
    assert [got.octets for got in sink.got] == [FRAME, FRAME[:20], FRAME + b"!"]
    assert [got.wire_length for got in sink.got] == [len(FRAME), 1500, len(FRAME) + 1]
    assert {(got.time_ns, got.link_type) for got in sink.got} == {(1_700_000_000_987_654_321, 1)}


def test_no_more_than_the_count() -> None:
    assert len(delivered(block(packet(FRAME), packet(FRAME)), 1).got) == 1
    assert len(delivered(block(packet(FRAME), packet(FRAME, last=True)), 9).got) == 2


def test_a_tag_is_put_back() -> None:
    sink = delivered(
        block(
            packet(FRAME, status=0x51, tci=0x6005, tpid=0x88A8),
            packet(FRAME, status=0x11, tci=0, tpid=0x9999),  # VLAN 0, and no TPID known
            packet(FRAME[:20], wire=900, status=0x11, tci=7),
        ),
        3,
    )
    assert sink.got[0].octets == FRAME[:12] + bytes.fromhex("88a8 6005") + FRAME[12:]
    assert sink.got[0].wire_length == len(FRAME) + 4
    assert sink.got[1].octets == FRAME[:12] + bytes.fromhex("8100 0000") + FRAME[12:]
    assert sink.got[2].octets == FRAME[:12] + bytes.fromhex("8100 0007") + FRAME[12:20]
    assert sink.got[2].wire_length == 904


def test_no_tag_goes_where_none_can_stand() -> None:
    sink = delivered(block(packet(FRAME[:11], status=0x11, tci=5)), 1)
    assert [got.octets for got in sink.got] == [FRAME[:11]]
    assert delivered(block(packet(FRAME, status=0x11, tci=5)), 1, link_type=101).got[0].octets == FRAME


def test_what_is_being_sent_is_left_out_of_loopback() -> None:
    both = block(packet(FRAME, kind=4), packet(FRAME, kind=0))
    assert len(delivered(both, 2).got) == 2
    assert len(delivered(both, 2, skip_outgoing=True).got) == 1


def test_cut_anywhere() -> None:
    whole = block(packet(FRAME, tci=5, status=0x51, tpid=0x8100), packet(FRAME, last=True))
    for size in range(FIRST, len(whole)):
        for got in delivered(whole[:size], 2).got:
            assert len(got.octets) <= len(FRAME) + 4


@given(st.binary(max_size=400), st.integers(0, 10), st.booleans())
def test_any_octets(octets: bytes, count: int, skip: bool) -> None:
    sink = delivered(bytes(FIRST) + octets, count, 1, skip)
    assert len(sink.got) <= count
