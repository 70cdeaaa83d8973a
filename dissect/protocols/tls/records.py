"""The record layer: splits the octets of one direction into TLS records (RFC 8446 section 5.1)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.copies import leaves
from dissect.wire.octets import u16

HEADER: Final = 5
#: Size of the largest body of a record: 2**14 of content, and up to 2048 more in TLS 1.2 (256 in TLS 1.3).
MAX_BODY: Final = (1 << 14) + 2048


def begins_record(octets: bytes, at: i64, end: i64) -> bool:
    """Return whether a record may begin at ``at``: those of type, version and length that are present are valid."""
    if at >= end or octets[at] < 0x14 or octets[at] > 0x18:
        return False
    if end - at >= 2 and octets[at + 1] != 3:
        return False
    if end - at >= 3 and octets[at + 2] > 4:
        return False
    return end - at < HEADER or 0 < u16(octets, at + 3) <= MAX_BODY


class RecordReader:
    """Splits one direction into records. At most one unfinished record is kept.

    ``skipped`` counts octets outside of records. After a gap (`lose`), the next message has to begin with a record.
    """

    __slots__ = ("_rest", "skipped")

    def __init__(self) -> None:
        self._rest: bytes = b""
        self.skipped: i64 = 0

    @property
    def held(self) -> int:
        """Octets of an unfinished record."""
        return len(self._rest)

    def push(self, octets: bytes) -> list[bytes]:
        """Take the next octets; return the records that they complete, with their headers.

        If no record begins there, the rest of ``octets`` is skipped: the next message may begin with a record.
        """
        rest = self._rest
        if rest:
            octets = rest + octets
            self._rest = b""
        found: list[bytes] = []
        at: i64 = 0
        size: i64 = len(octets)
        while at < size:
            if not begins_record(octets, at, size):
                self.skipped += size - at
                return found
            if size - at < HEADER:
                break
            total: i64 = HEADER + u16(octets, at + 3)
            if size - at < total:
                break
            found.append(octets[at : at + total])
            at += total
        self._rest = octets[at:]
        return found

    def lose(self) -> None:
        """Octets are missing: drop the unfinished record."""
        self.skipped += len(self._rest)
        self._rest = b""


leaves(RecordReader)
