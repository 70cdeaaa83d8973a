"""Addresses: HOST:PORT as users write them, and in the form for sockets, to listen at and to connect to."""

from __future__ import annotations

import ipaddress
import re
import socket
from typing import Final, NamedTuple

from dissect.packets.source.packet import CaptureError

#: An address that only this machine can reach.
THIS_MACHINE: Final = "127.0.0.1"
#: The default address at which the proxy listens.
DEFAULT: Final = "127.0.0.1:10102"
#: An example of one; the port is near that of Prometheus' node exporter.
_EXAMPLE: Final = "127.0.0.1:9102"
#: The port of PLCs (RFC 1006).
PLC_PORT: Final = 102
_DANGER: Final = "and anyone who reaches it reaches the PLC"
#: At most this many addresses of one name are used.
_MAX_ADDRESSES: Final = 8
_ADDRESS: Final = re.compile(r"(?:\[(?P<six>[0-9A-Fa-f:.%\w]+)\]|(?P<host>[^\[\]:\s]+)):(?P<port>[0-9]{1,5})", re.ASCII)


class AddressError(ValueError):
    """An address cannot be used; the message is one line that says why and what to do."""


class ProxyError(CaptureError):
    """The proxy cannot begin; the message is one line that says why and what to do."""


class Address(NamedTuple):
    """A host, by name or number, and a port; 0 lets the system choose one."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


class Place(NamedTuple):
    """An address of one family, as ``socket`` takes it."""

    family: int
    address: tuple[str, int] | tuple[str, int, int, int]

    def __str__(self) -> str:
        return str(Address(self.address[0], self.address[1]))


def parse_address(text: str) -> Address:
    """Read ``HOST:PORT`` or ``[IPv6]:PORT``. Raises `AddressError`."""
    found = _ADDRESS.fullmatch(text)
    if found is None:
        raise AddressError(f"{text!r} is not an address: expected HOST:PORT, for example {_EXAMPLE} or [::1]:9102")
    port = int(found["port"])
    if port > 65535:
        raise AddressError(f"{text!r}: a port is at most 65535")
    return Address(found["six"] or found["host"], port)


def read_address(text: str, default_port: int | None = None) -> Address:
    """Parse ``HOST:PORT`` or ``[IPv6]:PORT``; with ``default_port``, the port may be missing. Raises `AddressError`."""
    try:
        return parse_address(text)
    except AddressError:
        if default_port is not None:
            try:
                return parse_address(f"{text}:{default_port}")
            except AddressError:
                pass
    without = f" or HOST alone for port {default_port}" if default_port is not None else ""
    raise AddressError(f"{text!r} is not an address: expected HOST:PORT, for example {DEFAULT} or [::1]:10102{without}")


def places_to_listen(address: Address, allow_remote: bool, danger: str = _DANGER) -> list[Place]:
    """Return the places to listen on. Raises `ProxyError` if other machines can reach one, unless ``allow_remote``.

    ``danger`` is the end of that message: the risk if other machines connect.
    """
    places = _resolved(address, socket.AI_PASSIVE)
    for place in places:
        if not allow_remote and not is_loopback(str(place.address[0])):
            raise ProxyError(
                f"{address} can be reached from other machines, {danger}: "
                f"listen on {Address(THIS_MACHINE, address.port)}, or add --allow-remote if that is intended"
            )
    return places if address.port else places[:1]  # otherwise the system would choose a different port for each place


def places_to_connect(address: Address) -> list[Place]:
    """Return the places to try, in this order, to reach the server. Raises `ProxyError`."""
    if not address.port:
        raise ProxyError(f"{address}: port 0 cannot be connected to: give the port of the PLC, {PLC_PORT} by default")
    return _resolved(address, 0)


def _resolved(address: Address, flags: int) -> list[Place]:
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM, flags=flags)
    except (OSError, UnicodeError) as why:
        reason = why.strerror if isinstance(why, OSError) else "not a host name"
        raise ProxyError(f"{address}: {reason}") from None
    places = []
    for family, _, _, _, where in found:
        host, port = str(where[0]), int(where[1])
        place = Place(family, (host, port, int(where[2]), int(where[3])) if len(where) == 4 else (host, port))
        if place not in places:
            places.append(place)
    if not places:
        raise ProxyError(f"{address}: not an IPv4 or IPv6 address")
    return places[:_MAX_ADDRESSES]


def listen_on(place: Place) -> socket.socket:
    """Return a socket that listens at ``place``. Raises `ProxyError`."""
    listener = socket.socket(place.family, socket.SOCK_STREAM)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if place.family == socket.AF_INET6:
            listener.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        listener.bind(place.address)
        listener.listen(128)
        listener.setblocking(False)
    except OSError as why:
        listener.close()
        hint = ": ports below 1024 need root; choose another" if isinstance(why, PermissionError) else ""
        raise ProxyError(f"cannot listen on {place}: {why.strerror or why}{hint}") from None
    return listener


def expect_no_circle(listeners: list[Place], targets: list[Place]) -> None:
    """Raise `ProxyError` if a target is one of our own listeners: each connection would open another one endlessly."""
    anywhere = {"0.0.0.0", "::"}  # noqa: S104 - only compared with
    for target in targets:
        for place in listeners:
            if place.address[1] != target.address[1]:
                continue
            same = place.address[0] == target.address[0]
            if not same and place.address[0] in anywhere:
                same = is_loopback(str(target.address[0])) or (place.family == target.family and _is_own(target))
            if same:
                raise ProxyError(f"--to {target} is the proxy's own address: it would connect to itself forever")


def _is_own(place: Place) -> bool:
    """Return whether an address is one of this machine; nothing is sent.

    A successful bind is not enough: a system may be configured to allow any address (ip_nonlocal_bind). But then
    connecting from an address that is not its own fails.
    """
    with socket.socket(place.family, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind((place.address[0], 0, *place.address[2:]))
            probe.connect(place.address)
        except OSError:
            return False
    return True


def is_loopback(host: str) -> bool:
    """Return whether a numeric address is of this machine only."""
    try:
        number = ipaddress.ip_address(host)
    except ValueError:
        return False
    if isinstance(number, ipaddress.IPv6Address) and number.ipv4_mapped is not None:
        return number.ipv4_mapped.is_loopback
    return number.is_loopback
