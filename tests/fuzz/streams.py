"""Fuzz target ``streams``: the octets of one direction, cut anywhere, with holes: TPKTs, TPDUs, TSDUs, IBH-NetLink packets.

The input is pieces: an octet for the kind of the next piece, two octets of size, and the octets of the piece unless it is a
gap. The very first octet chooses whether the streams begin in step.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from dissect.meaning.report.tree import netlink_tree_lines, tpdu_tree_lines
from dissect.protocols.ibh.framer import PacketFramer
from dissect.protocols.ibh.packet import parse_packet
from dissect.protocols.iso.cotp import Assembler, parse_tpdu
from dissect.protocols.iso.tables import DT
from dissect.protocols.iso.tpkt import Framer
from dissect.protocols.iso.upper import classify
from tests.fuzz.checks import check_lines
from tests.fuzz.taking import Taker
from tests.fuzz.turns import TURNS

SYNCED: Final = 1
HOLE: Final = 1
CUT: Final = 2  # a hole because the capture cut the packet

#: The outputs for a stream, in turn (`tests.fuzz.turns`): the trees of its packets; the same again, octet by octet.
TREES, STREWN, THINGS = range(3)
#: A piece, or None and the size of a gap, and whether the gap is due to the capture.
Piece = tuple[bytes | None, int, bool]


def written(pieces: Iterable[bytes], synced: bool) -> bytes:
    """Return pieces in the form of this target."""
    octets = bytearray((SYNCED if synced else 0,))
    for piece in pieces:
        octets += b"\0" + len(piece).to_bytes(2, "big") + piece
    return bytes(octets)


def pieces_of(octets: bytes) -> tuple[list[Piece], bool]:
    """Return the pieces that ``octets`` describe, and whether the stream begins with the first of them."""
    taker = Taker(octets)
    synced = bool(taker.number() & SYNCED)
    pieces: list[Piece] = []
    while taker.left:
        kind = taker.number() & 3
        size = taker.number(2)
        if kind & HOLE and size:
            pieces.append((None, size, kind & CUT != 0))
        else:
            pieces.append((taker.octets(size), 0, False))
    return pieces, synced


def _tpkts(pieces: Iterable[Piece], synced: bool, strewn: bool) -> tuple[list[bytes], Framer]:
    """Return the TPKTs of a stream; ``strewn`` gives it octet by octet."""
    framer = Framer()
    framer.synced = synced
    packets: list[bytes] = []
    given = 0
    for piece, hole, cut in pieces:
        if piece is None:
            framer.hole(hole, cut)
        elif strewn:
            for at in range(len(piece)):
                framer.push(piece[at : at + 1], 0, at == 0)
        else:
            framer.push(piece, 0, True)
        given += len(piece or b"")
        assert framer.framed + framer.skipped + framer.buffered == given
        assert framer.passed <= given
        assert len(framer.ends) == len(framer.packets)
        packets += framer.packets
        framer.packets.clear()
        framer.ends.clear()
    return packets, framer


def _tpdus(packets: Iterable[bytes], shown: bool) -> None:
    """Read the TPDUs of TPKTs, join their TSDUs, and show them."""
    assembler = Assembler()
    given = taken = 0
    for packet in packets:
        assert int.from_bytes(packet[2:4], "big") >= len(packet)  # if fewer, it covered a sound one, and ends before it
        tpdu = parse_tpdu(packet[4:])
        if shown:
            check_lines(tpdu_tree_lines(packet))
        if tpdu.type == DT:
            given += len(tpdu.data)
            tsdu = assembler.push(tpdu.data, bool(tpdu.field("eot")))
            if tsdu is not None:
                taken += len(tsdu)
                classify(tsdu, 0, len(tsdu))
        held = len(assembler.parts or b"")
        assert taken + held + assembler.dropped == given
    assembler.abandon()
    assert taken + assembler.dropped == given


def _netlink(pieces: Iterable[Piece], shown: bool) -> None:
    framer = PacketFramer()
    given = 0
    for piece, hole, cut in pieces:
        if piece is None:
            framer.hole(hole, cut)
        else:
            framer.push(piece)
            given += len(piece)
        assert framer.framed + framer.skipped + framer.buffered == given
        assert len(framer.ends) == len(framer.packets)
        for packet in framer.packets:
            parse_packet(packet)
            if shown:
                check_lines(netlink_tree_lines(packet))
        framer.packets.clear()
        framer.ends.clear()


def streams(octets: bytes) -> None:
    """Any stream: its octets are accounted for, and while it is in step its TPKTs do not depend on how it was cut."""
    pieces, synced = pieces_of(octets)
    packets, framer = _tpkts(pieces, synced, False)
    strew = TURNS.has(octets, STREWN, THINGS)
    if strew and synced and not framer.faults and not any(piece is None for piece, _, _ in pieces):
        strewn, other = _tpkts(pieces, synced, True)
        assert strewn == packets
        assert (other.framed, other.skipped, other.buffered) == (framer.framed, framer.skipped, framer.buffered)
    elif strew and len(octets) < 1024:
        _tpkts(pieces, synced, True)
    shown = TURNS.has(octets, TREES, THINGS)
    _tpdus(packets, shown)
    _netlink(pieces, shown)
