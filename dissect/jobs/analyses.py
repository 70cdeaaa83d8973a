"""Adds up analyses of single captures; the sum is the analysis that one run over all of them would make.

Parts may be made anywhere and in any order, but are added in the order of the files. So connections, transactions and packets
get the numbers that they have in one run, and every bounded list keeps what comes first.
"""

from __future__ import annotations

from dissect.engine.options import Options
from dissect.findings.reporter import MAX_DETAILED, MAX_DETAILED_ALL
from dissect.jobs.sums import FilePart, Sum
from dissect.report.analysis import Analysis
from dissect.transactions.naming import Naming


class Analyses:
    """Adds up parts. ``found`` is the analysis of all parts so far; ``options`` are those of the whole run."""

    def __init__(self, options: Options) -> None:
        self.found = Analysis()
        self._sum = Sum(options)
        self._naming: Naming | None = options.naming
        self._detailed: dict[str, int] = {}
        self._detailed_of: dict[tuple[str, int], int] = {}
        self.found.take(self._sum.pipeline, self._sum.files)

    def add(self, part: FilePart) -> None:
        """Add the part of the next file."""
        later: Analysis = self._sum.take(part)
        if self._naming is not None:
            for connection in {
                id(each): each
                for each in (
                    *later.connections,
                    *[transaction.connection for transaction in (*later.failed, *later.slowest())],
                )
            }.values():
                connection.naming = self._naming.of(connection)
        self.found.merge(later)
        for finding in later.findings:
            if self._keeps(finding.slug, int(finding.connection)):
                self.found.finding(finding)

    def _keeps(self, slug: str, connection: int) -> bool:
        """Return whether one run would keep this finding in detail (bounds in `dissect.findings.reporter`)."""
        in_all, here = self._detailed.get(slug, 0), self._detailed_of.get((slug, connection), 0)
        if in_all >= MAX_DETAILED_ALL or here >= MAX_DETAILED:
            return False
        self._detailed[slug] = in_all + 1
        self._detailed_of[slug, connection] = here + 1
        return True
