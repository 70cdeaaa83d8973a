"""A summary adds up the values of each variable in bounded memory, and shows them as a table, JSON lines and CSV."""

from __future__ import annotations

import json
import math
import struct
from itertools import pairwise
from typing import Final

import pytest

from dissect.engine.pipeline import Options, Pipeline
from dissect.meaning.report.styled import DIM, HEADING, PLAIN
from dissect.meaning.report.words import Places
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.statistics import MAX_DISTINCT, POINTS, Pace, Statistics
from dissect.output.variables.summary import (
    Summary,
    csv_rows,
    json_lines,
    limits_text,
    mean_text,
    sparkline,
    text_lines,
)
from dissect.wire.text import Clock
from tests.cases import each
from tests.engine.transactions import talk as line
from tests.meaning.report.support import begun
from tests.output.variables.support import BIT, BYTE, INT, REAL, WORD, collected, db, reads, real, rows_of, writes
from tests.properties.packets import Talk

_MS: Final = 1_000_000


def test_the_pace_of_a_client() -> None:
    pace = Pace()
    times = [0, 1_000_000, 2_100_000, 2_900_000, 4_000_000]
    for time_ns in times:
        pace.add(time_ns)
    gaps = [later - earlier for earlier, later in pairwise(times)]
    mean = sum(gaps) / len(gaps)
    assert pace.period_ns == round(mean)
    assert pace.jitter_ns == round(math.sqrt(sum([(gap - mean) ** 2 for gap in gaps]) / len(gaps)))


def test_a_summary_of_any_length_stays_small() -> None:
    talk = begun()
    for ref in range(400):
        reads(talk, ref + 1, (db(WORD, 0), struct.pack(">H", ref)))
    found = collected(ValueCollector(sums=True), talk.packets())
    (variable,) = found.variables
    sums = variable.statistics
    assert sums is not None
    assert (sums.count, sums.least, sums.most, sums.mean) == (400, 0, 399, 199.5)
    assert (len(sums.distinct), sums.more_distinct) == (MAX_DISTINCT, True)
    assert POINTS <= len(sums.trend) < 2 * POINTS
    shown = [point for point in sums.trend if not math.isnan(point)]
    assert shown == sorted(shown)
    assert shown[-1] == 399
    assert limits_text(Summary(found)) == ""


def test_what_a_summary_leaves_out_is_said() -> None:
    talk = begun()
    for ref in range(1, 6):
        reads(talk, ref, (db(INT, 2 * ref), b"\0\1"))
    found = collected(ValueCollector(sums=True, most=2), talk.packets())
    summary = Summary(found)
    assert len(summary.variables) == 2
    assert limits_text(summary).startswith("3 values of variables beyond the first 2")


def test_sparklines() -> None:
    assert sparkline([]) == ""
    assert sparkline([5.0, 5.0]) == "▅▅"
    assert sparkline([0.0, math.nan, 7.0, 3.5]) == "▁▁█▅"
    assert sparkline([-1.7e308, 1.7e308]) == "▁█"


def test_statistics_of_odd_numbers() -> None:
    talk = begun()
    contents = [struct.pack(">f", value) for value in (1.0, math.nan, math.inf, 3.0)]
    for ref, octets in enumerate(contents, 1):
        reads(talk, ref, (db(REAL, 0), octets), (db(BIT, 9), bytes([ref % 2])))
    found = collected(ValueCollector(sums=True), talk.packets())
    number, bit = [one.statistics or Statistics() for one in found.variables]
    assert (number.count, number.numbers, number.least, number.most, number.mean) == (4, 2, 1.0, 3.0, 2.0)
    assert (bit.least, bit.most, bit.mean) == (0, 1, 0.5)


def plant() -> Talk:
    """A level that rises and is written, a word that stays, octets, a word that is not there, a write that is refused."""
    talk = begun()
    for ref, level in enumerate((1.0, 2.5, 2.5, 4.0), 1):
        reads(talk, ref, (db(REAL, 0), real(level)), (db(WORD, 8), b"\0\7"), (db(BYTE, 20, 4), bytes((ref, 2, 3, 4))))
    writes(talk, 5, (db(REAL, 0), real(8.0), 0xFF))
    writes(talk, 6, (db(REAL, 0), real(9.0), 0x05))
    reads(talk, 7, (db(WORD, 90), 0x0A), (db(BIT, 12), b"\1"))
    return talk


