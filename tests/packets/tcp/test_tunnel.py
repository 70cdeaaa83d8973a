"""Tunnels: what is in them is what it would be without, wherever the capture cuts it, and tshark finds the same in them."""

from __future__ import annotations

import shutil
import struct
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Final

import pytest
from hypothesis import given
from hypothesis import strategies as st

from captures.craft import container
from dissect.engine.transactions.accounts import CATEGORIES
from dissect.files.anonymize.account import Choices
from dissect.meaning.select.places import Places, Stretch, packet_key
from dissect.meaning.select.selection import Choice
from dissect.packets.tcp import link
from dissect.packets.tcp.ip import FragmentStore
from dissect.packets.tcp.segment import Segment, find_segment
from dissect.packets.tcp.tunnel import unwrapped
from tests.cases import each
from tests.engine.test_pipeline import poll, ready
from tests.files.anonymize.support import anonymized
from tests.files.anonymize.support import told as told_of
from tests.packets.tcp.craft import DST, SRC, TCP, UDP, authentication, v4, v6
from tests.packets.tcp.test_segment import DATA, MORE, ethernet, tcp, udp
from tests.properties.books import Result, check_books
from tests.properties.packets import EPOCH_NS, MS, Flow, Talk, capture

MACS: Final = bytes.fromhex("02aabbccdd0102aabbccdd02")
#: The ends of the tunnel.
FROM, TO = bytes((192, 0, 2, 1)), bytes((192, 0, 2, 2))
FROM6, TO6 = bytes.fromhex("20010db8ffff00000000000000000001"), bytes.fromhex("20010db8ffff00000000000000000002")


def outer(content: bytes, protocol: int, flags: int = 0, ident: int = 7) -> bytes:
    """An IPv4 packet between the ends of the tunnel, in Ethernet with a VLAN tag."""
    head = struct.pack(">BBHHHBBH", 0x45, 0, 20 + len(content), ident, flags, 64, protocol, 0)
    return bytes(12) + b"\x81\x00\x00\x63\x08\x00" + head + FROM + TO + content


def outer6(content: bytes, protocol: int) -> bytes:
    head = struct.pack(">IHBB", 6 << 28, len(content), protocol, 64)
    return bytes(12) + b"\x86\xdd" + head + FROM6 + TO6 + content


def frame_of(packet: bytes, vlan: int = 0) -> bytes:
    return MACS + ethernet(packet, vlan)[12:]


def gre(content: bytes, kind: int, flags: int = 0) -> bytes:
    fields = b"".join([bytes(3) + b"\x05" for bit in (0x8000, 0x2000, 0x1000) if flags & bit])
    return struct.pack(">HH", flags, kind) + fields + content


def ethertype(packet: bytes) -> int:
    return 0x0800 if packet[0] >> 4 == 4 else 0x86DD


def in_udp(content: bytes, port: int) -> bytes:
    return outer(struct.pack(">HHHH", 50000, port, 8 + len(content), 0) + content, UDP)


def erspan2(frame: bytes) -> bytes:
    return gre(b"\x10\x01\x00\x05\x00\x00\x00\x00" + frame, 0x88BE, 0x1000)


def erspan3(frame: bytes, more: bool, kind: int = 0) -> bytes:
    head = b"\x20\x01\x00\x05" + bytes(6) + struct.pack(">H", kind << 10 | more)
    return gre(head + (bytes(8) if more else b"") + frame, 0x22EB, 0x1000)


def vxlan(frame: bytes, port: int = 4789) -> bytes:
    return in_udp(b"\x08\x00\x00\x00\x00\x00\x07\x00" + frame, port)


