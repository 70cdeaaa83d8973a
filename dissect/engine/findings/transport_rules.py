"""Findings about TPKTs and TPDUs (reference 7.1).

They are about stray octets between TPKTs, the beginning of a connection, the connect confirm, and data after the end.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS
from dissect.engine.findings.reporter import Reporter
from dissect.engine.findings.ways import whole
from dissect.engine.transactions.connection import NO_LIMIT, Connection
from dissect.engine.transactions.ending import DISCONNECT, Ending
from dissect.engine.transactions.side import Side
from dissect.engine.transactions.stray import Stray
from dissect.protocols.iso.cotp import Tpdu
from dissect.protocols.iso.tables import CC, CR, DR, DT, ER, TPDU_TYPES
from dissect.protocols.iso.tpkt import BAD_VERSION, HIDING, VERSION
from dissect.protocols.iso.tsap import Tsap
from dissect.wire.text import count, duration_text

# Bits of `Connection.told` for what was judged or reported on side 0; shifted by one for side 1.
_BEGUN: Final = 1
_NUMBERED: Final = 4
_AFTER_END: Final = 16
#: Bits above those of other rules: a side sent a message larger than the TPDU size, in one TPDU or in several.
_LARGE: Final = 1024
#: The connect confirm has no TSAPs.
_BARE: Final = 4096

#: A longer stretch of stray octets is reported before it ends, because that may take days on a live network.
_LONG_STRAY: Final = 65536

#: The header of a DT of class 0, in octets.
DT_HEAD: Final = 3
#: The default TPDU size of a connect request (RFC 1006).
_LARGEST: Final = 65531


def judge_faults(reporter: Reporter, side: Side, frame: i64, time_ns: i64) -> None:
    """Report the faults of TPKT headers that the framer of ``side`` found; a stretch of stray octets may begin there."""
    number = side.connection.number
    who = side.tcp.ends[side.index]
    for fault in side.framer.faults:
        if fault.kind == HIDING:
            reporter.note("tpkt.false_length", number, [frame], time_ns, f"length {fault.value} from {who}")
            continue
        if fault.kind != BAD_VERSION:
            reporter.note("tpkt.bad_length", number, [frame], time_ns, f"length {fault.value} from {who}")
        stray = side.stray
        if stray is None or stray.framed != fault.framed:
            if stray is not None:  # one stretch ends and another begins in the same packet
                judge_stray(reporter, side, stray, fault.skipped, f"; decoding resumed in packet {frame}")
            first: i64 = fault.value if fault.kind == BAD_VERSION else VERSION
            stray = side.stray = Stray(first, fault.skipped, fault.framed, frame, time_ns)
        stray.garbage = stray.garbage or fault.kind == BAD_VERSION
    side.framer.faults = []


def judge_stray(reporter: Reporter, side: Side, stray: Stray, skipped: i64, how: str) -> None:
    """Report a stretch of stray octets.

    ``skipped`` counts all octets that the framer has skipped; ``how`` says how it continued.
    """
    if stray.garbage and not stray.told:
        stray.told = True
        who = side.tcp.ends[side.index]
        detail = f"{count(int(skipped - stray.skipped), 'byte')} from {who}, first 0x{stray.first:02x}{how}"
        reporter.note("tpkt.garbage", side.connection.number, stray.frames, stray.last_ns, detail)


def follow_stray(reporter: Reporter, side: Side, stray: Stray, frame: i64, time_ns: i64) -> None:
    """Follow a stretch of stray octets after a packet was read; report it if the framer found the next TPKT."""
    framer = side.framer
    skipped: i64 = framer.skipped
    if skipped != stray.seen:
        stray.seen = skipped
        stray.last_frame = frame
        stray.last_ns = time_ns
    if framer.synced:
        side.stray = None
        judge_stray(reporter, side, stray, skipped, f"; decoding resumed in packet {frame}")
    elif skipped - stray.skipped > _LONG_STRAY:
        judge_stray(reporter, side, stray, skipped, " so far")


def end_stray(reporter: Reporter, side: Side) -> None:
    """No more octets of ``side`` are read as TPKTs: its stretch of stray octets, if any, stays without an end."""
    stray = side.stray
    if stray is not None:
        side.stray = None
        judge_stray(reporter, side, stray, side.framer.skipped, "; decoding did not resume")


def judge_data(reporter: Reporter, side: Side, size: i64, frame: i64, time_ns: i64) -> bool:
    """Judge a DT longer than `Connection._dt_limit`: it is too long, or comes before the setup or after the end.

    Return whether it is longer than the TPDU size.
    """
    connection = side.connection
    large = 0 < connection.tpdu_size < size
    if large:
        connection._told |= _LARGE << side.index
        detail = f"{size} bytes, {connection.tpdu_size} negotiated"
        reporter.note("cotp.size_exceeded", connection.number, [frame], time_ns, detail)
    if connection._dt_limit > 0:
        return large
    judge_order(reporter, side, DT, frame, time_ns)
    if not _watched(connection):
        connection._dt_limit = connection.tpdu_size or NO_LIMIT
    return large


def note_large(side: Side, size: i64) -> None:
    """A side sent a message in several TPDUs, of ``size`` octets in all."""
    connection = side.connection
    if size > connection.tpdu_size - DT_HEAD > 0:
        connection._told |= _LARGE << side.index


def sent_large(connection: Connection, side: i64) -> bool:
    """Return whether a side sent a message that does not fit one TPDU of the negotiated size."""
    return connection._told & (_LARGE << side) != 0


def _watched(connection: Connection) -> bool:
    """Return whether the order of further TPDUs still needs a check."""
    if connection.iso_ended_how == DISCONNECT:
        return not connection._told & (_AFTER_END << connection.iso_ended_by)
    begun: i64 = 3 * _BEGUN
    return connection.tpdu_size == 0 and connection._told & begun != begun


def judge_order(reporter: Reporter, side: Side, type_: i64, frame: i64, time_ns: i64) -> None:
    """Judge the order of TPDUs: connect request, confirm or refusal, data, and nothing after a disconnect."""
    connection = side.connection
    ended: i64 = _AFTER_END << side.index
    if (
        connection.iso_ended_how == DISCONNECT
        and connection.iso_ended_by == side.index
        and not connection._told & ended
    ):
        connection._told |= ended
        name = TPDU_TYPES.name(type_)
        who = connection.tcp.ends[side.index]
        frames = [int(connection.iso_ended_frame), int(frame)]
        reporter.note("cotp.after_disconnect", connection.number, frames, time_ns, f"{name} from {who}")
    begun: i64 = _BEGUN << side.index
    if connection._told & begun:
        return
    connection._told |= begun
    peer = side.peer
    if not connection.tcp.known_start or peer is None or side.holes or side.framer.skipped:
        return
    if side.index == connection.tcp.initiator:
        if type_ != CR:
            name = TPDU_TYPES.name(type_)
            reporter.note(
                "cotp.bad_start", connection.number, [frame], time_ns, f"the first TPDU of the client is {name}"
            )
    elif connection.cr_seen and type_ != CC and type_ != DR and type_ != ER:
        detail = f"the first TPDU of the server is {TPDU_TYPES.name(type_)}, after a connect request"
        reporter.note("cotp.bad_start", connection.number, [frame], time_ns, detail)


def judge_number(reporter: Reporter, side: Side, number: i64, frame: i64, time_ns: i64) -> None:
    """Report a TPDU number other than 0, as class 0 has no numbers; once per side."""
    connection = side.connection
    told: i64 = _NUMBERED << side.index
    if not connection._told & told:
        connection._told |= told
        detail = f"TPDU number {number} from {connection.tcp.ends[side.index]}"
        reporter.note("cotp.tpdu_nr", connection.number, [frame], time_ns, detail)
    else:
        reporter.again("cotp.tpdu_nr", connection.number, frame, time_ns)


def note_early(reporter: Reporter, side: Side, frame: i64, time_ns: i64) -> None:
    """Take an empty DT that ``side`` sent while a request to it was open; report the first one of a server."""
    connection = side.connection
    traits = connection.traits
    traits.note_early(side.index, frame, time_ns)
    if side.index == connection.client_side or not reporter.first(connection, "cotp.empty_dt", frame, time_ns):
        return
    request = connection.open_requests[1 - side.index].asked_last()
    detail = f"from {connection.tcp.ends[side.index]}"
    frames = [int(frame)]
    if request is not None:
        frames.insert(0, int(request.request_frame))
        detail += f", {duration_text(int(time_ns - request.request_ns))} after {request.function_name}"
    reporter.note("cotp.empty_dt", connection.number, frames, time_ns, detail)


def judge_expedited(reporter: Reporter, side: Side, size: i64, frame: i64, time_ns: i64) -> None:
    """Report an ED with more user data than allowed; ``size`` is the number of octets in it."""
    detail = f"{size} bytes from {side.tcp.ends[side.index]}"
    reporter.note("cotp.expedited_too_long", side.connection.number, [frame], time_ns, detail)


def judge_confirm(reporter: Reporter, side: Side, tpdu: Tpdu, frame: i64, time_ns: i64) -> None:
    """Report a connect confirm that does not match its request: reference, class, TPDU size, TSAPs.

    Reference and class of a damaged request are -1.
    """
    connection = side.connection
    if not connection.cr_seen or tpdu.malformed or connection.client_side == side.index:
        return
    connection._told &= ~_BARE
    if tpdu.calling is None and tpdu.called is None and connection.tsap_called is not None:
        connection._told |= _BARE
    wrong: list[str] = []
    told: i64 = tpdu.field("dst_ref")
    if told != connection.cr_ref and connection.cr_ref >= 0:
        wrong.append(f"destination reference 0x{told:04x}, the request has 0x{connection.cr_ref:04x}")
    told = tpdu.field("class_")
    if told > connection.cr_class >= 0:
        wrong.append(f"class {told}, requested {connection.cr_class}")
    asked: i64 = connection.tpdu_size_asked or _LARGEST
    if tpdu.tpdu_size > asked:
        wrong.append(f"TPDU size {tpdu.tpdu_size}, requested {asked}")
    _compare(wrong, "calling", connection.tsap_calling, tpdu.calling)
    _compare(wrong, "called", connection.tsap_called, tpdu.called)
    if wrong:
        reporter.note("cotp.bad_confirm", connection.number, [frame], time_ns, "; ".join(wrong))


def judge_bare_confirm(reporter: Reporter, side: Side, ending: Ending) -> None:
    """Report a client that ends its connection right after a connect confirm without TSAPs."""
    connection = side.connection
    asking = side if side.index == connection.client_side else side.peer
    if not connection._told & _BARE or connection.pdus or connection.protocol or asking is None:
        return
    if ending.side == connection.client_side and whole(asking):
        said = f"{ending.deed(connection)}; the confirm of {connection.server} has no TSAPs"
        detail = said + KNOWN_BUGS["short_confirm"].note
        reporter.note("cotp.bare_confirm", connection.number, [int(ending.frame)], ending.time_ns, detail)


def _compare(wrong: list[str], name: str, asked: Tsap | None, told: bytes | None) -> None:
    if asked is not None and told is not None and asked.octets != told:
        wrong.append(f"{name} TSAP {Tsap(told)}, requested {asked}")
