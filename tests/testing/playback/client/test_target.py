"""Where a replay may go: this machine, by whatever name, and nowhere else unless that is asked for."""

from __future__ import annotations

import socket
from typing import Any

import pytest

from dissect.online.net.addresses import Address
from dissect.testing.playback.client import ReplayError, places_of, read_target
from dissect.testing.playback.client.target import expect_allowed


def resolving(monkeypatch: pytest.MonkeyPatch, *hosts: str) -> None:
    """Let every name stand for ``hosts``."""

    def resolved(_host: str, port: int, **_: Any) -> list[tuple[Any, ...]]:
        six = socket.AF_INET6
        return [
            (six, socket.SOCK_STREAM, 6, "", (host, port, 0, 0))
            if ":" in host
            else (socket.AF_INET, socket.SOCK_STREAM, 6, "", (host, port))
            for host in hosts
        ]

    monkeypatch.setattr(socket, "getaddrinfo", resolved)


def test_a_target_is_a_host_and_a_port_or_the_port_of_a_plc() -> None:
    assert read_target("127.0.0.1:1102") == Address("127.0.0.1", 1102)
    assert read_target("127.0.0.1") == Address("127.0.0.1", 102)
    assert read_target("[::1]:7") == Address("::1", 7)
    with pytest.raises(ReplayError, match="is not an address"):
        read_target("127.0.0.1:port")


@pytest.mark.parametrize("text", ["127.0.0.1", "127.9.8.7:1", "[::1]:102", "[::ffff:127.0.0.1]:102"])
def test_this_machine_is_allowed_by_its_numbers(text: str) -> None:
    address = read_target(text)
    expect_allowed(address, False)
    assert [place.address[1] for place in places_of(address, False)] == [address.port]


@pytest.mark.parametrize(
    "text", ["192.0.2.1", "0.0.0.0:102", "[::]:102", "[2001:db8::1]:102", "[::ffff:192.0.2.1]:102", "128.0.0.1"]
)
def test_another_machine_is_refused_without_looking_anything_up(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(socket, "getaddrinfo")
    monkeypatch.delattr(socket, "socket")
    for refuse in (expect_allowed, places_of):
        with pytest.raises(
            ReplayError, match="not a loopback address of this machine: nothing was sent; add --allow-remote"
        ):
            refuse(read_target(text), False)


def test_another_machine_may_be_asked_for() -> None:
    address = read_target("192.0.2.1")
    expect_allowed(address, True)
    assert [str(place) for place in places_of(address, True)] == ["192.0.2.1:102"]


def test_a_name_of_this_machine_is_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    resolving(monkeypatch, "127.0.0.1", "::1")
    assert [str(place) for place in places_of(read_target("localhost"), False)] == ["127.0.0.1:102", "[::1]:102"]


@pytest.mark.parametrize("hosts", [("192.0.2.1",), ("127.0.0.1", "192.0.2.1"), ("::1", "2001:db8::1")])
def test_a_name_is_refused_when_any_address_of_it_is_of_another_machine(
    hosts: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    resolving(monkeypatch, *hosts)
    with pytest.raises(ReplayError, match=f"plc:102 is {hosts[-1]}, not a loopback address of this machine"):
        places_of(read_target("plc"), False)
    assert len(places_of(read_target("plc"), True)) == len(hosts)


def test_a_port_of_zero_and_an_unknown_name_are_told() -> None:
    with pytest.raises(ReplayError, match="port 0 cannot be connected to"):
        places_of(Address("127.0.0.1", 0), False)
    with pytest.raises(ReplayError, match="not a host name"):
        places_of(Address("x" * 70, 102), False)


@pytest.mark.parametrize("text", ["3221225985", "0xC0.0.2.1", "192.0.513"])
def test_numbers_that_a_system_takes_for_an_address_are_looked_at_as_one(text: str) -> None:
    """All three are 192.0.2.1, as old functions of the C library read numbers."""
    with pytest.raises(ReplayError, match=r"not a loopback address of this machine|Name or service|not known"):
        places_of(read_target(text), False)


@pytest.mark.parametrize(
    "text",
    [
        "[64:ff9b::7f00:1]",
        "[::127.0.0.1]",
        "[2002:7f00:1::]",
        "[fe80::1%lo]",
        "[ff02::1]",
        "224.0.0.1",
        "255.255.255.255",
    ],
)
def test_what_only_looks_like_this_machine_is_another_one(text: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(socket, "socket")
    with pytest.raises(ReplayError, match=r"not a loopback address of this machine|no address"):
        places_of(read_target(text), False)


def test_a_mapped_address_behind_a_name_is_looked_at_as_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    resolving(monkeypatch, "::ffff:127.0.0.1")
    assert len(places_of(read_target("plc"), False)) == 1
    resolving(monkeypatch, "::1", "::ffff:192.0.2.1")
    with pytest.raises(ReplayError, match=r"plc:102 is ::ffff:192\.0\.2\.1, not a loopback address of this machine"):
        places_of(read_target("plc"), False)


def test_only_addresses_that_were_looked_at_are_connected_to(monkeypatch: pytest.MonkeyPatch) -> None:
    """A name of many addresses: those that are not looked at are not used either."""
    resolving(monkeypatch, *[f"127.0.0.{number}" for number in range(1, 9)], "192.0.2.1")
    assert [place.address[0] for place in places_of(read_target("plc"), False)] == [f"127.0.0.{n}" for n in range(1, 9)]
