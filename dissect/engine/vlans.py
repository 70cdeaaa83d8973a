"""Finds the connection of a packet that was captured in another VLAN (docs/decisions/0021).

A mirror port may show the two directions of a connection with different VLAN tags, or every packet twice if a router connects
two VLANs. `elsewhere` is called only if a packet belongs to no connection of its own VLAN. But identical machines may use the
same addresses in separate VLANs. So a packet belongs to the same connection only if its sequence and acknowledgement numbers
fit; those of a separate connection do not.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.side import Side
from dissect.engine.transactions.table import ConnectionTable, base_and_tag, reverse_key
from dissect.packets.tcp.stream import ACK, MASK, RST, SYN, WINDOW, HalfStream

#: Minimum size of a copy to be recognised, in octets; fewer octets may be equal by chance.
_COMPARED: Final = 8


def elsewhere(
    table: ConnectionTable, key: bytes, vlan: i64, seq: i64, ack: i64, flags: i64, octets: bytes, missing: i64
) -> tuple[Side | None, bytes, i64]:
    """Return the side that sent a packet, if its connection is in another VLAN, else None; then a key and a VLAN.

    With these the caller opens a new connection if there is no side. They are the packet's own ``key`` and ``vlan``, or those
    of another VLAN with a connection attempt that the packet answers.
    """
    base, tag = base_and_tag(key)
    table.note_tag(tag)
    if not flags & (ACK | RST):
        return None, key, vlan
    size: i64 = len(octets) + missing
    reverse = reverse_key(base)
    attempt = table.attempt(reverse + tag)
    answers: bool = attempt is not None and flags & ACK != 0 and _near(ack, attempt.seq + 1, flags)
    for other in table.tags:
        there = None if other == tag else table.sides.get(base + other)
        if there is None or there.peer is None:
            continue
        if _repeats(there, there.peer, seq, ack, flags, octets, size) or (
            not answers and not there.captured and _answers(there.peer, seq, ack, flags)
        ):
            table.add(there, key)
            return there, key, vlan
    if answers or not flags & ACK:
        return None, key, vlan
    for other in table.tags:
        attempt = None if other == tag else table.attempt(reverse + other)
        if attempt is None or not _near(ack, attempt.seq + 1, flags):
            continue
        # A packet without SYN may belong to the connection that is already open there, if there is one.
        if flags & SYN or base + other not in table.sides:
            return None, base + other, int.from_bytes(other, "big")
    return None, key, vlan


def _near(number: i64, place: i64, flags: i64) -> bool:
    """Return whether ``number`` is within a window of ``place``; in the answer to a SYN it must be equal."""
    distance: i64 = (number - place) & MASK
    if flags & SYN:
        return distance == 0
    return distance <= WINDOW or MASK + 1 - distance <= WINDOW


def _answers(peer: Side, seq: i64, ack: i64, flags: i64) -> bool:
    """Return whether a segment fits the direction towards ``peer``, which was not captured yet."""
    if not flags & ACK:  # a reset
        return seq == peer.last_ack
    place: i64 = peer.stream.start_seq if flags & SYN else peer.stream.next_seq
    if place < 0 or not _near(ack, place, flags):
        return False
    return peer.last_ack < 0 or flags & SYN != 0 or _near(seq, peer.last_ack, flags)


def _repeats(side: Side, peer: Side, seq: i64, ack: i64, flags: i64, octets: bytes, size: i64) -> bool:
    """Return whether a segment is a copy of one that ``side`` sent before, or exactly the next one from it."""
    mine, theirs = side.stream, peer.stream
    if flags & SYN:
        # Both copies are captured before the SYN/ACK is answered; a later one is from another machine with equal numbers.
        begins: bool = mine.start_seq == (seq + 1) & MASK and theirs.start_seq == ack
        return begins and mine.next_seq == mine.start_seq and theirs.next_seq == ack
    place: i64 = mine.next_seq if mine.next_seq >= 0 else peer.last_ack
    if not side.captured or place < 0:
        return False
    exact: bool = seq == place or (seq + size) & MASK == place
    if not flags & ACK:
        return exact
    if exact:
        return ack == side.last_ack or (theirs.next_seq >= 0 and ack == theirs.next_seq)
    # Several packets may have passed between the two copies.
    return theirs.next_seq >= 0 and _near(ack, theirs.next_seq, flags) and _kept(mine, seq, octets)


def _kept(stream: HalfStream, seq: i64, octets: bytes) -> bool:
    """Return whether ``octets`` are one of the two latest segments of a stream, at the same sequence number."""
    behind: i64 = (stream.next_seq - seq) & MASK
    at: i64 = stream.position - behind
    size: i64 = len(octets)
    if size < _COMPARED or behind > WINDOW:
        return False
    return (at == stream.last_at and octets == stream.last) or (at == stream.before_at and octets == stream.before)
