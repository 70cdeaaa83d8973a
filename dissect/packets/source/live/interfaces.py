"""Lists the network interfaces of this machine: by the kernel (rtnetlink) on Linux, by ``dumpcap`` elsewhere.

rtnetlink needs no permission, and shows the network namespace of this process, which files under /sys may not.
"""

from __future__ import annotations

import os
import socket
import struct
import subprocess
import sys
from collections.abc import Iterator
from typing import Final, NamedTuple

from dissect.packets.source.pcap import LINKTYPE_ETHERNET

_GET_LINK: Final = 18
_NEW_LINK: Final = 16
_GET_ADDRESS: Final = 22
_NEW_ADDRESS: Final = 20
_ERROR: Final = 2
_DONE: Final = 3
_REQUEST: Final = 1
_DUMP: Final = 0x300

_HEADER: Final = struct.Struct("=IHHII")
_LINK: Final = struct.Struct("=BxHiII")
_ADDRESS: Final = struct.Struct("=BBBBi")
_ATTRIBUTE: Final = struct.Struct("=HH")

_IFLA_ADDRESS: Final = 1
_IFLA_NAME: Final = 3
_IFLA_MTU: Final = 4
_IFLA_STATE: Final = 16
_IFLA_STATISTICS: Final = 23
_IFA_ADDRESS: Final = 1
_IFA_LOCAL: Final = 2

_UP: Final = 1
_LOOPBACK: Final = 8
_STATE_UNKNOWN: Final = 0
_STATE_UP: Final = 6
#: Indices of ``rx_fifo_errors`` and ``rx_missed_errors`` among the 64-bit counts of ``rtnl_link_stats64``.
_FIFO_ERRORS: Final = 14
_MISSED_ERRORS: Final = 15

RAW_IP: Final = 101
#: ARPHRD number -> LINKTYPE number and name, of interfaces that the ring can capture on; dumpcap can on others as well.
LINK_TYPES: Final = {1: (LINKTYPE_ETHERNET, "Ethernet"), 772: (LINKTYPE_ETHERNET, "Ethernet")} | dict.fromkeys(
    (519, 768, 776, 0xFFFE), (RAW_IP, "raw IP")
)
#: Other ARPHRD numbers a plant laptop may show.
_OTHER_KINDS: Final = {280: "CAN", 512: "PPP", 778: "GRE", 801: "802.11", 802: "802.11", 803: "802.11", 824: "netlink"}


#: How the names begin that dumpcap has for interfaces on Windows.
_WINDOWS_DEVICE: Final = "\\Device\\NPF_"


class NetworkInterface(NamedTuple):
    """One interface. ``state`` is ``up``, ``down``, ``no carrier`` or empty (not known); ``link_type`` a LINKTYPE number or -1.

    ``lost`` is how many packets it has lost before the kernel had them, since it exists; None when not known. ``mtu`` is 0 when
    not known.
    """

    name: str
    number: int
    state: str
    loopback: bool
    link_type: int
    link_name: str
    mac: str
    mtu: int
    addresses: tuple[str, ...]
    lost: int | None


def list_interfaces(dumpcap: str = "") -> list[NetworkInterface]:
    """Return the interfaces, by number; ``dumpcap`` is the path of the program to use where there is no rtnetlink."""
    if hasattr(socket, "AF_NETLINK"):
        return _from_kernel()
    return _from_dumpcap(dumpcap) if dumpcap else []


def find_interface(name: str) -> NetworkInterface | None:
    """Return the interface of that name as the kernel describes it now, None when there is none."""
    return next((one for one in list_interfaces() if one.name == name), None)


# ---- rtnetlink ------------------------------------------------------------------------------------------------------


def _from_kernel() -> list[NetworkInterface]:
    links = [body for kind, body in _dump(_GET_LINK, _LINK.size) if kind == _NEW_LINK]
    addresses: dict[int, list[str]] = {}
    for kind, body in _dump(_GET_ADDRESS, _ADDRESS.size):
        if kind == _NEW_ADDRESS:
            index, text = _parse_address(body)
            addresses.setdefault(index, []).append(text)
    found = [_parse_link(body, addresses) for body in links]
    return sorted(found, key=lambda interface: interface.number)


