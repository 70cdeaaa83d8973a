"""The same traffic over another link: ``python -m benchmarks.links KIND FILE OUT``.

Everyday lines are tagged, doubly tagged, IPv6, or captured by ``tcpdump -i any``. A twin of a capture has the same TCP segments
at the same times under another link header, so the difference between two runs is the cost of the link.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Final

from benchmarks.multiply import adjust, ip_offset, words
from benchmarks.readers import read_capture
from benchmarks.writers import ETHERNET, CaptureWriter

if TYPE_CHECKING:
    from collections.abc import Sequence

RAW: Final = 101
COOKED: Final = 113
COOKED_2: Final = 276
#: Link type and file format of each kind. ``plain`` is Ethernet with IPv4 and no tag, the reference for the others.
KINDS: Final = {
    "plain": (ETHERNET, "pcap-ns"),
    "vlan": (ETHERNET, "pcap-ns"),
    "qinq": (ETHERNET, "pcap-ns"),
    "ipv6": (ETHERNET, "pcap-ns"),
    "cooked": (COOKED, "pcap-ns"),
    "cooked_2": (COOKED_2, "pcap-ns"),
    "raw": (RAW, "pcap-ns"),
    "pcapng": (ETHERNET, "pcapng"),
}
_IPV4: Final = b"\x08\x00"
_IPV6: Final = b"\x86\xdd"
#: VLAN 102, and VLAN 7 of a provider around it (IEEE 802.1Q, clause 9.6).
_TAG: Final = b"\x81\x00\x00\x66"
_PROVIDER: Final = b"\x88\xa8\x00\x07"
#: An IPv4 address is placed at the end of an IPv6 address with this prefix (unique local, RFC 4193).
_PREFIX: Final = bytes.fromhex("fd533700000000000000ffff")
#: The offset of the checksum after the IP header, by protocol.
_SUMS: Final = {6: 16, 17: 6}


def twin(source: Path, kind: str, out: Path) -> int:
    """Write the IPv4 packets of an Ethernet capture to ``out`` over the link ``kind`` (of `KINDS`); return their number.

    Raises ValueError for a source that cannot be read or is not Ethernet.
    """
    link_type, packets = read_capture(source)
    if link_type != ETHERNET:
        raise ValueError(f"{source}: link type {link_type}; twins are made of Ethernet captures")
    to_link, format_ = KINDS[kind]
    with out.open("wb") as file:
        writer = CaptureWriter(file, format_, to_link)
        for time_ns, frame, wire in packets:
            ip = ip_offset(ETHERNET, frame)
            if ip < 0 or frame[ip - 2 : ip] != _IPV4:
                continue
            made = _frame(kind, frame[:12], frame[ip:])
            writer.write(time_ns, made, wire - len(frame) + len(made))
        writer.flush()
    return writer.packets


def _frame(kind: str, stations: bytes, packet: bytes) -> bytes:
    """Return an IPv4 packet as a frame of this kind; ``stations`` are the addresses of destination and source."""
    match kind:
        case "vlan":
            return stations + _TAG + _IPV4 + packet
        case "qinq":
            return stations + _PROVIDER + _TAG + _IPV4 + packet
        case "ipv6":
            return stations + _IPV6 + _as_ipv6(packet)
        case "cooked":  # from another host, ARPHRD_ETHER, address of 6 bytes
            return b"\x00\x00\x00\x01\x00\x06" + stations[6:] + b"\x00\x00" + _IPV4 + packet
        case "cooked_2":  # the protocol first, interface 2
            return _IPV4 + b"\x00\x00\x00\x00\x00\x02\x00\x01\x00\x06" + stations[6:] + b"\x00\x00" + packet
        case "raw":
            return packet
    return stations + _IPV4 + packet


def _as_ipv6(packet: bytes) -> bytes:
    """Return an IPv4 packet, not a fragment, as an IPv6 packet between addresses that end with the old ones."""
    head = 4 * (packet[0] & 15)
    size = int.from_bytes(packet[2:4], "big") - head
    addresses = _PREFIX + packet[12:16] + _PREFIX + packet[16:20]
    body = bytearray(packet[head:])
    place = _SUMS.get(packet[9])
    if place is not None:
        # The sum covers the addresses; protocol and length count the same in both versions (RFC 8200, clause 8.1).
        adjust(body, place, words(addresses) - words(packet[12:20]), optional=packet[9] == 17)
    return b"\x60\x00\x00\x00" + size.to_bytes(2, "big") + packet[9:10] + packet[8:9] + addresses + bytes(body)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.links", description=__doc__)
    parser.add_argument("kind", choices=KINDS)
    parser.add_argument("file", type=Path, help="a pcap or pcapng file of Ethernet")
    parser.add_argument("out", type=Path, help="the capture to write")
    options = parser.parse_args(arguments)
    try:
        packets = twin(options.file, options.kind, options.out)
    except (OSError, ValueError) as error:
        print(f"links: {error}", file=sys.stderr)
        return 2
    print(f"{packets} packets")
    return 0


if __name__ == "__main__":
    sys.exit(main())
