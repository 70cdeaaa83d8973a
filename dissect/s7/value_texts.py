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
    if transport_size == REAL:
        for at in range(0, end, step):
            single = octets if size == 4 else octets[at : at + 4]
            texts.append(real_json(single) if as_json else real_repr(single))
        return texts
    if not COMPILED:
        return [str(number) for number in struct.unpack_from(f">{end // step}{_LETTERS[transport_size]}", octets)]
    number: i64
    if step == 1:
        return [SHORT[octets[at]] for at in range(end)]
    if step == 2:
        for at in range(0, end, step):
            number = u16(octets, at)
            if transport_size == INT and number >= 0x8000:
                number -= 0x10000
            texts.append(decimal(number))
    else:
        for at in range(0, end, step):
            number = u32(octets, at)
            if transport_size == DINT and number >= 0x80000000:
                number -= 0x100000000
            texts.append(decimal(number))
    return texts
