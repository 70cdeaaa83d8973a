"""TPKT as a Scapy layer: it is between TCP and COTP (RFC 1006 section 6).

A segment with several TPKTs gives a chain, ``TPKT / COTP_DT / … / TPKT / COTP_DT / …``, so that ``packet.getlayer(TPKT, 2)`` is
the second one. What follows the last whole TPKT, such as the beginning of a cut one, is a `TPKT_Rest`, which is a `Raw`.
"""

from __future__ import annotations

import time
from typing import Any, Final

from scapy.layers.inet import TCP
from scapy.packet import NoPayload, Packet, Padding, Raw, bind_bottom_up, bind_layers

from dissect.layers.cotp import COTP, COTP_DT
from dissect.layers.fields import WireLayer, fill_number, header_fields
from dissect.protocols.iso.cotp import Assembler
from dissect.protocols.iso.layouts import TPKT as TPKT_LAYOUT
from dissect.protocols.iso.tpkt import HEADER, Framer, plausible

#: TPKTs of one segment that become layers; those after it stay octets, because Scapy walks a chain by recursion. `S7Session`
#: has no such limit.
CHAIN_LIMIT: Final = 32

_PORT: Final = 102
#: Seconds that a `StreamSocket` waits before it checks again for the rest of a TPKT.
_MOMENT: Final = 0.005
_VERSION: Final = 3


class TPKT_Rest(Raw):
    """Octets after the last whole TPKT of a segment; the ``length`` of that TPKT does not count them."""

    name = "Raw"
    match_subclass = True


def _size_at(octets: bytes, at: int) -> int:
    """Return the size of the TPKT that begins at ``at`` and ends within ``octets``, 0 when none does."""
    if len(octets) - at < HEADER or octets[at] != _VERSION:
        return 0
    size = int.from_bytes(octets[at + 2 : at + 4], "big")
    return size if HEADER <= size <= len(octets) - at else 0


