"""The hex view of a PDU: lines of offset, sixteen octets, and the same octets as text."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

#: The character that shows each octet.
_PRINTED: Final = bytes([octet if 0x20 <= octet < 0x7F else ord(".") for octet in range(256)])
#: The blanks before an offset, by its number of digits.
_BLANKS: Final[list[str]] = [" " * (5 - digits) for digits in range(5)]


def hexdump(octets: bytes, start: int = 0, hidden: Sequence[tuple[int, int]] = (), indent: str = "") -> list[str]:
    """Return one line for every sixteen octets, after ``indent``; ``start`` is the offset shown for the first.

    Offsets are decimal, as in the field tree. An octet that is not printable ASCII shows as a dot. ``hidden`` are (begin, end)
    of octets that show as stars.
    """
    lines: list[str] = []
    size = len(octets)
    printed = octets.translate(_PRINTED).decode("ascii")
    pairs = octets.hex(" ")
    for at in range(0, size, 16):
        place = 3 * at
        number = str(start + at)
        if len(number) < 5:
            number = _BLANKS[len(number)] + number
        if at + 16 <= size and not hidden:
            right = pairs[place + 24 : place + 47]
            lines.append(f"{indent}{number}  {pairs[place : place + 23]}  {right}  {printed[at : at + 16]}")
            continue
        left = pairs[place : place + 23]
        right = pairs[place + 24 : place + 47]
        text = printed[at : at + 16]
        if hidden:
            for begin, end in hidden:
                left, right, text = _starred(left, right, text, max(begin - at, 0), min(end - at, 16))
        lines.append(f"{indent}{number}  {left.ljust(23)}  {right.ljust(23)}  {text}")
    return lines


def _starred(left: str, right: str, text: str, begin: int, end: int) -> tuple[str, str, str]:
    """Return the columns of a line with stars for its octets from ``begin`` to ``end``, as far as it has these."""
    end = min(end, len(text))
    if begin >= end:
        return left, right, text
    pairs = (left.split() + right.split())[:begin] + ["**"] * (end - begin) + (left.split() + right.split())[end:]
    return " ".join(pairs[:8]), " ".join(pairs[8:]), text[:begin] + "*" * (end - begin) + text[end:]
