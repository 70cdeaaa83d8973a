from __future__ import annotations

import struct
from itertools import pairwise, permutations

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from dissect.engine.transactions.accounts import CATEGORIES
from dissect.packets.tcp import link
from dissect.packets.tcp.ip import FragmentStore
from dissect.packets.tcp.segment import Segment, find_segment
from tests.cases import each
from tests.packets.tcp.craft import DST, DST6, SRC, SRC6, TCP, UDP, extension, fragment_header, v4, v6

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


def found(
    frame: bytes, link_type: int = link.ETHERNET, store: FragmentStore | None = None, wants_udp: bool = False
) -> Segment:
    return find_segment(b"x" + frame, 1, 1 + len(frame), link_type, store or FragmentStore(), 0, wants_udp)


def udp(data: bytes = DATA, length: int | None = None) -> bytes:
    """A UDP datagram with a checksum that is wrong."""
    return PORTS + struct.pack(">HH", 8 + len(data) if length is None else length, 0xBAD0) + data


def found_udp(frame: bytes, link_type: int = link.ETHERNET, store: FragmentStore | None = None) -> Segment:
    return found(frame, link_type, store, True)


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
        assert (got.protocol, got.octets, got.missing) == (TCP, DATA, 0)


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


@each("size", range(20))
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


# ---- UDP ------------------------------------------------------------------------------------------------------------


#: What a segment tells; a compiled class does not list its attributes.
FACTS = ("ack", "key", "missing", "octets", "problem", "protocol", "seq", "vlan", "word")


def everything(got: Segment) -> tuple[object, ...]:
    return tuple(getattr(got, name) for name in FACTS)


@pytest.mark.parametrize("data", [b"", DATA, bytes(1400)])
@pytest.mark.parametrize("trailer", [b"", b"\x03\x00\x00\x07\x02\xf0"])
def test_a_datagram_in_every_dress(data: bytes, trailer: bytes) -> None:
    datagram = udp(data)
    four, six = v4(datagram, protocol=UDP, options=bytes(8)), v6(extension(UDP) + datagram, next_header=0)
    atomic = v6(fragment_header(UDP, 0, False) + datagram, next_header=44)
    sll = struct.pack(">HHH8sH", 0, 1, 6, bytes(8), 0x0800)
    for frame, link_type, key, vlan in (
        (ethernet(four), link.ETHERNET, SRC + DST + PORTS, 0),
        (ethernet(four, 5), link.ETHERNET, SRC + DST + PORTS + bytes(7) + b"\x05", 5),
        (ethernet(six), link.ETHERNET, SRC6 + DST6 + PORTS, 0),
        (ethernet(six, 4095), link.ETHERNET, SRC6 + DST6 + PORTS + bytes(6) + b"\x0f\xff", 4095),
        (ethernet(atomic), link.ETHERNET, SRC6 + DST6 + PORTS, 0),
        (four, link.RAW, SRC + DST + PORTS, 0),
        (b"\x02\0\0\0" + six, link.NULL, SRC6 + DST6 + PORTS, 0),
        (sll + four, link.LINUX_SLL, SRC + DST + PORTS, 0),
    ):
        got = found_udp(frame + trailer, link_type)
        assert (got.problem, got.protocol, got.key, got.vlan) == ("", UDP, key, vlan)
        assert (got.octets, got.missing) == (data, 0)
        assert (got.seq, got.ack, got.word) == (0, 0, 0)
        assert everything(found(frame + trailer, link_type)) == everything(Segment("not_tcp"))


@pytest.mark.parametrize("frame", [ethernet(v4(udp(), protocol=UDP), 3), ethernet(v6(udp(), next_header=UDP))])
def test_every_cut_of_a_datagram(frame: bytes) -> None:
    head = len(frame) - len(DATA)
    for size in range(len(frame) + 1):
        got = found_udp(frame[:size])
        if size < head:
            assert (got.problem, got.protocol) == ("cut", 0), size
        else:
            assert (got.problem, got.octets, got.missing) == ("", DATA[: size - head], len(frame) - size)


@pytest.mark.parametrize("packet", [v4(udp() + b"padding", protocol=UDP), v6(udp() + b"padding", next_header=UDP)])
def test_what_is_behind_the_udp_length_is_padding_captured_or_not(packet: bytes) -> None:
    frame = ethernet(packet)
    whole = len(frame) - len(b"padding")
    for size in range(whole - len(DATA), len(frame) + 1):
        got = found_udp(frame[:size])
        assert (got.problem, got.octets, got.missing) == ("", DATA[: size - (whole - len(DATA))], max(0, whole - size))


@each("length", [*range(18), 0x0F00, 65535])
def test_udp_lengths_that_lie(length: int) -> None:
    for packet in (v4(udp(length=length), protocol=UDP), v6(udp(length=length), next_header=UDP)):
        got = found_udp(ethernet(packet) + bytes(40))  # what the link adds is not the datagram's
        if 8 <= length <= 8 + len(DATA):
            assert (got.problem, got.octets, got.missing) == ("", DATA[: length - 8], 0)
        else:
            assert got.problem == "bad_header"