def geneve(content: bytes, kind: int, options: bytes = b"") -> bytes:
    head = struct.pack(">BBHI", len(options) // 4, 0, kind, 0x700)
    return in_udp(head + options + content, 6081)


TZSP_TAGS: Final = b"\x00\x0a\x01\xc4\x01"
LABELS: Final = b"\x00\x06\x40\x40" + b"\x00\x06\x51\x40"


def direct(kind: int, header: bytes, packet: bytes, trailer: bytes = b"") -> bytes:
    """An Ethernet frame with a header behind its EtherType."""
    return MACS + struct.pack(">H", kind) + header + packet + trailer


def after(packet: bytes) -> bytes:
    return struct.pack(">H", ethertype(packet))


Wrap = Callable[[bytes], bytes]

#: Tunnels that carry IP: by name, from the packet to the captured frame.
OF_IP: Final[dict[str, Wrap]] = {
    "gre": lambda p: outer(gre(p, ethertype(p)), 47),
    "gre-checksum": lambda p: outer(gre(p, ethertype(p), 0x8000), 47),
    "gre-key": lambda p: outer(gre(p, ethertype(p), 0x2000), 47),
    "gre-all": lambda p: outer(gre(p, ethertype(p), 0xB000), 47),
    "gre-mpls": lambda p: outer(gre(LABELS + p, 0x8847), 47),
    "gre-in-ipv6": lambda p: outer6(gre(p, ethertype(p)), 47),
    "erspan-3-ip": lambda p: outer(erspan3(p, False, 2), 47),
    "ip-in-ip": lambda p: outer(p, 4 if p[0] >> 4 == 4 else 41),
    "ip-in-ipv6": lambda p: outer6(p, 4 if p[0] >> 4 == 4 else 41),
    "mpls-in-ip": lambda p: outer(LABELS + p, 137),
    "geneve-ip": lambda p: geneve(p, ethertype(p)),
}
#: Tunnels that carry Ethernet frames.
OF_FRAMES: Final[dict[str, Wrap]] = {
    "gre-ethernet": lambda f: outer(gre(f, 0x6558, 0x2000), 47),
    "erspan-1": lambda f: outer(gre(f, 0x88BE), 47),
    "erspan-2": lambda f: outer(erspan2(f), 47),
    "erspan-3": lambda f: outer(erspan3(f, False), 47),
    "erspan-3-long": lambda f: outer(erspan3(f, True), 47),
    "vxlan": vxlan,
    "vxlan-linux": lambda f: vxlan(f, 8472),
    "geneve": lambda f: geneve(f, 0x6558),
    "geneve-options": lambda f: geneve(f, 0x6558, b"\x01\x02\x80\x01\x00\x00\x00\x0c"),
    "tzsp": lambda f: in_udp(b"\x01\x00\x00\x01\x01" + f, 37008),
    "tzsp-tags": lambda f: in_udp(b"\x01\x00\x00\x01" + TZSP_TAGS + f, 37008),
    "etherip": lambda f: outer(b"\x30\x00" + f, 97),
    "pseudowire": lambda f: direct(0x8847, LABELS + bytes(4), f),
    "erspan-in-ipv6": lambda f: outer6(erspan2(f), 47),
    "vxlan-in-gre": lambda f: outer(gre(vxlan(f)[18:], 0x0800), 47),
    "gre-in-erspan": lambda f: outer(erspan2(frame_of(outer(gre(f, 0x6558), 47)[18:])), 47),
}
#: Headers of the frame itself.
OF_LINK: Final[dict[str, Wrap]] = {
    "mpls": lambda p: direct(0x8847, LABELS, p),
    "mpls-multicast": lambda p: direct(0x8848, LABELS, p),
    "pppoe": lambda p: direct(0x8864, b"\x11\x00\x00\x01" + struct.pack(">H", len(p) + 2) + ppp(p), p),
    "snap": lambda p: direct(len(p) + 8, b"\xaa\xaa\x03\x00\x00\x00" + after(p), p),
    "hsr": lambda p: direct(0x892F, b"\x00\x60\x00\x01" + after(p), p),
    "hsr-vlan": lambda p: direct(0x892F, b"\x00\x60\x00\x01\x81\x00\x00\x00" + after(p), p),
    "cmd": lambda p: direct(0x8909, b"\x01\x01\x00\x01\x00\x07" + after(p), p),
    "vn-tag": lambda p: direct(0x8926, b"\x00\x00\x00\x01" + after(p), p),
    "macsec-plain": lambda p: direct(0x88E5, b"\x00\x00\x00\x00\x00\x01" + after(p), p, bytes(16)),
    "tpid-9200": lambda p: direct(0x9200, b"\x00\x00" + after(p), p),
}


def ppp(packet: bytes) -> bytes:
    return b"\x00\x21" if ethertype(packet) == 0x0800 else b"\x00\x57"


PACKETS: Final = {4: lambda: v4(tcp()), 6: lambda: v6(tcp())}


def found(frame: bytes, store: FragmentStore | None = None, wants_udp: bool = False, kind: int = 1) -> Segment:
    return find_segment(b"xy" + frame + b"z", 2, 2 + len(frame), kind, store or FragmentStore(), 0, wants_udp)


def told(got: Segment) -> tuple[object, ...]:
    return got.problem, got.protocol, got.key, got.vlan, got.seq, got.ack, got.word, got.octets, got.missing


def check_cuts(frame: bytes, expected: Segment, behind: int = 0, wants_udp: bool = False) -> None:
    """Whatever is left of a frame, it is the segment with what is missing at its end, or it is cut."""
    whole = len(frame) - behind
    head = whole - len(expected.octets)
    unknown = 0
    for size in range(len(frame) + 1):
        got = found(frame[:size], wants_udp=wants_udp)
        if size < head:
            assert (got.problem in {"cut", "not_tcp"}, got.sealed) == (True, ""), size
            unknown += got.problem == "not_tcp"
        else:
            kept = expected.octets[: size - head]
            assert (got.problem, got.key, got.octets) == ("", expected.key, kept), size
            assert got.missing == len(expected.octets) - len(kept)
    assert unknown in {0, 8}  # a header of UDP that is cut says nothing of a tunnel


@each("name", list(OF_IP))
@each("version", [4, 6])
def test_a_segment_in_a_tunnel_of_ip(name: str, version: int) -> None:
    packet = PACKETS[version]()
    frame = OF_IP[name](packet)
    plain, got = found(ethernet(packet)), found(frame)
    assert told(got) == told(plain)
    assert plain.problem == ""
    assert (plain.macs, got.macs) == (None, b"")
    check_cuts(frame, plain)
    assert packet_key(frame, 0, len(frame), 1) == (plain.key, packet_key(packet, 0, len(packet), link.RAW)[1])


@each("name", list(OF_FRAMES))
@each("version", [4, 6])
@each("vlan", [0, 20])
def test_a_segment_in_a_tunnel_of_frames_is_in_the_vlan_of_its_own_frame(name: str, version: int, vlan: int) -> None:
    packet = PACKETS[version]()
    frame = OF_FRAMES[name](frame_of(packet, vlan))
    plain, got = found(ethernet(packet, vlan)), found(frame)
    assert told(got) == told(plain)
    assert (got.problem, got.vlan, got.macs) == ("", vlan, MACS)
    check_cuts(frame, plain)
    assert packet_key(frame, 0, len(frame), 1)[0] == plain.key


@each("name", list(OF_LINK))
@each("version", [4, 6])
def test_a_segment_behind_another_header(name: str, version: int) -> None:
    packet = PACKETS[version]()
    frame = OF_LINK[name](packet)
    plain, got = found(ethernet(packet)), found(frame)
    assert told(got) == told(plain)
    assert (got.problem, got.macs) == ("", None)
    check_cuts(frame, plain, 16 if name == "macsec-plain" else 0)


@each("kind", [link.PPP, link.PPP_HDLC])
@each("version", [4, 6])
def test_ppp(kind: int, version: int) -> None:
    packet = PACKETS[version]()
    for head in (b"\xff\x03" + ppp(packet), ppp(packet), ppp(packet)[1:], b"\xff\x03" + ppp(packet)[1:]):
        for size in range(len(packet) - len(DATA)):
            assert found((head + packet)[:size], kind=kind).problem == "cut"
        assert told(found(head + packet, kind=kind)) == told(found(ethernet(packet)))
    cisco = b"\x0f\x00" + after(packet) + packet
    assert told(found(cisco, kind=kind)) == told(found(ethernet(packet)))
    assert found(b"\xff\x03\xc0\x21" + bytes(20), kind=kind).problem == "not_ip"


def test_the_authentication_header_of_ipv4() -> None:
    frame = ethernet(v4(authentication(TCP) + tcp(), protocol=51))
    plain = found(ethernet(v4(tcp())))
    assert told(found(frame)) == told(plain)
    check_cuts(frame, plain)


def test_a_frame_of_mpls_needs_no_control_word_where_its_type_shows() -> None:
    packet = v4(tcp())
    frame = b"\x00\x1b\x1b\x00\x00\x01\x00\x1b\x1b\x00\x00\x02" + ethernet(packet)[12:]
    assert told(found(direct(0x8847, LABELS, frame))) == told(found(ethernet(packet)))


def test_a_datagram_in_a_tunnel() -> None:
    packet = v4(udp(), protocol=UDP)
    plain = found(ethernet(packet), wants_udp=True)
    assert plain.octets == DATA
    for wrap in OF_IP.values():
        assert told(found(wrap(packet), wants_udp=True)) == told(plain)
        assert found(wrap(packet)).problem == "not_tcp"
    for wrap in OF_FRAMES.values():
        check_cuts(wrap(frame_of(packet)), plain, wants_udp=True)


def test_what_only_has_the_port_of_a_tunnel_is_a_datagram() -> None:
    for port in (4789, 8472, 6081, 37008):
        for content in (b"", b"\x01", bytes(7), b"\xff" * 40, b"\x08" * 60, b"\x01\x00\x00\x01\x01" + bytes(30)):
            frame = in_udp(content, port)
            got = found(frame, wants_udp=True)
            assert (got.problem, got.protocol, got.octets, got.vlan) == ("", UDP, content, 0x63)
            assert (got.macs, found(frame).problem) == (None, "not_tcp")


def test_tunnels_in_each_other_are_opened_up_to_a_bound() -> None:
    packet = v4(tcp())
    for levels in range(1, 9):
        content = packet
        for _ in range(levels):
            content = outer(gre(content, 0x0800), 47)[18:]
        got = found(ethernet(content))
        assert got.problem == ("" if levels <= 4 else "not_ip")
        assert got.sealed == ("" if levels <= 4 else "more than 4 tunnels in each other")
    wires = frame_of(packet)
    for levels in range(1, 400):
        wires = direct(0x8847, LABELS + bytes(4), wires)
        assert found(wires).problem == ("" if levels <= 4 else "not_ip"), levels
    assert found(direct(0x8847, b"\x00\x06\x40\x40" * 17, packet)).problem == "not_ip"
    headers = b"\x00\x60\x00\x01\x89\x2f" * 8
    assert found(direct(0x892F, headers, packet)).problem == "not_ip"


@each("name", ["gre", "gre-all", "erspan-2", "ip-in-ip", "mpls-in-ip", "etherip"])
def test_a_tunnel_in_fragments(name: str) -> None:
    packet = v4(tcp())
    content = (OF_IP[name](packet) if name in OF_IP else OF_FRAMES[name](frame_of(packet)))[18:]
    body, protocol = content[20:], content[9]
    store = FragmentStore()
    pieces = [outer(body[:32], protocol, MORE), outer(body[32:], protocol, 4)]
    for order in ((0, 1), (1, 0)):
        assert found(pieces[order[0]], store).problem == "fragment_waiting"
        assert told(found(pieces[order[1]], store)) == told(found(ethernet(packet)))
    assert (store.waiting, store.used, store.dropped) == (0, 2, 0)
    six = [outer6(struct.pack(">BBHI", protocol, 0, at | more, 9) + body[at:][: 32 if more else 999], 44) for at, more in
           ((0, 1), (32, 0))]  # fmt: skip
    assert found(six[0], store).problem == "fragment_waiting"
    assert told(found(six[1], store)) == told(found(ethernet(packet)))


def test_fragments_in_a_tunnel_in_fragments() -> None:
    segment = tcp(DATA * 9)
    store = FragmentStore()
    pieces = [v4(segment[:48], flags=MORE), v4(segment[48:], flags=6)]
    frames = []
    for number, piece in enumerate(pieces):
        body = gre(piece, 0x0800)
        frames += [outer(body[:24], 47, MORE, number), outer(body[24:], 47, 3, number)]
    problems = [found(frame, store).problem for frame in frames]
    assert problems == ["fragment_waiting"] * 3 + [""]
    # The first whole tunnel held a fragment, which waits itself: three of four wait, and all came to be of use.
    assert (store.waiting, store.used) == (0, 3)


def test_fragments_of_a_tunnel_over_udp_are_named() -> None:
    body = vxlan(frame_of(v4(tcp())))[38:]
    first, second = found(outer(body[:32], UDP, MORE)), found(outer(body[32:], UDP, 4))
    assert (first.problem, first.sealed) == ("not_tcp", "VXLAN in IP fragments")
    assert (second.problem, second.sealed) == ("not_tcp", "")


@pytest.mark.parametrize(
    ("frame", "kind", "problem", "sealed"),
    [
        (direct(0x88E5, b"\x0c\x00\x00\x00\x00\x01" + bytes(40), b""), 1, "not_ip", "MACsec"),
        (direct(0x88E5, b"\x20\x00\x00\x00\x00\x01" + bytes(40), b""), 1, "not_ip", "MACsec"),
        (outer(bytes(40), 50), 1, "not_tcp", "ESP (IPsec)"),
        (outer6(bytes(40), 50), 1, "not_tcp", "ESP (IPsec)"),
        (outer(bytes(40), 115), 1, "not_tcp", "L2TP"),
        (outer(b"\x30\x01\x88\x0b" + bytes(40), 47), 1, "not_tcp", "PPTP (GRE version 1)"),
        (outer(b"\x40\x00\x08\x00" + bytes(40), 47), 1, "not_tcp", "GRE with source routing"),
        (in_udp(b"\x01\x00\x00\x12\x01" + bytes(40), 37008), 1, "not_ip", "802.11 in TZSP"),
        (outer(gre(direct(0x88E5, b"\x0c" + bytes(40), b""), 0x6558), 47), 1, "not_ip", "MACsec"),
        (direct(0x8864, b"\x11\x00\x00\x01\x00\x20\x00\xfd" + bytes(40), b""), 1, "not_ip",
         "PPP that is compressed, encrypted or in pieces"),
        (b"\x08\x02" + bytes(60), 105, "link_type", "802.11"),
        (b"\x00\x00\x08\x00" + bytes(60), 127, "link_type", "802.11"),
        (bytes(60), 147, "link_type", "link type 147"),
        (outer(gre(bytes(40), 0x88CC), 47), 1, "not_ip", ""),
        (outer(gre(b"", 0), 47), 1, "not_ip", ""),
        (outer(b"\x00\x02\x08\x00" + bytes(40), 47), 1, "not_tcp", ""),
        (outer(erspan3(bytes(60), False, 5), 47), 1, "not_ip", ""),
        (direct(0x8847, b"\x00\x06\x41\x40\x10" + bytes(40), b""), 1, "not_ip", ""),
        (direct(0x8864, b"\x11\x09\x00\x01\x00\x20\x00\x21" + bytes(40), b""), 1, "not_ip", ""),
        (direct(38, b"\x42\x42\x03" + bytes(40), b""), 1, "not_ip", ""),
        (direct(0x0806, bytes(46), b""), 1, "not_ip", ""),
    ],
)  # fmt: skip
def test_what_is_not_opened_is_named_where_somebody_would_look_for_s7_in_it(
    frame: bytes, kind: int, problem: str, sealed: str
) -> None:
    got = found(frame, kind=kind)
    assert (got.problem, got.sealed, got.octets) == (problem, sealed, b"")


def of_frame(wrap: Wrap) -> Wrap:
    """Take the packet out of an untagged frame first."""
    return lambda frame: wrap(frame[14:])


WRAPS: Final = {**OF_FRAMES, **{name: of_frame(wrap) for name, wrap in {**OF_IP, **OF_LINK}.items()}}


@given(st.sampled_from(sorted(WRAPS)), st.integers(0, 200), st.binary(min_size=1, max_size=12), st.booleans())
def test_any_octets(name: str, at: int, octets: bytes, wants_udp: bool) -> None:
    frame = bytearray(WRAPS[name](frame_of(v4(tcp()))))
    frame[at : at + len(octets)] = octets
    for size in range(len(frame) + 1):
        got = found(bytes(frame[:size]), wants_udp=wants_udp)
        assert (not got.problem) == (got.protocol in {TCP, UDP})
        assert not got.problem or got.problem in CATEGORIES
        assert 0 <= got.vlan < 2**48
        packet_key(bytes(frame), 0, size, 1)


# ---- whole sessions -------------------------------------------------------------------------------------------------


def session(port: int = 49152) -> Talk:
    return poll(ready(Flow(ports=(port, 102))), 1, 2, 3)


def frames_in(name: str, talk: Talk) -> list[bytes]:
    return [WRAPS[name](segment.frame()) for segment in talk.segments]


@each("name", sorted(WRAPS))
def test_a_session_in_a_tunnel_is_the_session(name: str) -> None:
    talk = session()
    plain = Result(capture([segment.frame() for segment in talk.segments]))
    result = Result(capture(frames_in(name, talk)))
    check_books(result.pipeline, result.record)
    assert result.outcomes == plain.outcomes == ["answered"] * 4
    assert result.packets == plain.packets
    assert result.counts == plain.counts
    (connection,) = result.record.closed
    assert connection.tcp.vlan == 0


def test_stations_are_those_of_the_frame_in_the_tunnel() -> None:
    talk = session()
    # Both directions of these frames have the same sender, so that only one station of a connection is known.
    for name, macs in (("vxlan", talk.segments[0].frame()[:12]), ("hsr", MACS), ("gre", b"")):
        (connection,) = Result(capture(frames_in(name, talk)[:1] + frames_in(name, talk)[3:4])).record.closed
        assert connection.tcp.macs == macs[6:] + macs[:6]


def test_what_is_mirrored_bare_and_in_a_tunnel_is_captured_twice() -> None:
    talk = session()
    frames = []
    for segment in talk.segments:
        frames += [segment.frame(), WRAPS["erspan-2"](segment.frame())]
    result = Result(capture(frames))
    check_books(result.pipeline, result.record)
    assert result.outcomes == ["answered"] * 4
    assert len(result.record.closed) == 1
    assert result.packets["retransmission"] == result.packets["payload"]


def test_what_is_not_opened_is_counted_and_the_first_of_each_is_told() -> None:
    esp, macsec = outer(bytes(40), 50), direct(0x88E5, b"\x0c" + bytes(60), b"")
    result = Result(capture([esp, esp, macsec, esp]))
    check_books(result.pipeline)
    assert result.counts == {"capture.not_opened": 4}
    assert [(finding.frames, finding.detail) for finding in result.record.findings] == [
        ([1], "ESP (IPsec), first seen here"),
        ([3], "MACsec, first seen here"),
    ]


def test_fragments_of_a_tunnel_are_selected_with_what_is_in_it() -> None:
    """Which tunnel a fragment is of shows only when all of them are there: while something is wanted, all are."""
    talk = session()
    frames = []
    for number, segment in enumerate(talk.segments):
        body = gre(segment.frame(), 0x6558)
        frames += [outer(body[:48], 47, MORE, number), outer(body[48:], 47, 6, number)]
    result = Result(capture(frames))
    assert result.outcomes == ["answered"] * 4
    key = found(talk.segments[0].frame()).key
    places = Places(frozenset(), {})
    places.add_connections([Stretch(key, TCP, 10, 20)])
    choice = Choice(False, places, (0, 2**62), {})
    taken = [choice.takes(number, EPOCH_NS, frame, 0, len(frame), 1) for number, frame in enumerate(frames, 1)]
    assert taken == [10 <= number <= 20 for number in range(1, len(frames) + 1)]
    other = outer(bytes(48), 17, MORE)
    assert not choice.takes(15, EPOCH_NS, other, 0, len(other), 1)


#: What Wireshark has to be told: the port, the tag and the kind of label it does not know by itself.
DECODE_AS: Final = ("udp.port==8472,vxlan", "ethertype==0x9200,vlan", "mpls.label==101,pwethcw")
#: Of ERSPAN III it shows frames only, though the header says that an IP packet follows.
NOT_THEIRS: Final = "erspan-3-ip"


def test_tshark_finds_the_same_frames(tmp_path: Path) -> None:
    tshark = shutil.which("tshark")
    if tshark is None:
        pytest.skip("tshark is not installed")
    frames: list[bytes] = []
    skipped: set[int] = set()
    for number, name in enumerate(sorted(WRAPS)):
        before = len(frames)
        frames += frames_in(name, session(40000 + number))
        if name == NOT_THEIRS:
            skipped |= set(range(before + 1, len(frames) + 1))
    path = tmp_path / "tunnels.pcap"
    packets = [container.Packet(EPOCH_NS + at * MS, frame, len(frame)) for at, frame in enumerate(frames)]
    path.write_bytes(container.write_pcap(packets))
    command = [
        tshark,
        "-n",
        "-r",
        str(path),
        *[part for each in DECODE_AS for part in ("-d", each)],
        "-Y",
        "s7comm",
        "-T",
        "fields",
        "-e",
        "frame.number",
    ]
    theirs = set(map(int, subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()))
    result = Result(capture(frames))
    ours = {frame for one in result.transactions for frame in (one.request_frame, one.response_frame)}
    assert len(result.transactions) == 4 * len(WRAPS)
    assert ours - skipped == theirs - skipped


@each("others", [False, True])
def test_what_is_in_a_tunnel_is_made_anonymous_and_nothing_of_the_tunnel_is_left(others: bool, tmp_path: Path) -> None:
    source, out = tmp_path / "tunnels.pcap", tmp_path / "anonymous.pcapng"
    talks = {name: session(40000 + number) for number, name in enumerate(WRAPS)}
    frames = [frame for name, talk in talks.items() for frame in frames_in(name, talk)]
    frames += [outer(gre(ethernet(v4(bytes(40), protocol=1)), 0x6558), 47), outer(bytes(60), 50)]
    packets = [container.Packet(EPOCH_NS + at * MS, frame, len(frame)) for at, frame in enumerate(frames)]
    source.write_bytes(container.write_pcap(packets))
    account = anonymized(source, out, Choices(keep_others=others))
    assert account.written == len(frames) - (0 if others else 2)
    assert len(told_of(out)) == 4 * len(WRAPS)
    assert told_of(out) == told_of(source)
    left = out.read_bytes()
    for secret in (
        SRC + DST,
        DST + SRC,
        FROM,
        TO,
        FROM6,
        TO6,
        MACS[:6],
        MACS[6:],
        talks["gre"].segments[0].frame()[:12],
    ):
        assert secret not in left


def test_what_is_cut_in_a_tunnel_stays_cut(tmp_path: Path) -> None:
    source, out = tmp_path / "cut.pcap", tmp_path / "anonymous.pcapng"
    frames = [WRAPS["vxlan"](segment.frame()) for segment in session().segments]
    packets = [
        container.Packet(EPOCH_NS + at * MS, frame[:-2] if at == 8 else frame, len(frame))
        for at, frame in enumerate(frames)
    ]
    source.write_bytes(container.write_pcap(packets))
    anonymized(source, out)
    assert told_of(out) == told_of(source)


@each("vlan", [0, 20])
def test_a_packet_out_of_its_tunnel_is_as_it_came_into_it(vlan: int) -> None:
    frame = frame_of(v4(tcp()), vlan)
    for wrap in OF_FRAMES.values():
        assert unwrapped(wrap(frame) + bytes(4), 1) == (frame, link.ETHERNET, 0)
        assert unwrapped(wrap(frame)[:-3], 1) == (frame[:-3], link.ETHERNET, 3)
    for wrap in OF_IP.values():
        assert unwrapped(wrap(v4(tcp())), 1) == (v4(tcp()), link.RAW, 0)
    for wrap in OF_LINK.values():
        assert unwrapped(wrap(v4(tcp())), 1) is None
    assert unwrapped(frame, 1) is None
    assert unwrapped(outer(gre(frame_of(v4(bytes(20), protocol=1)), 0x6558), 47), 1) is None
