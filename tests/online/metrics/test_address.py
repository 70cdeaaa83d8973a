"""Addresses: what can be said, and what is refused without being asked for twice."""

from __future__ import annotations

import socket

import pytest

from dissect.online.metrics.server import resolve
from dissect.online.net.addresses import Address, AddressError, is_loopback, parse_address


@pytest.mark.parametrize(
    ("text", "host", "port"),
    [
        ("127.0.0.1:9102", "127.0.0.1", 9102),
        ("localhost:0", "localhost", 0),
        ("[::1]:9102", "::1", 9102),
        ("[fe80::1%eth0]:65535", "fe80::1%eth0", 65535),
    ],
)
def test_an_address(text: str, host: str, port: int) -> None:
    address = parse_address(text)
    assert address == Address(host, port)
    assert str(address) == text


@pytest.mark.parametrize(
    "text",
    [
        "",
        "9102",
        ":9102",
        "127.0.0.1",
        "127.0.0.1:",
        "::1:9102",
        "[::1]",
        "a b:1",
        "h:x",
        "h:123456",
        "h:-1",
        "h:१",
        "x:1\n",
    ],
)
def test_no_address(text: str) -> None:
    with pytest.raises(AddressError, match=r"expected HOST:PORT, for example 127\.0\.0\.1:9102"):
        parse_address(text)


def test_a_port_beyond_all_ports() -> None:
    with pytest.raises(AddressError, match="at most 65535"):
        parse_address("127.0.0.1:65536")


@pytest.mark.parametrize("host", ["127.0.0.1", "127.9.9.9", "::1", "::ffff:127.0.0.1"])
def test_of_this_machine_only(host: str) -> None:
    assert is_loopback(host)


@pytest.mark.parametrize(
    "host", ["0.0.0.0", "::", "192.0.2.7", "2001:db8::1", "::ffff:192.0.2.7", "fe80::1%lo", "localhost"]
)
def test_of_other_machines_too(host: str) -> None:
    assert not is_loopback(host)


@pytest.mark.parametrize("host", ["0.0.0.0", "192.0.2.7", "::", "2001:db8::1"])
def test_what_others_can_reach_takes_one_more_word(host: str) -> None:
    address = Address(host, 9102)
    with pytest.raises(AddressError, match=r"other machines.*use 127\.0\.0\.1:9102, or add --allow-remote"):
        resolve(address, False)
    assert resolve(address, True).address[:2] == (host, 9102)


def test_a_name_is_looked_up_once() -> None:
    target = resolve(Address("localhost", 9102), False)
    assert target.family in {socket.AF_INET, socket.AF_INET6}
    assert is_loopback(target.address[0])


@pytest.mark.parametrize("host", ["fe80::1%nosuch0", "x" * 300, "a..b"])
def test_a_name_nobody_has(host: str) -> None:
    with pytest.raises(AddressError, match="use a name or an address of this machine"):
        resolve(Address(host, 9102), True)
