"""Data that a page shows in several places, sorted once."""

from __future__ import annotations

from dissect.output.page.gathered import Gathered, SpreadOf
from dissect.output.page.polls import PolledRequest, PolledVariable
from dissect.output.page.rows import Station


class Ordered:
    """The gathered rows in the order of their tables, by which plots and cards refer to them.

    ``functions`` are answers by PLC and function, the most frequent first; ``polls`` are repeated requests, the most frequent
    first; ``variables`` are reads and writes by PLC and address, the most often refused first, then the most frequent.
    """

    def __init__(self, gathered: Gathered) -> None:
        self.of = gathered
        self.functions: list[tuple[tuple[Station, str], SpreadOf]] = sorted(
            gathered.spreads.items(), key=lambda entry: (-entry[1].total, entry[0])
        )
        self.polls: list[PolledRequest] = gathered.requests.polls()
        self.variables: list[tuple[tuple[Station, str], PolledVariable]] = sorted(
            gathered.requests.variables().items(),
            key=lambda entry: (-entry[1].refused, -entry[1].read - entry[1].written, entry[0]),
        )
