"""Octets from a fuzzer, taken piece by piece: any octets make a valid input of some kind."""

from __future__ import annotations


class Taker:
    """Hands out octets from the front; past the end everything is zero or empty."""

    def __init__(self, octets: bytes) -> None:
        self._octets = octets
        self._at = 0

    @property
    def left(self) -> int:
        """Octets not taken yet."""
        return max(0, len(self._octets) - self._at)

    def octets(self, size: int) -> bytes:
        """Return up to ``size`` octets."""
        piece = self._octets[self._at : self._at + size]
        self._at += size
        return piece

    def number(self, size: int = 1) -> int:
        """Return a number of ``size`` octets, big-endian."""
        return int.from_bytes(self.octets(size).ljust(size, b"\0"), "big")

    def rest(self) -> bytes:
        """Return all that is left."""
        return self.octets(self.left)
