"""The hex view of a PDU: offset, sixteen octets, and what they print as."""

from __future__ import annotations


def hexdump(octets: bytes, start: int = 0) -> list[str]:
    """Return one line for every sixteen octets; ``start`` is the offset shown for the first.

    Offsets are decimal, as in the field tree; octets that are not printable ASCII show as a dot.
    """
    lines: list[str] = []
    for at in range(0, len(octets), 16):
        row = octets[at : at + 16]
        left = row[:8].hex(" ")
        right = row[8:].hex(" ")
        text = "".join([chr(octet) if 0x20 <= octet < 0x7F else "." for octet in row])
        lines.append(f"{start + at:>5}  {left:<23}  {right:<23}  {text}")
    return lines
