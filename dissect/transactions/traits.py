"""What a connection has been used for so far, in a few numbers: the memory of the rules about events of security."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

#: Distinct SZL-IDs, and blocks that were loaded, that are remembered of a connection.
MAX_REMEMBERED: Final = 256


class Writes:
    """The latest writes of a connection: how many they are, and a sample of them.

    ``count`` counts all writes ever; the others begin anew with each look: ``since_ns`` and ``pdus`` are the time and PDUs of
    the connection when it began, ``variables`` and ``answer_ns`` the requests of the sample and the time their answers took.
    """

    __slots__ = ("answer_ns", "count", "pdus", "since_ns", "variables")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.since_ns: i64 = 0
        self.pdus: i64 = 0
        self.answer_ns: i64 = 0
        self.variables: set[bytes] = set()


class Traits:
    """The memory of one connection; every part of it is bounded.

    ``written`` has a bit for each kind of area that was written (`dissect.s7.items.AREA_BITS`); ``told`` has the slugs that
    are said once for a connection; ``szl_ids`` and ``loaded`` are what was asked for and loaded.
    """

    __slots__ = ("inquiries", "loaded", "pace_ns", "refusals", "szl_ids", "told", "writes", "written")

    def __init__(self) -> None:
        self.written: i64 = 0
        self.pace_ns = 0
        self.writes: Writes = Writes()
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
