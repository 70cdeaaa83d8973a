"""The short way to the IP header, beside the one for every frame."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.tcp import link
from dissect.packets.tcp.usual import LEAST, usual_ip
from tests.packets.tcp.craft import v4, v6

#: What stands before the IP packet, by link type; ``%b`` is its EtherType.
LINKS = [
    (link.ETHERNET, bytes(12) + b"%b"),
    (link.ETHERNET, bytes(12) + b"\x81\0\0\5%b"),
    (link.ETHERNET, bytes(12) + b"\x81\0\x60\0%b"),  # only a priority
    (link.ETHERNET, bytes(12) + b"\x88\xa8\0\7%b"),
    (link.ETHERNET, bytes(12) + b"\x88\xa8\0\7\x81\0\0\5%b"),
    (link.ETHERNET, bytes(12) + b"\x81\0\x60\0\x81\0\xef\xff%b"),
    (link.ETHERNET, bytes(12) + b"\x88\xa8\xff\xff\x81\0\0\0%b"),
    (link.ETHERNET, bytes(12) + b"\x88\xa8\0\7\x88\xa8\0\5%b"),
    (link.ETHERNET, bytes(12) + b"\x91\0\0\7\x81\0\0\5\x81\0\0\6%b"),
    (link.ETHERNET, bytes(12) + b"\x81\0\0\7\x81\0\0\5\x81\0\0\6%b"),
    (link.ETHERNET, bytes(12) + b"\x81\0\0\7\x88\x64\x11\0\0\1\0\x30\0\x21%.0b"),  # PPPoE in a VLAN
    (link.LINUX_SLL, bytes(14) + b"%b"),
    (link.LINUX_SLL, bytes(14) + b"\x81\0\0\5%b"),
    (link.LINUX_SLL2, b"%b" + bytes(18)),
    (link.RAW, b"%.0b"),
    (link.IPV4, b"%.0b"),
    (link.NULL, b"\2\0\0\0%.0b"),
    (147, b"%.0b"),
]
PACKETS = [v4(bytes(20)), v6(bytes(20)), v4(bytes(60), options=bytes(4)), v4(b"")]


def framed(head: bytes, packet: bytes) -> bytes:
    return head % (b"\x86\xdd" if packet[0] >> 4 == 6 else b"\x08\0") + packet


def check(frame: bytes, link_type: int) -> None:
    buf = b"\x08" + frame + b"\x08\0" * 30  # another packet is behind it
    end = 1 + len(frame)
    at, vlan = link.find_ip(buf, 1, end, link_type)
    found = usual_ip(buf, 1, end, link_type)
    if at < 0 or at + LEAST > end:
        assert found[0] < 0
    else:
        assert found == (at, vlan)


@pytest.mark.parametrize(("link_type", "head"), LINKS)
@pytest.mark.parametrize("packet", PACKETS)
def test_it_finds_what_the_long_way_finds(link_type: int, head: bytes, packet: bytes) -> None:
    frame = framed(head, packet)
    for size in range(len(frame) + 1):
        check(frame[:size], link_type)


@given(
    st.sampled_from(LINKS),
    st.sampled_from(PACKETS),
    st.lists(st.tuples(st.integers(0, 40), st.sampled_from(b"\0\x08\x81\x88\xa8\x86\xdd\x45\xff")), max_size=4),
)
def test_it_does_so_with_any_octets(place: tuple[int, bytes], packet: bytes, changes: list[tuple[int, int]]) -> None:
    link_type, head = place
    frame = bytearray(framed(head, packet))
    for at, octet in changes:
        frame[at % len(frame)] = octet
    check(bytes(frame), link_type)
