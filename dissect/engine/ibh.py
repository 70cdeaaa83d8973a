"""Conversations through an IBH-NetLink gateway: its packets instead of TPKTs, the same S7 PDUs in them (docs/ibh.md).

Beside the road of `dissect.engine.conversation`, which it joins where a message is whole:

    octets → ibh_octets → _packet → _tsdu → …
"""

from __future__ import annotations

from mypy_extensions import i64

from dissect.engine.conversation import Conversation
from dissect.engine.observer import Observer, Options
from dissect.ibh.framer import PacketFramer, opens
from dissect.ibh.packet import IbhPacket, parse_packet
from dissect.ibh.tables import (
    IBH_NETLINK,
    KIND_CONNECT,
    KIND_DATA,
    KIND_DISCONNECT,
    KIND_FRAGMENT,
    KINDS,
    NETLINK_PORT,
)
from dissect.iso.upper import S7COMM, is_sound
from dissect.tcp.stream import MASK
from dissect.transactions.connection import IBH
from dissect.transactions.table import Side


class Gateway(Conversation):
    """Octets of known connections in, be they ISO-on-TCP or IBH-NetLink; counts the packets of the latter by kind."""

    def __init__(self, observer: Observer, options: Options) -> None:
        super().__init__(observer, options)
        self.ibh_packets: list[int] = [0] * len(KINDS)

    def probe(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Look at octets of a connection not known yet: does it speak IBH-NetLink, or ISO-on-TCP."""
        first: i64 = side.end_seq - len(octets)
        at_start: bool = side.tcp.known_start and first & MASK == side.stream.start_seq
        if self.follow(side, "tcp", at_start):
            self.carried_octets(side, octets, frame, time_ns)
            return
        ends = side.tcp.ends
        on_port: bool = ends[0].port == NETLINK_PORT or ends[1].port == NETLINK_PORT
        if opens(octets, on_port, at_start):
            self._open_gateway(side)
            self.ibh_octets(side, octets, frame, time_ns)
        else:
            super().probe(side, octets, frame, time_ns)

    def _open_gateway(self, side: Side) -> None:
        connection = side.connection
        peer = side.peer
        assert peer is not None
        connection.state = IBH
        connection.protocol = IBH_NETLINK
        self.connections += 1
        connection.number = self.connections
        mine = PacketFramer()
        theirs = PacketFramer()
        mine.synced = True
        theirs.synced = side.tcp.known_start and peer.stream.octets == 0
        side.ibh = mine
        peer.ibh = theirs
        self.observer.connection_opened(connection)

    def ibh_octets(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the next octets of a connection that speaks IBH-NetLink."""
        framer = side.ibh
        assert framer is not None
        framer.push(octets)
        if framer.faults:
            for first in framer.faults:
                detail = f"octets that begin no packet from {side.tcp.ends[side.index]}, first 0x{first:02x}"
                self.judge.note("ibh.malformed", side.connection.number, [frame], time_ns, detail)
            framer.faults = []
        if framer.hiding:
            detail = f"a length that covers other packets from {side.tcp.ends[side.index]}; they were read as well"
            self.judge.note("ibh.malformed", side.connection.number, [frame], time_ns, detail)
            framer.hiding = 0
        packets = framer.packets
        framer.packets = []
        for packet in packets:
            try:
                self._packet(side, packet, frame, time_ns)
            except Exception as bug:
                if self._strict:
                    raise
                self.note_bug(bug, frame, time_ns)
            del framer.ends[0]

    def _packet(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """A whole packet: count it, and take out of it what belongs to a message."""
        if self.observer.wants_tpdus:
            self.observer.ibh_packet(frame, time_ns, side, octets)
        connection = side.connection
        packet = parse_packet(octets)
        kind: i64 = packet.kind
        self.ibh_packets[kind] += 1
        if packet.malformed:
            detail = f"{packet.name} from {side.tcp.ends[side.index]}: {packet.malformed[0]}"
            self.judge.note("ibh.malformed", connection.number, [frame], time_ns, detail)
        if kind == KIND_DATA or kind == KIND_FRAGMENT:
            self._message(side, packet, frame, time_ns)
        elif kind == KIND_CONNECT:
            connection.mid_stream = False
            connection.iso_ended = ""
            connection.set_client(side.index)
        elif kind == KIND_DISCONNECT:
            connection.iso_ended = f"MPI disconnect from {side.tcp.ends[side.index]}"

    def _message(self, side: Side, packet: IbhPacket, frame: i64, time_ns: i64) -> None:
        assembler = side.assembler
        begun: bool = not assembler.clear
        overflows: i64 = assembler.overflows
        message = assembler.push(packet.data, packet.kind == KIND_DATA)
        if assembler.overflows > overflows:
            detail = f"a message in parts from {side.tcp.ends[side.index]} grew past 65536 octets and was dropped"
            self.judge.note("ibh.malformed", side.connection.number, [frame], time_ns, detail)
        if begun and packet.kind == KIND_DATA and is_sound(packet.data, 0, len(packet.data)):
            self._end_of_parts(side, message, packet.data, "ibh.unfinished", frame, time_ns)
        elif message is not None:
            self._tsdu(side, message, 0, len(message), frame, time_ns)

    # ---- what is irregular ------------------------------------------------------------------------------------------

    def hole(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """Take note of ``size`` octets missing here; ``cut``: the capture cut them off a packet."""
        framer = side.ibh
        if framer is None:
            super().hole(side, size, cut, frame, time_ns)
            return
        side.holes += 1
        side.missing += size
        side.hole_frame = frame
        inside = framer.hole(size, cut)
        if framer.cut_packet:
            self._cut_packet(side, framer.cut_packet, frame, time_ns)
            framer.cut_packet = b""
        if not cut:
            where = "inside a packet" if inside else "between packets"
            detail = f"{size} octets from {side.tcp.ends[side.index]}, {where}"
            self.judge.note("stream.hole", side.connection.number, [frame], time_ns, detail)
        self._abandon(side, "the capture cut a packet of it" if cut else "octets were lost", frame, time_ns)

    def _cut_packet(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """A packet the capture cut: an S7 header that is there still tells what was asked or answered."""
        packet = parse_packet(octets)
        pdu = packet.data
        if packet.kind != KIND_DATA or side.assembler.parts is not None or len(pdu) < 10 or pdu[0] != 0x32:
            return
        self.ibh_packets[KIND_DATA] += 1
        self.tsdus[S7COMM] += 1
        self.cut_pdu(side, pdu, frame, time_ns)

    def _abandon(self, side: Side, why: str, frame: i64, time_ns: i64) -> None:
        """Drop the message begun, if there is one."""
        if side.assembler.parts is not None:
            side.assembler.abandon()
            detail = f"a message from {side.tcp.ends[side.index]}: {why}"
            self.judge.note("ibh.unfinished", side.connection.number, [frame], time_ns, detail)

    def end(self, side: Side, reason: str, frame: i64, now_ns: i64) -> None:
        """A connection is over (``reason`` is why its open requests stay unanswered): close what is open on both sides."""
        peer = side.peer
        assert peer is not None
        for end in (side, peer):
            framer = end.ibh
            if framer is not None:
                self._abandon(end, "its rest was not captured", frame, now_ns)
                if framer.buffered:
                    detail = f"{framer.buffered} octets from {end.tcp.ends[end.index]}"
                    self.judge.note("ibh.unfinished", end.connection.number, [frame], now_ns, detail)
        super().end(side, reason, frame, now_ns)
