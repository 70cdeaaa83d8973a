"""Positions of the numbers in rows that count over all files: the task that makes the rows finds them for the recipient.

A search for marked numbers in rows (`dissect.files.jobs.numbers`) takes a third of the time that it takes to make the rows. In
some formats, a line names its transaction and its connection once, next to each other
(`dissect.meaning.report.writer.Writer.joint`). There the position in the previous line is tried first, and the recipient copies
everything in between unread.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter, read_i64_be, read_i64_le, write_i64_le
from mypy_extensions import i64

from dissect.wire.digits import write_decimal

#: Digits of a mark, and of the number after it; the first eight of a mark are compared at once.
_MARK: Final = 9
_DIGITS: Final = 9
_WHOLE: Final = _MARK + _DIGITS
_ZERO: Final = 0x30
#: Size of a spot in an index: the octets of rows before it, the octets after the last one, transaction, connection.
_SPOT: Final = 24


class _Mark:
    """Finds marked numbers of one kind, once in a line."""

    def __init__(self, mark: bytes) -> None:
        self._mark: bytes = mark
        self._begin: i64 = read_i64_be(mark, 0)
        self._last: i64 = mark[_MARK - 1]
        self._hint: i64 = 0

    def is_at(self, octets: bytes, at: i64, end: i64) -> bool:
        """Return whether there is a marked number at this position."""
        return at + _WHOLE <= end and read_i64_be(octets, at) == self._begin and octets[at + _MARK - 1] == self._last

    def find(self, octets: bytes, start: i64, end: i64) -> i64:
        """Return the position of the marked number of a line, -1 for none."""
        if self.is_at(octets, start + self._hint, end):
            return start + self._hint
        at: i64 = octets.find(self._mark, start, end)
        if at < 0 or at + _WHOLE > end:
            return -1
        self._hint = at - start
        return at


def _number(octets: bytes, at: i64) -> i64:
    """Return the number after a mark."""
    number: i64 = 0
    for place in range(at + _MARK, at + _WHOLE):
        number = number * 10 + i64(octets[place]) - _ZERO
    return number


class Spots:
    """Finds the spots of rows: a marked number of a transaction, ``joint``, and one of a connection; or only the last.

    ``transaction`` and ``connection`` are marks.
    """

    def __init__(self, transaction: bytes, connection: bytes, joint: bytes) -> None:
        self._transaction: _Mark = _Mark(transaction)
        self._connection: _Mark = _Mark(connection)
        self._joint: bytes = joint

    def index(self, octets: bytes, lengths: list[int]) -> bytes:
        """Return the spots of rows, 24 octets each; ``lengths`` are those of the lines, without line feeds."""
        out = BytesWriter()
        start: i64 = 0
        passed: i64 = 0
        joint: i64 = len(self._joint)
        for length in lengths:
            end: i64 = start + length
            at: i64 = -1
            number: i64 = 0
            if joint:
                at = self._transaction.find(octets, start, end)
            if at >= 0:
                number = _number(octets, at)
                second: i64 = at + _WHOLE + joint
                if not self._connection.is_at(octets, second, end):
                    second = -1
            else:
                second = at = self._connection.find(octets, start, end)
            if at >= 0:
                write_i64_le(out, at - passed)
                write_i64_le(out, number)
                write_i64_le(out, _number(octets, second) if second >= 0 else 0)
                passed = (at if second < 0 else second) + _WHOLE
            start = end + 1
        return out.getvalue()


def pieces(octets: bytes, index: bytes, transactions: i64, connections: i64, joint: bytes) -> list[bytes]:
    """Return rows with the numbers of the whole run, in pieces; ``transactions`` and ``connections`` count earlier ones."""
    made: list[bytes] = []
    out = BytesWriter()
    at: i64 = 0
    width: i64 = len(joint)
    spot: i64 = 0
    while spot < len(index):
        spot_at: i64 = at + read_i64_le(index, spot)
        transaction: i64 = read_i64_le(index, spot + 8)
        connection: i64 = read_i64_le(index, spot + 16)
        made.append(octets[at:spot_at])
        at = spot_at
        out.truncate(0)
        if transaction:
            write_decimal(out, transaction + transactions)
            at += _WHOLE
        if transaction and connection:
            out.write(joint)
            at += width
        if connection:
            write_decimal(out, connection + connections)
            at += _WHOLE
        made.append(out.getvalue())
        spot += _SPOT
    made.append(octets[at:])
    return made
