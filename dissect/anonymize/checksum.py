"""Internet checksums of packets that were changed: right ones stay right, wrong ones stay as wrong as they were."""

from __future__ import annotations

from typing import Final

ONES: Final = 0xFFFF


def total(octets: bytes) -> int:
    """Return the sum of ``octets`` in ones' complement, 0 for zeros only; an odd octet is the high one of a pair."""
    if len(octets) & 1:
        octets += b"\0"
    number = int.from_bytes(octets, "big")
    return (number % ONES or ONES) if number else 0


def renewed(stored: int, old: bytes, new: bytes, old_pseudo: bytes, new_pseudo: bytes) -> int:
    """Return the checksum of ``new`` from ``stored``, that of ``old``; both are without the checksum itself.

    The pseudo headers are empty where the checksum does not cover one. 0 stays 0 unless it was right: it says that there is
    none. A sum of the pseudo header alone, as a host leaves it whose network card works out the rest, is one again. Everything
    else changes by what the octets changed, so that it is right exactly where it was (RFC 1624); octets that the capture cut
    off count as they were.
    """
    was = (total(old) + total(old_pseudo)) % ONES
    becomes = (total(new) + total(new_pseudo)) % ONES
    if stored == 0 and was:
        return 0
    if old_pseudo and (stored - total(old_pseudo)) % ONES == 0 and (stored + was) % ONES:
        return total(new_pseudo)
    return moved(stored, was, becomes)


def moved(stored: int, was: int, becomes: int) -> int:
    """Return a checksum after octets whose sum ``was`` have become others; what stays in its place may count in both."""
    return (stored + was - becomes) % ONES or ONES
