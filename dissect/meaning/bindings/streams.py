"""Splits a bound TCP stream into messages, by the size in the envelope or that of a bare content (reference 3.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from dissect.engine.transactions.payloads import Backlog

if TYPE_CHECKING:
    from dissect.engine.transactions.side import Side
    from dissect.meaning.bindings.binding import Binding
    from dissect.scd.envelope import Envelope

#: Maximum number of possible beginnings of incomplete messages that are kept during a search.
MAX_PENDING: Final = 64


def cut_stream(side: Side, envelope: Envelope, binding: Binding, octets: bytes) -> tuple[list[bytes], int]:
    """Return the messages that ``octets`` complete, and how many octets were skipped to find them.

    The rest, less than a message, waits in the state of the side (`Backlog`). If the beginning of a message is unknown (the
    capture begins in the middle, octets are missing, or something else is in the stream), the next message is searched for; it
    counts if its checksum is right.
    """
    backlog = side.kept
    assert isinstance(backlog, Backlog)
    buffer = backlog.octets + octets
    if binding.size:
        units, at, skipped = _cut_equal(backlog, binding.size, buffer)
    else:
        units, at, skipped = _cut_messages(side, backlog, envelope, buffer)
        backlog.scan = max(backlog.scan - at, 0)
        backlog.pending = [(begin - at, size) for begin, size in backlog.pending]
    backlog.octets = buffer[at:]
    backlog.framed += sum([len(unit) for unit in units])
    backlog.skipped += skipped
    return units, skipped


def skip_hole(side: Side, binding: Binding, size: int) -> int:
    """Octets are missing: drop the unfinished message, and return how many octets of it there were.

    Contents of a fixed size continue where the next one begins; messages have to be searched for.
    """
    backlog = side.kept
    assert isinstance(backlog, Backlog)
    lost = len(backlog.octets)
    if binding.size:
        rest = backlog.owed or -lost % binding.size
        backlog.owed = (rest - size) % binding.size
    side.framer.synced = False
    backlog.skipped += lost
    backlog.octets = b""
    backlog.scan = 0
    backlog.pending = []
    return lost


def _cut_equal(backlog: Backlog, size: int, buffer: bytes) -> tuple[list[bytes], int, int]:
    """Return contents of a fixed size, where the rest of ``buffer`` begins, and how many octets precede the first content."""
    owed = min(int(backlog.owed), len(buffer))
    backlog.owed -= owed
    end = len(buffer) - (len(buffer) - owed) % size
    return [buffer[at : at + size] for at in range(owed, end, size)], end, owed


def _cut_messages(side: Side, backlog: Backlog, envelope: Envelope, buffer: bytes) -> tuple[list[bytes], int, int]:
    """Return messages, where the rest of ``buffer`` begins, and how many octets were skipped."""
    units: list[bytes] = []
    at = skipped = 0
    while at < len(buffer):
        if not side.framer.synced:
            found = _search(backlog, envelope, buffer)
            begin = found
            if found < 0:
                begin = backlog.pending[0][0] if backlog.pending else int(backlog.scan)
            skipped += begin - at
            at = begin
            if found < 0:
                break
            side.framer.synced = True
            backlog.pending = []
        size, error = envelope.frame(buffer, at)
        if error is not None:
            side.framer.synced = False
            backlog.scan = at + 1
            continue
        if not size or at + size > len(buffer):
            if not (envelope.has_crc and envelope.opening):
                break
            # Its size may be wrong: a valid message that begins inside it is taken first.
            inside, backlog.scan = _find_right(envelope, buffer, max(at + 1, int(backlog.scan)), len(buffer))
            if inside < 0:
                break
            skipped += inside - at
            at = inside
            continue
        if envelope.has_crc and not _is_message(envelope, buffer[at : at + size]):
            # Its size may be as wrong as its checksum: a valid message that begins inside it ends it.
            inside, _ = _find_right(envelope, buffer, at + 1, at + size)
            size = inside - at if inside >= 0 else size
            side.framer.synced = False
            backlog.scan = at + size
        units.append(buffer[at : at + size])
        at += size
    return units, at, skipped


def _find_right(envelope: Envelope, buffer: bytes, at: int, stop: int) -> tuple[int, int]:
    """Return where the first valid message begins before ``stop`` (-1 if none does), and the first undecided place."""
    begin = _next(envelope, buffer, at)
    settled = -1
    looked = 0
    while begin < stop and looked < MAX_PENDING:
        size, error = envelope.frame(buffer, begin)
        if error is None and (not size or begin + size > len(buffer)):
            settled = begin if settled < 0 else settled
        elif error is None:
            if _is_message(envelope, buffer[begin : begin + size]):
                return begin, begin
        looked += error is None
        begin = _next(envelope, buffer, begin + 1)
    return -1, begin if settled < 0 else settled


def _search(backlog: Backlog, envelope: Envelope, buffer: bytes) -> int:
    """Return where the first complete message begins, -1 for none; then ``scan`` and ``pending`` say where to continue.

    An incomplete message does not hide those after it, because its size may be wrong. Without a checksum they cannot be told
    apart, so the search waits for the first one.
    """
    pending = []
    for begin, size in backlog.pending:
        if begin + size > len(buffer):
            pending.append((begin, size))
        elif _is_message(envelope, buffer[begin : begin + size]):
            return begin
    most = MAX_PENDING if envelope.has_crc else 1
    begin = _next(envelope, buffer, int(backlog.scan))
    while begin < len(buffer) and len(pending) < most:
        size, error = envelope.frame(buffer, begin)
        if error is None:
            if not size:
                break  # even its head is incomplete
            if begin + size > len(buffer):
                pending.append((begin, size))
            elif _is_message(envelope, buffer[begin : begin + size]):
                return begin
        begin = _next(envelope, buffer, begin + 1)
    backlog.scan = begin
    backlog.pending = pending
    return -1


def _is_message(envelope: Envelope, unit: bytes) -> bool:
    return envelope.parse(unit).error is None


def _next(envelope: Envelope, buffer: bytes, at: int) -> int:
    """Return where a message may begin at or after ``at``; the end of the buffer if nowhere."""
    opening = envelope.opening
    if not opening:
        return at
    found = buffer.find(opening, at)
    if found >= 0:
        return found
    for size in range(min(len(opening) - 1, len(buffer) - at), 0, -1):
        if buffer.endswith(opening[:size]):
            return len(buffer) - size
    return max(at, len(buffer))
