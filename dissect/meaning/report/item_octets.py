"""Writes the values of items, in the form of CSV and of text lines, directly into the buffer of the row.

This is the fast path for usual values. Its functions return 0 or False for all other data, which the caller then writes in the
slow way: dates, most texts, octets that spell a text, and data that do not match their item.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.words import Places
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.singles import write_real_repr
from dissect.protocols.s7.tables import BIT, CHAR, REAL
from dissect.protocols.s7.values import LEAST_TEXT, number_size, spelled, time_size, write_number, write_time
from dissect.wire.octets import u16

_BLANK: Final = 0x20
_OPEN: Final = 0x5B
_CLOSE: Final = 0x5D
#: The exponent bits in the first two octets of a REAL; all of them are set in infinities and NaN.
NOT_FINITE: Final = 0x7F80
_ANYWHERE: Final = 2
_BEHIND: Final = 1
#: By octet: where a character needs neither escape nor quotes in any output: `_ANYWHERE`, only `_BEHIND` other characters
#: (characters that begin a formula in a spreadsheet), or nowhere (0).
_HARMLESS: Final = bytes(
    [
        0 if not " " <= chr(code) <= "~" or chr(code) in '",;' else _BEHIND if chr(code) in "=+-@" else _ANYWHERE
        for code in range(256)
    ]
)


def is_usual(transaction: Transaction, places: Places) -> bool:
    """Return whether a read without an error is an ordinary one, in one file, with both packets captured."""
    return (
        transaction._carried is None
        and not transaction.reason
        and transaction.request_frame != 0
        and transaction.response_frame != 0
        and not places.several
        and len(transaction.parameters.items) > 0
    )


def step_of(item: Item, octets: bytes, at: i64, size: i64) -> i64:
    """Return the size of an element of ``octets[at:at + size]``; 0 if `write_elements` cannot write them."""
    kind: i64 = item.transport_size
    step: i64 = 1
    if kind != BIT:  # a conditional expression would create int objects (mypyc)
        step = number_size(kind)
    if step == 0 or size == 0 or size & (step - 1) or (item.size != size and not item.fits(size)):
        return 0
    if step == 1 and size > 1 and (kind == BIT or (size >= LEAST_TEXT and spelled(octets[at : at + size]))):
        return 0
    return step


def write_elements(out: BytesWriter, kind: i64, step: i64, octets: bytes, at: i64, end: i64, finite: bool) -> bool:
    """Write elements of ``step`` octets: a bit as a word, several bytes as `bytes.hex`, numbers as `repr` does.

    Return False if ``finite`` requires finite numbers and a REAL is not finite; some elements may have been written then.
    """
    if kind == BIT:
        out.write(b"true" if octets[at] & 1 else b"false")
        return True
    if step == 1 and end - at > 1:
        out.write(octets[at:end].hex(" ").encode("ascii"))
        return True
    begin: i64 = at
    while at < end:
        if at > begin:
            out.write(b", ")
        if kind != REAL:
            write_number(out, kind, octets, at)
        elif finite and u16(octets, at) & NOT_FINITE == NOT_FINITE:
            return False
        else:
            write_real_repr(out, octets, at)
        at += step
    return True


def write_word(out: BytesWriter, item: Item, octets: bytes, at: i64, size: i64, quote: bytes, most: i64) -> bool:
    """Write a time, or up to ``most`` harmless characters, between ``quote`` and ``quote``.

    Return False and write nothing for anything else.
    """
    if size == 0 or (item.size != size and not item.fits(size)):
        return False
    begin = len(out)
    if item.transport_size == CHAR:
        if size > most:
            return False
        if not is_harmless(octets, at, at + size):
            return False
        out.write(quote)
        out.write(octets[at : at + size])
    else:
        if time_size(item.transport_size) != size:
            return False
        out.write(quote)
        if not write_time(out, size, octets, at):
            out.truncate(begin)
            return False
    out.write(quote)
    return True


def write_times(out: BytesWriter, item: Item, octets: bytes, at: i64, size: i64, quote: bytes, none: bytes) -> bool:
    """Write an array of times, each between ``quote`` and ``quote``, and ``none`` for an element that is not a valid time.

    Return False and write nothing for anything else.
    """
    step = time_size(item.transport_size)
    if step == 0 or size <= step or size & (step - 1) or (item.size != size and not item.fits(size)):
        return False
    out.append(_OPEN)
    end: i64 = at + size
    while at < end:
        begin = len(out)
        out.write(quote)
        if write_time(out, step, octets, at):
            out.write(quote)
        else:
            out.truncate(begin)
            out.write(none)
        at += step
        if at < end:
            out.write(b", ")
    out.append(_CLOSE)
    return True


def is_harmless(octets: bytes, at: i64, end: i64) -> bool:
    """Return whether no character needs an escape or quotes in its place; leading blanks do not disarm a formula."""
    least: i64 = _ANYWHERE
    while at < end:
        octet: i64 = octets[at]
        if _HARMLESS[octet] < least:
            return False
        if octet != _BLANK:
            least = _BEHIND
        at += 1
    return True
