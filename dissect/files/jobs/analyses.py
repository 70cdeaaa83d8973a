"""Adds up analyses of single captures; the sum is the analysis that one run over all of them would make.

Parts may be made anywhere and in any order, but are added in the order of the files. So connections, transactions and packets
get the numbers that they have in one run, and every limited list keeps the first entries.
"""

from __future__ import annotations

from dissect.engine.findings.bounds import KEPT, Bounds
from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES
from dissect.engine.findings.reporter import Finding
from dissect.engine.options import Options
from dissect.engine.transactions.naming import Naming
from dissect.files.jobs.sums import FilePart, Sum
from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.per_file import PerFile


class Analyses:
    """Adds up parts. ``result`` is the analysis of all parts so far; ``options`` are those of the whole run."""

    def __init__(self, options: Options) -> None:
        self.result = Analysis()
        self._sum = Sum(options)
        self._naming: Naming | None = options.naming
        self._bounds = Bounds()
        self._explained_bounds = Bounds()
        self.result.take(self._sum.pipeline, self._sum.files)

    def add(self, part: FilePart) -> None:
        """Add the part of the next file."""
        before = int(self._sum.pipeline.exchange.reporter.number)
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
        self.result.merge(later)
        self._add_findings(later, before)

    def finish(self) -> None:
        """There are no more parts, and no later part waits for one."""

    def _add_findings(self, later: Analysis, before: int) -> None:
        """Keep the findings of a part with the numbers that they have in one run; ``before`` were reported in earlier parts.

        The limits of one run may leave out some findings. With a selection it is unknown which ones, so there are gaps in these
        numbers.
        """
        numbers = {0: 0}
        for finding in sorted([*later.findings, *later.explained], key=_number):
            own, cause = int(finding.number), int(finding.explained_by)
            if not self._keeps(finding):
                continue
            if later.part is not None:
                finding.number, finding.explained_by = own and before + own, cause and before + cause
            else:
                numbers[own] = finding.number = len(self.result.findings) + len(self.result.explained) + 1
                finding.explained_by = numbers.get(cause, 0)
            self.result.finding(finding)

    def _keeps(self, finding: Finding) -> bool:
        """Return whether one run would keep this finding in detail (`dissect.engine.findings.bounds`)."""
        bounds = self._explained_bounds if finding.because else self._bounds
        return bounds.take(finding.slug, finding.client, finding.server, finding.connection) == KEPT


class AnalysesByFile(Analyses):
    """Adds up parts, and keeps in ``rows`` the share of each file."""

    def __init__(self, options: Options, rows: PerFile) -> None:
        super().__init__(options)
        self.rows = rows
        self.rows.files = self._sum.files

    def add(self, part: FilePart) -> None:
        """Add the part of the next file; its share is what the sum gains."""
        before = _counts(self.result)
        super().add(part)
        after = _counts(self.result)
        counts = self.rows.of(len(self._sum.files) - 1)
        more = [now - then for now, then in zip(after, before, strict=True)]
        counts.connections, counts.transactions, counts.errors, counts.missed = more[:4]
        counts.findings = dict(zip(SEVERITIES, more[4:], strict=True))


def _counts(analysis: Analysis) -> list[int]:
    """Return connections, transactions, errors, missing answers, and findings by severity."""
    counts = analysis.finding_counts
    by_severity = [
        sum([n for slug, n in counts.items() if CATALOGUE[slug].severity == severity]) for severity in SEVERITIES
    ]
    connections = len(analysis.connections) + int(analysis.connections_not_listed)
    return [connections, int(analysis.total), int(analysis.with_errors), analysis.missed, *by_severity]


def _number(finding: Finding) -> int:
    return int(finding.number)
