"""A TCP conversation that is captured: two ends with their sequence numbers, and frames made with Scapy."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

from scapy.layers.inet import IP, TCP
from scapy.layers.inet6 import IPv6
from scapy.layers.l2 import Ether
from scapy.packet import NoPayload, Raw
from scapy.packet import Packet as Layer

from captures.craft import pdus

if TYPE_CHECKING:
    from captures.craft.case import Case

CLIENT, SERVER = 0, 1
MODULUS = 1 << 32
MACS = ("02:00:00:00:00:01", "02:00:00:00:00:02")
Link = Callable[[int, Layer], bytes]
"""Puts an IP packet of a side into a frame."""


def ethernet(side: int, packet: Layer) -> bytes:
    """An Ethernet frame."""
    return octets_of(Ether(src=MACS[side], dst=MACS[1 - side]) / packet)


def octets_of(packet: Layer) -> bytes:
    """The octets of a packet whose fields all have a single value: Scapy otherwise copies every layer to try others."""
    layer = packet
    while not isinstance(layer, NoPayload):
        layer.explicit = 1
        layer = layer.payload
    return bytes(packet)


class Talk:
    """One TCP connection between a client and a server.

    ``isn`` are the initial sequence numbers of both. Data sent in turn advance them; ``make`` with a ``seq`` does not. The
    acknowledgement covers what the other end sent so far, captured or not, unless one is given.
    """

    def __init__(
        self,
        case: Case,
        client: str = "192.0.2.10",
        server: str = "192.0.2.20",
        client_port: int = 49152,
        port: int = 102,
        isn: tuple[int, int] = (1_000, 900_000),
        link: Link = ethernet,
        interface: int = 0,
    ) -> None:
        self.case = case
        self.ends = (client, server)
        self.ports = (client_port, port)
        self.seq = [isn[0], isn[1]]
        self.link = link
        self.interface = interface
        self.ident = 1
        self.pdu_ref = 0x0100

    # ---- segments ---------------------------------------------------------------------------------------------------

    def make(
        self,
        side: int,
        octets: bytes = b"",
        flags: str = "PA",
        seq: int | None = None,
        ack: int | None = None,
    ) -> bytes:
        """Give a frame without capturing it."""
        return self.link(side, self.ip(side) / self.tcp(side, octets, flags, seq, ack))

    def ip(self, side: int) -> Layer:
        """The IP header of a side."""
        source, destination = self.ends[side], self.ends[1 - side]
        if ":" in source:
            return IPv6(src=source, dst=destination)
        self.ident += 1
        return IP(src=source, dst=destination, id=self.ident, flags="DF")

    def tcp(
        self,
        side: int,
        octets: bytes = b"",
        flags: str = "PA",
        seq: int | None = None,
        ack: int | None = None,
    ) -> Layer:
        """The TCP segment of a side."""
        if seq is None:
            seq = self.seq[side]
            self.seq[side] = (seq + len(octets) + ("S" in flags) + ("F" in flags)) % MODULUS
        if ack is None:
            ack = self.seq[1 - side] if "A" in flags else 0
        header = TCP(
            sport=self.ports[side], dport=self.ports[1 - side], seq=seq % MODULUS, ack=ack % MODULUS, flags=flags
        )
        return header / Raw(octets) if octets else header

    def send(self, side: int, octets: bytes, *cuts: int) -> None:
        """Capture octets in one segment, or cut at these places."""
        for start, end in zip((0, *cuts), (*cuts, len(octets)), strict=True):
            self.put(self.make(side, octets[start:end]))

    def put(self, *frames: bytes) -> None:
        """Capture frames."""
        self.case.put(*frames, interface=self.interface)

    def ack(self, side: int) -> None:
        """Capture a bare acknowledgement."""
        self.put(self.make(side, flags="A"))

    # ---- life of a connection ---------------------------------------------------------------------------------------

    def open(self) -> None:
        """Capture the handshake."""
        self.put(self.make(CLIENT, flags="S"), self.make(SERVER, flags="SA"))
        self.ack(CLIENT)
        self.case.count(connections=1)

    def connect(self, tpdu_size: int = 1024) -> None:
        """Capture CR and CC."""
        self.send(CLIENT, pdus.cr(tpdu_size=tpdu_size))
        self.send(SERVER, pdus.cc(tpdu_size=tpdu_size))

    def setup(self, pdu_length: int = 480, calling: int = 8, called: int = 8) -> None:
        """Capture Setup communication, everything granted as requested."""
        self.exchange(
            pdus.SETUP,
            pdus.setup(0, pdu_length, calling, called),
            pdus.setup(0, pdu_length, calling, called, answer=True),
        )

    def begin(self, tpdu_size: int = 1024, pdu_length: int = 480) -> None:
        """Capture everything up to the answer to Setup."""
        self.open()
        self.connect(tpdu_size)
        self.setup(pdu_length)

    def exchange(self, function: int, request: bytes, answer: bytes, asking: int = CLIENT) -> None:
        """Capture a request and its answer, each a PDU in one DT in one segment."""
        self.send(asking, pdus.dt(request))
        self.send(1 - asking, pdus.dt(answer))
        self.case.pair(function)

    def poll(self, times: int = 1, size: int = 2) -> None:
        """Capture good reads of some octets of DB1, each with its own reference."""
        for _ in range(times):
            number = self.next_ref()
            self.exchange(pdus.READ, pdus.read_bytes(number, size), pdus.values(number, pdus.pattern(size)))

    def next_ref(self) -> int:
        """A PDU reference this conversation has not used."""
        self.pdu_ref += 1
        return self.pdu_ref

    def close(self, side: int = CLIENT) -> None:
        """Capture both FINs and their acknowledgements; ``side`` begins."""
        self.put(self.make(side, flags="FA"), self.make(1 - side, flags="FA"))
        self.ack(side)
