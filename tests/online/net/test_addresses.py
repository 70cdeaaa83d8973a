"""Addresses: what is understood, what is refused and why, and that nothing listens to the world unasked."""

from __future__ import annotations

import socket

import pytest

from dissect.online.net import addresses
from dissect.online.net.addresses import (
    Address,
    AddressError,
    Place,
    ProxyError,
    expect_no_circle,
    listen_on,
    places_to_connect,
    places_to_listen,
    read_address,
)


@pytest.mark.parametrize(
    ("text", "port", "address"),
    [
        ("127.0.0.1:10102", None, Address("127.0.0.1", 10102)),
        ("[::1]:10102", None, Address("::1", 10102)),
        ("plc-7.plant:102", 102, Address("plc-7.plant", 102)),
        ("192.168.0.1", 102, Address("192.168.0.1", 102)),
        ("[fe80::1%eth0]", 102, Address("fe80::1%eth0", 102)),
        ("plc", 102, Address("plc", 102)),
    ],
)
def test_addresses_are_read(text: str, port: int | None, address: Address) -> None:
    assert read_address(text, port) == address


@pytest.mark.parametrize(
    ("text", "port"),
    [("", 102), ("127.0.0.1", None), (":102", 102), ("fe80::1", 102), ("a:b", 102), ("a:70000", 102), ("a b", 102)],
)
def test_what_is_no_address_is_told_with_an_example(text: str, port: int | None) -> None:
    with pytest.raises(AddressError, match=r"is not an address: expected HOST:PORT, for example 127\.0\.0\.1:10102"):
        read_address(text, port)


@pytest.mark.parametrize("host", ["127.0.0.1", "127.8.9.10", "::1", "localhost", "::ffff:127.0.0.1"])
def test_loopback_needs_no_permission(host: str) -> None:
    assert places_to_listen(Address(host, 10102), allow_remote=False)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.0.2.1", "::ffff:192.0.2.1"])
def test_the_world_is_let_in_only_when_asked(host: str) -> None:
    with pytest.raises(ProxyError, match=r"reaches the PLC: listen on .*--allow-remote"):
        places_to_listen(Address(host, 10102), allow_remote=False)
    (place,) = places_to_listen(Address(host, 10102), allow_remote=True)
    assert place.address[:2] == (host, 10102)


def test_a_chosen_port_is_one_port() -> None:
    assert len(places_to_listen(Address("localhost", 0), allow_remote=False)) == 1


def test_names_that_nobody_knows() -> None:
    for find in (places_to_connect, lambda address: places_to_listen(address, allow_remote=True)):
        with pytest.raises(ProxyError, match=r"no\.such\.host\.invalid:102: "):
            find(Address("no.such.host.invalid", 102))


def test_port_0_is_no_server() -> None:
    with pytest.raises(ProxyError, match="port 0 cannot be connected to"):
        places_to_connect(Address("127.0.0.1", 0))


def test_a_port_in_use_and_an_address_of_somebody_else() -> None:
    with listen_on(Place(socket.AF_INET, ("127.0.0.1", 0))) as listener:
        taken = Place(socket.AF_INET, listener.getsockname())
        with pytest.raises(ProxyError, match=rf"cannot listen on {taken}: Address already in use"):
            listen_on(taken)
    with pytest.raises(ProxyError, match=r"cannot listen on 192\.0\.2\.1:0"):
        listen_on(Place(socket.AF_INET, ("192.0.2.1", 0)))


@pytest.mark.parametrize(
    ("listens", "target", "circle"),
    [
        ("127.0.0.1:102", "127.0.0.1:102", True),
        ("0.0.0.0:102", "127.0.0.1:102", True),
        ("127.0.0.1:10102", "127.0.0.1:102", False),
        ("127.0.0.1:102", "127.0.0.2:102", False),
        ("0.0.0.0:102", "192.0.2.1:102", False),
    ],
)
def test_a_proxy_does_not_connect_to_itself(listens: str, target: str, circle: bool) -> None:
    places, targets = [
        [Place(socket.AF_INET, (host, int(port)))] for host, port in [text.split(":") for text in (listens, target)]
    ]
    if not circle:
        expect_no_circle(places, targets)
        return
    with pytest.raises(ProxyError, match="would connect to itself forever"):
        expect_no_circle(places, targets)


def test_a_proxy_that_listens_everywhere_does_not_connect_to_an_address_of_its_machine(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """No machine is sure to have another address than those of its loopback, so these are taken for any other."""
    monkeypatch.setattr(addresses, "is_loopback", lambda _: False)
    targets = [Place(socket.AF_INET, ("127.0.0.1", 10102))]
    with pytest.raises(ProxyError, match="would connect to itself forever"):
        expect_no_circle([Place(socket.AF_INET, ("0.0.0.0", 10102))], targets)
    expect_no_circle([Place(socket.AF_INET, ("0.0.0.0", 10103))], targets)
    expect_no_circle([Place(socket.AF_INET6, ("::", 10102, 0, 0))], targets)
