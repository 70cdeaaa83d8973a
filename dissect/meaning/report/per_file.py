"""`analyze --per-file`: one row for each file. Each transaction and finding counts for the file of its first packet."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import Final

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.styled import DIM, HEADING, PLAIN, Line
from dissect.meaning.report.text import table
from dissect.packets.source.packet import CONTINUES_NS, SourceFile
from dissect.wire.text import printable, shortened

_NAME: Final = 60
_DAMAGED: Final = "capture.damaged"


class FileCounts:
    """The counts of one file; ``findings`` by severity."""

    __slots__ = ("connections", "errors", "findings", "missed", "transactions")

    def __init__(self) -> None:
        self.connections = 0
        self.transactions = 0
        self.errors = 0
        self.missed = 0
        self.findings = dict.fromkeys(SEVERITIES, 0)


class PerFile(Observer):
    """Counts by file. ``files`` are the files of the run; more may be added while it runs.

    It gets every finding, before any limit, so that each counts for the file of its own first packet.
    """

    def __init__(self) -> None:
        super().__init__()
        self.files: Sequence[SourceFile] = []
        self.wants_every_finding = True
        self._counts: dict[int, FileCounts] = {}

    def of(self, index: int) -> FileCounts:
        """Return the counts of the file with this index in ``files``."""
        return self._counts.setdefault(index, FileCounts())

    def _at(self, frame: int) -> FileCounts:
        return self.of(max(0, bisect_right(self.files, frame, key=lambda file: int(file.first_frame)) - 1))

    def transaction(self, transaction: Transaction) -> None:
        """Count a transaction."""
        counts = self._at(transaction.request_frame or transaction.response_frame)
        counts.transactions += 1
        if transaction.has_errors:
            counts.errors += 1
        if transaction.missed:
            counts.missed += 1

    def connection_closed(self, connection: Connection) -> None:
        """Count a connection for the file in which it begins."""
        self._at(connection.tcp.first_frame).connections += 1

    def finding(self, finding: Finding) -> None:
        """Count a finding that no other finding explains; one without a packet counts for the latest file.

        A finding about the damage of a file counts for that file, which may have no packet of its own.
        """
        if finding.because or not finding.reported:
            return
        if finding.slug == _DAMAGED or not finding.frames:
            counts = self.of(self._named(finding.detail))
        else:
            counts = self._at(finding.frames[0])
        counts.findings[finding.severity] += 1

    def _named(self, detail: str) -> int:
        """Return the index of the latest file with whose name a detail begins, else of the latest file of all."""
        named = [at for at, file in enumerate(self.files) if detail.startswith(f"{file.name}: ")]
        return named[-1] if named else max(0, len(self.files) - 1)

    def lines(self, foreign: Sequence[str] = (), joined: bool = True) -> Iterator[Line]:
        """Yield a heading, a row for each file, and, if there are several files, a row with the sums.

        ``foreign`` are files that are not captures; ``joined`` is whether files that continue each other were read as one.
        """
        total = FileCounts()
        rows = [["file", "packets", "connections", "transactions", "errors", "no answer", *SEVERITIES, ""]]
        packets = 0
        before_ns = 0
        for index, file in enumerate(self.files):
            counts = self.of(index)
            rows.append(_row(_named(file.name), int(file.packets), counts, _remark(file, before_ns, joined)))
            before_ns = int(file.last_ns) or before_ns
            packets += int(file.packets)
            for name in ("connections", "transactions", "errors", "missed"):
                setattr(total, name, getattr(total, name) + getattr(counts, name))
            for severity in SEVERITIES:
                total.findings[severity] += counts.findings[severity]
        if len(self.files) > 1:
            rows.append(_row(f"{len(self.files)} files", packets, total, ""))
        for number, line in enumerate(table(rows, frozenset(range(1, 9)))):
            damaged = 0 < number <= len(self.files) and self.files[number - 1].damage
            yield Line(line.text, HEADING if not number else "error" if damaged else PLAIN, line.hang)
        for name in foreign:
            yield Line(f"  {_named(name)}: not a capture by its name, not read", DIM)
        yield Line("  findings by severity; each counts for the file of its first packet", DIM)


def _named(name: str) -> str:
    """Return the name of a file, or the end of a long name, because names in a folder often begin alike."""
    whole = printable(name)
    return whole if len(whole) <= _NAME else f"…{whole[1 - _NAME :]}"


def _remark(file: SourceFile, before_ns: int, joined: bool) -> str:
    """Return a remark on a file; ``before_ns`` is the time of the last packet before it, 0 for none."""
    said = []
    if file.damage:
        said.append(f"{'DAMAGED' if file.packets else 'UNREAD'}: {shortened(file.damage, 80)}")
    elif not file.packets:
        said.append("no packets")
    if file.packets and before_ns and 0 <= int(file.first_ns) - before_ns <= CONTINUES_NS:
        said.append("continues the file before" if joined else "continues the file before; read apart")
    return "; ".join(said)


def _row(name: str, packets: int, counts: FileCounts, remark: str) -> list[str]:
    numbers = [counts.connections, counts.transactions, counts.errors, counts.missed, *counts.findings.values()]
    return [name, str(packets), *[str(number) if number else "." for number in numbers], remark]
