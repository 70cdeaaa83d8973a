"""The target of a replay: this machine, unless another one is allowed."""

from __future__ import annotations

import ipaddress

from dissect.online.net.addresses import (
    PLC_PORT,
    Address,
    AddressError,
    Place,
    ProxyError,
    is_loopback,
    places_to_connect,
    read_address,
)
from dissect.testing.playback.client.recorded import ReplayError


def read_target(text: str) -> Address:
    """Refuse a numeric address of another machine. Resolves nothing. Raises `ReplayError`."""
    try:
        return read_address(text, PLC_PORT)
    except AddressError as why:
        raise ReplayError(f"{why}") from None


def expect_allowed(address: Address, allow_remote: bool) -> None:
    """Refuse a numeric address of another machine. Resolves nothing. Raises `ReplayError`."""
    try:
        ipaddress.ip_address(address.host.partition("%")[0])
    except ValueError:
        return
    if not allow_remote and not is_loopback(address.host):
        raise _remote(address, address.host)


def places_of(address: Address, allow_remote: bool) -> list[Place]:
    """Return the addresses to connect to, in order: every address of the name must be one of this machine.

    With ``allow_remote`` any is accepted. Only this function resolves the name. Raises `ReplayError`.
    """
    expect_allowed(address, allow_remote)
    try:
        places = places_to_connect(address)
    except ProxyError as why:
        raise ReplayError(str(why)) from None
    for place in places:
        if not allow_remote and not is_loopback(str(place.address[0])):
            raise _remote(address, str(place.address[0]))
    return places


def _remote(address: Address, host: str) -> ReplayError:
    # An address of one of our network interfaces is refused as well: it may belong to a container, or be forwarded.
    which = f"{address} is" if address.host == host else f"{address} is {host},"
    return ReplayError(
        f"{which} not a loopback address of this machine: nothing was sent; add --allow-remote if that is intended"
    )
