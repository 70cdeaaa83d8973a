from __future__ import annotations

import ipaddress
from itertools import pairwise, permutations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dissect.packets.tcp import ip
from dissect.packets.tcp.ip import FragmentStore, parse_ip
from dissect.packets.tcp.stream import address_text
from tests.cases import each
from tests.growth import assert_growth
from tests.packets.tcp.craft import DST, DST6, SRC, SRC6, TCP, UDP, authentication, extension, fragment_header, v4, v6

PAYLOAD = bytes(range(64))
MORE = 0x2000
SECOND = 10**9

# ---- IPv4 -----------------------------------------------------------------------------------------------------------


def payload_of(buf: bytes, at: int = 0, end: int | None = None) -> bytes:
    packet = parse_ip(buf, at, len(buf) if end is None else end)
    assert packet.problem == ""
    return buf[packet.start : packet.end]


@pytest.mark.parametrize("words", range(11))
def test_v4_with_options(words: int) -> None:
    buf = b"link" + v4(PAYLOAD, options=b"\x01" * words * 4) + b"trailer that is no data"
    packet = parse_ip(buf, 4, len(buf))
    assert (packet.problem, packet.protocol, packet.addresses) == ("", TCP, SRC + DST)
    assert (packet.start, packet.missing, packet.fragment_key) == (24 + words * 4, 0, b"")
    assert buf[packet.start : packet.end] == PAYLOAD


@pytest.mark.parametrize("words", [0, 3, 10])
def test_v4_cut_at_every_length(words: int) -> None:
    whole = v4(PAYLOAD, options=bytes(words * 4))
    header = 20 + words * 4
    for size in range(len(whole) + 1):
        packet = parse_ip(whole, 0, size)
        assert packet.problem == ("cut" if size < header else ""), size
        if size >= header:
            assert whole[packet.start : packet.end] == PAYLOAD[: size - header]
            assert packet.missing == len(whole) - size


@pytest.mark.parametrize("ihl", range(5))
def test_v4_header_length_below_the_header(ihl: int) -> None:
    buf = v4(PAYLOAD, ihl=ihl)
    assert parse_ip(buf, 0, len(buf)).problem == "bad_header"


@pytest.mark.parametrize(
    ("total", "ihl", "problem", "missing"),
    [
        (1, 5, "bad_header", 0),
        (19, 5, "bad_header", 0),
        (20, 6, "bad_header", 0),  # the header alone is longer than the packet
        (59, 15, "bad_header", 0),
        (20, 5, "", 0),
        (60, 15, "", 0),
        (84, 5, "", 0),
        (85, 5, "", 1),
        (65535, 5, "", 65535 - 84),
    ],
)
def test_v4_lengths_that_lie(total: int, ihl: int, problem: str, missing: int) -> None:
    buf = v4(PAYLOAD, total=total, ihl=ihl)
    packet = parse_ip(buf, 0, len(buf))
    assert (packet.problem, packet.missing) == (problem, missing)
    if not problem:
        assert (packet.start, packet.end) == (ihl * 4, min(total, 84))


def test_v4_length_0_of_segmentation_offload_is_the_rest_of_the_frame() -> None:
    buf = b"link" + v4(PAYLOAD * 2000, total=0)
    assert payload_of(buf, 4) == PAYLOAD * 2000
    assert parse_ip(buf, 4, 24).problem == ""
    assert parse_ip(v4(b"", total=0, ihl=6), 0, 20).problem == "cut"


@pytest.mark.parametrize("flags", [0, 0x4000, 0x8000, 0xC000])
def test_v4_that_is_no_fragment(flags: int) -> None:
    buf = v4(PAYLOAD, flags=flags)
    packet = parse_ip(buf, 0, len(buf))
    assert (packet.fragment_key, packet.more, packet.fragment_offset) == (b"", False, 0)


@pytest.mark.parametrize(("flags", "offset", "more"), [(MORE, 0, True), (0x6001, 8, True), (0x1FFF, 65528, False)])
def test_v4_fragment(flags: int, offset: int, more: bool) -> None:
    buf = v4(PAYLOAD, flags=flags, identification=0xABCD)
    packet = parse_ip(buf, 0, len(buf))
    assert packet.fragment_key == SRC + DST + b"\xab\xcd\x06"
    assert (packet.fragment_offset, packet.more) == (offset, more)