def summary_of(talk: Talk, spark: bool = False) -> Summary:
    return Summary(collected(ValueCollector(sums=True), talk.packets()), spark)


def test_a_table_for_a_person() -> None:
    lines = text_lines(summary_of(plant()), Clock(), Places([], False))
    assert [row.text for row in lines] == [
        "10.0.0.2:102: 5 variables",
        ("  variable     type      count  first        last         "
        "min  max  mean  period          distinct  read by       written by    refused"),
        ("  DB1.DBD0     REAL          5  1.0          8.0          "
        "1.0  8.0   3.6  2.00 ms ± 0 µs         4  10.0.0.1 (4)  10.0.0.1 (1)  1 write"),
        "  DB1.DBW8     WORD          4  7            =              7    7     7  2.00 ms ± 0 µs         1  10.0.0.1 (4)",
        "  DB1.DBB20    4 x BYTE      4  01 02 03 04  04 02 03 04                  2.00 ms ± 0 µs         4  10.0.0.1 (4)",
        f"  DB1.DBW90    WORD          0{' ' * 98}1 read",
        f"  DB1.DBX12.0  BOOL          1  true{' ' * 61}1  10.0.0.1 (1)",
    ]  # fmt: skip


def test_sparklines_are_columns_of_their_own() -> None:
    plain = text_lines(summary_of(plant()), Clock(), Places([], False))
    lines = text_lines(summary_of(plant(), spark=True), Clock(), Places([], False))
    assert lines[1].text.endswith("  trend")
    assert "trend" not in plain[1].text
    assert lines[2].text.split()[-1] == "▁▁▂▂▂▂▄█"
    assert lines[3].text.split()[-1] == "▅▅▅▅▅▅▅"
    assert lines[6].text.endswith("10.0.0.1 (1)")  # of one number there is nothing to draw


def test_a_table_has_a_heading_and_lines_that_hang() -> None:
    heading, columns, *rows = text_lines(summary_of(plant()), Clock(), Places([], False))
    assert (heading.style, columns.style, {row.style for row in rows}) == (HEADING, DIM, {PLAIN})
    assert (heading.hang, columns.hang, {row.hang for row in rows}) == (0, 6, {6})


def test_each_plc_has_a_table_of_its_own() -> None:
    collector = ValueCollector(sums=True)
    first = line.Talk()
    first.pipeline = Pipeline(collector, Options(strict=True))
    for number, vlan in enumerate((0, 7)):
        talk = first if not number else line.Talk(50001, beside=first)
        talk.vlan = vlan
        talk.open()
        talk.ask(line.read(1, line.dbw(1, 0)))
        talk.tell(line.words(1, 5))
    lines = [row.text for row in text_lines(Summary(collector), Clock(), Places([], False, {"10.0.0.1": "panel"}))]
    assert [lines[at] for at in (0, 3, 4)] == ["10.0.0.2:102: 1 variable", "", "10.0.0.2:102 in VLAN 7: 1 variable"]
    assert lines[2] == lines[6]
    assert "panel (1)" in lines[2]