class TPKT(WireLayer):
    """A TPKT. ``length`` counts the whole packet, this header included, and is filled in when left out.

    Under TCP, octets that do not look like a whole TPKT with a COTP TPDU in it stay `Raw`. Called on octets of your own,
    ``TPKT(octets)`` reads any four octets as the header; a TPKT that is cut keeps its content as `Raw`.
    """

    name = "TPKT"
    __slots__ = ["built_size"]
    built_size: int
    least = TPKT_LAYOUT.size
    match_subclass = True
    fields_desc = header_fields(TPKT_LAYOUT, {"version": _VERSION, "length": None})

    @classmethod
    def dispatch_hook(
        cls, _pkt: bytes | None = None, *_args: Any, _underlayer: Packet | None = None, **_kwargs: Any
    ) -> Any:
        """Return the class for the octets: a TPKT is recognised strictly under TCP, by size alone elsewhere."""
        if not _pkt:
            return cls
        if isinstance(_underlayer, TCP) and not (_size_at(_pkt, 0) and plausible(bytes(_pkt), 0, len(_pkt))):
            return Raw
        return cls if len(_pkt) >= cls.least else Raw

    @classmethod
    def tcp_reassemble(cls, data: bytes, metadata: dict[str, Any], session: dict[str, Any]) -> Packet | None:
        """Cut one TPKT off a stream, for `StreamSocket`, by the engine's rules (`dissect.protocols.iso.tpkt.Framer`).

        Octets that belong to no TPKT are returned as a `Raw`; octets after them follow later. The DT that ends a PDU of several
        DTs has the whole PDU. While nothing is whole: None, or for a `StreamSocket`, which would wait for the rest whatever its
        time-out, a packet that is False, which Scapy ignores.
        """
        if not data:
            return None if metadata else _Unfinished()
        framer = Framer()
        framer.synced = session.get("s7dissect.synced", False)
        framer.push(data, 0, True)
        begin, size = int(framer.skipped), 0
        if framer.packets:
            size = len(framer.packets[0])
            begin = framer.ends[0] - size
        session["s7dissect.synced"] = begin == 0 and size > 0
        if begin:
            return _with_rest(Raw(data[:begin]), data[begin:])
        if size:
            packet: Packet = cls(data[:size])
            if "ident" not in metadata:  # not Scapy's TCPSession, which keeps one session for both directions
                _join(packet, session)
            return _with_rest(packet, data[size:])
        session["s7dissect.synced"] = framer.synced
        return None if metadata else _Unfinished.waiting(data, session)

    def do_dissect_payload(self, s: bytes) -> None:
        """Dissect this TPKT's content, then the TPKTs after it (Scapy's interface)."""
        at = max(0, self.length - HEADER)
        super().do_dissect_payload(s[:at])
        for _ in range(CHAIN_LIMIT - 1):
            step = (
                _size_at(s, at) if self.length >= HEADER else 0
            )  # a length below 4 gives no position for the next one
            if not step:
                break
            self.add_payload(TPKT(s[at : at + step], _internal=1, stop_dissection_after=self.stop_dissection_after))
            at += step
        if at < len(s):
            self.add_payload(TPKT_Rest(s[at:], _internal=1))

    def guess_payload_class(self, payload: bytes) -> type[Packet]:
        """Return COTP, or Raw when the content is cut (Scapy's interface)."""
        return COTP if len(payload) + HEADER == self.length else Raw

    def do_build(self) -> bytes:
        """Build, and keep the size for the TPKT before this one (Scapy's interface)."""
        octets = super().do_build()
        self.built_size = len(octets)
        return octets

    def post_build(self, pkt: bytes, pay: bytes) -> bytes:
        """Fill in the length, which does not count the TPKTs after this one (Scapy's interface)."""
        if self.getfieldval("length") is None:
            size = len(pkt) + len(pay) - self._size_behind()
            pkt = fill_number(pkt, 2, 2, size, "the TPKT length")
        return pkt + pay

    def _size_behind(self) -> int:
        """Return the octets just built of what follows this TPKT."""
        layer = self.payload
        while not isinstance(layer, NoPayload):
            if isinstance(layer, TPKT):
                return layer.built_size
            if isinstance(layer, TPKT_Rest):
                return len(layer.load)
            layer = layer.payload
        return 0

    def answers(self, other: Packet) -> int:
        """Return whether the (first) PDU in here answers the one in ``other`` (Scapy's interface)."""
        return self.payload.answers(other.payload) if isinstance(other, TPKT) else 0


class _Unfinished(Raw):
    """Nothing yet: what Scapy's `StreamSocket` gets while a TPKT is not whole. It is False, so that nothing is delivered."""

    name = "Raw"

    def __bool__(self) -> bool:
        """Return False: Scapy's sessions ignore it."""
        return False

    @classmethod
    def waiting(cls, data: bytes, session: dict[str, Any]) -> Packet:
        """Return one that leaves all of ``data`` in the socket; where nothing came since the last, after a moment."""
        if session.get("s7dissect.waiting") == data:
            time.sleep(_MOMENT)
        session["s7dissect.waiting"] = data
        return _with_rest(cls(), data)


def _with_rest(packet: Packet, rest: bytes) -> Packet:
    if rest:
        packet.add_payload(Padding(rest))
    return packet


def _join(packet: Packet, session: dict[str, Any]) -> None:
    """Let the DT that ends a PDU of several DTs have the whole PDU."""
    content = packet.payload
    if not isinstance(content, COTP_DT):
        return
    assembler: Assembler = session.setdefault("s7dissect.assembler", Assembler())
    begun = not assembler.clear
    message = assembler.push(bytes(content.payload), bool(content.eot))
    if begun and message is not None:
        content.join(content.guess_payload_class(message)(message))


def bind_port(port: int) -> None:
    """Have Scapy look for TPKTs in TCP segments to and from ``port``, as it does for port 102.

    Raises ValueError for a number that is not a port.
    """
    if not 0 < port < 65536:
        message = f"{port} is not a TCP port: give one of 1 to 65535"
        raise ValueError(message)
    bind_bottom_up(TCP, TPKT, sport=port)
    bind_bottom_up(TCP, TPKT, dport=port)


bind_bottom_up(TCP, TPKT, sport=_PORT)
bind_layers(TCP, TPKT, dport=_PORT)
