"""`S7Session`: Scapy's ``sniff`` on this package's own reassembly instead of Scapy's.

::

    sniff(offline="plant.pcapng", session=S7Session) sniff(iface="eth0", session=S7Session, prn=lambda packet: packet.summary())

Scapy's own TCP session takes Ethernet padding for payload, fills gaps with zeros and does not support COTP fragments. Here each
packet goes through `dissect.engine.pipeline`, which recognises ISO-on-TCP on every port. The output is one packet for each
whole TPKT, in the order of the stream: ``Ether / IP / TCP / TPKT / …``.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from scapy.config import conf
from scapy.layers.inet import IP, TCP
from scapy.layers.inet6 import IPv6
from scapy.layers.l2 import Dot1Q, Ether
from scapy.packet import Raw
from scapy.sessions import DefaultSession
from scapy.utils import EDecimal

from dissect.engine.pipeline import Observer, Pipeline
from dissect.layers.cotp import COTP_DT
from dissect.layers.ibh import IBH, MPI
from dissect.layers.s7 import S7, is_s7
from dissect.layers.s7plus import S7Plus, is_s7plus
from dissect.layers.tpkt import TPKT
from dissect.packets.tcp.stream import address_text
from dissect.protocols.s7plus.message import parse_plus

if TYPE_CHECKING:
    from scapy.packet import Packet
    from scapy.supersocket import SuperSocket

    from dissect.engine.transactions.side import Side

_NO_MAC: Final = "00:00:00:00:00:00"
_NS: Final = 10**9
_IPV6_SIZE: Final = 16
_VIDS: Final = 4096
_MASK: Final = 0xFFFFFFFF


class _Message:
    """A TPKT, an IBH-NetLink packet, or a PDU that was cut: its octets, direction and time, and the S7 PDU it completed."""

    __slots__ = ("ack", "cut", "end", "fragment", "octets", "pdu", "side", "time_ns")

    def __init__(self, side: Side, time_ns: int, octets: bytes, fragment: bool, cut: bool) -> None:
        self.side = side
        self.time_ns = time_ns
        self.octets = octets
        self.fragment = fragment
        self.cut = cut
        self.pdu = b""
        self.ack = max(0, int(side.last_ack))
        framer = side.framer if side.ibh is None else side.ibh
        # The sequence number after it; the framer gets no octets for gaps.
        self.end = (int(side.stream.start_seq) + int(framer.passed) + int(side.missing)) & _MASK


class _Witness(Observer):
    """Collects the pipeline's results until `S7Session` fetches them."""

    def __init__(self) -> None:
        super().__init__()
        self.wants_tpdus = True
        self.wants_pdus = True
        self.messages: list[_Message] = []

    def tpdu(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """A TPKT; a DT inside a TSDU that began before is a fragment, whatever its octets look like."""
        self.messages.append(_Message(side, time_ns, octets, not side.assembler.clear, False))

    def ibh_packet(self, frame: int, time_ns: int, side: Side, octets: bytes) -> None:
        """An IBH-NetLink packet; one inside a message that began before is a fragment, whatever its octets look like."""
        self.messages.append(_Message(side, time_ns, octets, not side.assembler.clear, False))

    def pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """Keep an S7 PDU: that of the packet just reported, or one the capture cut."""
        if cut:
            self.messages.append(_Message(side, time_ns, octets, False, True))
        else:
            self.messages[-1].pdu = octets

    def plus_pdu(self, frame: int, time_ns: int, side: Side, octets: bytes, cut: bool) -> None:
        """An S7comm-plus PDU; a PDU of one frame that came in several DTs is attached to the last of them, like S7."""
        if not cut and self.messages[-1].fragment and parse_plus(octets).frames == 1:
            self.messages[-1].pdu = octets


class S7Session(DefaultSession):
    """Delivers one packet for each whole TPKT or IBH-NetLink packet, whatever the segmentation, and none for other protocols.

    * The packet's time is that of the packet which completed the TPKT. Addresses, ports and VLAN are those of the direction;
      MAC addresses are known if the completing packet has them. Sequence and acknowledgement numbers are those of the
      stream, so that ``wrpcap`` writes a complete stream, with its gaps.
    * An S7 PDU spread over several DTs is attached as `S7` to the last of them, whole, while the earlier DTs contain their
      fragments as `Raw`. Each builds its own octets: ``bytes(packet[S7])`` is the whole PDU, ``bytes(packet)`` its piece.
    * A PDU that the capture cut comes as ``TCP / S7`` without TPKT, as far as it was captured.

    Each capture or interface that ``sniff`` reads has a separate pipeline; ``pipelines`` contains them, with counters for all
    packets and octets.
    """

    def __init__(self, supersession: Any = None) -> None:
        super().__init__(supersession)
        self.pipelines: dict[SuperSocket | None, Pipeline] = {}

    def recv(self, sock: SuperSocket) -> Iterator[Packet]:
        """Take a packet from ``sock``, deliver completed TPKTs (Scapy's interface), at the end also pending ones."""
        try:
            packet = sock.recv(stop_dissection_after=TCP)
        except EOFError:
            yield from self._ended(sock)
            raise
        if packet is not None:
            yield from self._taken(sock, packet)

    def feed(self, packet: Packet) -> Iterator[Packet]:
        """Take one of your own packets, deliver the TPKTs it completed: for packets in order, without ``sniff``."""
        yield from self._taken(None, packet)

    def finish(self) -> Iterator[Packet]:
        """Deliver what is pending from the packets that `feed` took, at their end."""
        yield from self._ended(None)

    def process(self, pkt: Packet) -> Packet | None:
        """Raise TypeError: one packet may complete several TPKTs, or none, so `feed` takes packets of your own."""
        raise TypeError(
            "S7Session gives any number of packets for one: use feed(packet), which yields them, and finish()"
        )

    def _taken(self, sock: SuperSocket | None, packet: Packet) -> Iterator[Packet]:
        pipeline = self.pipelines.get(sock)
        if pipeline is None:
            pipeline = self.pipelines[sock] = Pipeline(_Witness())
        octets = bytes(packet)
        link_type = conf.l2types.layer2num.get(type(packet), -1)
        pipeline.frame(int(packet.time * _NS), octets, 0, len(octets), packet.wirelen or len(octets), link_type)
        yield from _delivered(pipeline, packet)

    def _ended(self, sock: SuperSocket | None) -> Iterator[Packet]:
        pipeline = self.pipelines.get(sock)
        if pipeline is not None:
            pipeline.finish()
            yield from _delivered(pipeline, None)


def _delivered(pipeline: Pipeline, packet: Packet | None) -> Iterator[Packet]:
    """Make a packet of each result found since the last call."""
    witness = pipeline.observer
    assert isinstance(witness, _Witness)
    messages, witness.messages = witness.messages, []
    for one in messages:
        whole = _stacked([*_lower(one, packet), _built(one)])
        whole.time = EDecimal(one.time_ns) / _NS
        yield whole


def _built(message: _Message) -> Packet:
    """Return the TPKT or IBH-NetLink packet, its data packet holding the S7 PDU it completed."""
    if message.cut:
        return _pdu(message.octets)
    tpkt: Packet = TPKT(message.octets) if message.side.ibh is None else IBH(message.octets)
    content = tpkt.payload
    if isinstance(content, COTP_DT | MPI) and (message.fragment or message.pdu):
        octets = bytes(content.payload)
        if not message.pdu:
            content.remove_payload()
            content.add_payload(octets)
        elif message.pdu != octets or not isinstance(content.payload, S7):
            content.join(_pdu(message.pdu))
    return tpkt


def _pdu(octets: bytes) -> Packet:
    """Return the layer of a PDU. One that begins with 0x32 and an unknown ROSCTR stays Raw, as it does without reassembly."""
    layer: Packet = S7(octets) if is_s7(octets) else S7Plus(octets) if is_s7plus(octets) else Raw(octets)
    return layer


def _stacked(layers: list[Packet]) -> Packet:
    """Put each layer on the one before; Scapy's ``/`` would copy them all each time."""
    for under, layer in pairwise(layers):
        under.add_payload(layer)
    return layers[0]


def _lower(message: _Message, packet: Packet | None) -> list[Packet]:
    """Return the layers under the TPKT, as the direction has them."""
    side = message.side
    source, target = side.tcp.ends[side.index], side.tcp.ends[1 - side.index]
    src, dst = address_text(source.address), address_text(target.address)
    macs = _macs(packet, src, dst)
    tags: list[Packet] = []
    left = int(side.tcp.vlan)
    while left:
        left, vid = divmod(left, _VIDS)
        tags.append(Dot1Q(vlan=vid))
    network = IPv6 if len(source.address) == _IPV6_SIZE else IP
    seq = (message.end - len(message.octets)) & _MASK
    return [
        Ether(src=macs[0], dst=macs[1]),
        *reversed(tags),
        network(src=src, dst=dst),
        TCP(sport=source.port, dport=target.port, flags="PA", seq=seq, ack=message.ack),
    ]


def _macs(packet: Packet | None, src: str, dst: str) -> tuple[str, str]:
    """Return the MAC addresses of a direction if ``packet`` is of its connection, in either direction."""
    if packet is not None and type(packet) is Ether:
        network = packet.getlayer(IP) or packet.getlayer(IPv6)
        if network is not None:
            if (network.src, network.dst) == (src, dst):
                return packet.src, packet.dst
            if (network.dst, network.src) == (src, dst):
                return packet.dst, packet.src
    return _NO_MAC, _NO_MAC
