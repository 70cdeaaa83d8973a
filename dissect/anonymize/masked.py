"""What is set to zero, counted. Compiled: most messages have values."""

from __future__ import annotations


class Masked:
    """Fields and octets that were set to zero, by kind: ``counts`` has (fields, octets)."""

    __slots__ = ("counts",)

    def __init__(self) -> None:
        self.counts: dict[str, tuple[int, int]] = {}

    def add(self, kind: str, octets: bytes) -> None:
        """Octets are set to zero; those that were zero need no word."""
        if octets.count(0) != len(octets):
            fields, size = self.counts.get(kind, (0, 0))
            self.counts[kind] = (fields + 1, size + len(octets))
