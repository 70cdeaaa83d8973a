"""The outputs for an input: everything, or in long runs one thing each time, chosen by the input itself.

Most of an execution's time goes into its outputs: a tree, a line, JSON, all of which are read back. A run with one output each
time checks less of each input, but reads up to twice as many in the same time.
"""

from __future__ import annotations

from typing import Final
from zlib import crc32


class Turns:
    """``one``: only one of the possible outputs is made, always the same one for an input."""

    def __init__(self) -> None:
        self.one = False

    def has(self, octets: bytes, number: int, count: int) -> bool:
        """Return whether the thing ``number`` of ``count`` is made of an input."""
        return not self.one or crc32(octets) % count == number


TURNS: Final = Turns()
