"""What lies below TCP: VLAN tags, other links, IPv6, fragments, odd headers, frames that the capture cut."""

from __future__ import annotations

import struct

from scapy.layers.inet import IP, UDP, IPOption_NOP, IPOption_RR
from scapy.layers.inet6 import IPv6, IPv6ExtHdrFragment
from scapy.layers.l2 import ARP, Dot1AD, Dot1Q, Ether
from scapy.packet import Packet as Layer
from scapy.packet import Raw

from captures.craft import container
from captures.craft.case import Case, crafts
from captures.craft.pdus import READ, WRITE, dt, pattern, read_bytes, values, write, written
from captures.craft.talk import CLIENT, MACS, SERVER, Link, Talk, ethernet, octets_of

V6 = ("2001:db8::10", "2001:db8::20")
TCP = 6

# IPv6 extension headers, each with its own number where the next one's stands.
HOP_BY_HOP = b"\x00\x00\x01\x04" + bytes(4)
DESTINATION = b"\x3c\x01\x01\x0c" + bytes(12)
ROUTING = b"\x2b\x02\x00\x00" + bytes(4) + bytes.fromhex("20010db8000000000000000000000099")
AUTHENTICATION = b"\x33\x04" + bytes(2) + b"\x00\x00\x00\x07\x00\x00\x00\x01" + b"\x11" * 12
ATOMIC = b"\x2c\x00\x00\x00\x00\x00\x12\x34"


def tagged(*tags: Layer) -> Link:
    """Ethernet with tags, the outer one first."""

    def link(side: int, packet: Layer) -> bytes:
        frame = Ether(src=MACS[side], dst=MACS[1 - side])
        for tag in tags:
            frame /= tag.copy()
        return octets_of(frame / packet)

    return link


@crafts(
    "VLAN tags: the same addresses, ports, sequence numbers and PDU references in two VLANs, in a QinQ stack and "
    "untagged, all at once; a priority tag (VLAN 0) in one direction only."
)
def vlan(case: Case) -> None:
    links = [
        ethernet,
        tagged(Dot1Q(vlan=10)),
        tagged(Dot1Q(vlan=20)),
        tagged(Dot1AD(vlan=10), Dot1Q(vlan=20)),
        tagged(Dot1Q(vlan=20), Dot1Q(vlan=10)),
    ]
    talks = [Talk(case, link=link) for link in links]
    for talk in talks:
        talk.begin()
    for number in range(1, 6):
        for talk in talks:
            talk.send(CLIENT, dt(read_bytes(number, 2)))
        for size, talk in enumerate(talks, 2):
            talk.send(SERVER, dt(values(number, pattern(2, size))))
            case.pair(READ)
    for talk in talks:
        talk.close()
    # The tag protocol of old switches, and a tag that only says how urgent the frame is.
    old = Talk(case, client_port=49153, link=old_tag)
    old.begin()
    old.poll()
    old.close()
    urgent = tagged(Dot1Q(vlan=0, prio=6))
    mixed = Talk(
        case, client_port=49154, link=lambda side, packet: (urgent if side == SERVER else ethernet)(side, packet)
    )
    mixed.begin()
    mixed.poll(3)
    mixed.close()
    case.tshark_shows(
        24, "its conversations know no VLAN: the same addresses and ports in another VLAN are retransmissions to it"
    )


def old_tag(side: int, packet: Layer) -> bytes:
    """A tag of EtherType 0x9100 with VLAN 30."""
    frame = ethernet(side, packet)
    return frame[:12] + b"\x91\x00\x00\x1e" + frame[12:]


@crafts(
    "IPv6: plain, link-local, with hop-by-hop, destination, routing and authentication headers, with a fragment "
    "header round a whole packet, and in fragments."
)
def ipv6(case: Case) -> None:
    case.find("security.write")
    talk = Talk(case, *V6)
    talk.begin()
    talk.poll(2)
    talk.close()
    talk = Talk(case, "fe80::1", "fe80::2", client_port=49153)
    talk.begin()
    talk.poll()
    talk.close()
    chains: list[list[bytes]] = [
        [HOP_BY_HOP],
        [HOP_BY_HOP, DESTINATION],
        [ROUTING],
        [AUTHENTICATION],
        [ATOMIC],
        [HOP_BY_HOP, ATOMIC, DESTINATION],
    ]
    for place, chain in enumerate(chains):
        talk = Talk(case, *V6, client_port=49160 + place, link=extended(chain))
        talk.begin()
        talk.poll(2)
        talk.close()
    # A write of 300 octets in three fragments, the last one first; its answer in one.
    talk = Talk(case, *V6, client_port=49170)
    talk.begin()
    pieces = fragments6(talk, CLIENT, dt(write(1, pattern(300))), 0xABCD, 120, 248)
    case.put(pieces[2], pieces[0], pieces[1])
    talk.send(SERVER, dt(written(1)))
    case.pair(WRITE)
    talk.close()


