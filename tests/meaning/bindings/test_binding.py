"""Which conversations and places a binding means."""

from __future__ import annotations

from ipaddress import ip_address, ip_network

import pytest

from dissect.meaning.bindings.binding import Binding, Bindings


def octets(address: str) -> bytes:
    return ip_address(address).packed


@pytest.mark.parametrize(
    ("network", "one", "other", "meant"),
    [
        ("10.0.0.5/32", "10.0.0.5", "10.0.0.9", True),
        ("10.0.0.5/32", "10.0.0.9", "10.0.0.5", True),
        ("10.0.0.5/32", "10.0.0.4", "10.0.0.6", False),
        ("10.0.0.0/24", "10.0.0.255", "192.168.0.1", True),
        ("10.0.0.0/24", "10.0.1.0", "192.168.0.1", False),
        ("0.0.0.0/0", "10.0.1.0", "192.168.0.1", True),
        ("0.0.0.0/0", "fe80::1", "fe80::2", False),
        ("fe80::/64", "fe80::1", "fe80::2", True),
        ("::/0", "10.0.1.0", "192.168.0.1", False),
    ],
)
def test_network(network: str, one: str, other: str, meant: bool) -> None:
    binding = Binding("x", "udp", "messages", port=1, network=ip_network(network))
    assert binding.matches(octets(one), octets(other)) is meant


def test_without_a_network_everybody_is_meant() -> None:
    assert Binding("x", "udp", "messages", port=1).matches(octets("10.0.0.1"), octets("fe80::1"))


def test_an_address_of_an_odd_size_is_nobody() -> None:
    binding = Binding("x", "udp", "messages", port=1, network=ip_network("0.0.0.0/0"))
    assert not binding.matches(b"", b"\n\0\0")


def test_by_place_the_narrowest_network_first() -> None:
    wide = Binding("wide", "udp", "messages", port=7)
    six = Binding("six", "udp", "messages", port=7, network=ip_network("fe80::/64"))
    net = Binding("net", "udp", "messages", port=7, network=ip_network("10.0.0.0/24"))
    host = Binding("host", "udp", "messages", port=7, network=ip_network("10.0.0.5"))
    tcp = Binding("tcp", "tcp", "messages", port=7)
    tsap = Binding("tsap", "cotp", "messages", tsap=b"SCD1")
    low = Binding("low", "s7", "struct", area=0x84, db=10, offset=0, size=3)
    high = Binding("high", "s7", "pdo", area=0x84, db=10, offset=8, size=7)
    other = Binding("other", "s7", "pdo", area=0x83, offset=8, size=7)
    block = Binding("block", "bsend", "messages", r_id=0)
    given = [wide, six, net, host, tcp, tsap, high, low, other, block]
    found = Bindings(given)
    assert found.all == tuple(given)
    assert found.udp == {7: [host, net, six, wide]}
    assert found.tcp == {7: [tcp]}
    assert found.cotp == {b"SCD1": [tsap]}
    assert found.s7 == {(0x84, 10): [high, low], (0x83, 0): [other]}
    assert found.bsend == {0: [block]}