@pytest.mark.parametrize("flags", [MORE, MORE | 7, 7])
def test_v4_fragments_of_other_protocols_need_not_be_kept(flags: int) -> None:
    buf = v4(PAYLOAD, flags=flags, protocol=UDP)
    packet = parse_ip(buf, 0, len(buf))
    assert (packet.problem, packet.protocol, packet.fragment_key) == ("", UDP, b"")
    assert parse_ip(buf, 0, len(buf), True).fragment_key == SRC + DST + b"\x12\x34\x11"
    other = v4(PAYLOAD, flags=flags, protocol=1)
    assert parse_ip(other, 0, len(other), True).fragment_key == b""


# ---- IPv6 -----------------------------------------------------------------------------------------------------------

#: Extension headers by their numbers: (octets before the TCP segment, number of the first).
CHAINS = [
    (b"", TCP),
    (extension(TCP), 0),
    (extension(TCP, 3), 60),
    (extension(43) + extension(60, 1) + extension(TCP, 2), 0),
    (authentication(TCP), 51),
    (authentication(TCP, 0), 51),
    (extension(51) + authentication(135, 6) + extension(139) + extension(140) + extension(TCP), 0),
]


@pytest.mark.parametrize(("chain", "first"), CHAINS, ids=range(len(CHAINS)))
def test_v6_cut_at_every_length(chain: bytes, first: int) -> None:
    whole = v6(chain + PAYLOAD, next_header=first)
    header = 40 + len(chain)
    for size in range(len(whole) + 1):
        packet = parse_ip(b"x" + whole + b"trailer", 1, 1 + size)
        assert packet.problem == ("cut" if size < header else ""), size
        if size >= header:
            assert (packet.protocol, packet.addresses, packet.fragment_key) == (TCP, SRC6 + DST6, b"")
            assert (packet.start, packet.end, packet.missing) == (1 + header, 1 + size, len(whole) - size)
    assert payload_of(whole + b"trailer") == PAYLOAD


@pytest.mark.parametrize(("chain", "first"), CHAINS[1:], ids=range(1, len(CHAINS)))
def test_v6_length_that_ends_inside_an_extension_header(chain: bytes, first: int) -> None:
    for length in range(1, len(chain)):
        buf = v6(chain + PAYLOAD, next_header=first, length=length)
        assert parse_ip(buf, 0, len(buf)).problem == "bad_header", length


def test_v6_length_0_is_the_rest_of_the_frame() -> None:
    assert payload_of(v6(PAYLOAD * 2000, length=0)) == PAYLOAD * 2000


@pytest.mark.parametrize(("protocol", "content"), [(UDP, PAYLOAD), (58, PAYLOAD), (59, b""), (50, PAYLOAD), (255, b"")])
def test_v6_of_another_protocol(protocol: int, content: bytes) -> None:
    buf = v6(extension(protocol) + content, next_header=60)
    packet = parse_ip(buf, 0, len(buf))
    assert (packet.problem, packet.protocol) == ("", protocol)


def test_v6_with_more_extension_headers_than_anybody_sends() -> None:
    for count, protocol in ((16, TCP), (17, 60)):
        buf = v6(extension(60) * (count - 1) + extension(TCP) + PAYLOAD, next_header=60)
        assert parse_ip(buf, 0, len(buf)).protocol == protocol


@pytest.mark.parametrize("before", [b"", extension(44), extension(43) + extension(44)])
def test_v6_fragment(before: bytes) -> None:
    first = 44 if not before else 60
    for offset, more in ((0, True), (8, True), (65528, False)):
        buf = v6(before + fragment_header(TCP, offset, more) + PAYLOAD, next_header=first)
        packet = parse_ip(buf, 0, len(buf))
        assert packet.fragment_key == SRC6 + DST6 + bytes.fromhex("12345678") + b"\x06"
        assert (packet.problem, packet.fragment_offset, packet.more) == ("", offset, more)
        assert buf[packet.start : packet.end] == PAYLOAD