def test_what_has_no_value_is_there_where_it_was_refused() -> None:
    """A variable that was only asked for in vain is a row; what it has no number of is empty, in JSON null."""
    talk = begun()
    reads(talk, 1, (db(WORD, 0), 0x0A), (db(REAL, 4), real(math.nan)), (db(BYTE, 8, 3), b"\1\2"))
    writes(talk, 2, (db(WORD, 0), b"\0\1", 0x05))
    talk.send(0, line.dt(line.write(3, [line.dbw(1, 0)], line.written(4, b"\0\1"))))
    summary = summary_of(talk)
    missing, number, octets = [json.loads(row) for row in json_lines(summary)]
    assert [missing[key] for key in ("count", "first", "last", "min", "mean", "period_ns")] == [0, *[None] * 5]
    assert [missing[key] for key in ("refused_reads", "refused_writes", "unconfirmed_writes")] == [1, 1, 1]
    assert (number["count"], number["min"], number["mean"]) == (1, None, None)
    assert (octets["count"], octets["first"], octets["distinct"]) == (1, None, 1)  # fewer bytes than were asked for
    rows = list(csv_rows(summary))
    cells = [dict(zip(rows[0], row, strict=True)) for row in rows[1:]]
    assert (cells[0]["refused_reads"], cells[0]["first"], cells[0]["min"]) == ("1", "", "")
    assert (cells[2]["first"], cells[2]["last"]) == ("01 02", "01 02")
    text = text_lines(summary, Clock(), Places([], False))
    assert text[2].text.endswith("1 read, 1 write, 1 write unconfirmed")
    assert text[4].text.split() == ["DB1.DBB8", "3", "x", "BYTE", "1", "01", "02", "1", "10.0.0.1", "(1)"]


def test_two_numbers_are_drawn() -> None:
    talk = begun()
    for ref, value in enumerate((0.0, 7.0), 1):
        reads(talk, ref, (db(REAL, 0), real(value)))
    lines = text_lines(summary_of(talk, spark=True), Clock(), Places([], False))
    assert lines[2].text.endswith("10.0.0.1 (2)  ▁▁█")  # 2 ms from one to the other


def test_values_in_a_row_are_shown_as_such() -> None:
    talk = begun()
    reads(
        talk, 1, (db(INT, 0, 2), b"\0\1\xff\xfe"), (db(REAL, 8, 2), real(1.5) + real(-2.0)), (db(BYTE, 20, 2), b"\1\2")
    )
    summary = summary_of(talk)
    lines = [row.text.split("  ") for row in text_lines(summary, Clock(), Places([], False))[2:]]
    said = ["[1, -2]", "[1.5, -2.0]", "01 02"]
    assert [value for value, line in zip(said, lines, strict=True) if value in line] == said
    heads, *rows = csv_rows(summary)
    assert [row[heads.index("first")] for row in rows] == said
    assert [json.loads(row)["first"] for row in json_lines(summary)] == [[1, -2], [1.5, -2.0], [1, 2]]


def test_a_summary_in_cells() -> None:
    heads, *rows = csv_rows(summary_of(plant()))
    level, word, octets, *_ = [dict(zip(heads, row, strict=True)) for row in rows]
    assert [level[key] for key in ("address", "type", "count", "changes", "first", "last", "min", "max", "mean")] == [
        "DB1.DBD0", "REAL", "5", "3", "1.0", "8.0", "1.0", "8.0", "3.6",
    ]  # fmt: skip
    assert (level["readers"], level["writers"], level["distinct_more"]) == ("10.0.0.1 4", "10.0.0.1 1", "false")
    assert (octets["first"], octets["last"]) == ("01 02 03 04", "04 02 03 04")
    assert (word["first"], word["last"], word["refused_writes"], word["likely"]) == ("7", "7", "0", "0")


def test_a_variable_that_nobody_told_a_value_of_is_no_row() -> None:
    """One that was only named is left out; one that counts for anything is there."""
    talk = begun()
    reads(talk, 1, (db(WORD, 0), b"\0\1"))
    found = collected(ValueCollector(), talk.packets())  # without sums: no statistics
    assert Summary(found).variables == []
    for name in ("refused_reads", "refused_writes", "unconfirmed", "likely"):
        (only,) = found.variables
        setattr(only, name, 1)
        assert Summary(found).variables == [only], name
        setattr(only, name, 0)


@pytest.mark.parametrize("clients", [1, 8, 9, 11])
def test_clients_beyond_the_bound_are_counted_together(clients: int) -> None:
    collector = ValueCollector(sums=True)
    first = line.Talk()
    first.pipeline = Pipeline(collector, Options(strict=True))
    for number in range(clients):
        talk = first if not number else line.Talk(50000 + number, beside=first)
        talk.hosts = [10 + number, 2]
        talk.open()
        for ref in (1, 2):
            talk.ask(line.read(ref, line.dbw(1, 0)))
            talk.tell(line.words(ref, 5))
    (variable,) = collector.variables
    found = variable.statistics
    assert found is not None
    kept = min(clients, 8)
    assert {host: pace.count for host, pace in found.readers.items()} == {f"10.0.0.{10 + at}": 2 for at in range(kept)}
    assert (found.count, found.others) == (2 * clients, 2 * (clients - kept))


