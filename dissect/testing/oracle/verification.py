"""Results of comparing captures, for people and programs: `s7dissect verify` (docs/oracle.md, docs/json.md)."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from typing import Final

from dissect.meaning.report import words
from dissect.testing.oracle import facts
from dissect.testing.oracle.compare import Comparison, FieldDifference
from dissect.testing.oracle.entry import KnownDifference
from dissect.testing.oracle.known import KNOWN
from dissect.testing.oracle.plus import PlusProof
from dissect.wire.text import encodable, printable

VERIFICATION_SCHEMA: Final = "s7dissect.verification/1"
_ENTRIES: Final = {entry.id: entry for entry in KNOWN}


class Verification:
    """The comparisons of some captures, in the order in which they were made.

    ``tshark`` is its version; ``every`` requests one line for each known difference besides the summary.
    """

    def __init__(self, tshark: str, every: bool = False) -> None:
        self.tshark = tshark
        self.every = every
        self.files: list[tuple[str, Comparison]] = []

    @property
    def unexplained(self) -> int:
        """Differences that no entry of `dissect.testing.oracle.known` explains."""
        return sum(len(comparison.unexplained) for _, comparison in self.files)

    @property
    def holds(self) -> bool:
        """True if nothing is unexplained and all checks of S7comm-plus pass."""
        return not self.unexplained and all([comparison.plus.holds for _, comparison in self.files])

    @property
    def known(self) -> Counter[str]:
        """The explained differences, by explanation."""
        return sum((comparison.known for _, comparison in self.files), Counter())

    def take(self, path: str, comparison: Comparison) -> list[str]:
        """Keep the comparison of a capture and return its lines."""
        self.files.append((path, comparison))
        lines = [f"{printable(path)}: {_counts([comparison])}"]
        lines += [
            f"  {words.count(count, 'PDU')} not compared: {why}" for why, count in comparison.not_comparable.items()
        ]
        if comparison.plus.met:
            lines.append(f"  {comparison.plus}")
            lines += [f"  {printable(fault)}" for fault in comparison.plus.faults]
        for difference in comparison.differences:
            if self.every or not difference.known:
                lines.append(f"  {difference}")
        return lines

    def summary(self) -> Iterator[str]:
        """Yield the totals, and the known differences with their counts."""
        files = "1 file" if len(self.files) == 1 else f"{len(self.files)} files"
        yield f"{files}, tshark {self.tshark}: {_counts([comparison for _, comparison in self.files])}"
        plus = PlusProof()
        for _, comparison in self.files:
            plus.add(comparison.plus)
        if plus.met:
            yield f"  {plus}"
        for id_, count in self.known.most_common():
            entry = _ENTRIES[id_]
            yield f"  {count:6}  {id_}: {entry.what} {entry.side}: {entry.why}"

    def as_dict(self) -> dict[str, object]:
        """Return the object that ``-T json`` writes; all differences, the known ones with their id."""
        return {
            "schema": VERIFICATION_SCHEMA,
            "tshark": self.tshark,
            "unexplained": self.unexplained,
            "files": [_file(path, comparison) for path, comparison in self.files],
            "known": {id_: _entry(_ENTRIES[id_], count) for id_, count in sorted(self.known.items())},
        }


def _counts(comparisons: list[Comparison]) -> str:
    compared = sum((one.compared for one in comparisons), Counter[str]())
    fields = sum(one.fields for one in comparisons)
    unexplained = sum(len(one.unexplained) for one in comparisons)
    known = sum(one.known.total() for one in comparisons)
    kinds = ", ".join(words.count(compared[kind], kind) for kind in (facts.TPDU, facts.PDU))
    return (
        f"{kinds}, {words.count(fields, 'field')}; {words.count(unexplained, 'unexplained difference')}, {known} known"
    )


def _file(path: str, comparison: Comparison) -> dict[str, object]:
    return {
        "name": encodable(path),
        "tpdus": comparison.compared[facts.TPDU],
        "pdus": comparison.compared[facts.PDU],
        "fields": comparison.fields,
        "not_comparable": dict(comparison.not_comparable),
        "s7plus": {
            "pdus": comparison.plus.pdus,
            "read": comparison.plus.read,
            "cut": comparison.plus.cut,
            "unknown": comparison.plus.unknown,
            "pairs": comparison.plus.pairs,
            "true": comparison.plus.true,
        },
        "differences": [_difference(difference) for difference in comparison.differences],
    }


def _difference(difference: FieldDifference) -> dict[str, object]:
    ours, theirs = difference.ours, difference.theirs
    return {
        "frame": difference.frame,
        "kind": difference.kind,
        "field": difference.field,
        "ours": ours.hex() if isinstance(ours, bytes) else ours,
        "wireshark": theirs.hex() if isinstance(theirs, bytes) else theirs,
        "known": difference.known or None,
    }


def _entry(entry: KnownDifference, count: int) -> dict[str, object]:
    return {
        "count": count,
        "wireshark": entry.what,
        "right": entry.side,
        "why": entry.why,
        "reference": entry.reference.split(", "),
    }
