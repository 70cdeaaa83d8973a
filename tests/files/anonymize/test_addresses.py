"""Addresses by key: how much two have in common stays, ranges with a meaning stay, nothing else does."""

from __future__ import annotations

from hypothesis import assume, given
from hypothesis import strategies as st

from dissect.files.anonymize.addresses import AddressMap
from dissect.files.anonymize.key import Key

MAP = AddressMap(Key(b"secret"))
V4 = st.binary(min_size=4, max_size=4)
V6 = st.binary(min_size=16, max_size=16)


def v4(text: str) -> bytes:
    return bytes(int(number) for number in text.split("."))


def common(one: bytes, other: bytes) -> int:
    """Return how many bits two addresses have in common from the front."""
    size = 8 * len(one)
    return size - (int.from_bytes(one, "big") ^ int.from_bytes(other, "big")).bit_length()


@given(V4, V4)
def test_ipv4_prefixes_stay_common(one: bytes, other: bytes) -> None:
    assert common(MAP.ip(one), MAP.ip(other)) == common(one, other)


@given(V4, st.integers(0, 31))
def test_neighbours_stay_neighbours(one: bytes, bit: int) -> None:
    other = (int.from_bytes(one, "big") ^ 1 << bit).to_bytes(4, "big")
    assert common(MAP.ip(one), MAP.ip(other)) == 31 - bit


@given(V6, st.integers(0, 127))
def test_ipv6_prefixes_stay_common(one: bytes, bit: int) -> None:
    other = (int.from_bytes(one, "big") ^ 1 << bit).to_bytes(16, "big")
    solicited = bytes.fromhex("ff0200000000000000000001ff")
    mapped = b"\0" * 10 + b"\xff\xff"
    assume(not any(address.startswith((solicited, mapped)) for address in (one, other)))
    assert common(MAP.ip(one), MAP.ip(other)) == 127 - bit


@given(V4)
def test_ranges_with_a_meaning_keep_their_meaning(address: bytes) -> None:
    def kind(one: bytes) -> tuple[bool, ...]:
        first, second = one[0], one[1]
        return (
            first == 0,
            first == 10,
            first == 127,
            first >= 224,
            first == 172 and second & 0xF0 == 16,
            first == 192 and second == 168,
            first == 169 and second == 254,
        )

    assert kind(MAP.ip(address)) == kind(address)


def test_what_stays_and_what_does_not() -> None:
    for same in ("0.0.0.0", "127.0.0.1", "224.0.0.251", "255.255.255.255"):
        assert MAP.ip(v4(same)) == v4(same)
    plant = {v4(f"192.168.{net}.{host}") for net in range(3) for host in range(1, 40)}
    mapped = {MAP.ip(address) for address in plant}
    assert len(mapped) == len(plant)
    assert len(mapped & plant) < 6
    assert {address[:2] for address in mapped} == {v4("192.168.0.0")[:2]}


def test_link_local_stays_link_local() -> None:
    address = bytes.fromhex("fe80000000000000021b1bfffe123456")
    assert MAP.ip(address)[:8] == address[:8]
    assert MAP.ip(address)[8:] != address[8:]
    inside = b"\0" * 10 + b"\xff\xff" + v4("192.168.0.1")
    assert MAP.ip(inside) == inside[:12] + MAP.ip(v4("192.168.0.1"))


def test_the_end_of_a_station_in_a_group_address_goes() -> None:
    group = bytes.fromhex("ff0200000000000000000001ff123456")
    assert MAP.ip(group)[:13] == group[:13]
    assert MAP.ip(group)[13:] != group[13:]
    assert MAP.mac(bytes.fromhex("3333ff123456"))[3:] == MAP.ip(group)[13:]


@given(st.binary(min_size=6, max_size=6))
def test_stations(address: bytes) -> None:
    mapped = MAP.mac(address)
    assert mapped == AddressMap(Key(b"secret")).mac(address)
    assert mapped[0] & 3 == address[0] & 3
    if address[0] & 1 or not any(address):
        assert mapped == address or address.startswith(b"\x33\x33\xff")
    else:
        assert mapped != address


def test_different_addresses_are_counted_once() -> None:
    made = AddressMap(Key(b"x"))
    for _ in range(3):
        made.ip(v4("10.0.0.1"))
        made.ip(v4("127.0.0.1"))
        made.mac(bytes.fromhex("001b1b123456"))
    assert made.changed == {"ip_addresses": 1, "mac_addresses": 1}