@pytest.mark.parametrize(("chain", "first"), CHAINS, ids=range(len(CHAINS)))
def test_v6_atomic_fragment_is_whole_by_itself(chain: bytes, first: int) -> None:
    buf = v6(fragment_header(first, 0, False) + chain + PAYLOAD, next_header=44)
    packet = parse_ip(buf, 0, len(buf))
    assert (packet.problem, packet.protocol, packet.fragment_key) == ("", TCP, b"")
    assert buf[packet.start : packet.end] == PAYLOAD


@pytest.mark.parametrize(("offset", "more"), [(0, True), (8, True), (8, False)])
def test_v6_fragments_of_other_protocols_need_not_be_kept(offset: int, more: bool) -> None:
    buf = v6(fragment_header(UDP, offset, more) + PAYLOAD, next_header=44)
    packet = parse_ip(buf, 0, len(buf))
    assert (packet.problem, packet.protocol, packet.fragment_key) == ("", UDP, b"")
    assert parse_ip(buf, 0, len(buf), True).fragment_key == SRC6 + DST6 + b"\x12\x34\x56\x78\x11"
    other = v6(fragment_header(58, offset, more) + PAYLOAD, next_header=44)
    assert parse_ip(other, 0, len(other), True).fragment_key == b""


def test_v6_first_fragment_without_its_whole_header_chain() -> None:
    """RFC 7112 forbids it; what is in the others may be anything."""
    whole = fragment_header(60, 0, True) + extension(TCP, 1)
    for size in range(1, len(whole)):
        buf = v6(whole[:size], next_header=44)
        assert parse_ip(buf, 0, len(buf)).problem == "bad_header"


# ---- any octets -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("nibble", [version for version in range(16) if version not in {4, 6}])
def test_other_versions(nibble: int) -> None:
    buf = bytes([nibble << 4 | 5]) + v4(PAYLOAD)[1:]
    assert parse_ip(buf, 0, len(buf)).problem == "bad_header"


HEADERS = st.sampled_from(
    [
        v4(PAYLOAD),
        v4(PAYLOAD, flags=MORE),
        v6(PAYLOAD),
        v6(b"".join(chain for chain, _ in CHAINS), next_header=0),
        v6(fragment_header(60, 0, True) + extension(TCP) + PAYLOAD, next_header=44),
    ]
)


@st.composite
def damaged(draw: st.DrawFn) -> bytes:
    octets = bytearray(draw(HEADERS))
    for at, value in draw(st.lists(st.tuples(st.integers(0, 80), st.integers(0, 255)), max_size=6)):
        octets[at % len(octets)] = value
    return bytes(octets)


@given(st.one_of(damaged(), st.binary(max_size=100)), st.integers(0, 3))
def test_any_octets(octets: bytes, start: int) -> None:
    start = min(start, len(octets))
    for end in range(start, len(octets) + 1):
        packet = parse_ip(octets, start, end)
        assert packet.problem in {"", "cut", "bad_header"}
        if not packet.problem:
            assert start <= packet.start <= packet.end <= end
            assert packet.missing >= 0
            assert len(packet.addresses) in {8, 32}
            assert packet.fragment_key == b"" or packet.fragment_offset or packet.more


# ---- fragments ------------------------------------------------------------------------------------------------------

Piece = tuple[int, bool, bytes]


def cut(payload: bytes, *edges: int) -> list[Piece]:
    """Cut a payload at offsets, which are multiples of 8."""
    places = [0, *edges, len(payload)]
    return [(start, end != len(payload), payload[start:end]) for start, end in pairwise(places)]


def filled(store: FragmentStore, pieces: list[Piece], key: bytes = b"k" * 11, time_ns: int = 0) -> list[bytes]:
    """Add pieces; return what became whole."""
    done = [store.add(key, offset, more, octets, time_ns) for offset, more, octets in pieces]
    return [whole for whole in done if whole is not None]


@each("order", list(permutations(range(4))))
def test_fragments_in_every_order(order: tuple[int, ...]) -> None:
    pieces = cut(PAYLOAD, 8, 32, 56)
    store = FragmentStore()
    assert filled(store, [pieces[index] for index in order]) == [PAYLOAD]
    assert (store.waiting, store.used, store.dropped, store.conflicts) == (0, 3, 0, 0)
    assert filled(store, pieces[:-1]) == []
    assert store.waiting == 3  # a datagram that is complete is forgotten: these begin another


