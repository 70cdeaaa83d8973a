"""Lines of text for reads without an error, written as UTF-8 octets without a str in between: the fast path."""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.good_items import GoodItems
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report import facets, words
from dissect.meaning.report.item_octets import is_usual, step_of, write_elements, write_word
from dissect.meaning.report.words import FRAMES_WIDTH, LATENCY_WIDTH, NUMBER_WIDTH, Places
from dissect.protocols.s7.items import Item
from dissect.wire.digits import Moments, write_decimal, write_digits
from dissect.wire.text import HUNDREDTHS, Clock, short_duration

#: How characters that UTF-8 cannot encode are written; the same for all outputs.
ERRORS: Final = "backslashreplace"
_ARROW: Final = "→".encode()
_GREATER_BY: Final = len(_ARROW) - 1  # number of octets of the arrow minus its number of characters
_MORE: Final = ", … ".encode()
_LONG: Final = " … ".encode()
_MICROSECONDS: Final = " µs".encode()
_BLANK: Final = 0x20
_POINT: Final = 0x2E
_OPEN: Final = 0x5B
_CLOSE: Final = 0x5D
#: With this many connections in it, the cache of their ends is emptied.
_MAX_CACHED: Final = 8192


class BothEnds:
    """Sender and receiver for lines, as octets, made once for each connection and direction."""

    __slots__ = ("_known", "_places")

    def __init__(self, places: Places) -> None:
        self._places: Places = places
        self._known: dict[int, bytes] = {}

    def of(self, connection: Connection, side: i64) -> bytes:
        """Return the end that sent, an arrow, and the other end."""
        key: i64 = connection.number * 2 + side
        found = self._known.get(key)
        if found is None:
            if len(self._known) >= _MAX_CACHED:
                self._known.clear()
            ends = connection.tcp.ends
            found = f"{self._places.end(ends[side])} → {self._places.end(ends[1 - side])}  ".encode("utf-8", ERRORS)
            self._known[key] = found
        return found


class LineOctets:
    """Makes the line of a transaction in one buffer, which is used again for the next line."""

    def __init__(self, clock: Clock, places: Places) -> None:
        self._places: Places = places
        self._moments: Moments = Moments(clock)
        self._ends: BothEnds = BothEnds(places)
        self._said: bytes = b""  # the name of the function between blanks; all lines are about reads
        self._out: BytesWriter = BytesWriter()
        self._step: GoodItems = GoodItems()

    def of(self, transaction: Transaction) -> bytes:
        """Return the line of an ordinary read without an error; empty for any other transaction."""
        if not self._step.begin(transaction) or not is_usual(transaction, self._places):
            return b""
        out = self._out
        out.truncate(0)
        self._moments.write(out, transaction.request_ns)
        out.write(b"  #")
        begin = len(out)
        write_decimal(out, transaction.number)
        _fill(out, begin, NUMBER_WIDTH)
        out.append(_BLANK)
        begin = len(out)
        write_decimal(out, transaction.request_frame)
        out.write(_ARROW)
        write_decimal(out, transaction.response_frame)
        _fill(out, begin, FRAMES_WIDTH + _GREATER_BY)
        out.append(_BLANK)
        out.write(self._ends.of(transaction.connection, transaction.asked_by))
        _write_latency(out, transaction.response_ns - transaction.request_ns)
        if len(self._said) == 0:
            self._said = f"  {transaction.function_name}  ".encode()
        out.write(self._said)
        items = transaction.parameters.items
        step = self._step
        while step.step():
            if step.index:
                out.write(b", ")
            item = items[step.index]
            if len(item.line) == 0:  # quicker than the truth of bytes (mypyc)
                item.line = f"{facets.address(item)} = ".encode("utf-8", ERRORS)
            out.write(item.line)
            if not _write_content(out, item, step.buf, step.at, step.size):
                out.write(facets.content(item, step.buf[step.at : step.at + step.size]).encode("utf-8", ERRORS))
        return out.getvalue() if step.whole else b""


def _write_latency(out: BytesWriter, ns: i64) -> None:
    """Write the result of `words.answer_time`, right-aligned in a column of `LATENCY_WIDTH`."""
    short: i64 = short_duration(ns)
    if short >= HUNDREDTHS:
        short -= HUNDREDTHS
        if short < 1000:
            out.append(_BLANK)
        write_decimal(out, short // 100)
        out.append(_POINT)
        write_digits(out, short % 100, 2)
        out.write(b" ms")
    elif short:
        out.write(b"   " if short < 100 else b"  ")
        write_decimal(out, short)
        out.write(_MICROSECONDS)
    else:
        out.write(words.answer_time(int(ns)).rjust(LATENCY_WIDTH).encode())


def _fill(out: BytesWriter, begin: i64, width: i64) -> None:
    """Append blanks until ``width`` octets were written since ``begin``."""
    missing: i64 = width - (len(out) - begin)
    while missing > 0:
        out.append(_BLANK)
        missing -= 1


def _write_content(out: BytesWriter, item: Item, octets: bytes, at: i64, size: i64) -> bool:
    """Write the result of `facets.content`, without a str in between; return False and write nothing if it cannot."""
    step = step_of(item, octets, at, size)
    if step == 0:
        return write_word(out, item, octets, at, size, b"'", words.SHOWN_TEXT)
    most: i64 = words.SHOWN_OCTETS if step == 1 else words.SHOWN * step
    several = size > step > 1
    if several:
        out.append(_OPEN)
    write_elements(out, item.transport_size, step, octets, at, at + (min(size, most)), False)
    if size > most:
        out.write(_MORE if several else _LONG)
        write_decimal(out, size // step)
        out.write(b" in all" if several else b" bytes")
    if several:
        out.append(_CLOSE)
    return True
