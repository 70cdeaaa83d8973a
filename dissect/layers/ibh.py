"""IBH-NetLink as Scapy layers: the layers between TCP port 1099 and S7 on a gateway from Ethernet to MPI (docs/ibh.md).

``IBH / MPI / S7`` to the gateway, ``IBH / MPI_Long / S7`` from it; acknowledgements and connects are the same without `S7`. A
segment with several packets gives a chain, as with TPKT. The flags of `IBH` determine the MPI header after it; if they are left
out, they are set by the layer that follows.
"""

from __future__ import annotations

from typing import Any, Final

from scapy.fields import LEShortEnumField
from scapy.layers.inet import TCP
from scapy.packet import NoPayload, Packet, Padding, Raw, bind_bottom_up, bind_layers

from dissect.layers.fields import Joining, WireLayer, fill_number, header_fields
from dissect.layers.s7 import S7
from dissect.layers.tpkt import TPKT
from dissect.protocols.ibh.framer import channels_fit, flags_fit
from dissect.protocols.ibh.layouts import IBH as IBH_LAYOUT
from dissect.protocols.ibh.layouts import MPI_LONG, MPI_SHORT
from dissect.protocols.ibh.packet import HEADER, LONG_HEAD, SHORT_HEAD
from dissect.protocols.ibh.tables import DATA, FUNCTIONS, MPI_INDICATION, MPI_REQUEST, NETLINK_PORT, SERVICES

#: Packets of one segment that become layers; those after it stay octets, because Scapy walks a chain by recursion.
CHAIN_LIMIT: Final = 32
_LENGTH_AT: Final = 2
_FLAGS_AT: Final = 6
_CLIENT: Final = 0x07
_GATEWAY: Final = 0xFF


class IBH_Rest(Raw):
    """Octets after the last whole packet of a segment, which belong to no packet."""

    name = "Raw"
    match_subclass = True


class XLEShortEnumField(LEShortEnumField):
    """A number of two octets, the low one first, shown in hexadecimal where it has no name."""

    def i2repr_one(self, pkt: Packet | None, x: Any) -> str:
        """Return the name, or the number (Scapy's interface)."""
        if not isinstance(x, int):
            return repr(x)
        names: dict[int, str] = self.i2s or {}
        return names.get(x, f"0x{x:04x}")


def _size_at(octets: bytes, at: int) -> int:
    """Return the size of the packet that begins at ``at`` and ends within ``octets``, 0 when none does."""
    if len(octets) - at < HEADER or not channels_fit(octets, at, len(octets)):
        return 0
    size = HEADER + octets[at + _LENGTH_AT]
    return size if size <= len(octets) - at else 0


def _size_behind(packet: Packet) -> int:
    """Return the number of octets just built for the packets after the one that ``packet`` is a layer of."""
    layer = packet.payload
    while not isinstance(layer, NoPayload):
        if isinstance(layer, IBH):
            return layer.built_size
        if isinstance(layer, IBH_Rest):
            return len(layer.load)
        layer = layer.payload
    return 0


