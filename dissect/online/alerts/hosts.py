"""The hosts to which alerts may be sent: this machine, and those that the user has allowed."""

from __future__ import annotations

import re
from ipaddress import ip_address
from typing import Final

_PLACE: Final = re.compile(r"(?:\[([0-9A-Fa-f:.]+)\]|([A-Za-z0-9.-]{1,253}))(?::([0-9]{1,5}))?")
_LOCAL: Final = "localhost"


def is_loopback(host: str) -> bool:
    """Return whether a name or address means this machine."""
    if host.lower() == _LOCAL:
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def allowed(host: str, hosts: frozenset[str]) -> bool:
    """Return whether alerts may be sent to ``host``."""
    return is_loopback(host) or host.lower() in {name.lower() for name in hosts}


def split_host(text: str, port: int) -> tuple[str, int] | None:
    """Return host and port of ``HOST``, ``HOST:PORT`` or ``[ADDRESS]:PORT``, None for anything else."""
    match = _PLACE.fullmatch(text)
    if match is None:
        return None
    number = int(match[3]) if match[3] else port
    return (match[1] or match[2], number) if 0 < number < 65536 else None
