"""A bound TCP stream cut into messages: by the size that the envelope tells, or by that of a bare content (reference 3.3)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from dissect.scd.errors import E_CRC

if TYPE_CHECKING:
    from dissect.bindings.binding import Binding
    from dissect.scd.envelope import Envelope
    from dissect.transactions.table import Side


def cut_stream(side: Side, envelope: Envelope, binding: Binding, octets: bytes) -> tuple[list[bytes], int]:
    """Return the whole messages that ``octets`` complete, and how many octets were stepped over to find them.

    What is left waits in the side's backlog, less than a message. Where the begin of a message is not known (the capture
    begins in the middle, octets are missing, or something else is in the stream) the next one is searched for, and believed
    when its checksum is right.
    """
    backlog = side.backlog
    assert backlog is not None
    buffer = backlog.octets + octets
    units: list[bytes] = []
    at = skipped = 0
    while at < len(buffer):
        size = binding.size
        if not size:
            size, error = envelope.frame(buffer, at)
            if error is not None:
                step = _next(envelope, buffer, at + 1) - at
                side.framer.synced = False
                skipped += step
                at += step
                continue
            if not size:
                break  # not even its head is there
        if at + size > len(buffer):
            break
        unit = buffer[at : at + size]
        if not binding.size and not side.framer.synced and not _is_message(envelope, unit):
            step = _next(envelope, buffer, at + 1) - at
            skipped += step
            at += step
            continue
        side.framer.synced = True
        units.append(unit)
        backlog.framed += size
        at += size
    backlog.octets = buffer[at:]
    backlog.skipped += skipped
    return units, skipped


def _is_message(envelope: Envelope, unit: bytes) -> bool:
    error = envelope.parse(unit).error
    return error is None or error.code != E_CRC


def _next(envelope: Envelope, buffer: bytes, at: int) -> int:
    """Return where a message may begin, at ``at`` or later: the end of the buffer when nowhere."""
    if not envelope.opening:
        return at
    found = buffer.find(envelope.opening, at)
    return found if found >= 0 else len(buffer)