def test_the_pace_is_that_of_who_read_most_or_else_wrote_most() -> None:
    found = Statistics()
    assert found.pace is None
    for clients, count in (("writers", 3), ("readers", 1)):
        pace = Pace()
        for at in range(count):
            pace.add(at * _MS)
        getattr(found, clients)[clients] = pace
    assert found.pace is found.writers["writers"]  # nobody read twice
    for name, count in (("often", 5), ("seldom", 2), ("less", 4)):
        found.readers[name] = Pace()
        for at in range(count):
            found.readers[name].add(at * _MS)
    assert found.pace is found.readers["often"]
    assert found.pace.period_ns == _MS


@each(
    ("mean", "least", "most", "expected"),
    [
        (1.0, 1.0, 1.0, "1"), (2 / 3, 0.0, 1.0, "0.666666667"), (1e300, 0.0, 1e301, "1e+300"), (math.inf, 0.0, 1.0, "inf"),
        (123456789012.0, 0, 2e11, "123456789012"), (0.1 + 0.2, 0.30000000000000004, 0.30000000000000004, "0.30000000000000004"),
        (5.0, 6, 7, "6"), (9.0, 6, 7, "7"),
        (0.10000000000000003, 0.10000000000000002, 0.10000000000000005, "0.10000000000000003"),
        (1234567890123456.0, 1, 2e15, "1234567890123456"), (12345678901234568.0, 1, 2e16, "1.23456789e+16"),
    ],
)  # fmt: skip
def test_a_mean_has_as_many_digits_as_it_needs(mean: float, least: float, most: float, expected: str) -> None:
    assert mean_text(mean, least, most) == expected


@each(
    ("points", "levels", "expected"),
    [
        ([math.nan, 1.0, 2.0], "ab", " ab"),
        ([math.nan], "ab", ""),
        ([0.0, 1.0, 2.0, 3.0], "abcd", "abcd"),
        ([0.0, 0.99, 2.01, 4.0], "abcd", "aacd"),
        ([-4.0, 0.0, 4.0], "abc", "abc"),
        ([3.0, math.nan, math.nan, 1.0], "ab", "bbba"),
    ],
)
def test_a_sparkline_of_any_levels(points: list[float], levels: str, expected: str) -> None:
    assert sparkline(points, levels) == expected


def test_a_long_value_is_cut_in_the_table() -> None:
    for size, length in ((12, 35), (13, 36), (40, 36)):
        talk = begun()
        reads(talk, 1, (db(BYTE, 0, size), bytes(size)))
        text = text_lines(summary_of(talk), Clock(), Places([], False))[2].text
        shown = text.partition(" 1  ")[2].partition("   ")[0].strip()
        assert len(shown) == length
        assert shown.endswith("…") == (size > 12)


def test_sums_are_in_the_same_order_of_time_as_their_rows() -> None:
    """The clock of the capture goes back: the earliest point takes the number, and nothing raises."""
    talk = begun()
    reads(talk, 1, (db(WORD, 0), b"\0\1"))
    (row,) = rows_of(talk)
    found = Statistics()
    for time_ns, number in ((5 * _MS, 1), (6 * _MS, 7), (9 * _MS // 2, 8)):
        found._take(number, time_ns, row.link, 0, False)
    assert found.trend == [8.0, 7.0]
    found = Statistics()
    for time_ns, number in ((5 * _MS, 1), (9 * _MS, 2), (3 * _MS, 3), (5 * _MS, 4)):
        found._take(number, time_ns, row.link, 0, False)
    assert [None if math.isnan(point) else point for point in found.trend] == [4.0, None, None, None, 2.0]
    assert (found.count, found.numbers, found.total, found.least, found.most) == (4, 4, 10.0, 1, 4)
