from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.tcp import link
from dissect.tcp.ip import FragmentStore
from dissect.tcp.segment import Segment, find_segment
from dissect.transactions.accounts import CATEGORIES
from tests.tcp.craft import DST, DST6, SRC, SRC6, UDP, extension, fragment_header, v4, v6

PORTS = struct.pack(">HH", 49152, 102)
DATA = bytes.fromhex("0300000702f080")
PUSH_ACK = 0x18
MORE = 0x2000


def tcp(data: bytes = DATA, options: bytes = b"", offset: int | None = None) -> bytes:
    words = 5 + len(options) // 4 if offset is None else offset
    head = struct.pack(">IIHHHH", 0xFFFFFFFE, 0x01020304, words << 12 | PUSH_ACK, 8192, 0, 0)
    return PORTS + head + options + data


def ethernet(packet: bytes, vlan: int = 0) -> bytes:
    tag = struct.pack(">HH", 0x8100, vlan) if vlan else b""
    ethertype = 0x0800 if packet[0] >> 4 == 4 else 0x86DD
    return bytes(12) + tag + struct.pack(">H", ethertype) + packet


def found(frame: bytes, link_type: int = link.ETHERNET, store: FragmentStore | None = None) -> Segment:
    return find_segment(b"x" + frame, 1, 1 + len(frame), link_type, store or FragmentStore(), 0)


@pytest.mark.parametrize("options", [b"", b"\x01" * 4, b"\x02\x04\x05\xb4" + b"\x01" * 36])
@pytest.mark.parametrize("trailer", [b"", b"\x03\x00\x00\x07\x02\xf0"])
def test_a_segment_in_every_dress(options: bytes, trailer: bytes) -> None:
    segment = tcp(options=options)
    four, six = v4(segment, options=bytes(8)), v6(extension(6) + segment, next_header=0)
    for frame, link_type, key, vlan in (
        (ethernet(four) + trailer, link.ETHERNET, SRC + DST + PORTS, 0),
        (ethernet(four, 5) + trailer, link.ETHERNET, SRC + DST + PORTS + bytes(7) + b"\x05", 5),
        (ethernet(six) + trailer, link.ETHERNET, SRC6 + DST6 + PORTS, 0),
        (four + trailer, link.RAW, SRC + DST + PORTS, 0),
        (b"\x02\0\0\0" + six + trailer, link.NULL, SRC6 + DST6 + PORTS, 0),
    ):
        got = found(frame, link_type)
        assert (got.problem, got.key, got.vlan) == ("", key, vlan)
        assert (got.seq, got.ack, got.word & 0xFF) == (0xFFFFFFFE, 0x01020304, PUSH_ACK)
        assert (got.octets, got.missing) == (DATA, 0)


def test_every_cut_of_a_frame() -> None:
    frame = ethernet(v4(tcp(options=bytes(4))))
    for size in range(len(frame)):
        got = found(frame[:size])
        if size < 14 + 20 + 24:
            assert got.problem == "cut", size
        else:
            assert (got.problem, got.octets, got.missing) == ("", DATA[: size - 58], len(frame) - size)


@pytest.mark.parametrize("offset", range(16))
def test_data_offsets_that_lie(offset: int) -> None:
    got = found(ethernet(v4(tcp(offset=offset))))
    if offset == 5:
        assert (got.problem, got.octets) == ("", DATA)
    elif offset == 6:
        assert (got.problem, got.octets) == ("", DATA[4:])
    else:
        assert got.problem == "bad_header"


@pytest.mark.parametrize("size", range(20))
def test_packets_too_short_for_tcp(size: int) -> None:
    assert found(ethernet(v4(tcp()[:size])) + bytes(60)).problem == "bad_header"


@pytest.mark.parametrize(
    ("frame", "link_type", "problem"),
    [
        (ethernet(v4(tcp(), protocol=UDP)), link.ETHERNET, "not_tcp"),
        (ethernet(v4(tcp(), protocol=UDP, flags=MORE)), link.ETHERNET, "not_tcp"),
        (ethernet(v4(tcp(), protocol=UDP, flags=7)), link.ETHERNET, "not_tcp"),
        (ethernet(v4(tcp(), ihl=4)), link.ETHERNET, "bad_header"),
        (bytes(12) + b"\x08\x06" + bytes(28), link.ETHERNET, "not_ip"),
        (bytes(64), 147, "link_type"),
        (b"", link.RAW, "cut"),
        (ethernet(v4(tcp(), flags=MORE, total=200)), link.ETHERNET, "cut"),  # a fragment whose rest was not captured
    ],
)
def test_packets_without_a_segment(frame: bytes, link_type: int, problem: str) -> None:
    assert found(frame, link_type).problem == problem


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_segment_in_fragments(order: tuple[int, int]) -> None:
    segment = tcp(DATA * 3)
    four = [v4(segment[:24], flags=MORE), v4(segment[24:], flags=3)]
    six = [
        v6(fragment_header(6, at, not at) + part, next_header=44)
        for at, part in ((0, segment[:24]), (24, segment[24:]))
    ]
    for packets, key in ((four, SRC + DST + PORTS), (six, SRC6 + DST6 + PORTS)):
        store = FragmentStore()
        first, second = (found(ethernet(packets[index], 9), store=store) for index in order)
        assert first.problem == "fragment_waiting"
        assert (second.problem, second.key[: len(key)], second.vlan, second.octets) == ("", key, 9, DATA * 3)
        assert (store.waiting, store.used) == (0, 1)


def test_the_same_fragments_in_another_vlan_are_another_datagram() -> None:
    segment = tcp()
    store = FragmentStore()
    assert found(ethernet(v4(segment[:24], flags=MORE), 1), store=store).problem == "fragment_waiting"
    assert found(ethernet(v4(segment[24:], flags=3), 2), store=store).problem == "fragment_waiting"
    assert found(ethernet(v4(segment[24:], flags=3), 1), store=store).octets == DATA


FRAMES = st.sampled_from(
    [
        (ethernet(v4(tcp(options=bytes(8)))), link.ETHERNET),
        (ethernet(v4(tcp(), flags=MORE), 7), link.ETHERNET),
        (ethernet(v6(fragment_header(6, 0, True) + tcp() + b"x", next_header=44)), link.ETHERNET),
        (v6(extension(6) + tcp(), next_header=60), link.RAW),
        (b"\0\0\0\x02" + v4(tcp()), link.LOOP),
        (struct.pack(">HHIHBB8s", 0x0800, 0, 1, 1, 0, 6, bytes(8)) + v4(tcp()), link.LINUX_SLL2),
    ]
)


@given(FRAMES, st.lists(st.tuples(st.integers(0, 110), st.integers(0, 255)), max_size=6), st.integers(0, 40))
def test_damaged_frames(made: tuple[bytes, int], changes: list[tuple[int, int]], cut: int) -> None:
    frame, link_type = made
    octets = bytearray(frame)
    for at, value in changes:
        octets[at % len(octets)] = value
    store = FragmentStore()
    for size in (len(octets), len(octets) - cut):
        got = found(bytes(octets[:size]), link_type, store)
        assert got.problem == "" or got.problem in CATEGORIES
        if not got.problem:
            assert len(got.key) in {12, 20, 36, 44}
            assert len(got.octets) <= size
            assert got.missing >= 0
