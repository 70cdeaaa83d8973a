"""Where a replay goes: this machine, unless more was asked for."""

from __future__ import annotations

import ipaddress

from dissect.net.addresses import (
    PLC_PORT,
    Address,
    AddressError,
    Place,
    ProxyError,
    is_loopback,
    places_to_connect,
    read_address,
)
from dissect.playback.client.recorded import ReplayError


def read_target(text: str) -> Address:
    """Read ``HOST[:PORT]``, port 102 unless said. Raises `ReplayError`."""
    try:
        return read_address(text, PLC_PORT)
    except AddressError as why:
        raise ReplayError(f"{why}") from None


def expect_allowed(address: Address, allow_remote: bool) -> None:
    """Refuse an address in numbers that is not of this machine. Resolves nothing. Raises `ReplayError`."""
    try:
        ipaddress.ip_address(address.host.partition("%")[0])
    except ValueError:
        return
    if not allow_remote and not is_loopback(address.host):
        raise _remote(address, address.host)


def places_of(address: Address, allow_remote: bool) -> list[Place]:
    """Return what to connect to, in this order: every address that the name stands for must be of this machine.

    With ``allow_remote`` any may be. The name is resolved here and nowhere else. Raises `ReplayError`.
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
    # One of a network interface of this machine is refused as well: it may be a container's, or forwarded.
    which = f"{address} is" if address.host == host else f"{address} is {host},"
    return ReplayError(
        f"{which} not a loopback address of this machine: nothing was sent; add --allow-remote if that is intended"
    )
