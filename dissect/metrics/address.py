"""The addresses from which metrics can be fetched: only this machine, unless the user allows more."""

from __future__ import annotations

import ipaddress
import re
import socket
from typing import Final, NamedTuple

#: The default address; the port is near that of Prometheus' node exporter.
DEFAULT: Final = "127.0.0.1:9102"
#: An address that only this machine can reach.
THIS_MACHINE: Final = "127.0.0.1"

_ADDRESS: Final = re.compile(r"(?:\[(?P<six>[0-9A-Fa-f:.%\w]+)\]|(?P<host>[^\[\]:\s]+)):(?P<port>[0-9]{1,5})", re.ASCII)


class AddressError(ValueError):
    """An address cannot be used; the message is one line that says why and what to do."""


class Address(NamedTuple):
    """A host, by name or number, and a port; 0 lets the system choose one."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


class Target(NamedTuple):
    """An address in the form that a socket takes."""

    family: int
    address: tuple[str, int] | tuple[str, int, int, int]


def parse_address(text: str) -> Address:
    """Read ``HOST:PORT`` or ``[IPv6]:PORT``. Raises `AddressError`."""
    found = _ADDRESS.fullmatch(text)
    if found is None:
        raise AddressError(f"{text!r} is not an address: expected HOST:PORT, for example {DEFAULT} or [::1]:9102")
    port = int(found["port"])
    if port > 65535:
        raise AddressError(f"{text!r}: a port is at most 65535")
    return Address(found["six"] or found["host"], port)


def resolve(address: Address, allow_remote: bool) -> Target:
    """Return the address to listen on. Raises `AddressError` if others can reach it, unless ``allow_remote``."""
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    except (OSError, UnicodeError) as why:
        reason = why.strerror if isinstance(why, OSError) else "not a host name"
        raise AddressError(f"{address}: {reason}: use a name or an address of this machine") from None
    family, _, _, _, where = found[0]
    host = str(where[0])
    if not allow_remote and not is_loopback(host):
        raise AddressError(
            f"{address} can be reached from other machines, and anyone who reaches it can read the metrics: "
            f"use {Address(THIS_MACHINE, address.port)}, or add --allow-remote if that is intended"
        )
    port = int(where[1])
    return Target(family, (host, port, int(where[2]), int(where[3])) if len(where) == 4 else (host, port))


def is_loopback(host: str) -> bool:
    """Return whether a numeric address is of this machine only."""
    try:
        number = ipaddress.ip_address(host)
    except ValueError:
        return False
    if isinstance(number, ipaddress.IPv6Address) and number.ipv4_mapped is not None:
        return number.ipv4_mapped.is_loopback
    return number.is_loopback
