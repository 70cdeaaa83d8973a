"""Writes usual values directly from their octets, without the value in between: as text, as JSON, as the cell of a table.

Each function returns False and writes nothing if the value needs the slow way: dates, most texts, octets that spell a text,
octets that do not match their type.
"""

from __future__ import annotations

from typing import Final

from librt.strings import BytesWriter
from mypy_extensions import i64

from dissect.meaning.report import words
from dissect.meaning.report.item_octets import NOT_FINITE, is_harmless
from dissect.output.variables.model import SharedValue
from dissect.protocols.s7.singles import write_real_repr
from dissect.protocols.s7.tables import BIT, CHAR, REAL
from dissect.protocols.s7.values import (
    LEAST_TEXT,
    number_size,
    spelled,
    time_size,
    write_number,
    write_numbers,
    write_time,
    write_times,
)
from dissect.wire.digits import write_decimal
from dissect.wire.octets import u16

_QUOTE: Final = 0x22
_APOSTROPHE: Final = 0x27
_OPEN: Final = 0x5B
_CLOSE: Final = 0x5D
_MORE: Final = ", … ".encode()
_LONG: Final = " … ".encode()


def write_hex(out: BytesWriter, octets: bytes) -> bool:
    """Write the result of `words.octets` for octets that spell no text."""
    size: i64 = len(octets)
    if size == 0 or (size >= LEAST_TEXT and spelled(octets)):
        return False
    if size <= words.SHOWN_OCTETS:
        out.write(octets.hex(" ").encode("ascii"))
        return True
    out.write(octets[: words.SHOWN_OCTETS].hex(" ").encode("ascii"))
    out.write(_LONG)
    write_decimal(out, size)
    out.write(b" bytes")
    return True


def write_shown(out: BytesWriter, told: SharedValue) -> bool:
    """Write the result of `words.value` for a value that is not decoded yet."""
    kind: i64 = told.coded
    octets = told.data
    if kind < 0 or octets is None:
        return False
    size: i64 = len(octets)
    if kind == BIT and size == 1:
        out.write(b"true" if octets[0] & 1 else b"false")
        return True
    if kind == CHAR:
        if size == 0 or size > words.SHOWN_TEXT or not is_harmless(octets, 0, size):
            return False
        out.append(_APOSTROPHE)
        out.write(octets)
        out.append(_APOSTROPHE)
        return True
    step = number_size(kind)
    if step == 0:
        step = time_size(kind)
    if step == 0 or size == 0 or size & (step - 1) or kind == BIT:
        return False
    if size == step:
        return _write_one(out, kind, octets, 0)
    begin = len(out)
    out.append(_OPEN)
    end: i64 = min(size, words.SHOWN * step)
    at: i64 = 0
    while at < end:
        if at:
            out.write(b", ")
        if not _write_one(out, kind, octets, at):
            out.truncate(begin)
            return False
        at += step
    if size > end:
        out.write(_MORE)
        write_decimal(out, size // step)
        out.write(b" in all")
    out.append(_CLOSE)
    return True


def _write_one(out: BytesWriter, kind: i64, octets: bytes, at: i64) -> bool:
    """Write a number as `str`, or a time between apostrophes; return False, after writing a part, if the time is not valid."""
    if kind == REAL:
        write_real_repr(out, octets, at)
    elif number_size(kind):
        write_number(out, kind, octets, at)
    else:
        out.append(_APOSTROPHE)
        if not write_time(out, time_size(kind), octets, at):
            out.truncate(len(out) - 1)
            return False
        out.append(_APOSTROPHE)
    return True


def write_json(out: BytesWriter, told: SharedValue) -> bool:
    """Write a value that is not decoded yet as JSON."""
    kind: i64 = told.coded
    octets = told.data
    if kind < 0 or octets is None:
        return False
    if kind == BIT:
        if len(octets) != 1:
            return False
        out.write(b"true" if octets[0] & 1 else b"false")
        return True
    size: i64 = len(octets)
    if kind == REAL:  # in the form of `repr`: transactions write large numbers with an exponent
        return size > 0 and size & 3 == 0 and _write_finite(out, kind, 4, octets, b",")
    return write_numbers(out, kind, octets, 0, size) or write_times(out, kind, octets, 0, size)


def write_cell(out: BytesWriter, told: SharedValue) -> bool:
    """Write the cell of a value that is not decoded yet, quoted if necessary."""
    kind: i64 = told.coded
    octets = told.data
    if kind < 0 or octets is None:
        return False
    size: i64 = len(octets)
    if kind == BIT and size == 1:
        out.write(b"true" if octets[0] & 1 else b"false")
        return True
    if kind == CHAR:
        if size == 0 or not is_harmless(octets, 0, size):
            return False
        out.write(octets)
        return True
    if kind != BIT and size and size == time_size(kind):
        begin = len(out)
        if not write_time(out, size, octets, 0):
            out.truncate(begin)
            return False
        return True
    step = number_size(kind)
    if step == 0 or size == 0 or size & (step - 1) or kind == BIT:
        return False
    begin = len(out)
    if size > step:
        out.append(_QUOTE)
    if not _write_finite(out, kind, step, octets, b", "):
        out.truncate(begin)
        return False
    if size > step:
        out.append(_QUOTE)
    return True


def _write_finite(out: BytesWriter, kind: i64, step: i64, octets: bytes, joint: bytes) -> bool:
    """Write a number, or several in brackets with ``joint`` between them; False, with nothing written, if one is not finite."""
    begin = len(out)
    size: i64 = len(octets)
    if size > step:
        out.append(_OPEN)
    at: i64 = 0
    while at < size:
        if at:
            out.write(joint)
        if kind != REAL:
            write_number(out, kind, octets, at)
        elif u16(octets, at) & NOT_FINITE == NOT_FINITE:
            out.truncate(begin)
            return False
        else:
            write_real_repr(out, octets, at)
        at += step
    if size > step:
        out.append(_CLOSE)
    return True
