"""Values of data items, decoded by the transport size of the request (reference 3.5, 3.6).

A value is a Python number, text or bool; several elements give a list. Octets that cannot be decoded (wrong size, a code that
is not BCD, a transport size without a known type) give None; nothing is guessed.
"""

from __future__ import annotations

import struct
from codecs import utf_16_be_decode
from typing import Final

from librt.strings import BytesWriter, read_i16_be, read_i32_be, read_i64_le
from mypy_extensions import i64

from dissect.protocols.s7.singles import real, real_json, real_repr, write_real_json
from dissect.protocols.s7.tables import BIT, BYTE, CHAR, DINT, DWORD, ELEMENT_OCTETS, INT, REAL, WCHAR, WORD
from dissect.wire.build import COMPILED
from dissect.wire.digits import MINUS, write_decimal, write_octets
from dissect.wire.octets import u16, u32
from dissect.wire.text import SHORT, THREE, TWO, civil, decimal

#: Decoded value of one item.
Value = bool | int | float | str | list["bool | int | float | str | None"] | None

_DOUBLE: Final = struct.Struct(">d")
MS_PER_DAY: Final = 86_400_000
#: Shorter texts may appear by chance.
LEAST_TEXT: Final = 4
_S5_BASE_MS: Final = (10, 100, 1000, 10000)
_UNITS: Final[list[str]] = ["d", "h", "m", "s", "ms"]
_UNIT_MS: Final[list[int]] = [MS_PER_DAY, 3_600_000, 60_000, 1000, 1]
#: The same in the form that compiled code reads without creating objects.
_S5_BASES: Final = struct.pack(f"<{len(_S5_BASE_MS)}q", *_S5_BASE_MS)
_UNIT_NAMES: Final[list[bytes]] = [name.encode("ascii") for name in _UNITS]
_UNIT_SIZES: Final = struct.pack(f"<{len(_UNIT_MS)}q", *_UNIT_MS)
#: Transport sizes of times; the second one of S5TIME is that of a timer.
_TIME: Final = 0x0B
_S5TIME: Final = 0x0C
_S5TIME_TIMER: Final = 0x1D


def decode_value(transport_size: i64, octets: bytes) -> Value:
    """Return the value of ``octets``, which were read or written with the request transport size ``transport_size``."""
    if transport_size == CHAR:
        return octets.decode("latin-1")
    if transport_size == WCHAR:
        return utf_16_be_decode(octets, "replace", True)[0] if len(octets) % 2 == 0 else None
    size: i64 = _ELEMENT[transport_size] if 0 <= transport_size < 256 else 0
    total: i64 = len(octets)
    if size == 0 or total == 0 or total % size:
        return None
    if total == size:
        return _element(transport_size, octets)
    if transport_size == BYTE:
        return list(octets)
    values: list[bool | int | float | str | None] = []
    at: i64 = 0
    while at < total:
        values.append(_element(transport_size, octets[at : at + size]))
        at += size
    return values


#: Size of one element by transport size; 0 if the meaning of the octets is unknown.
_ELEMENT: Final = bytes([ELEMENT_OCTETS.get(code, 0) if code != 0x30 else 8 for code in range(256)])


def _element(transport_size: i64, octets: bytes) -> bool | int | float | str | None:
    if transport_size == BIT:
        return octets[0] & 1 == 1
    if transport_size == 0x02:
        return octets[0]
    if transport_size == 0x04:
        return u16(octets, 0)
    if transport_size == 0x06:
        return u32(octets, 0)
    if transport_size == 0x08:
        return real(octets)
    if transport_size == 0x05:
        word: i64 = u16(octets, 0)
        return word - 0x10000 if word >= 0x8000 else word
    if transport_size == 0x07:
        double: i64 = u32(octets, 0)
        return double - 0x100000000 if double >= 0x80000000 else double
    if transport_size == 0x30:
        wide: float = _DOUBLE.unpack(octets)[0]
        return wide
    if transport_size == 0x1C:
        return bcd(octets[0] & 0x0F, octets[1])
    if transport_size == _S5TIME or transport_size == _S5TIME_TIMER:
        return s5time(octets)
    number = int.from_bytes(octets, "big", signed=transport_size == _TIME)
    if transport_size == 0x09:
        return date_text(number)
    if transport_size == 0x0A:
        return time_of_day(number)
    if transport_size == _TIME:
        return duration(number)
    return date_and_time(octets)


#: By transport size: size of one element, 0 if `write_numbers` does not write it; and the `struct` letter of integers.
_TEXT_SIZES: Final = bytes([{BYTE: 1, WORD: 2, INT: 2, DWORD: 4, DINT: 4, REAL: 4}.get(code, 0) for code in range(256)])
NUMBER_LETTERS: Final[dict[int, str]] = {BYTE: "B", WORD: "H", INT: "h", DWORD: "I", DINT: "i"}