def test_fragments_of_v4_from_the_wire() -> None:
    pieces = cut(PAYLOAD, 24, 40)
    store = FragmentStore()
    done = []
    for offset, more, octets in reversed(pieces):
        buf = v4(octets, flags=offset // 8 | (MORE if more else 0)) + b"\0\0\0\0"  # an Ethernet trailer
        packet = parse_ip(buf, 0, len(buf))
        content = buf[packet.start : packet.end]
        done.append(store.add(packet.fragment_key, packet.fragment_offset, packet.more, content, 0))
    assert done == [None, None, PAYLOAD]


@each(("chain", "first"), CHAINS)
@each("order", [(0, 1, 2), (2, 0, 1), (1, 2, 0)])
def test_fragments_of_v6_from_the_wire(chain: bytes, first: int, order: tuple[int, ...]) -> None:
    """Extension headers behind the fragment header count in the offsets, and are no part of the segment."""
    content = chain + PAYLOAD
    pieces = cut(content, len(chain) + 8, len(chain) + 32)
    store = FragmentStore()
    done = []
    for offset, more, octets in [pieces[index] for index in order]:
        buf = v6(extension(44) + fragment_header(first, offset, more) + octets, next_header=0)
        packet = parse_ip(buf, 0, len(buf))
        got = buf[packet.start : packet.end]
        done.append(store.add(packet.fragment_key, packet.fragment_offset, packet.more, got, 0))
    assert done == [None, None, PAYLOAD]


def test_a_v6_header_chain_changed_by_an_overlap_leads_nowhere() -> None:
    """The first fragment shows TCP, but an earlier copy of its second header says otherwise: no segment comes out."""
    key = bytes(32) + b"iden" + bytes([60])
    chain = extension(60) + extension(TCP)
    evil = [(8, True, extension(UDP)), (0, True, chain), (16, False, PAYLOAD)]
    store = FragmentStore()
    assert filled(store, evil, key) == [b""]
    assert store.conflicts == 1
    assert [store.add(key, *piece, 0, True) for piece in evil] == [
        None,
        None,
        PAYLOAD,
    ]  # where UDP is wanted, it is that
    assert (store.protocol, store.conflicts) == (UDP, 2)


@st.composite
def fragment_floods(draw: st.DrawFn) -> tuple[bytes, list[Piece]]:
    """A payload, and fragments that cover it in any order, with copies and overlaps of the same or of other octets."""
    payload = draw(st.binary(min_size=1, max_size=120))
    size = len(payload)
    blocks = st.integers(1, max(1, (size - 1) // 8))
    edges = sorted(draw(st.sets(blocks, max_size=8))) if size > 8 else []
    pieces = cut(payload, *[edge * 8 for edge in edges])
    for first, count, change in draw(st.lists(st.tuples(blocks, blocks, st.integers(0, 8)), max_size=6)):
        start = (first - 1) * 8
        octets = bytearray(payload[start : start + count * 8])
        if change < len(octets):
            octets[change] ^= 1
        pieces.append((start, start + len(octets) != size, bytes(octets)))
    return payload, draw(st.permutations(pieces))


@given(fragment_floods())
def test_first_copy_wins(flood: tuple[bytes, list[Piece]]) -> None:
    payload, pieces = flood
    model: dict[int, int] = {}
    conflict = False
    store = FragmentStore()
    for number, (offset, more, octets) in enumerate(pieces, 1):
        for place, octet in enumerate(octets, offset):
            conflict |= model.setdefault(place, octet) != octet
        whole = store.add(b"k" * 11, offset, more, octets, 0)
        if len(model) == len(payload):
            assert whole == bytes(model[place] for place in range(len(payload)))
            assert (store.waiting, store.used, store.dropped) == (0, number - 1, 0)
            break
        assert whole is None
        assert (store.waiting, store.used, store.dropped) == (number, 0, 0)
    else:
        pytest.fail("the fragments cover the payload")
    assert store.conflicts == conflict


@given(st.lists(st.tuples(st.integers(0, 5), st.booleans(), st.binary(max_size=24)), max_size=30), st.booleans())
def test_every_fragment_is_accounted_for(pieces: list[tuple[int, bool, bytes]], late: bool) -> None:
    """Contradicting ends, impossible sizes, copies: whatever comes out has no hole in it, and every packet is counted."""
    store = FragmentStore()
    model: dict[int, set[int]] = {}
    done = 0
    for number, (block, more, octets) in enumerate(pieces, 1):
        for place, octet in enumerate(octets, block * 8):
            model.setdefault(place, set()).add(octet)
        whole = store.add(b"k" * 11, block * 8, more, octets, number if late else 0)
        if whole is not None:
            done += 1
            assert all(octet in model[place] for place, octet in enumerate(whole))
        assert store.waiting + store.used + store.dropped + done == number


@pytest.mark.parametrize(
    "pieces",
    [
        # A piece far behind the end must not make up for octets that are missing before it.
        [(16, False, b"l" * 8), (40, True, b"x" * 24)],
        [(40, True, b"x" * 24), (16, False, b"l" * 8)],
        [(16, False, b"l" * 8), (24, False, b"m" * 8), (0, True, b"a" * 8)],
    ],
)
def test_fragments_that_contradict_the_end(pieces: list[Piece]) -> None:
    store = FragmentStore()
    assert filled(store, pieces) == []
    assert (store.conflicts, store.dropped, store.waiting) == (1, 1, len(pieces) - 1)


def test_the_first_end_counts() -> None:
    store = FragmentStore()
    pieces = [(8, False, b"b" * 8), (8, False, b"c" * 4), (8, False, b"c" * 16), (0, True, b"a" * 8)]
    assert filled(store, pieces) == [b"a" * 8 + b"b" * 8]
    assert (store.conflicts, store.dropped, store.used, store.waiting) == (1, 2, 1, 0)


@pytest.mark.parametrize("key", [b"j" + b"k" * 10, b"k" * 10 + b"\x11", b"k" * 11 + b"\0" * 7 + b"\x05"])
def test_other_addresses_identification_or_vlan_are_another_datagram(key: bytes) -> None:
    store = FragmentStore()
    assert filled(store, [(0, True, b"a" * 8)]) == []
    assert filled(store, [(8, False, b"b" * 8)], key) == []
    assert filled(store, [(8, False, b"c" * 8)]) == [b"a" * 8 + b"c" * 8]
    assert filled(store, [(0, True, b"d" * 8)], key) == [b"d" * 8 + b"b" * 8]


@pytest.mark.parametrize(
    ("offset", "more", "size", "taken"),
    [
        (65528, False, 7, True),
        (65528, False, 8, False),
        (65528, True, 8, False),
        (64, False, 65535, False),
        (0, True, 7, False),
        (0, True, 12, False),
        (0, True, 0, True),
        (8, False, 0, True),
    ],
)
def test_fragments_that_cannot_be(offset: int, more: bool, size: int, taken: bool) -> None:
    store = FragmentStore()
    assert store.add(b"k" * 11, offset, more, bytes(size), 0) is None
    assert (store.waiting, store.dropped) == ((1, 0) if taken else (0, 1))


def test_the_longest_datagram() -> None:
    payload = bytes(range(251)) * 262
    payload = payload[:65535]
    store = FragmentStore()
    assert filled(store, cut(payload, *range(1480, 65535, 1480))) == [payload]


def test_fragments_wait_thirty_seconds() -> None:
    for late, done in ((30 * SECOND, True), (30 * SECOND + 1, False)):
        store = FragmentStore()
        filled(store, [(0, True, b"a" * 8)], time_ns=5)
        whole = filled(store, [(8, False, b"b" * 8)], time_ns=5 + late)
        assert bool(whole) is done
        assert (store.expired, store.dropped, store.waiting) == ((0, 0, 0) if done else (1, 1, 1))


def test_what_is_late_goes_when_anything_comes_and_time_may_run_backwards() -> None:
    store = FragmentStore()
    for second in (10, 20, 5):
        filled(store, [(0, True, b"a" * 8)], bytes([second]) * 11, second * SECOND)
    filled(store, [(0, True, b"a" * 8)], b"z" * 11, 41 * SECOND)
    assert (store.expired, store.waiting) == (1, 3)
    filled(store, [(0, True, b"b" * 8)], b"y" * 11, 51 * SECOND)
    assert (store.expired, store.waiting) == (3, 2)


def test_too_many_datagrams_lose_the_oldest() -> None:
    store = FragmentStore()
    for number in range(ip.MAX_DATAGRAMS + 10):
        filled(store, [(0, True, b"a" * 8)], number.to_bytes(11, "big"))
    assert (store.evicted, store.dropped, store.waiting) == (10, 10, ip.MAX_DATAGRAMS)
    assert filled(store, [(8, False, b"b" * 8)], (10).to_bytes(11, "big")) == [b"a" * 8 + b"b" * 8]
    assert filled(store, [(8, False, b"b" * 8)], (9).to_bytes(11, "big")) == []


def test_too_many_octets_lose_the_oldest() -> None:
    store = FragmentStore()
    large = 65528
    number = 0
    while not store.evicted:
        filled(store, [(0, True, bytes(large))], number.to_bytes(11, "big"))
        number += 1
    assert number == ip.MAX_FRAGMENT_OCTETS // (large + 128) + 1
    assert (store.evicted, store.waiting) == (1, number - 1)


def test_small_pieces_count_with_what_they_cost() -> None:
    """8 octets each would fill the memory long before they fill the bound."""
    store = FragmentStore()
    pieces = 256
    for number in range(1500):
        key = number.to_bytes(11, "big")
        for place in range(pieces):
            store.add(key, place * 16, True, bytes(8), 0)
        if store.evicted:
            break
    assert store.evicted == 1
    assert store.waiting <= ip.MAX_FRAGMENT_OCTETS // (8 + 128)


def test_a_datagram_takes_a_bounded_number_of_fragments() -> None:
    store = FragmentStore()
    for _ in range(1030):
        store.add(b"k" * 11, 8, True, b"a" * 8, 0)
    assert (store.waiting, store.dropped) == (1024, 6)


def add(fragments: list[tuple[bytes, int, bool]]) -> None:
    """Add these fragments of 8 octets."""
    store = FragmentStore()
    for key, offset, more in fragments:
        store.add(key, offset, more, b"01234567", 0)


def test_a_flood_of_datagrams_takes_linear_work() -> None:
    def lone(count: int) -> list[tuple[bytes, int, bool]]:
        return [(number.to_bytes(11, "big"), 0, True) for number in range(count)]

    few, many = lone(10_000), lone(40_000)
    assert_growth(lambda: add(few), lambda: add(many), 8)  # 4 when linear, 16 when quadratic


def test_a_datagram_of_many_fragments_costs_no_more_for_each() -> None:
    def every_other(count: int) -> list[tuple[bytes, int, bool]]:
        """Whole datagrams of ``count`` fragments each: those with even numbers, then those that fit between them."""
        order = [*range(0, count, 2), *range(1, count, 2)]
        return [(b"k" * 11, place * 8, place != count - 1) for _ in range(16384 // count) for place in order]

    few, many = every_other(64), every_other(1024)
    assert_growth(lambda: add(few), lambda: add(many), 4)


# ---- addresses ------------------------------------------------------------------------------------------------------


@given(st.binary(min_size=4, max_size=4))
def test_v4_address_is_what_ipaddress_says(address: bytes) -> None:
    assert address_text(address) == str(ipaddress.IPv4Address(address))


GROUPS = st.one_of(st.just(b"\0\0"), st.just(b"\0\1"), st.binary(min_size=2, max_size=2))


@given(st.lists(GROUPS, min_size=8, max_size=8).map(b"".join))
def test_v6_address_is_what_ipaddress_says(address: bytes) -> None:
    text = address_text(address)
    expected = ipaddress.IPv6Address(address)
    assert ipaddress.IPv6Address(text) == expected
    if expected.ipv4_mapped is None:  # since 3.13 the standard library writes those with dots
        assert text == str(expected)


@pytest.mark.parametrize(
    ("address", "text"),
    [
        ("00" * 16, "::"),
        ("00" * 15 + "01", "::1"),
        ("fe80" + "00" * 14, "fe80::"),
        ("20010db8000000010000000000000001", "2001:db8:0:1::1"),
        ("20010db8000000000001000000000001", "2001:db8::1:0:0:1"),  # of two runs as long, the first
        ("20010db8000100010001000100010001", "2001:db8:1:1:1:1:1:1"),
        ("20010db8000000010001000100010001", "2001:db8:0:1:1:1:1:1"),  # one group of zero stays
    ],
)
def test_v6_address_in_the_form_of_rfc_5952(address: str, text: str) -> None:
    assert address_text(bytes.fromhex(address)) == text
