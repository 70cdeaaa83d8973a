"""Counts the octets that are set to zero. Compiled, because most messages contain values."""

from __future__ import annotations


class Masked:
    """Counts fields and octets that were set to zero: ``counts`` has (fields, octets) by kind."""

    __slots__ = ("counts",)

    def __init__(self) -> None:
        self.counts: dict[str, tuple[int, int]] = {}

    def add(self, kind: str, octets: bytes) -> None:
        """Count octets that are set to zero, unless they already were."""
        if octets.count(0) != len(octets):
            fields, size = self.counts.get(kind, (0, 0))
            self.counts[kind] = (fields + 1, size + len(octets))
