"""IBH-NetLink: packets of a gateway, used instead of TPKTs, with the same S7 PDUs in them (docs/ibh.md)."""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.exchange import Exchange
from dissect.engine.iso import IsoOnTcp
from dissect.engine.transactions.accounts import OctetAccount
from dissect.engine.transactions.connection import FOLLOWED
from dissect.engine.transactions.protocol import Protocol
from dissect.engine.transactions.side import Side
from dissect.protocols.ibh.framer import PacketFramer, opens
from dissect.protocols.ibh.packet import IbhPacket, parse_packet
from dissect.protocols.ibh.tables import (
    IBH_NETLINK,
    KIND_CONNECT,
    KIND_DATA,
    KIND_DISCONNECT,
    KIND_FRAGMENT,
    KINDS,
    NETLINK_PORT,
)
from dissect.protocols.iso.upper import is_sound


class IbhNetLink(Protocol):
    """Takes octets of a gateway's connection and hands their messages to ``messages``; counts packets by kind."""

    def __init__(self, exchange: Exchange, messages: IsoOnTcp) -> None:
        super().__init__(FOLLOWED)
        self._exchange: Exchange = exchange
        self._messages: IsoOnTcp = messages
        self.packets: list[int] = [0] * len(KINDS)

    def probe(self, side: Side, octets: bytes, at_start: bool) -> bool:
        """Return whether a connection speaks IBH-NetLink."""
        ends = side.tcp.ends
        on_port: bool = ends[0].port == NETLINK_PORT or ends[1].port == NETLINK_PORT
        return opens(octets, on_port, at_start)

    def begin(self, side: Side, at_start: bool) -> None:
        """A connection speaks IBH-NetLink; ``side`` is in step, whatever came before."""
        peer = side.peer
        assert peer is not None
        side.connection.protocol = IBH_NETLINK
        mine = PacketFramer()
        theirs = PacketFramer()
        mine.synced = True
        theirs.synced = side.tcp.known_start and peer.stream.octets == 0
        side.ibh = mine
        peer.ibh = theirs

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a connection."""
        framer = side.ibh
        assert framer is not None
        framer.push(buf[at : at + size])
        if framer.faults:
            for first in framer.faults:
                detail = f"bytes that begin no packet from {side.tcp.ends[side.index]}, first 0x{first:02x}"
                self._exchange.reporter.note("ibh.malformed", side.connection.number, [frame], time_ns, detail)
            framer.faults = []
        if framer.hiding:
            detail = f"a length that covers other packets from {side.tcp.ends[side.index]}; they were decoded as well"
            self._exchange.reporter.note("ibh.malformed", side.connection.number, [frame], time_ns, detail)
            framer.hiding = 0
        packets = framer.packets
        framer.packets = []
        for packet in packets:
            try:
                self._packet(side, packet, frame, time_ns)
            except Exception as bug:
                self._exchange.note_bug(bug, frame, time_ns)
            del framer.ends[0]

    def _packet(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take a complete packet: count it, and use the part of a message that it carries."""
        exchange = self._exchange
        if exchange.observer.wants_tpdus:
            exchange.observer.ibh_packet(frame, time_ns, side, octets)
        connection = side.connection
        packet = parse_packet(octets)
        kind: i64 = packet.kind
        self.packets[kind] += 1
        if packet.malformed:
            detail = f"{packet.name} from {side.tcp.ends[side.index]}: {packet.malformed[0]}"
            exchange.reporter.note("ibh.malformed", connection.number, [frame], time_ns, detail)
        if kind == KIND_DATA or kind == KIND_FRAGMENT:
            self._message(side, packet, frame, time_ns)
        elif kind == KIND_CONNECT:
            connection.mid_stream = False
            connection.iso_ended = ""
            connection._set_client(side.index)
        elif kind == KIND_DISCONNECT:
            connection.iso_ended = f"MPI disconnect from {side.tcp.ends[side.index]}"

    def _message(self, side: Side, packet: IbhPacket, frame: i64, time_ns: i64) -> None:
        assembler = side.assembler
        begun: bool = not assembler.clear
        overflows: i64 = assembler.overflows
        message = assembler.push(packet.data, packet.kind == KIND_DATA)
        if assembler.overflows > overflows:
            detail = f"a message in parts from {side.tcp.ends[side.index]} exceeded 65536 bytes and was dropped"
            self._exchange.reporter.note("ibh.malformed", side.connection.number, [frame], time_ns, detail)
        if begun and packet.kind == KIND_DATA and is_sound(packet.data, 0, len(packet.data)):
            self._messages.end_of_parts(side, message, packet.data, "ibh.unfinished", frame, time_ns)
        elif message is not None:
            self._messages.message(side, message, 0, len(message), frame, time_ns)

    # ---- what is irregular ------------------------------------------------------------------------------------------

    def gap(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """Take note of ``size`` octets missing here; ``cut``: the capture cut them off a packet."""
        framer = side.ibh
        assert framer is not None
        inside = framer.hole(size, cut)
        if framer.cut_packet:
            self._cut_packet(side, framer.cut_packet, frame, time_ns)
            framer.cut_packet = b""
        if not cut:
            where = "inside a packet" if inside else "between packets"
            detail = f"{size} bytes from {side.tcp.ends[side.index]}, {where}"
            self._exchange.reporter.note("stream.hole", side.connection.number, [frame], time_ns, detail)
        self._abandon(side, "the capture truncated one of its packets" if cut else "bytes were lost", frame, time_ns)

    def _cut_packet(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take a packet that the capture cut off: a complete S7 header in it still shows the request or response."""
        packet = parse_packet(octets)
        pdu = packet.data
        if packet.kind != KIND_DATA or side.assembler.parts is not None or len(pdu) < 10 or pdu[0] != 0x32:
            return
        self.packets[KIND_DATA] += 1
        self._messages.cut(side, pdu, frame, time_ns)

    def _abandon(self, side: Side, why: str, frame: i64, time_ns: i64) -> None:
        """Drop an unfinished message, if there is one."""
        if side.assembler.parts is not None:
            side.assembler.abandon()
            detail = f"a message from {side.tcp.ends[side.index]}: {why}"
            self._exchange.reporter.note("ibh.unfinished", side.connection.number, [frame], time_ns, detail)

    def finish(self, side: Side, frame: i64, time_ns: i64) -> None:
        """No more octets come: report an unfinished message and an unfinished packet of ``side``."""
        framer = side.ibh
        assert framer is not None
        self._messages.finish(side, frame, time_ns)
        self._abandon(side, "the rest was not captured", frame, time_ns)
        if framer.buffered:
            detail = f"{framer.buffered} bytes from {side.tcp.ends[side.index]}"
            self._exchange.reporter.note("ibh.unfinished", side.connection.number, [frame], time_ns, detail)

    def held(self, side: Side) -> i64:
        """Return the octets of an unfinished packet and message."""
        framer = side.ibh
        buffered: i64 = framer.buffered if framer is not None else 0
        return self._messages.held(side) + buffered

    def add_up(self, side: Side, account: OctetAccount) -> None:
        """Add the octets of packets, and those before the gateway was recognised."""
        super().add_up(side, account)
        framer = side.ibh
        assert framer is not None
        account.framed += framer.framed
        account.skipped += framer.skipped
        account.buffered += framer.buffered

    # ---- what was counted -------------------------------------------------------------------------------------------

    def describe(self) -> dict[str, object]:
        """Return the section ``ibh``."""
        return {"ibh": {name: count for name, count in zip(KINDS, self.packets, strict=True) if count}}
