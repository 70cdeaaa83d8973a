"""What saves work changes no result: sums without rows, lines with parts that were written before."""

from __future__ import annotations

import math
import random
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from dissect.files.session import Run
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.model import ValueRow, Variable
from dissect.output.variables.statistics import Pace, Statistics
from dissect.output.variables.writers import RowWriter, ValueCsv, ValueJsonl, ValueText, ValueWriter
from tests.cases import each
from tests.meaning.report.support import ROOT, begun
from tests.output.variables.support import BIT, BYTE, REAL, WORD, collected, db, reads, real, writes
from tests.properties.packets import Talk

CAPTURES: Final = sorted(
    [*(ROOT / "captures").glob("nodes7*.pcapng"), *(ROOT / "captures" / "crafted").glob("*.pcap*")]
)
_SMALL: Final = 300_000


def busy(seed: int) -> Talk:
    """Return a talk in which values stay, change, come back, are no numbers, and are given in both directions."""
    chance = random.Random(seed)
    talk = begun()
    asked = [db(REAL, 0), db(WORD, 4), db(BIT, 6), db(BYTE, 8, 3), db(REAL, 12, 2)]
    sizes = [4, 2, 1, 3, 8]
    latest = [bytes(size) for size in sizes]
    for ref in range(1, 120):
        for at, size in enumerate(sizes):
            match chance.randrange(6):
                case 0:
                    latest[at] = bytes([chance.getrandbits(1)]) if size == 1 else chance.randbytes(size)
                case 1:
                    number = real(chance.choice((0.1, -3.5, 1e9, float("nan"), float("inf"))))
                    latest[at] = {4: number, 8: number + real(0.5), 1: b"\1"}.get(size, latest[at])
                case _:
                    pass  # as it was
        if chance.randrange(5):
            reads(talk, ref, *zip(asked, latest, strict=True))
        else:
            writes(talk, ref, *[(item, content, 0xFF) for item, content in zip(asked, latest, strict=True)])
    return talk


def facts(found: Statistics) -> tuple[object, ...]:
    """Return everything that statistics say; NaN as text, because it equals nothing."""

    def paces(clients: dict[str, Pace]) -> list[tuple[object, ...]]:
        return [(host, int(one.count), one.period_ns, one.jitter_ns) for host, one in clients.items()]

    return (
        int(found.count),
        int(found.changes),
        repr(found.first),
        int(found.first_ns),
        repr(found.last),
        int(found.last_ns),
        int(found.numbers),
        found.least,
        found.most,
        found.total,
        found.distinct,
        found.more_distinct,
        paces(found.readers),
        paces(found.writers),
        int(found.others),
        repr(found.trend),
    )


def of_rows(rows: Iterable[ValueRow]) -> dict[Variable, Statistics]:
    """Return statistics that rows were added to one by one."""
    found: dict[Variable, Statistics] = {}
    for row in rows:
        found.setdefault(row.variable, Statistics()).add(row)
    return found


@each("seed", range(6))
def test_sums_without_rows_are_those_of_the_rows(seed: int) -> None:
    packets = busy(seed).packets()
    rows = collected(ValueCollector(), packets).take()
    sums = collected(ValueCollector(sums=True), packets)
    assert not sums.take()
    told = {(one.address, one.type): facts(one.statistics) for one in sums.variables if one.statistics is not None}
    assert told == {(one.address, one.type): facts(found) for one, found in of_rows(rows).items()}
    assert len(rows) > 500
    assert any(not row.changed for row in rows)


def test_the_trend_keeps_the_latest_number_of_each_stretch_of_time() -> None:
    """A list of all points, made anew of all rows, says the same as one that is kept up to date."""
    rows = collected(ValueCollector(), busy(1).packets()).take()
    level = next(row.variable for row in rows if row.address == "DB1.DBD0")
    found = Statistics()
    numbers = []
    for row in [row for row in rows if row.variable is level]:
        found.add(row)
        if isinstance(row.value, float) and math.isfinite(row.value):
            numbers.append((int(row.time_ns - found.first_ns), row.value))
        shown = found.trend
        if not numbers:
            continue
        width = next(size for size in (10**6 * 2**power for power in range(40)) if numbers[-1][0] // size < 48)
        latest = {time_ns // width: number for time_ns, number in numbers}
        assert [(at, point) for at, point in enumerate(shown) if not math.isnan(point)] == sorted(latest.items())


@each("writer", (ValueText, ValueJsonl, ValueCsv))
def test_a_line_is_the_same_whatever_was_written_before(writer: type[RowWriter]) -> None:
    runs = [collected(ValueCollector(), busy(3).packets()).take(), *[rows_of_file(path) for path in CAPTURES]]
    seen = 0
    for rows in runs:
        together = written(writer(), rows)
        assert together == [line for row in rows for line in written(writer(), [row])]
        seen += len(rows)
    assert seen > 1000


def rows_of_file(path: Path) -> list[ValueRow]:
    """Return the rows of a capture."""
    if path.stat().st_size > _SMALL:
        return []
    collector = ValueCollector()
    run = Run([path], collector)
    while run.step():
        pass
    return collector.take()


def written(writer: ValueWriter, rows: list[ValueRow]) -> list[object]:
    """Return the lines of rows, without the names of columns."""
    writer.values(rows)
    lines: list[object] = list(writer.take())
    return lines[1:] if isinstance(writer, ValueCsv) else lines
