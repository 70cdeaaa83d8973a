"""A binding: a place where SCD is carried, and the kind of SCD there (profile, reference 3.3); not part of a dictionary."""

from __future__ import annotations

from collections.abc import Sequence
from ipaddress import IPv4Network, IPv6Network
from typing import Final, Literal

import msgspec

#: The carrier: a UDP or TCP port, ISO 8073 TSDUs by TSAP, an S7 area, BSEND by R_ID.
CarrierName = Literal["udp", "tcp", "cotp", "s7", "bsend"]
#: Messages in the dictionary's envelope (or the default one), or a bare content without an envelope.
Holds = Literal["messages", "pdo", "struct", "value", "object"]
#: The end that owns the dictionary: the one with the bound port or the called TSAP, or the other one.
Owner = Literal["port", "peer"]
Network = IPv4Network | IPv6Network

#: Octets of an IPv4 and an IPv6 address.
_ADDRESS_SIZES: Final = {4: 4, 6: 16}


class Binding(msgspec.Struct, frozen=True, eq=False):
    """A place where SCD is carried, and the kind of SCD there; fields that the carrier does not use are 0 or empty.

    ``name`` is shown to people and is unique. ``port`` is for udp and tcp, ``tsap`` for cotp (called or calling), ``area`` (its
    code), ``db`` and ``offset`` (octets) for s7, ``r_id`` for bsend. With ``network``, the binding applies only to
    conversations with an end in it. ``key`` names the content: "T1", "pump_t", "0x6001:0", "0x6000", empty for messages.
    ``title`` is the same with the name in the dictionary. ``address`` is index and sub-index of a value, or index and 0 of a
    struct or object. ``size`` is in octets, 0 if it varies; in an S7 area it never varies. ``device`` says which end owns the
    dictionary.
    """

    name: str
    carrier: CarrierName
    holds: Holds
    key: str = ""
    title: str = ""
    address: tuple[int, int] = (0, 0)
    size: int = 0
    port: int = 0
    tsap: bytes = b""
    area: int = 0
    db: int = 0
    offset: int = 0
    r_id: int = 0
    network: Network | None = None
    device: Owner = "port"

    def matches(self, address_a: bytes, address_b: bytes) -> bool:
        """Return whether the binding applies to a conversation between two addresses, of 4 or 16 octets each."""
        return self.network is None or _holds(self.network, address_a) or _holds(self.network, address_b)

    def overlaps(self, other: Binding) -> bool:
        """Return whether both may apply to the same conversation, judged by addresses."""
        mine, others = self.network, other.network
        if mine is None or others is None:
            return True
        if isinstance(mine, IPv4Network):
            return isinstance(others, IPv4Network) and mine.overlaps(others)
        return isinstance(others, IPv6Network) and mine.overlaps(others)


class Bindings:
    """All bindings of a file, in their order, and by place. For the same place the narrowest network comes first.

    The keys are: for ``cotp`` the TSAP, for ``s7`` area and DB number (0 outside of DBs), for ``bsend`` the R_ID.
    """

    def __init__(self, bindings: Sequence[Binding]) -> None:
        self.all: Final = tuple(bindings)
        self.udp: Final[dict[int, list[Binding]]] = {}
        self.tcp: Final[dict[int, list[Binding]]] = {}
        self.cotp: Final[dict[bytes, list[Binding]]] = {}
        self.s7: Final[dict[tuple[int, int], list[Binding]]] = {}
        self.bsend: Final[dict[int, list[Binding]]] = {}
        for binding in sorted(self.all, key=_width):
            if binding.carrier == "udp":
                self.udp.setdefault(binding.port, []).append(binding)
            elif binding.carrier == "tcp":
                self.tcp.setdefault(binding.port, []).append(binding)
            elif binding.carrier == "cotp":
                self.cotp.setdefault(binding.tsap, []).append(binding)
            elif binding.carrier == "s7":
                self.s7.setdefault((binding.area, binding.db), []).append(binding)
            else:
                self.bsend.setdefault(binding.r_id, []).append(binding)


def _holds(network: Network, address: bytes) -> bool:
    if len(address) != _ADDRESS_SIZES[network.version]:
        return False
    return int.from_bytes(address, "big") & int(network.netmask) == int(network.network_address)


def _width(binding: Binding) -> int:
    """Return the number of address bits that a binding leaves open; without a network, a number larger than for any network."""
    network = binding.network
    return 129 if network is None else network.max_prefixlen - network.prefixlen
