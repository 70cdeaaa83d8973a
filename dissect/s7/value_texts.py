"""Values of items as text, element by element, without a Python number in between: for the sizes that polling is made of."""

from __future__ import annotations

import struct
from typing import Final

from mypy_extensions import i64

from dissect.s7.singles import real_json, real_repr
from dissect.s7.tables import BYTE, DINT, DWORD, INT, REAL, WORD
from dissect.wire.build import COMPILED
from dissect.wire.digits import SHORT, decimal
from dissect.wire.octets import u16, u32

#: Octets of one element by transport size, 0 for those that are not written here; and how `struct` knows them.
_SIZES: Final = bytes([{BYTE: 1, WORD: 2, INT: 2, DWORD: 4, DINT: 4, REAL: 4}.get(code, 0) for code in range(256)])
_LETTERS: Final[dict[int, str]] = {BYTE: "B", WORD: "H", INT: "h", DWORD: "I", DINT: "i"}


def number_texts(transport_size: i64, octets: bytes, as_json: bool, most: i64) -> list[str]:
    """Return the first ``most`` elements as text, one by one; nothing where they are no numbers or the size does not fit.

    A REAL is written as `real_json` or as `real_repr` has it.
    """
    texts: list[str] = []
    step: i64 = _SIZES[transport_size] if 0 <= transport_size < 256 else 0
    size: i64 = len(octets)
    if step == 0 or size % step:
        return texts
    end: i64 = min(size, most * step)
    if transport_size != REAL and not COMPILED:
        return [str(number) for number in struct.unpack_from(f">{end // step}{_LETTERS[transport_size]}", octets)]
    at: i64 = 0
    if transport_size == BYTE:
        while at < end:
            texts.append(SHORT[octets[at]])
            at += 1
    while at < end:
        texts.append(_element(transport_size, octets, at, as_json))
        at += step
    return texts


def _element(transport_size: i64, octets: bytes, at: i64, as_json: bool) -> str:
    if transport_size == REAL:
        single = octets if len(octets) == 4 else octets[at : at + 4]
        return real_json(single) if as_json else real_repr(single)
    number: i64
    if transport_size == WORD or transport_size == INT:
        number = u16(octets, at)
        if transport_size == INT and number >= 0x8000:
            number -= 0x10000
        return decimal(number)
    number = u32(octets, at)
    if transport_size == DINT and number >= 0x80000000:
        number -= 0x100000000
    return decimal(number)
