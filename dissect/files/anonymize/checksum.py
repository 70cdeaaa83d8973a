"""Internet checksums of rewritten packets: correct ones stay correct, wrong ones stay wrong by the same difference."""

from __future__ import annotations

from typing import Final

ONES: Final = 0xFFFF


def total(octets: bytes) -> int:
    """Return the ones' complement sum of ``octets``, 0 for all zeros; a last odd octet is the high one of a pair."""
    if len(octets) & 1:
        octets += b"\0"
    number = int.from_bytes(octets, "big")
    return (number % ONES or ONES) if number else 0


def renewed(stored: int, old: bytes, new: bytes, old_pseudo: bytes, new_pseudo: bytes) -> int:
    """Return the checksum for ``new``, given the ``stored`` one of ``old``; both are without the checksum field itself.

    The pseudo headers are empty if the checksum does not cover one. 0 stays 0 unless it was correct: it means that there is no
    checksum. A sum of the pseudo header alone (left by a host whose network card computes the rest) is updated likewise. All
    other checksums are adjusted by the changed octets, so that a correct one stays correct and a wrong one wrong (RFC 1624);
    octets that the capture cut off count as unchanged.
    """
    was = (total(old) + total(old_pseudo)) % ONES
    becomes = (total(new) + total(new_pseudo)) % ONES
    if stored == 0 and was:
        return 0
    if old_pseudo and (stored - total(old_pseudo)) % ONES == 0 and (stored + was) % ONES:
        return total(new_pseudo)
    return moved(stored, was, becomes)


def moved(stored: int, was: int, becomes: int) -> int:
    """Return a checksum after octets with the sum ``was`` were replaced; both sums may include octets that did not change."""
    return (stored + was - becomes) % ONES or ONES
