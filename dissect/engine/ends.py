"""Ends of connections: real and false RSTs and FINs, and SYNs that begin another connection with the same addresses.

Any host that can forge the addresses of a connection can send such packets; the receiver checks their sequence numbers, and
ignores those that are wrong. So a RST or FIN with a number that its receiver may reject counts as the end only as long as the
connection does not continue (`dissect.packets.tcp.doubt`). A SYN ends an open connection only once something confirms it: a
SYN/ACK or a RST that acknowledges it, or data with the sequence numbers that follow it.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine import attempts
from dissect.engine.counters import Counters
from dissect.engine.transactions.connection import FOREIGN, LEFT_OUT
from dissect.engine.transactions.side import Rival, Side
from dissect.engine.transactions.table import ConnectionTable
from dissect.packets.tcp.doubt import HOLDS, REFUTED
from dissect.packets.tcp.stream import ACK, FIN, MASK, RST, SYN, WINDOW
from dissect.wire.text import count

#: After a reset, a segment at most this far ahead may be out of order; any other segment comes too late.
AFTER_RESET: Final = 65536

# What `judge` returns for a SYN or RST: it belongs to this connection, begins a new one in its place, or needs a confirmation.
SAME: Final = 0
ANOTHER: Final = 1
HELD_BACK: Final = 2

_NAMES: Final[dict[str, str]] = {"fin": "FIN", "reset": "reset"}


# ---- RST and FIN ----------------------------------------------------------------------------------------------------


def take(counters: Counters, side: Side, seq: i64, flags: i64, size: i64, link: bytes) -> bool:
    """Take a RST, else a FIN, with ``size`` octets from ``seq``; return False for a RST that is ignored.

    ``link`` are the Ethernet addresses of its packet, destination first, empty for none.
    """
    tcp = side.tcp
    state = side.connection._state
    read: bool = state != FOREIGN and state != LEFT_OUT
    in_doubt: bool = tcp.doubt is not None
    if flags & RST:
        if not read:
            seq = side.stream.next_seq  # its octets are not followed, so no sequence number is expected
        if not tcp.note_reset(side.index, seq, counters.frames, counters.now_ns):
            counters.note_ignored(side, "reset")
            return False
    elif tcp.note_fin(side.index, (seq + size) & MASK, counters.frames, counters.now_ns, read):
        side.fin_seq = (seq + size) & MASK
    else:
        counters.note_ignored(side, "FIN")
    if tcp.doubt is not None and not in_doubt:
        tcp.doubt.sender = link[6:12]
    return True


def look(counters: Counters, side: Side) -> None:
    """If the end of the connection is in doubt, check whether both sides continued since then; if so, withdraw the end."""
    tcp = side.tcp
    doubt = tcp.doubt
    peer = side.peer
    if doubt is None or peer is None:
        return
    mine, theirs = (side, peer) if doubt.side == side.index else (peer, side)
    found: i64 = doubt.look(mine.stream, theirs.stream, mine.last_ack, theirs.last_ack)
    if found == HOLDS:
        tcp.doubt = None
    elif found == REFUTED:
        tcp.withdraw()
        if side.connection.followed:
            where = f"{count(abs(int(doubt.distance)), 'byte')} {'ahead of' if doubt.distance > 0 else 'behind'}"
            detail = (
                f"{_NAMES[doubt.how]} from {tcp.ends[doubt.side]}, {where} the number expected: the connection went on"
            )
            own = tcp.mac(doubt.side)
            if own and doubt.sender and doubt.sender != own:
                detail += f"; sent by {doubt.sender.hex(':')}, but {tcp.ends[doubt.side].host} has {own.hex(':')}"
            counters.note_of("stream.reset_ignored", [int(doubt.frame)], doubt.time_ns, detail, side.connection.number)


def note_quiet(side: Side, flags: i64) -> None:
    """At a FIN or RST, perhaps after idle time, report octets as missing that were acknowledged but not captured by then."""
    peer = side.peer
    if peer is None or not flags & (FIN | RST):
        return
    for end in (side, peer):
        if end.unseen > 0 and end.stream.shown == 0:
            end.stream.shown = end.unseen
            end.stream.gap_ns = end.tcp.last_ns


def note_unseen(counters: Counters, side: Side, peer: Side) -> bool:
    """Report as a gap what a side of a finished connection sent but the capture lacks; return whether there is a gap.

    Such octets were acknowledged by the other side, or precede a FIN or RST of the side that still counts (`look`).
    """
    if not side.connection.followed or not (side.unseen or peer.unseen or side.tcp.doubt is not None):
        return False
    look(counters, side)
    for end in (side, peer):
        missing: i64 = _unseen(end)
        if missing > 0 and end.stream.next_seq >= 0:
            shown_ns: i64 = end.stream.gap_ns if missing <= end.stream.shown else end.tcp.last_ns
            end.stream.skip(missing, end.tcp.last_frame, end.tcp.last_ns)
            end.stream.gap_ns = shown_ns
    return bool(side.stream.ready or peer.stream.ready)


def _unseen(side: Side) -> i64:
    missing: i64 = side.unseen
    peer = side.peer
    if missing > 0 and side.fin_seq >= 0 and peer is not None and peer.acked == (side.fin_seq + 1) & MASK:
        missing -= 1  # the number of its FIN
    doubt = side.tcp.doubt
    asked: bool = side.connection.open_requests[1 - side.index].count > 0
    if doubt is not None and asked and doubt.side == side.index and side.is_ahead(doubt.seq):
        missing = max(missing, (doubt.seq - side.end_seq) & MASK)
    return missing


def finish(counters: Counters, table: ConnectionTable, side: Side, peer: Side) -> None:
    """Decide about a doubtful end and unconfirmed SYNs of a finished connection whose octets were all passed on."""
    if side.tcp.doubt is not None:
        look(counters, side)
        side.tcp.doubt = None
    _drop(counters, table, side)
    _drop(counters, table, peer)


# ---- SYN ------------------------------------------------------------------------------------------------------------


def judge(
    counters: Counters, table: ConnectionTable, side: Side, seq: i64, ack: i64, flags: i64, data: bool, link: bytes
) -> i64:
    """Return whether a SYN or RST that ``side`` sent is of its connection: SAME, ANOTHER or HELD_BACK.

    With ``data`` it carries octets; ``link`` is as in `take`.
    """
    if flags & SYN:
        if not side.tcp.is_new_connection(side.index, seq):
            return SAME
        if data or (side.tcp.ended and side.tcp.doubt is None):
            return ANOTHER
        return _hold_back(counters, table, side, seq, ack, flags, link)
    peer = side.peer
    rival = peer.rival if peer is not None else None
    if rival is not None and flags & ACK and rival.seq == ack:
        return ANOTHER  # it answers the SYN: its sender does not know the connection that was here
    return SAME


def _hold_back(
    counters: Counters, table: ConnectionTable, side: Side, seq: i64, ack: i64, flags: i64, link: bytes
) -> i64:
    """Keep a SYN with a new sequence number on an open connection as the `Rival` of ``side`` until it is confirmed."""
    peer = side.peer
    assert peer is not None
    rival = side.rival
    if flags & ACK:
        rival = peer.rival
        return HELD_BACK if rival is not None and rival.seq != ack else ANOTHER
    if rival is not None and _went_on(side, peer, rival):
        _drop(counters, table, side)
        rival = None
    if rival is None or rival.seq != (seq + 1) & MASK:
        octets: i64 = side.stream.octets
        sent: i64 = peer.stream.octets
        side.rival = Rival(side.tcp, (seq + 1) & MASK, octets, sent, counters.frames, counters.now_ns)
    attempts.note_syn(counters, table, side.key, seq, link)
    return HELD_BACK


def follows(side: Side, peer: Side, seq: i64) -> bool:
    """Return whether data of ``side`` from ``seq`` on belong to the connection that an unconfirmed SYN begins."""
    far: bool = side.stream.next_seq < 0 or not -WINDOW <= side.stream.distance(seq) <= WINDOW
    rival = side.rival
    if rival is not None and (seq == rival.seq or (far and (seq - rival.seq) & MASK <= WINDOW)):
        return not _went_on(side, peer, rival)
    rival = peer.rival
    if rival is None or not far or side.last_ack < 0 or (side.last_ack - rival.seq) & MASK > WINDOW:
        return False
    return not _went_on(peer, side, rival)


def give_way(counters: Counters, side: Side) -> None:
    """Another connection replaces this one, which is over."""
    tcp = side.tcp
    frame: i64 = counters.frames
    time_ns: i64 = counters.now_ns
    for end in (side, side.peer):
        rival = end.rival if end is not None else None
        if end is not None and rival is not None:
            frame = rival.frame
            time_ns = rival.time_ns
            end.rival = None
            if tcp.ended_frame < frame and _silent(end, rival):
                tcp.last_frame = rival.last_frame  # packets since then are of the new connection
                tcp.last_ns = rival.last_ns
    look(counters, side)
    if not tcp.ended:
        tcp.ended = "reused"
        tcp.ended_frame = frame
        tcp.ended_ns = time_ns
        if side.connection.followed:
            counters.note_of("stream.reused", [int(frame)], time_ns, "", side.connection.number)


def _silent(side: Side, rival: Rival) -> bool:
    """Return whether neither side sent octets since the SYN."""
    peer = side.peer
    return peer is not None and side.stream.octets == rival.octets and peer.stream.octets == rival.answered


def _went_on(side: Side, peer: Side, rival: Rival) -> bool:
    """Return whether both sides sent octets since the SYN; the other side alone may have done so before it got the SYN."""
    return side.stream.octets != rival.octets and peer.stream.octets != rival.answered


def _drop(counters: Counters, table: ConnectionTable, side: Side) -> None:
    """Forget the unconfirmed SYN of ``side``; report that it was ignored if the connection continued."""
    rival = side.rival
    peer = side.peer
    if rival is None or peer is None:
        return
    side.rival = None
    if not _went_on(side, peer, rival):
        return
    table.forget_syn(side.key)
    if side.connection.followed:
        detail = f"SYN from {side.tcp.ends[side.index]}, with other numbers: the connection went on"
        counters.note_of("stream.reset_ignored", [int(rival.frame)], rival.time_ns, detail, side.connection.number)
