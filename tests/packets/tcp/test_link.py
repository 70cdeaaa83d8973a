from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.tcp import link
from tests.cases import each

V4 = b"\x45\x00\x00\x14" + bytes(16)
V6 = b"\x60" + bytes(39)

IPV4, IPV6, ARP = 0x0800, 0x86DD, 0x0806


def tagged(ethertype: int, tags: list[tuple[int, int]]) -> tuple[int, bytes]:
    """Return the EtherType an untagged header ends with, and what stands between it and the packet."""
    types = [tpid for tpid, _ in tags] + [ethertype]
    return types[0], b"".join(struct.pack(">HH", tci, after) for (_, tci), after in zip(tags, types[1:], strict=True))


def header(link_type: int, ethertype: int, tags: list[tuple[int, int]]) -> bytes:
    first, between = tagged(ethertype, tags)
    if link_type == link.ETHERNET:
        return bytes(range(12)) + struct.pack(">H", first) + between
    if link_type == link.LINUX_SLL:
        return struct.pack(">HHH8sH", 0, 1, 6, bytes(8), first) + between
    return struct.pack(">HHIHBB8s", first, 0, 3, 1, 0, 6, bytes(8)) + between


WITH_ETHERTYPE = [link.ETHERNET, link.LINUX_SLL, link.LINUX_SLL2]
BARE = [link.RAW, link.RAW_BSD, link.RAW_OPENBSD, link.IPV4, link.IPV6]
STACKS = [
    [],
    [(0x8100, 5)],
    [(0x8100, 0xE005)],  # priority 7
    [(0x88A8, 100), (0x8100, 5)],
    [(0x9100, 1), (0x8100, 2), (0x8100, 3)],
    [(0x8100, 4095)] * 4,
]


@each("link_type", WITH_ETHERTYPE)
@each("ethertype", [IPV4, IPV6])
@each("tags", STACKS)
def test_every_cut_of_a_frame(link_type: int, ethertype: int, tags: list[tuple[int, int]]) -> None:
    head = header(link_type, ethertype, tags)
    frame = head + (V4 if ethertype == IPV4 else V6)
    vlan = 0
    for _, tci in tags:
        vlan = vlan * 4096 + (tci & 0xFFF)
    for before in (b"", b"another packet"):
        buf = before + frame + b"and one behind"
        for size in range(len(frame) + 1):
            found = link.find_ip(buf, len(before), len(before) + size, link_type)
            assert found == ((link.CUT, 0) if size < len(head) else (len(before) + len(head), vlan)), size


@pytest.mark.parametrize("link_type", WITH_ETHERTYPE)
@pytest.mark.parametrize("tags", STACKS)
def test_other_protocols_are_not_ip(link_type: int, tags: list[tuple[int, int]]) -> None:
    for ethertype in (ARP, 0x88CC, 0x8892, 0, 46, 0xFFFF):
        frame = header(link_type, ethertype, tags) + V4
        assert link.find_ip(frame, 0, len(frame), link_type) == (link.NOT_IP, 0)


@pytest.mark.parametrize("link_type", WITH_ETHERTYPE)
def test_nobody_stacks_five_tags(link_type: int) -> None:
    frame = header(link_type, IPV4, [(0x8100, 1)] * 5) + V4
    assert link.find_ip(frame, 0, len(frame), link_type) == (link.NOT_IP, 0)


@pytest.mark.parametrize("link_type", WITH_ETHERTYPE)
def test_a_priority_tag_is_no_vlan(link_type: int) -> None:
    plain = header(link_type, IPV4, [(0x8100, 7)])
    for tags in ([(0x8100, 0xE000), (0x8100, 7)], [(0x8100, 7), (0x8100, 0x2000)]):
        frame = header(link_type, IPV4, tags)
        found = link.find_ip(frame + V4, 0, len(frame + V4), link_type)
        assert found == (len(frame), link.find_ip(plain + V4, 0, len(plain + V4), link_type)[1])
    alone = header(link_type, IPV4, [(0x8100, 0xE000)])
    assert link.find_ip(alone + V4, 0, len(alone + V4), link_type) == (len(alone), 0)