def test_a_udp_length_is_held_against_the_ip_length_also_where_the_capture_is_cut() -> None:
    for length, problem, missing in ((107, "", 92), (108, "", 93), (109, "bad_header", 0)):
        got = found_udp(ethernet(v4(udp(length=length), protocol=UDP, total=128)))
        assert (got.problem, got.missing) == (problem, missing)


@pytest.mark.parametrize("size", range(8))
def test_packets_too_short_for_udp(size: int) -> None:
    assert found_udp(ethernet(v4(udp()[:size], protocol=UDP)) + bytes(60)).problem == "bad_header"
    assert found_udp(ethernet(v4(udp()[:size], protocol=UDP, total=28))).problem == "cut"


def test_an_ip_length_of_0_leaves_the_udp_length_to_tell_the_trailer() -> None:
    got = found_udp(ethernet(v4(udp(), protocol=UDP, total=0)) + b"trailer")
    assert (got.problem, got.octets, got.missing) == ("", DATA, 0)


def pieces_of(datagram: bytes, six: bool, chain: bytes = b"", first: int = UDP) -> list[bytes]:
    """A datagram in three fragments, the first of them of 16 octets behind the extension headers."""
    content = chain + datagram
    edges = [0, len(chain) + 16, len(chain) + 24, len(content)]
    packets = []
    for at, end in pairwise(edges):
        more = end != len(content)
        if six:
            packets.append(v6(fragment_header(first, at, more) + content[at:end], next_header=44))
        else:
            packets.append(v4(content[at:end], protocol=UDP, flags=at // 8 | (MORE if more else 0)))
    return [ethernet(packet, 9) for packet in packets]


@pytest.mark.parametrize("order", list(permutations(range(3))))
def test_a_datagram_in_fragments(order: tuple[int, ...]) -> None:
    datagram = udp(DATA * 4) + b"padding"
    for frames, key in (
        (pieces_of(datagram, False), SRC + DST + PORTS),
        (pieces_of(datagram, True), SRC6 + DST6 + PORTS),
        (pieces_of(datagram, True, extension(60) + extension(UDP, 1), 60), SRC6 + DST6 + PORTS),
    ):
        store = FragmentStore()
        got = [found_udp(frames[index], store=store) for index in order]
        assert [one.problem for one in got] == ["fragment_waiting", "fragment_waiting", ""]
        assert (got[2].protocol, got[2].key[: len(key)], got[2].vlan) == (UDP, key, 9)
        assert (got[2].octets, got[2].missing) == (DATA * 4, 0)
        assert (store.waiting, store.used, store.dropped, store.conflicts) == (0, 2, 0, 0)


def test_fragments_of_udp_nobody_wants_are_not_kept() -> None:
    for six in (False, True):
        store = FragmentStore()
        for frame in pieces_of(udp(DATA * 4), six):
            assert found(frame, store=store).problem == "not_tcp"
        assert (store.waiting, store.used, store.dropped) == (0, 0, 0)


def test_fragments_behind_extension_headers_wait_for_a_first_that_may_show_tcp() -> None:
    """Only the first fragment shows UDP, and is not kept."""
    frames = pieces_of(udp(DATA * 4), True, extension(60) + extension(UDP), 60)
    store = FragmentStore()
    assert [found(frame, store=store).problem for frame in frames] == ["not_tcp"] + ["fragment_waiting"] * 2
    assert (store.waiting, store.used) == (2, 0)


@pytest.mark.parametrize(("length", "problem"), [(0, "bad_header"), (7, "bad_header"), (36, ""), (37, "bad_header")])
def test_the_udp_length_of_a_datagram_in_fragments(length: int, problem: str) -> None:
    for six in (False, True):
        store = FragmentStore()
        got = [found_udp(frame, store=store) for frame in pieces_of(udp(DATA * 4, length), six)]
        assert got[2].problem == problem
        assert (store.waiting, store.used) == (0, 2)


def test_a_fragmented_chain_with_no_datagram_behind_it() -> None:
    store = FragmentStore()
    chain = extension(60) + extension(UDP)
    first = v6(fragment_header(60, 0, True) + chain, next_header=44)
    last = v6(fragment_header(60, len(chain), False), next_header=44)
    assert found_udp(ethernet(first), store=store).problem == "fragment_waiting"
    assert found_udp(ethernet(last), store=store).problem == "bad_header"


def test_a_cut_fragment_of_udp_never_comes_whole() -> None:
    store = FragmentStore()
    first, *others = pieces_of(udp(DATA * 4), False)
    assert found_udp(first[:-1], store=store).problem == "cut"
    assert [found_udp(frame, store=store).problem for frame in others] == ["fragment_waiting"] * 2


def test_tcp_and_udp_with_the_same_identification_are_two_datagrams() -> None:
    store = FragmentStore()
    segment = tcp(DATA * 3)
    frames = pieces_of(udp(DATA * 4), False)
    ours = [ethernet(packet, 9) for packet in (v4(segment[:24], flags=MORE), v4(segment[24:], flags=3))]
    got = [found_udp(frame, store=store) for frame in (frames[0], ours[0], frames[1], ours[1], frames[2])]
    assert [(one.problem, one.protocol) for one in got[3:]] == [("", TCP), ("", UDP)]
    assert (got[3].octets, got[4].octets) == (DATA * 3, DATA * 4)
    assert (store.waiting, store.used, store.conflicts) == (0, 3, 0)


def test_fragments_of_another_program() -> None:
    """Scapy makes and cuts the datagrams, with its own lengths and checksums."""
    inet = pytest.importorskip("scapy.layers.inet")
    inet6 = pytest.importorskip("scapy.layers.inet6")
    layers = pytest.importorskip("scapy.layers.l2")
    data = bytes(range(256)) * 20
    ports = inet.UDP(sport=49152, dport=102) / data
    four = inet.fragment(inet.IP(src="10.0.0.1", dst="10.0.0.2", id=7) / ports, 1000)
    header = inet6.IPv6ExtHdrFragment(id=7)
    six = inet6.fragment6(inet6.IPv6(src="2001:db8::1", dst="2001:db8::2") / header / ports, 1280)
    for packets, key in ((four, SRC + DST + PORTS), (six, SRC6 + DST6 + PORTS)):
        assert len(packets) > 4
        store = FragmentStore()
        frames = [bytes(layers.Ether(src="02:00:00:00:00:01") / packet) for packet in reversed(packets)]
        *others, last = [found_udp(frame, store=store) for frame in frames]
        assert {one.problem for one in others} == {"fragment_waiting"}
        assert (last.problem, last.key, last.octets, last.missing) == ("", key, data, 0)


# ---- any octets -----------------------------------------------------------------------------------------------------

FRAMES = st.sampled_from(
    [
        (ethernet(v4(tcp(options=bytes(8)))), link.ETHERNET),
        (ethernet(v4(tcp(), flags=MORE), 7), link.ETHERNET),
        (ethernet(v6(fragment_header(6, 0, True) + tcp() + b"x", next_header=44)), link.ETHERNET),
        (v6(extension(6) + tcp(), next_header=60), link.RAW),
        (b"\0\0\0\x02" + v4(tcp()), link.LOOP),
        (struct.pack(">HHIHBB8s", 0x0800, 0, 1, 1, 0, 6, bytes(8)) + v4(tcp()), link.LINUX_SLL2),
        (ethernet(v4(udp(DATA * 4), protocol=UDP), 7), link.ETHERNET),
        (ethernet(v6(extension(UDP) + udp(DATA * 4), next_header=60)), link.ETHERNET),
        *[(frame, link.ETHERNET) for frame in pieces_of(udp(DATA * 4), True, extension(UDP), 60)],
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


@given(
    st.lists(
        st.tuples(
            FRAMES, st.lists(st.tuples(st.integers(0, 110), st.integers(0, 255)), max_size=4), st.integers(0, 20)
        ),
        max_size=12,
    )
)
def test_damaged_frames_where_udp_is_wanted(made: list[tuple[tuple[bytes, int], list[tuple[int, int]], int]]) -> None:
    """Whatever comes, every packet is on the books once, and what is no UDP is as it is where nobody wants UDP."""
    store = FragmentStore()
    here = 0
    for (frame, link_type), changes, cut in made:
        octets = bytearray(frame)
        for at, value in changes:
            octets[at % len(octets)] = value
        damaged = bytes(octets[: len(octets) - cut])
        got = found_udp(damaged, link_type, store)
        here += got.problem != "fragment_waiting"
        if not got.problem:
            assert got.protocol in {TCP, UDP}
            assert len(got.key) in {12, 20, 36, 44}
            assert len(got.octets) + got.missing <= 65535
        else:
            assert got.problem in CATEGORIES
        alone, unwanted = found_udp(damaged, link_type), found(damaged, link_type)
        if unwanted.problem != "not_tcp":
            assert everything(alone) == everything(unwanted)
        assert unwanted.protocol in {0, TCP}
    assert store.waiting + store.used + store.dropped + here == len(made)


@given(
    st.binary(max_size=60), st.none() | st.integers(0, 110), st.booleans(), st.integers(0, 40), st.binary(max_size=20)
)
@example(bytes(30), 25, False, 0, b"")
@example(bytes(30), 40, True, 20, b"")
def test_any_octets_as_udp(content: bytes, stated: int | None, six: bool, lacking: int, trailer: bytes) -> None:
    """The rule of lengths, told once more."""
    if stated is not None and len(content) >= 6:
        content = content[:4] + stated.to_bytes(2, "big") + content[6:]
    claimed = len(content) + lacking
    packet = v6(content, next_header=UDP, length=claimed) if six else v4(content, protocol=UDP, total=20 + claimed)
    got = found_udp(ethernet(packet) + (b"" if lacking else trailer))
    if six and not claimed:
        return  # length 0: the rest of the frame
    length = int.from_bytes(content[4:6], "big")
    if len(content) < 8:
        assert got.problem == ("cut" if lacking else "bad_header")
    elif 8 <= length <= claimed:
        assert (got.problem, got.octets) == ("", content[8:length])
        assert len(got.octets) + got.missing == length - 8
    else:
        assert got.problem == "bad_header"