class IBH(WireLayer):
    """The header of every packet. ``length`` counts the octets after it; it is filled in if left out, and so are the flags.

    Under TCP, octets that do not look like a whole packet stay `Raw`. Called on octets of your own, ``IBH(octets)`` reads any
    eight octets as the header.
    """

    name = "IBH"
    __slots__ = ["built_size"]
    built_size: int
    least = IBH_LAYOUT.size
    match_subclass = True
    fields_desc = header_fields(
        IBH_LAYOUT,
        {"channel1": None, "channel2": None, "length": None},
        {
            "s_flags": XLEShortEnumField("s_flags", 0, SERVICES.names()),
            "r_flags": XLEShortEnumField("r_flags", None, SERVICES.names()),
        },
    )

    @classmethod
    def dispatch_hook(
        cls, _pkt: bytes | None = None, *_args: Any, _underlayer: Packet | None = None, **_kwargs: Any
    ) -> Any:
        """Return the class for the octets: a packet is recognised strictly under TCP, by size alone elsewhere."""
        if not _pkt:
            return cls
        if isinstance(_underlayer, TCP) and not (_size_at(_pkt, 0) and flags_fit(bytes(_pkt), 0)):
            return TPKT.dispatch_hook(_pkt, _underlayer=_underlayer)  # ordinary S7 may use the port as well
        return cls if len(_pkt) >= cls.least else Raw

    @classmethod
    def tcp_reassemble(cls, data: bytes, _metadata: dict[str, Any], _session: dict[str, Any]) -> Packet | None:
        """Cut one packet off a stream, for `StreamSocket`; None while it is not whole."""
        if len(data) <= _LENGTH_AT:
            return None
        size = HEADER + data[_LENGTH_AT]
        if len(data) < size:
            return None
        packet: Packet = cls(data[:size])
        if len(data) > size:
            packet.add_payload(Padding(data[size:]))
        return packet

    def do_dissect_payload(self, s: bytes) -> None:
        """Dissect this packet's content, then the packets after it (Scapy's interface)."""
        at = self.length
        super().do_dissect_payload(s[:at])
        for _ in range(CHAIN_LIMIT - 1):
            step = _size_at(s, at)
            if not step:
                break
            self.add_payload(IBH(s[at : at + step], _internal=1, stop_dissection_after=self.stop_dissection_after))
            at += step
        if at < len(s):
            self.add_payload(IBH_Rest(s[at:], _internal=1))

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Return the MPI header that the flags announce, Raw if there is none or it is incomplete (Scapy's interface)."""
        if len(payload) == self.length:
            if self.r_flags == MPI_REQUEST and len(payload) > SHORT_HEAD:
                return MPI
            if self.r_flags == MPI_INDICATION and len(payload) > LONG_HEAD:
                return MPI_Long
        return Raw

    def do_build(self) -> bytes:
        """Build, and keep the size for the packet before this one (Scapy's interface)."""
        octets = super().do_build()
        self.built_size = len(octets)
        return octets

    def self_build(self) -> bytes:
        """Build the header; channels and flags that were left out are taken from the following layer (Scapy's interface)."""
        octets: bytes = super().self_build()
        from_gateway = isinstance(self.payload, MPI_Long)
        left, right = (_GATEWAY, _CLIENT) if from_gateway else (_CLIENT, _GATEWAY)
        if self.getfieldval("channel1") is None:
            octets = bytes((left,)) + octets[1:]
        if self.getfieldval("channel2") is None:
            octets = octets[:1] + bytes((right,)) + octets[2:]
        if self.getfieldval("r_flags") is None and isinstance(self.payload, MPI):
            flags = MPI_INDICATION if from_gateway else MPI_REQUEST
            octets = octets[:_FLAGS_AT] + flags.to_bytes(2, "little")
        return octets

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the length, which does not count the packets after this one (Scapy's interface)."""
        if self.getfieldval("length") is None:
            pkt = fill_number(pkt, _LENGTH_AT, 1, len(pay) - _size_behind(self), "the IBH length")
        return pkt + pay

    def answers(self, other: Packet) -> int:
        """Return whether the PDU in this packet answers the one in ``other`` (Scapy's interface)."""
        return self.payload.answers(other.payload) if isinstance(other, IBH) else 0


class MPI(Joining, WireLayer):
    """The short MPI header, to the gateway. ``length`` counts from ``function`` on and is filled in when left out.

    A data packet carries `S7`; any other, also a fragment that the next packet continues, has the octets after its number as
    `Raw`. A packet whose length ends with the function (a disconnect) has no number: ``number`` is None.
    """

    name = "MPI"
    __slots__ = ["piece"]
    head = SHORT_HEAD
    least = SHORT_HEAD + 1
    match_subclass = True
    fields_desc = header_fields(
        MPI_SHORT, {"src_conn": 20, "dst_conn": 20, "mpi": 2, "length": None, "function": DATA, "number": 1}
    )

    def do_dissect(self, s: bytes) -> bytes:
        """Read the header, which may end before its number (Scapy's interface)."""
        rest = s
        self.raw_packet_cache_fields = {}
        for field in self.fields_desc:
            if field.name == "number" and not rest:
                self.fields["number"] = None
                break
            rest, self.fields[field.name] = field.getfield(self, rest)
        self.raw_packet_cache = s[: len(s) - len(rest)]
        self.explicit = 1
        return rest

    def self_build(self) -> bytes:
        """Build the header, without its number if that is None (Scapy's interface)."""
        octets: bytes = super().self_build()
        return octets[:-1] if self.getfieldval("number") is None and len(octets) > self.head + 1 else octets

    def line(self) -> str:
        """Return the meaning of the packet."""
        return f"{self.name} {FUNCTIONS.name(self.function)}"

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Return S7 for a data packet that holds a whole PDU (Scapy's interface)."""
        return S7 if self.function == DATA and payload[:1] == b"\x32" and self.length == len(payload) + 2 else Raw

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the length (Scapy's interface)."""
        if self.getfieldval("length") is None:
            size = len(pkt) - self.head + len(pay) - _size_behind(self)
            pkt = fill_number(pkt, self.head - 1, 1, size, "the MPI length")
        return pkt + pay

    def answers(self, other: Packet) -> int:
        """Return whether the PDU in this packet answers the one in ``other``, on the same connection (Scapy's interface)."""
        if not isinstance(other, MPI) or (self.src_conn, self.mpi) != (other.src_conn, other.mpi):
            return 0
        return self.payload.answers(other.payload)


class MPI_Long(MPI):
    """The long MPI header, from the gateway."""

    name = "MPI"
    head = LONG_HEAD
    least = LONG_HEAD + 1
    fields_desc = header_fields(
        MPI_LONG,
        {"src_conn": 20, "dst_conn": 20, "mpi": 2, "unknown3": 0x22, "length": None, "function": DATA, "number": 1},
    )


bind_bottom_up(TCP, IBH, sport=NETLINK_PORT)
bind_layers(TCP, IBH, dport=NETLINK_PORT)
