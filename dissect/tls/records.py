"""The record layer: octets of one direction to whole TLS records, however they are cut into messages (RFC 8446 section 5.1)."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.octets import u16

HEADER: Final = 5
#: The largest body a record may have: TLS 1.2 allows 2048 octets beside the 2**14 of its content, TLS 1.3 256.
MAX_BODY: Final = (1 << 14) + 2048


def begins_record(octets: bytes, at: i64, end: i64) -> bool:
    """Tell whether a record may begin at ``at``: type, version and length, as far as they are there, are those of one."""
    if at >= end or octets[at] < 0x14 or octets[at] > 0x18:
        return False
    if end - at >= 2 and octets[at + 1] != 3:
        return False
    if end - at >= 3 and octets[at + 2] > 4:
        return False
    return end - at < HEADER or 0 < u16(octets, at + 3) <= MAX_BODY


class RecordReader:
    """Cuts one direction into records. What is kept of an unfinished one is never more than a record.

    ``skipped`` counts octets that are in no record. After a gap (`lose`) the next message has to begin with a record.
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
        """Take the next octets; return the records they complete, headers included.

        Where no record begins the rest of ``octets`` is skipped: the next message may begin with one.
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
        """Octets are missing: what was begun has no end."""
        self.skipped += len(self._rest)
        self._rest = b""