def extended(chain: list[bytes]) -> Link:
    """Ethernet with these extension headers between IPv6 and TCP; the first octet of each says which it is."""

    def link(side: int, packet: Layer) -> bytes:
        tcp = bytes(packet)[40:]
        kinds = [header[0] for header in chain]
        octets = b"".join(bytes([after]) + header[1:] for header, after in zip(chain, [*kinds[1:], TCP], strict=True))
        return ethernet(side, IPv6(src=packet.src, dst=packet.dst, nh=kinds[0]) / Raw(octets + tcp))

    return link


def fragments6(talk: Talk, side: int, octets: bytes, ident: int, *cuts: int) -> list[bytes]:
    """A segment in IPv6 fragments, cut at these octets of it (multiples of 8)."""
    packet = talk.ip(side) / talk.tcp(side, octets)
    whole = bytes(packet)[40:]
    pieces = []
    for start, end in zip((0, *cuts), (*cuts, len(whole)), strict=True):
        fragment = IPv6ExtHdrFragment(id=ident, nh=6, offset=start // 8, m=int(end < len(whole)))
        pieces.append(ethernet(side, IPv6(src=packet.src, dst=packet.dst) / fragment / Raw(whole[start:end])))
    return pieces


def fragments4(talk: Talk, side: int, octets: bytes, ident: int, *cuts: int) -> list[bytes]:
    """A segment in IPv4 fragments, cut at these octets of it (multiples of 8)."""
    packet = talk.ip(side) / talk.tcp(side, octets)
    whole = bytes(packet)[20:]
    return [
        fragment4(talk, side, ident, start, whole[start:end], end < len(whole))
        for start, end in zip((0, *cuts), (*cuts, len(whole)), strict=True)
    ]


def fragment4(talk: Talk, side: int, ident: int, offset: int, octets: bytes, more: bool) -> bytes:
    """One IPv4 fragment."""
    head = IP(
        src=talk.ends[side], dst=talk.ends[1 - side], id=ident, proto=6, flags="MF" if more else 0, frag=offset // 8
    )
    return ethernet(side, head / Raw(octets))


@crafts(
    "IPv4 fragments: in order, backwards, twice, overlapping with the same and with other octets (the first copy "
    "counts), the TCP header itself in two, two datagrams interleaved, one that stays incomplete."
)
def ip_fragments(case: Case) -> None:
    case.find("security.write")
    writer = FragmentedWriter(case)
    request = writer.request
    case.put(*request(64, 200))
    writer.answered()
    case.put(*reversed(request(64, 200)))
    writer.answered()
    first, second, third = request(64, 200)
    case.put(first, first, third, second)
    writer.answered()
    # The TCP header ends in the second fragment.
    case.put(*request(8, 16, 24))
    writer.answered()
    # The second piece repeats the end of the first: with the same octets, then with others.
    for other in (False, True):
        octets = b"".join(piece[34:] for piece in request(64))
        overlap = b"\xee" * 64 if other else octets[64:128]
        case.put(writer.piece(0, octets[:128], True), writer.piece(64, overlap + octets[128:], False))
        writer.answered()
    case.find("ip.fragment_conflict")
    # The fragments of two requests alternate; both are answered in one fragmented segment.
    one, two = request(120), request(120)
    case.put(one[0], two[0], two[1], one[1])
    answer = dt(written(writer.number - 1)) + dt(written(writer.number))
    case.put(*fragments4(writer.talk, SERVER, answer, 0x7001, 32))
    case.pair(WRITE, WRITE)
    # A request whose second fragment is not in the capture.
    case.put(request(120)[0])
    case.table("ignored", fragment_waiting=1)
    case.lose(len(dt(write(writer.number, writer.payload))))
    case.find("stream.hole")
    writer.talk.send(SERVER, dt(written(writer.number)))
    case.orphan(WRITE)
    writer.talk.poll(10)
    case.pause(1_500)
    writer.talk.close()
    case.tshark_shows(38, "it puts nothing in order (its default): what comes late it calls a retransmission")


class FragmentedWriter:
    """A connection whose client writes 300 octets at a time, each request in IPv4 fragments."""

    def __init__(self, case: Case) -> None:
        self.talk = Talk(case)
        self.talk.begin()
        self.payload = pattern(300)
        self.number = 0

    def request(self, *cuts: int) -> list[bytes]:
        """The fragments of the next request, cut at these octets of its TCP segment."""
        self.number += 1
        octets = dt(write(self.number, self.payload))
        return fragments4(self.talk, CLIENT, octets, 0x4000 + self.number, *cuts)

    def piece(self, offset: int, octets: bytes, more: bool) -> bytes:
        """A fragment of the last request, with any octets."""
        return fragment4(self.talk, CLIENT, 0x4000 + self.number, offset, octets, more)

    def answered(self) -> None:
        """Capture the answer to the last request."""
        self.talk.send(SERVER, dt(written(self.number)))
        self.talk.case.pair(WRITE)


@crafts(
    "Headers that are odd and right (IP options, Ethernet padding and a trailer that looks like a TPKT, no IP "
    "length, a wrong TCP checksum) and headers that are wrong, among packets of other protocols."
)
def ip_headers(case: Case) -> None:
    talk = Talk(case)
    talk.begin()
    trailer = dt(read_bytes(0xBAD, 2))

    def exchange(change: Link) -> None:
        talk.link = change
        talk.poll()
        talk.link = ethernet

    def options(side: int, packet: Layer) -> bytes:
        packet[IP].options = [IPOption_NOP(), IPOption_RR(routers=["192.0.2.1"])]
        return ethernet(side, packet)

    exchange(options)
    exchange(lambda side, packet: ethernet(side, packet) + trailer)
    exchange(lambda side, packet: no_length(ethernet(side, packet)))
    exchange(lambda side, packet: ethernet(side, packet)[:50] + b"\xde\xad" + ethernet(side, packet)[52:])
    # Bare acknowledgements, padded to the 60 octets an Ethernet frame must have, with octets that mean nothing.
    for side in (CLIENT, SERVER):
        case.put(talk.make(side, flags="A") + b"\x03\x00\x00\x07\x02\xf0")
    # Wrong: header length, total length, TCP offset, and a piece of TCP that is no header.
    case.find("ip.bad_header", 6)
    good = talk.make(CLIENT, dt(read_bytes(0xBAD, 2)), seq=talk.seq[CLIENT])
    case.put(
        good[:14] + b"\x44" + good[15:],
        good[:16] + b"\x00\x13" + good[18:],
        good[:46] + b"\x40" + good[47:],
        good[:46] + b"\xf0" + good[47:],
        good[:16] + b"\x00\x1e" + good[18:44],
        good[:14] + b"\x75" + good[15:],
    )
    case.table("ignored", bad_header=6)
    # Cut short though nothing was cut: the frame ends inside the IP header, inside the Ethernet header.
    case.put(good[:30], good[:10])
    case.table("ignored", cut=2)
    broadcast = "ff:ff:ff:ff:ff:ff"
    case.put(
        bytes(Ether(src=MACS[0], dst=broadcast) / ARP(hwsrc=MACS[0], psrc=talk.ends[0], pdst=talk.ends[1])),
        bytes(Ether(src=MACS[0], dst=MACS[1], type=0x88CC) / Raw(bytes(40))),
    )
    case.table("ignored", not_ip=2)
    case.put(ethernet(CLIENT, IP(src=talk.ends[0], dst=talk.ends[1]) / UDP(sport=102, dport=102) / Raw(trailer)))
    case.table("ignored", not_tcp=1)
    talk.poll()
    talk.close()
    case.tshark_shows(
        11, "it counts the octets of segments with a wrong header as sent, and calls the good segment a retransmission"
    )


def no_length(frame: bytes) -> bytes:
    """A frame as captured before the network card filled in the IP length (segmentation offload)."""
    return frame[:16] + bytes(2) + frame[18:]


@crafts(
    "One connection on each kind of link, each an interface of one file: Ethernet, Linux cooked v1 and v2 (with a "
    "VLAN tag too), raw IP under four numbers, BSD null in both byte orders, BSD loop; and a link that carries no "
    "IP."
)
def link_types(case: Case) -> None:
    def cooked_tagged(_side: int, packet: Layer) -> bytes:
        return struct.pack(">HHH8sHHH", 0, 1, 6, bytes(8), 0x8100, 7, ethertype(packet)) + bytes(packet)

    def cooked2(_side: int, packet: Layer) -> bytes:
        return struct.pack(">HHIHBB8s", ethertype(packet), 0, 2, 1, 0, 6, bytes(8)) + bytes(packet)

    def little(_side: int, packet: Layer) -> bytes:
        return struct.pack("<I", 2 if packet.version == 4 else 24) + bytes(packet)

    def big(_side: int, packet: Layer) -> bytes:
        return struct.pack(">I", 2 if packet.version == 4 else 30) + bytes(packet)

    v4 = ("192.0.2.10", "192.0.2.20")
    kinds: list[tuple[int, Link, tuple[str, str]]] = [
        (container.ETHERNET, ethernet, v4),
        (container.SLL, cooked, v4),
        (container.SLL, cooked, V6),
        (container.SLL, cooked_tagged, v4),
        (container.SLL2, cooked2, v4),
        (container.SLL2, cooked2, V6),
        (container.RAW, bare, v4),
        (container.RAW, bare, V6),
        (container.RAW_BSD, bare, v4),
        (container.IPV4, bare, v4),
        (container.IPV6, bare, V6),
        (container.NULL, little, v4),
        (container.NULL, little, V6),
        (container.NULL, big, v4),
        (container.LOOP, big, v4),
        (container.LOOP, big, V6),
    ]
    case.link_types = [kind for kind, _, _ in kinds] + [147]  # 147 is for private use
    for place, (_, link, ends) in enumerate(kinds):
        talk = Talk(case, *ends, client_port=49152 + place, link=link, interface=place)
        talk.begin()
        talk.poll(2)
        talk.close()
    case.put(dt(read_bytes(1, 2)), interface=len(kinds))
    case.table("ignored", link_type=1)
    case.find("capture.not_opened")


def cooked(_side: int, packet: Layer) -> bytes:
    """A frame of Linux cooked capture v1."""
    return struct.pack(">HHH8sH", 0, 1, 6, bytes(8), ethertype(packet)) + bytes(packet)


def bare(_side: int, packet: Layer) -> bytes:
    """No frame at all."""
    return bytes(packet)


def ethertype(packet: Layer) -> int:
    return 0x0800 if packet.version == 4 else 0x86DD


@crafts(
    "Frames cut by the capture (snaplen): behind the S7 parameters, in the second TPKT of a segment, inside the "
    "COTP header, inside the TCP header. What was cut is known to be missing, nothing is made up for it, and the "
    "stream goes on."
)
def snaplen(case: Case) -> None:
    talk = Talk(case)
    talk.begin()

    def cut(side: int, octets: bytes, kept: int) -> None:
        """A segment of which only ``kept`` octets of payload were captured."""
        frame = talk.make(side, octets)
        case.put(frame[: 54 + kept], wire=len(frame))
        case.lose(len(octets) - kept)

    # Answers whose header and parameters are there, the data only in part.
    for number, kept in ((1, 60), (2, 4 + 3 + 12 + 2)):
        talk.send(CLIENT, dt(read_bytes(number, 200)))
        cut(SERVER, dt(values(number, pattern(200))), kept)
        case.pair(READ)
    # A request cut behind its function: what it asks for is not known, that it asks is.
    cut(CLIENT, dt(read_bytes(3, 2)), 4 + 3 + 10 + 2)
    talk.send(SERVER, dt(values(3, b"\x00\x03")))
    case.pair(READ)
    # Two answers in one segment, cut in the second.
    talk.send(CLIENT, dt(read_bytes(4, 2)) + dt(read_bytes(5, 100)))
    cut(SERVER, dt(values(4, b"\x00\x04")) + dt(values(5, pattern(100))), 27 + 40)
    case.pair(READ, READ)
    # Cut inside the COTP header and right behind the TCP header: nobody knows what it was.
    for kept in (6, 0):
        number = talk.next_ref()
        cut(CLIENT, dt(read_bytes(number, 2)), kept)
        talk.send(SERVER, dt(values(number, b"\x00\x06")))
        case.orphan(READ)
    # The S7 header itself in part: no PDU that could be counted.
    cut(CLIENT, dt(read_bytes(8, 2)), 4 + 3 + 6)
    talk.send(SERVER, dt(values(8, b"\x00\x08")))
    case.orphan(READ)
    case.find("capture.cut_frames", 7)
    # Inside the TCP header: not even the connection is known.
    frame = talk.make(CLIENT, dt(end=False))
    case.put(frame[:46], wire=len(frame))
    case.find("capture.cut_frames")
    case.table("ignored", cut=1)
    case.lose(7)
    case.find("stream.hole")
    talk.poll(12)
    case.pause(1_500)
    talk.close()
    case.count(truncated=8)
