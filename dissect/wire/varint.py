"""Numbers of variable size (VLQ) of S7comm-plus: seven bits per octet, the highest first (docs/s7plus.md).

Bit 7 of an octet says that more octets follow. A 32-bit number has at most five octets. A 64-bit number has at most nine; the
ninth has eight bits of the number. Signed numbers are two's complement: bit 6 of the first octet is the sign.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

# Kinds of numbers; less than `REST` of dissect.wire.layout, so that they can be used as the size of a field.
VLQ: Final = -2
VLQ64: Final = -3
SIGNED: Final = -4
SIGNED64: Final = -5

#: The most octets with seven bits of the number each.
_LONGEST_32: Final = 5
_LONGEST_64: Final = 8


def read_varint(octets: bytes, at: int, end: int, kind: int) -> tuple[int, int]:
    """Read the number of a ``kind`` above at ``at``; return it, and where it ends.

    Return (-1, -1) when it does not end before ``end``, or has more octets than its kind may. Bits beyond 32 of a 32-bit kind
    are dropped, as receivers do.
    """
    wide = kind == VLQ64 or kind == SIGNED64
    signed = kind == SIGNED or kind == SIGNED64
    last = at + (_LONGEST_64 if wide else _LONGEST_32)
    stop = min(last, end)
    value = 0
    if signed and at < end and octets[at] & 0x40:
        value = -1  # sign extension: all bits above those read are set
    while at < stop:
        octet = octets[at]
        value = (value << 7) | (octet & 0x7F)
        at += 1
        if octet < 0x80:
            if wide:
                return value, at
            return (((value + 0x80000000) & 0xFFFFFFFF) - 0x80000000 if signed else value & 0xFFFFFFFF), at
    if wide and at == last and at < end:
        return (value << 8) | octets[at], at + 1
    return -1, -1


def pass_varint(octets: bytes, at: i64, end: i64, wide: bool) -> i64:
    """Return where the number at ``at`` ends, -1 where `read_varint` finds none; ``wide``: it has 64 bits."""
    last: i64 = at + _LONGEST_32
    if wide:
        last = at + _LONGEST_64
    stop: i64 = min(last, end)
    while at < stop:
        octet: i64 = octets[at]
        at += 1
        if octet < 0x80:
            return at
    if wide and at == last and at < end:
        return at + 1
    return -1


def build_varint(value: int, kind: int) -> bytes:
    """Return the shortest octets of ``value``. ValueError when its kind cannot hold it."""
    wide = kind == VLQ64 or kind == SIGNED64
    signed = kind == SIGNED or kind == SIGNED64
    bits = 64 if wide else 32
    least, most = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    if not least <= value <= most:
        raise ValueError(f"{value} does not fit into {bits} bits{', signed' if signed else ''}")
    # The bits that are needed; a signed number needs one more, for the sign.
    needed = (value if value >= 0 else ~value).bit_length() + (1 if signed else 0)
    count = max(1, (needed + 6) // 7)
    if count > _LONGEST_64:
        head = value >> 8
        groups = [(head >> shift) & 0x7F | 0x80 for shift in range(49, -1, -7)]
        return bytes([*groups, value & 0xFF])
    groups = [(value >> shift) & 0x7F | 0x80 for shift in range(7 * (count - 1), -1, -7)]
    groups[-1] &= 0x7F
    return bytes(groups)