def number_texts(transport_size: i64, octets: bytes, most: i64) -> list[str]:
    """Return the text that `write_numbers` writes; empty if it writes nothing."""
    texts: list[str] = []
    step: i64 = _TEXT_SIZES[transport_size] if 0 <= transport_size < 256 else 0
    size: i64 = len(octets)
    if step == 0 or size % step:
        return texts
    end: i64 = min(size, most * step)
    if transport_size != REAL and not COMPILED:
        return [str(number) for number in struct.unpack_from(f">{end // step}{NUMBER_LETTERS[transport_size]}", octets)]
    at: i64 = 0
    if transport_size == BYTE:
        while at < end:
            texts.append(SHORT[octets[at]])
            at += 1
    if transport_size == REAL:
        while at < end:
            texts.append(real_repr(octets if size == 4 else octets[at : at + 4]))
            at += 4
    while at < end:
        texts.append(decimal(_whole(transport_size, octets, at)))
        at += step
    return texts


def numbers_json(transport_size: i64, octets: bytes) -> str:
    """Return what `write_numbers` writes; empty if it writes nothing."""
    if COMPILED:
        out = BytesWriter()
        return out.getvalue().decode("ascii") if write_numbers(out, transport_size, octets, 0, len(octets)) else ""
    step: i64 = _TEXT_SIZES[transport_size] if 0 <= transport_size < 256 else 0
    size: i64 = len(octets)
    if step == 0 or size == 0 or size % step:
        return ""
    if transport_size == REAL:
        told = ",".join([real_json(octets, at) for at in range(0, size, 4)])
    else:
        told = ",".join(map(str, struct.unpack(f">{size // step}{NUMBER_LETTERS[transport_size]}", octets)))
    return f"[{told}]" if size > step else told


def number_size(transport_size: i64) -> i64:
    """Return the size of one element for `write_number`: 1, 2 or 4; 0 if elements of this type are not numbers."""
    if 0 <= transport_size < 256:  # as one expression it would make int objects (mypyc)
        return _TEXT_SIZES[transport_size]
    return 0


def write_numbers(out: BytesWriter, transport_size: i64, octets: bytes, at: i64, size: i64) -> bool:
    """Write ``size`` octets from ``at`` as JSON: an array of their elements, or a single element without brackets.

    Return False and write nothing if they are not numbers or the size does not match.
    """
    step = number_size(transport_size)
    if step == 0 or size == 0 or size & (step - 1):  # 1, 2 or 4
        return False
    if size == step:
        write_number(out, transport_size, octets, at)
        return True
    out.append(_BEGIN)
    end: i64 = at + size
    if step == 1:
        write_octets(out, octets, at, end)
    else:
        while at < end:
            write_number(out, transport_size, octets, at)
            out.append(_COMMA)
            at += step
    out.truncate(len(out) - 1)  # the last comma
    out.append(_END)
    return True


def write_number(out: BytesWriter, transport_size: i64, octets: bytes, at: i64) -> None:
    """Write a number of one, two or four octets as JSON."""
    if transport_size == REAL:
        write_real_json(out, octets, at)
    elif transport_size == BYTE:
        write_decimal(out, octets[at])
    else:
        write_decimal(out, _whole(transport_size, octets, at))


def write_times(out: BytesWriter, transport_size: i64, octets: bytes, at: i64, size: i64) -> bool:
    """Write TIME or S5TIME as `write_numbers` writes numbers: as JSON strings, with the texts of `duration` and `s5time`.

    Return False and write nothing if the type is neither or the size does not match.
    """
    step = time_size(transport_size)
    if step == 0 or size == 0 or size & (step - 1):
        return False
    if size > step:
        out.append(_BEGIN)
    end: i64 = at + size
    while True:
        begin = len(out)
        out.append(_QUOTE)
        if write_time(out, step, octets, at):
            out.append(_QUOTE)
        else:
            out.truncate(begin)
            out.write(b"null")
        at += step
        if at >= end:
            break
        out.append(_COMMA)
    if size > step:
        out.append(_END)
    return True


def time_size(transport_size: i64) -> i64:
    """Return the size of a time that `write_time` writes: 4 for TIME, 2 for S5TIME, 0 for other types."""
    if transport_size == _TIME:
        return 4
    return 2 if transport_size == _S5TIME or transport_size == _S5TIME_TIMER else 0


def write_time(out: BytesWriter, step: i64, octets: bytes, at: i64) -> bool:
    """Write a `duration` (``step`` 4 octets) or an `s5time` (2); return False and write nothing if it is invalid."""
    if step == 4:
        _write_duration(out, i64(read_i32_be(octets, at)))
        return True
    word: i64 = u16(octets, at)
    tens: i64 = word >> 4 & 0xF
    ones: i64 = word & 0xF
    if word >> 8 & 0xF > 9 or tens > 9 or ones > 9:
        return False
    out.write(b"S5")
    base: i64 = read_i64_le(_S5_BASES, 8 * (word >> 12 & 3))
    _write_duration(out, ((word >> 8 & 0xF) * 100 + tens * 10 + ones) * base)
    return True


