"""Which packets are wanted: by their connection, by octets of streams, by the packets that open and close a connection."""

from __future__ import annotations

import struct
from typing import Final

import pytest

from dissect.meaning.select.places import Places, Ranges, Stretch, packet_key, parsed
from dissect.meaning.select.spans import Span, TimedSpan
from dissect.packets.tcp import ip, link
from tests.cases import each
from tests.packets.tcp.craft import DST, DST6, SRC, SRC6, TCP, UDP, fragment_header, v4, v6
from tests.packets.tcp.test_segment import MORE, ethernet
from tests.packets.tcp.test_tunnel import FROM, OF_FRAMES, OF_IP, TO, frame_of, gre, outer

PORTS: Final = bytes.fromhex("c3500066")
BACK: Final = bytes.fromhex("0066c350")
KEY: Final = SRC + DST + PORTS
KEY6: Final = SRC6 + DST6 + PORTS
GRE: Final = 47


def segment(seq: int = 0, data: bytes = b"", flags: int = 0x18, options: bytes = b"", ports: bytes = PORTS) -> bytes:
    return ports + struct.pack(">IIHHHH", seq, 0, (5 + len(options) // 4) << 12 | flags, 8192, 0, 0) + options + data


def turned(packet: bytes) -> bytes:
    """Return the IPv4 packet from the other host."""
    return packet[:12] + packet[16:20] + packet[12:16] + packet[20:]


def wants(places: Places, frame: int, time_ns: int, octets: bytes) -> bool:
    found = parsed(octets, 0, len(octets), link.ETHERNET)
    assert found is not None
    return places.wants(frame, time_ns, octets, *found)


# ---- connections ----------------------------------------------------------------------------------------------------


@each("protocol", [TCP, UDP])
@each("six", [False, True])
def test_a_connection_is_its_packets_in_both_directions_from_the_first_to_the_last(protocol: int, six: bool) -> None:
    places = Places(frozenset((77,)), {})
    assert not places.looks
    places.add_connections(
        [Stretch(KEY6 if six else KEY, protocol, 5, 9), Stretch(KEY6 if six else KEY, protocol, 20, 20)]
    )
    assert places.looks
    assert places.frames == {77}

    def of(ports: bytes, kind: int = protocol, back: bool = False) -> list[int]:
        content = segment(ports=ports) if kind == TCP else ports + b"\0\x0b\0\0abc"
        if six:
            packet = v6(content, next_header=kind)
            packet = packet[:8] + packet[24:40] + packet[8:24] + packet[40:] if back else packet
        else:
            packet = v4(content, protocol=kind)
            packet = turned(packet) if back else packet
        return [frame for frame in range(1, 30) if wants(places, frame, 0, ethernet(packet))]

    assert of(PORTS) == of(BACK, back=True) == [5, 6, 7, 8, 9, 20]
    assert of(BACK) == of(PORTS, back=True) == of(PORTS[:3] + b"\x67") == of(PORTS, TCP + UDP - protocol) == []


def test_of_a_connection_in_several_vlans_all_keys_are_its_own() -> None:
    tag, other = bytes(7) + b"\x05", bytes(7) + b"\x06"
    swapped = DST + SRC + BACK
    places = Places(frozenset(), {KEY + tag: KEY + other, swapped + tag: swapped + other})
    places.add_connections([Stretch(KEY + tag, TCP, 1, 9)])
    packet = v4(segment())
    back = turned(v4(segment(ports=BACK)))
    for vlan, expected in ((5, True), (6, True), (7, False), (0, False)):
        assert wants(places, 3, 0, ethernet(packet, vlan)) is expected
        assert wants(places, 3, 0, ethernet(back, vlan)) is expected


# ---- octets ---------------------------------------------------------------------------------------------------------


def test_packets_that_carry_octets_of_a_range_at_its_time() -> None:
    places = Places(frozenset(), {})
    places.add_spans([TimedSpan(Span(KEY, 1000, 100), 50, 60)])
    assert places.looks

    def at(seq: int, size: int, time_ns: int = 55, options: bytes = b"", missing: int = 0) -> bool:
        packet = v4(segment(seq, bytes(size), options=options))
        octets = ethernet(packet)
        return wants(places, 1, time_ns, octets[: len(octets) - missing])

    for options in (b"", b"\x01" * 4, b"\x01" * 40):
        assert [size for size in (0, 1, 9, 10, 11, 30) if at(990, size, options=options)] == [11, 30]
        assert [seq for seq in (999, 1000, 1099, 1100) if at(seq, 1, options=options)] == [1000, 1099]
    assert [time_ns for time_ns in (49, 50, 60, 61) if at(1000, 1, time_ns)] == [50, 60]
    # The capture kept only the beginning: the octets that the IP header announces count, from a whole TCP header on.
    assert [missing for missing in range(40) if at(990, 30, missing=missing)] == list(range(31))
    assert not wants(places, 1, 55, ethernet(turned(v4(segment(1000, b"x", ports=BACK)))))
    assert not wants(places, 1, 55, ethernet(v4(PORTS + struct.pack(">HH", 9, 0) + bytes(40), protocol=UDP)))


def test_octets_in_another_vlan_of_the_same_connection() -> None:
    tag, other = bytes(7) + b"\x05", bytes(7) + b"\x06"
    for same, vlans in (({KEY + other: KEY + tag}, [5, 6]), ({}, [6])):
        places = Places(frozenset(), same)
        places.add_spans([TimedSpan(Span(KEY + other, 7, 3), 0, 9)])
        packet = v4(segment(8, b"x"))
        assert [vlan for vlan in (0, 5, 6, 7) if wants(places, 1, 0, ethernet(packet, vlan))] == vlans


# ---- opening and closing --------------------------------------------------------------------------------------------


def test_of_a_marked_connection_the_packets_that_open_and_close_it() -> None:
    places = Places(frozenset(), {})
    places.mark([Stretch(KEY, TCP, 5, 9)])
    assert places.looks
    for octets in (v4(segment()), turned(v4(segment(ports=BACK)))):
        flagged = [
            flags
            for flags in (0x01, 0x02, 0x04, 0x08, 0x10, 0x11, 0x12, 0x14, 0x18, 0x20, 0xF8)
            if wants(places, 5, 0, ethernet(octets[:33] + bytes((flags,)) + octets[34:]))
        ]
        assert flagged == [0x01, 0x02, 0x04, 0x11, 0x12, 0x14]
    syn = ethernet(v4(segment(flags=2)))
    assert [frame for frame in range(1, 12) if wants(places, frame, 0, syn)] == [5, 6, 7, 8, 9]
    cut = [size for size in range(38, 55) if wants(places, 5, 0, syn[:size])]
    assert cut == list(range(48, 55))  # 34 octets of Ethernet and IP, and the flags at octet 13 of TCP
    assert not wants(places, 5, 0, ethernet(v4(segment(flags=2, ports=PORTS[:3] + b"\x67"))))
    assert not wants(places, 5, 0, ethernet(v4(PORTS + b"\0\x20" + bytes(7) + b"\x02" + bytes(20), protocol=UDP)))


def test_what_has_no_ports_belongs_to_no_connection() -> None:
    places = Places(frozenset(), {b"": KEY})
    places.add_connections([Stretch(KEY, 1, 1, 9)])
    assert not wants(places, 5, 0, ethernet(v4(b"\x08\0", protocol=1)))


# ---- fragments ------------------------------------------------------------------------------------------------------


@each("six", [False, True])
@each("vlan", [0, 5])
def test_a_fragment_is_wanted_between_the_hosts_at_that_place_or_time(six: bool, vlan: int) -> None:
    key = (KEY6 if six else KEY) + (vlan.to_bytes(8, "big") if vlan else b"")

    def fragment(of: int = TCP) -> bytes:
        if six:
            return ethernet(v6(fragment_header(of, 64, False) + bytes(16), next_header=44), vlan)
        return ethernet(v4(bytes(16), protocol=of, flags=8), vlan)

    by_place, by_time, none = Places(frozenset(), {}), Places(frozenset(), {}), Places(frozenset(), {})
    by_place.add_connections([Stretch(key, TCP, 5, 9)])
    by_time.add_spans([TimedSpan(Span(key, 0, 1), 50, 60)])
    none.mark([Stretch(key, TCP, 5, 9)])
    for of in (TCP, UDP, GRE):
        assert [frame for frame in range(1, 12) if wants(by_place, frame, 0, fragment(of))] == [5, 6, 7, 8, 9]
        assert [at for at in (49, 50, 60, 61) if wants(by_time, 1, at, fragment(of))] == [50, 60]
        assert not wants(none, 5, 55, fragment(of))
    other = bytearray(fragment())
    other[14 + (4 if vlan else 0) + (39 if six else 19)] ^= 1  # the last octet of its receiver
    assert not wants(by_place, 5, 0, bytes(other))
    assert not wants(by_time, 1, 55, bytes(other))


def test_a_fragment_of_a_tunnel_is_wanted_at_that_place_or_time_whatever_its_hosts() -> None:
    by_place, by_time = Places(frozenset(), {}), Places(frozenset(), {})
    by_place.add_connections([Stretch(KEY, TCP, 5, 9)])
    by_time.add_spans([TimedSpan(Span(KEY, 0, 1), 50, 60)])
    for protocol, expected in ((GRE, True), (4, True), (TCP, False), (UDP, False)):
        octets = outer(bytes(16), protocol, MORE)
        assert wants(by_place, 9, 0, octets) is wants(by_time, 1, 60, octets) is expected
        assert not wants(by_place, 10, 0, octets)
        assert not wants(by_time, 1, 61, octets)


# ---- keys -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*OF_IP, *OF_FRAMES])
def test_a_fragment_of_udp_in_a_tunnel_is_one_of_its_hosts(name: str) -> None:
    packet = v4(bytes(16), protocol=UDP, flags=8)
    octets = OF_FRAMES[name](frame_of(packet)) if name in OF_FRAMES else OF_IP[name](packet)
    places = Places(frozenset(), {})
    places.add_connections([Stretch(KEY, UDP, 5, 9)])
    assert wants(places, 5, 0, octets)
    assert not wants(places, 4, 0, octets)


def test_an_ip_packet_without_a_header_before_it() -> None:
    packet = v4(segment())
    assert packet_key(packet, 0, len(packet), link.RAW) == (KEY, SRC + DST)


def test_a_frame_without_ip_has_no_key_whatever_its_octets() -> None:
    """The octets of this ARP frame, begun one place before it, are those of an IP packet."""
    arp = bytes.fromhex("00 0028 0000 0000 40 06 0000 0a000001 0a000002") + PORTS + bytes(21)
    arp = arp[:12] + b"\x08\x06" + arp[14:] + b"\x45"
    assert packet_key(arp, 0, len(arp), link.ETHERNET) == (b"", b"")


@pytest.mark.parametrize("name", [*OF_IP, *OF_FRAMES])
def test_in_a_tunnel_the_key_is_that_of_the_packet_in_it(name: str) -> None:
    packet = v4(segment(5, b"abc"))
    for vlan in (0, 5) if name in OF_FRAMES else (0,):
        octets = OF_FRAMES[name](frame_of(packet, vlan)) if name in OF_FRAMES else OF_IP[name](packet)
        key, addresses = packet_key(octets, 0, len(octets), link.ETHERNET)
        assert (key[:12], addresses) == (KEY, SRC + DST)
        if name in OF_FRAMES:
            assert key[12:] == (vlan.to_bytes(8, "big") if vlan else b"")
        places = Places(frozenset(), {key: KEY})
        places.add_spans([TimedSpan(Span(KEY, 7, 1), 0, 9)])
        assert wants(places, 1, 0, octets)


def test_a_tunnel_that_holds_nothing_that_can_be_read_is_a_packet_of_its_own() -> None:
    octets = outer(gre(b"\x45\0", 0x0800), GRE)
    assert packet_key(octets, 0, len(octets), link.ETHERNET) == (b"", FROM + TO)
    udp = outer(struct.pack(">HHHH", 50000, 4789, 8 + 9, 0) + b"\x08" + bytes(8), UDP)
    assert packet_key(udp, 0, len(udp), link.ETHERNET)[0][:12] == FROM + TO + struct.pack(">HH", 50000, 4789)
    wire = OF_FRAMES["pseudowire"](frame_of(v4(segment())))
    for size in range(14, len(wire) - 40):
        assert packet_key(wire, 0, size, link.ETHERNET) == (b"", b"")


def test_a_packet_has_a_key_from_its_ports_on() -> None:
    for size, key in ((0, b""), (3, b""), (4, KEY), (5, KEY)):
        octets = ethernet(v4(segment()[:size]))
        found = parsed(b"x" + octets + b"yyyy", 1, 1 + len(octets), link.ETHERNET)
        assert found is not None
        assert (found[1], int(found[0].protocol)) == (key, ip.TCP)
        assert packet_key(octets, 0, len(octets), link.ETHERNET) == (key, SRC + DST)


def test_ranges_that_touch_are_one() -> None:
    ranges = Ranges()
    assert 0 not in ranges
    for first, last in ((5, 9), (7, 8), (10, 12), (14, 14), (20, 29), (22, 23), (3, 2), (5, 6)):
        ranges.add(first, last)
    assert [number for number in range(31) if number in ranges] == [5, 6, 7, 8, 9, 10, 11, 12, 14, *range(20, 30)]
    ranges.add(13, 13)
    ranges.add(1, 30)
    ranges.add(2, 4)
    assert [number for number in range(40) if number in ranges] == list(range(1, 31))
