"""What a connection has been used for so far, in a few numbers: the memory of the rules about events of security."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

#: Distinct SZL-IDs, and blocks that were loaded, that are remembered of a connection.
MAX_REMEMBERED: Final = 256


class Traits:
    """The memory of one connection; every part of it is bounded.

    ``written`` has a bit for each kind of area that was written (`dissect.s7.items.AREA_BITS`); ``told`` has the slugs that
    are said once for a connection; ``szl_ids`` and ``loaded`` are what was asked for and loaded.
    """

    __slots__ = ("inquiries", "loaded", "pace_ns", "refusals", "szl_ids", "told", "written")

    def __init__(self) -> None:
        self.written: i64 = 0
        self.pace_ns = 0
        self.inquiries = 0
        self.refusals = 0
        self.told: set[str] = set()
        self.szl_ids: set[int] = set()
        self.loaded: set[str] = set()

    def first(self, slug: str) -> bool:
        """Tell whether ``slug`` is said for the first time on this connection, and remember that it was."""
        if slug in self.told:
            return False
        self.told.add(slug)
        return True