def _write_duration(out: BytesWriter, ms: i64) -> None:
    """Write the text of `duration`."""
    out.write(b"T#")
    left: i64 = ms
    if ms < 0:
        out.append(MINUS)
        left = -ms
    begin = len(out)
    index: i64 = 0
    while left:
        unit: i64 = read_i64_le(_UNIT_SIZES, 8 * index)
        if left >= unit:
            write_decimal(out, left // unit)
            out.write(_UNIT_NAMES[index])
            left %= unit
        index += 1
    if len(out) == begin:
        out.write(b"0ms")


_QUOTE: Final = 0x22
_BEGIN: Final = 0x5B
_COMMA: Final = 0x2C
_END: Final = 0x5D


def _whole(transport_size: i64, octets: bytes, at: i64) -> i64:
    """Return an integer of two or four octets."""
    if transport_size == WORD:
        return u16(octets, at)
    if transport_size == INT:
        return i64(read_i16_be(octets, at))
    if transport_size == DINT:
        return i64(read_i32_be(octets, at))
    return u32(octets, at)


def spelled(octets: bytes) -> str:
    """Return the text that octets contain: printable ASCII, followed by NULs or blanks; empty if they contain none.

    An S7 STRING begins with its maximum and its present length.
    """
    size: i64 = len(octets)
    if size < LEAST_TEXT:
        return ""
    first: i64 = octets[0]
    present: i64 = octets[1]
    said: bool = present <= first and LEAST_TEXT <= present <= size - 2
    if not said and (first < 0x20 or first >= 0x7F):
        return ""  # most octets are not text, and the first one shows it
    content = octets[2 : 2 + present] if said else octets.rstrip(b"\0 ")
    if len(content) < LEAST_TEXT:
        return ""
    for octet in content:
        if octet < 0x20 or octet >= 0x7F:
            return ""
    return content.decode("ascii")


def bcd(*octets: int) -> int | None:
    """Return the number of BCD octets, most significant first; None if a digit is above 9."""
    number = 0
    for octet in octets:
        pair = _pair(octet)
        if pair < 0:
            return None
        number = number * 100 + int(pair)
    return number


def _pair(octet: i64) -> i64:
    """Return the number of two BCD digits, -1 if one of them is above 9."""
    high: i64 = octet >> 4
    low: i64 = octet & 0x0F
    if high > 9 or low > 9:
        return -1
    return high * 10 + low


def s5time(octets: bytes) -> str | None:
    """Return an S5TIME (time base in bits 13-12, three BCD digits) as text, for example ``S5T#1s500ms``."""
    digits = bcd(octets[0] & 0x0F, octets[1])
    return None if digits is None else "S5" + duration(digits * _S5_BASE_MS[(octets[0] >> 4) & 3])


def duration(ms: int) -> str:
    """Return milliseconds as IEC 61131-3 text, for example ``T#-1d2h3m4s5ms``."""
    sign = "-" if ms < 0 else ""
    left: i64 = -ms if ms < 0 else ms
    parts = ""
    for index in range(len(_UNITS)):
        size: i64 = _UNIT_MS[index]
        if left >= size:
            parts += f"{decimal(left // size)}{_UNITS[index]}"
            left %= size
    return f"T#{sign}{parts or '0ms'}"


def time_of_day(ms: int) -> str | None:
    """Return milliseconds since midnight as ``TOD#hh:mm:ss.mmm``; None for a day or more."""
    if ms >= MS_PER_DAY:
        return None
    seconds, rest = divmod(ms, 1000)
    return f"TOD#{seconds // 3600:02d}:{seconds // 60 % 60:02d}:{seconds % 60:02d}.{rest:03d}"


#: Days from 1970-01-01, where `civil` begins, to 1990-01-01, where DATE begins.
DAYS_TO_1990: Final = 7305


def date_text(days: int) -> str:
    """Return days since 1990-01-01 as ``D#yyyy-mm-dd``."""
    year, month, day = civil(days + DAYS_TO_1990)
    return f"D#{year:04d}-{month:02d}-{day:02d}"


def date_and_time(octets: bytes) -> str | None:
    """Return the 8-octet BCD form (year, month, day, hour, minute, second, ms, weekday) as ``DT#…``; None if it is invalid."""
    year = _pair(octets[0])
    month = _pair(octets[1])
    day = _pair(octets[2])
    hour = _pair(octets[3])
    minute = _pair(octets[4])
    second = _pair(octets[5])
    centi = _pair(octets[6])
    units: i64 = octets[7] >> 4
    if year < 0 or hour < 0 or minute < 0 or second < 0 or centi < 0:
        return None
    full: i64 = year + 1900
    if year < 90:
        full = year + 2000
    if not (
        1 <= month <= 12 and 1 <= day <= _days(full, month) and hour < 24 and minute < 60 and second < 60 and units < 10
    ):
        return None
    return f"DT#{decimal(full)}-{TWO[month]}-{TWO[day]}-{TWO[hour]}:{TWO[minute]}:{TWO[second]}.{THREE[centi * 10 + units]}"


def _days(year: i64, month: i64) -> i64:
    """Return the number of days of a month; from 1990 to 2089 every fourth year is a leap year."""
    if month == 2:
        return 29 if year % 4 == 0 else 28
    return 30 if month == 4 or month == 6 or month == 9 or month == 11 else 31