VIDS = st.lists(st.integers(1, 4095), max_size=4)


@given(VIDS, VIDS)
def test_each_stack_of_vlans_has_its_own_key(one: list[int], other: list[int]) -> None:
    def key(vids: list[int]) -> int:
        frame = header(link.ETHERNET, IPV4, [(0x8100, vid) for vid in vids]) + V4
        return int(link.find_ip(frame, 0, len(frame), link.ETHERNET)[1])

    assert (key(one) == key(other)) is (one == other)
    assert 0 <= key(one) < 2**63  # the pipeline puts it into eight octets


@pytest.mark.parametrize("link_type", BARE)
def test_raw_ip_begins_at_once(link_type: int) -> None:
    for buf in (V4, V6, b""):
        assert link.find_ip(b"xyz" + buf, 3, 3 + len(buf), link_type) == (3, 0)


@each("link_type", [link.NULL, link.LOOP])
@each("family", [b"\x02\0\0\0", b"\0\0\0\x02", b"\x1e\0\0\0", b"\x18\0\0\0", b"\0\0\0\x1c"])
@each("packet", [V4, V6])
def test_loopback_of_every_system(link_type: int, family: bytes, packet: bytes) -> None:
    frame = b"before" + family + packet
    for size in range(len(frame) - 6):
        expected = link.CUT if size < 5 else 10
        assert link.find_ip(frame, 6, 6 + size, link_type) == (expected, 0)


@pytest.mark.parametrize("link_type", [link.NULL, link.LOOP])
def test_loopback_of_other_protocols(link_type: int) -> None:
    assert link.find_ip(b"\x17\0\0\0\x83\x1b\x01\0", 0, 8, link_type) == (link.NOT_IP, 0)


@pytest.mark.parametrize("link_type", [-1, 2, 105, 109, 127, 147, 189, 249, 65535, 2**31])
def test_other_link_types(link_type: int) -> None:
    assert link.find_ip(V4 * 2, 0, 40, link_type) == (link.UNSUPPORTED, 0)


KNOWN = [*WITH_ETHERTYPE, *BARE, link.NULL, link.LOOP]
#: Octets that often look like a stack of tags.
TAGGY = st.lists(
    st.one_of(
        st.sampled_from([b"\x81\x00", b"\x88\xa8", b"\x91\x00", b"\x08\x00", b"\x86\xdd"]), st.binary(max_size=3)
    ),
    max_size=30,
).map(b"".join)


@given(TAGGY, st.integers(0, 8), st.sampled_from([*KNOWN, 7]))
def test_any_octets(octets: bytes, start: int, link_type: int) -> None:
    start = min(start, len(octets))
    for end in range(start, len(octets) + 1):
        at, vlan = link.find_ip(octets, start, end, link_type)
        assert start <= at <= end or at in {link.NOT_IP, link.CUT, link.UNSUPPORTED}
        assert (at == link.UNSUPPORTED) is (link_type == 7)
        assert vlan == 0 or (at >= 0 and 0 < vlan < 2**48)


@pytest.mark.parametrize(
    ("vids", "text"), [([], ""), ([20], "20"), ([5, 7], "5.7"), ([7, 5], "7.5"), ([4095, 1, 2, 4094], "4095.1.2.4094")]
)
def test_a_key_gives_its_ids_back(vids: list[int], text: str) -> None:
    frame = header(link.ETHERNET, IPV4, [(0x8100, vid) for vid in vids]) + V4
    key = link.find_ip(frame, 0, len(frame), link.ETHERNET)[1]
    assert link.vlan_ids(key) == vids
    assert link.vlan_text(key) == text
