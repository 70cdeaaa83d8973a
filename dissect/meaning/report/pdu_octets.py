"""Lines of text for usual PDUs, reads and answers without an error, written as octets without an object for the PDU."""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.transactions.side import Side
from dissect.meaning.report import words
from dissect.meaning.report.line_octets import ERRORS, BothEnds
from dissect.meaning.report.words import Places
from dissect.protocols.s7.items import DATA_HEAD, data_size_within, item_fill
from dissect.protocols.s7.parameters import ACK_HEADER_SIZE, HEADER_SIZE
from dissect.protocols.s7.tables import ACK_DATA, FUNCTIONS, JOB, READ_VAR, ROSCTR, SUCCESS, WRITE_VAR
from dissect.wire.digits import Moments, write_aligned, write_hexadecimal
from dissect.wire.octets import u16
from dissect.wire.text import Clock

#: Minimum width of the name of a kind of PDU in a line.
KIND_WIDTH: Final = 8
_FRAME_WIDTH: Final = 6
#: The beginning of a regular DT header, after the four octets of its TPKT (`dissect.meaning.report.headers.irregular`).
_PLAIN_LENGTH: Final = 2
_PLAIN_DT: Final = 0xF0
#: When the known requests have this many octets, they make room for others.
_MAX_KEPT: Final = 4 << 20


def _kind(rosctr: int) -> bytes:
    """Return the text in a line between the ends of a connection and the reference."""
    return f"{ROSCTR.name(rosctr).ljust(KIND_WIDTH)}  ref 0x".encode("ascii")


_ASKS: Final = _kind(JOB)
_ANSWERS: Final = _kind(ACK_DATA)


def _good(function: int, count: int) -> bytes:
    """Return the end of the line of an answer with this many good items."""
    said = f"{words.count(count, 'item')}, {'all good' if count > 1 else 'good'}"
    return f"  {FUNCTIONS.name(function)}  {said}".encode("ascii")


#: By the number of items.
_GOOD_READS: Final = [_good(READ_VAR, count) for count in range(256)]
_GOOD_WRITES: Final = [_good(WRITE_VAR, count) for count in range(256)]


class PduOctets:
    """Makes the lines of PDUs in one buffer. ``asks``: the latest PDU is a read request whose line `keep` will remember."""

    def __init__(self, clock: Clock, places: Places) -> None:
        self.asks: bool = False
        self._places: Places = places
        self._moments: Moments = Moments(clock)
        self._ends: BothEnds = BothEnds(places)
        self._out: BytesWriter = BytesWriter()
        self._asked: dict[bytes, bytes] = {}  # by parameter block: the end of the line
        self._kept: i64 = 0

    def of(self, frame: i64, time_ns: i64, side: Side, octets: bytes, carrying: bytes) -> bytes:
        """Return the line of a PDU that was captured whole, in the TPKT ``carrying``; empty for one that is not usual."""
        self.asks = False
        if self._places.several or len(carrying) < 7 or len(octets) < HEADER_SIZE + 2:
            return b""
        if carrying[4] != _PLAIN_LENGTH or carrying[5] != _PLAIN_DT:
            return b""
        kind: i64 = octets[1]
        if kind == ACK_DATA:
            end = _answer_end(octets)
            begin = _ANSWERS
        elif kind == JOB and side.connection.naming is None and _is_read(octets):
            self.asks = True
            known = self._asked.get(octets[HEADER_SIZE:])
            end = known if known is not None else b""
            begin = _ASKS
        else:
            return b""
        if len(end) == 0:
            return b""
        out = self._out
        out.truncate(0)
        write_aligned(out, frame, _FRAME_WIDTH)
        out.write(b"  ")
        self._moments.write(out, time_ns)
        out.write(b"  ")
        out.write(self._ends.of(side.connection, side.index))
        out.write(begin)
        write_hexadecimal(out, octets, 4, 6)
        out.write(end)
        return out.getvalue()

    def keep(self, octets: bytes, rest: str) -> None:
        """Remember the text after the reference in the line of a read request."""
        end = rest.encode("utf-8", ERRORS)
        self._kept += len(octets) + len(end)
        if self._kept > _MAX_KEPT:
            self._asked.clear()
            self._kept = len(octets) + len(end)
        self._asked[octets[HEADER_SIZE:]] = end


def _is_read(octets: bytes) -> bool:
    """Return whether a job is a read request that has only a parameter block: its line shows nothing else."""
    return octets[HEADER_SIZE] == READ_VAR and u16(octets, 8) == 0 and HEADER_SIZE + u16(octets, 6) == len(octets)


def _answer_end(octets: bytes) -> bytes:
    """Return the end of the line of an answer without errors; empty for any other."""
    size: i64 = len(octets)
    at: i64 = ACK_HEADER_SIZE + 2
    if size < at or u16(octets, 6) != 2 or at + u16(octets, 8) != size or u16(octets, 10):
        return b""
    function: i64 = octets[ACK_HEADER_SIZE]
    count: i64 = octets[ACK_HEADER_SIZE + 1]
    if function == READ_VAR:
        return _GOOD_READS[count] if _are_good(octets, at, size, count) else b""
    if function != WRITE_VAR or count == 0 or size - at != count:
        return b""
    while at < size:
        if octets[at] != SUCCESS:
            return b""
        at += 1
    return _GOOD_WRITES[count]


def _are_good(octets: bytes, at: i64, end: i64, count: i64) -> bool:
    """Return whether this many data items without an error fill the data block, as `parse_data_items` reads them."""
    size: i64 = 0
    left: i64 = count
    while left:
        left -= 1
        body: i64 = at + DATA_HEAD
        if body > end or octets[at] != SUCCESS:
            return False
        size = data_size_within(octets[at + 1], u16(octets, at + 2), end - body)
        if body + size > end:
            return False
        at = body + size + item_fill(size, left == 0)
    return count > 0 and (at == end or (end - at == 1 and size & 1 == 1))