def _dump(kind: int, size: int) -> Iterator[tuple[int, bytes]]:
    """Request all objects of a kind; yield type and body of each message of the answer."""
    if sys.platform != "linux":
        return
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, socket.NETLINK_ROUTE) as asking:
        asking.settimeout(5)
        asking.send(_HEADER.pack(_HEADER.size + size, kind, _REQUEST | _DUMP, 1, 0) + bytes(size))
        while True:
            octets = asking.recv(1 << 18)
            at = 0
            while at + _HEADER.size <= len(octets):
                length, answer, _flags, _sequence, _port = _HEADER.unpack_from(octets, at)
                if answer in {_DONE, _ERROR} or length < _HEADER.size:
                    return
                yield answer, octets[at + _HEADER.size : at + length]
                at += (length + 3) & ~3


def _attributes(octets: bytes, at: int) -> dict[int, bytes]:
    found: dict[int, bytes] = {}
    while at + _ATTRIBUTE.size <= len(octets):
        length, kind = _ATTRIBUTE.unpack_from(octets, at)
        if length < _ATTRIBUTE.size:
            break
        found[kind & 0x3FFF] = octets[at + _ATTRIBUTE.size : at + length]
        at += (length + 3) & ~3
    return found


def _parse_link(body: bytes, addresses: dict[int, list[str]]) -> NetworkInterface:
    _family, kind, index, flags, _change = _LINK.unpack_from(body)
    attributes = _attributes(body, _LINK.size)
    link_type, link_name = LINK_TYPES.get(kind, (-1, _OTHER_KINDS.get(kind, f"ARPHRD {kind}")))
    operational = int.from_bytes(attributes.get(_IFLA_STATE, b"\0")[:1], "little")
    state = "down"
    if flags & _UP:
        state = "up" if operational in {_STATE_UNKNOWN, _STATE_UP} else "no carrier"
    counts = attributes.get(_IFLA_STATISTICS, b"")
    lost = None
    if len(counts) >= 8 * (_MISSED_ERRORS + 1):
        lost = sum(struct.unpack_from("=QQ", counts, 8 * _FIFO_ERRORS))
    return NetworkInterface(
        attributes.get(_IFLA_NAME, b"").rstrip(b"\0").decode("utf-8", "backslashreplace"),
        index,
        state,
        bool(flags & _LOOPBACK),
        link_type,
        link_name,
        attributes.get(_IFLA_ADDRESS, b"").hex(":"),
        int.from_bytes(attributes.get(_IFLA_MTU, b""), sys.byteorder),
        tuple(addresses.get(index, ())),
        lost,
    )


def _parse_address(body: bytes) -> tuple[int, str]:
    """Return (interface index, address with its prefix length)."""
    family, prefix, _flags, _scope, index = _ADDRESS.unpack_from(body)
    attributes = _attributes(body, _ADDRESS.size)
    octets = attributes.get(_IFA_LOCAL) or attributes.get(_IFA_ADDRESS, b"")
    if (family, len(octets)) not in {(socket.AF_INET, 4), (socket.AF_INET6, 16)}:
        return index, octets.hex()
    return index, f"{socket.inet_ntop(family, octets)}/{prefix}"


# ---- dumpcap --------------------------------------------------------------------------------------------------------


def _from_dumpcap(program: str) -> list[NetworkInterface]:
    """Return what ``dumpcap -D -M`` lists: number and name, then tab-separated fields with addresses and the kind."""
    listed = ask(program, "-D", "-M").stdout.decode("utf-8", "backslashreplace")
    found = []
    for line in listed.splitlines():
        fields = line.split("\t")
        number, dot, name = fields[0].partition(". ")
        if not dot or not number.isdigit() or len(fields) < 6:
            continue
        if name.startswith(_WINDOWS_DEVICE):  # users do not type that, and dumpcap accepts the name that Windows shows
            name = fields[2] or name
        addresses = tuple(address for address in fields[4].split(",") if address)
        loopback = fields[5] == "loopback"
        found.append(NetworkInterface(name, int(number), "", loopback, -1, "", "", 0, addresses, None))
    return found


def ask(program: str, *arguments: str) -> subprocess.CompletedProcess[bytes]:
    """Run dumpcap with a query that it answers at once, in English; after 10 s return an empty answer with exit code 1."""
    environment = {**os.environ, "LC_ALL": "C"}
    try:
        return subprocess.run(
            [program, *arguments],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=False,
            timeout=10,
            env=environment,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return subprocess.CompletedProcess([program], 1, b"", str(error).encode())
