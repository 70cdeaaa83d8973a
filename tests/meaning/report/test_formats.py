"""The table of formats: every row writes what it says it takes, and a new format is one file and one row."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from dissect.meaning.report.formats import (
    ANALYSIS,
    EVENTS,
    FORMATS,
    KINDS,
    OPERATIONS,
    PDUS,
    TRANSACTIONS,
    Format,
    formats_for,
)
from dissect.meaning.report.writer import OperationFeed, PduFeed, TransactionFeed, Writer
from tests.cli.support import run, simple
from tests.meaning.report.support import begun, observed, read

Capture = pytest.CaptureFixture[bytes]

FEEDS: dict[str, Callable[[Writer], Any]] = {TRANSACTIONS: TransactionFeed, PDUS: PduFeed, OPERATIONS: OperationFeed}

#: A format of somebody's own: one file.
MADE = '''
from dissect.meaning.report.writer import Writer


class MarkdownWriter(Writer):
    """A row of a table for each record."""

    def begin(self, places):
        super().begin(places)
        self.lines.append("| what |")

    def transaction(self, transaction):
        self.lines.append(f"| {transaction.number} {transaction.function_name} {transaction.outcome} |")

    def operation(self, operation):
        self.lines.append(f"| {operation.kind} {operation.result} |")

    def pdu(self, frame, time_ns, side, octets, cut):
        self.lines.append(f"| {self.places.number(frame)} {len(octets)} bytes |")


def summary(outcome):
    yield f"# {outcome.as_dict()['transactions']['total']} transactions"
'''


@pytest.fixture
def markdown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterable[Format]:
    """A made format: its file on the path, its row in the table."""
    (tmp_path / "made_markdown.py").write_text(MADE, encoding="utf-8")
    monkeypatch.syspath_prepend(str(tmp_path))
    writers = dict.fromkeys((TRANSACTIONS, PDUS, OPERATIONS), "made_markdown:MarkdownWriter")
    row = Format("markdown", "a table", {**writers, ANALYSIS: "made_markdown:summary"})
    monkeypatch.setitem(FORMATS, row.name, row)
    yield row
    sys.modules.pop("made_markdown", None)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_formats_and_text_comes_first(kind: str) -> None:
    rows = formats_for(kind)
    assert len(rows) >= 2
    assert rows[0].name == "text"
    for row in rows:
        assert callable(row.maker(kind))
        assert row.about


def test_rows_have_their_names_and_take_only_known_kinds() -> None:
    assert {name: row.name for name, row in FORMATS.items()} == {name: name for name in FORMATS}
    for row in FORMATS.values():
        assert set(row.writers) <= set(KINDS)
    with pytest.raises(KeyError):
        FORMATS["csv"].maker(EVENTS)


@pytest.mark.parametrize(("kind", "name"), [(kind, row.name) for kind in FEEDS for row in formats_for(kind)], ids=str)
def test_every_row_writes_what_it_takes(kind: str, name: str) -> None:
    writer = FORMATS[name].writer(kind)
    observed(FEEDS[kind](writer), read(read(begun(), 1), 2).packets())
    lines = writer.take()
    assert lines
    assert len({type(line) for line in lines}) == 1  # all text, all octets, or all with a style
    assert writer.take() == []


def test_a_feed_hands_on_nothing_else() -> None:
    counted: list[str] = []

    class Counting(Writer):
        def transaction(self, transaction: Any) -> None:
            counted.append("transaction")

        def operation(self, operation: Any) -> None:
            counted.append("operation")

        def finding(self, finding: Any) -> None:
            counted.append("finding")

        def pdu(self, *_: Any) -> None:
            counted.append("pdu")

    packets = read(read(begun(), 1), 2, content=0x0A).packets()
    for kind, feed in FEEDS.items():
        counted.clear()
        observed(feed(Counting()), packets)
        assert set(counted) == {{TRANSACTIONS: "transaction", PDUS: "pdu", OPERATIONS: "operation"}[kind]}


# ---- a format of somebody's own -------------------------------------------------------------------------------------


@pytest.mark.usefixtures("markdown")
def test_a_made_format_works_in_every_command_that_it_takes_results_of(capfdbinary: Capture, tmp_path: Path) -> None:
    file = simple(tmp_path / "a.pcapng")
    ran = run(capfdbinary, "transactions", file, "-T", "markdown")
    assert ran.code == 0, ran.err
    assert ran.out.splitlines() == [
        "| what |",
        "| 1 Setup communication answered |",
        "| 2 Read Var answered |",
        "| 3 Read Var answered |",
        "| 4 Read Var answered |",
    ]
    failed = run(capfdbinary, "transactions", file, "-T", "markdown", "--failed")
    assert failed.out.splitlines() == ["| what |", "| 3 Read Var answered |"]
    assert run(capfdbinary, "operations", file, "-T", "markdown").out.splitlines() == ["| what |", "| connect done |"]
    shown = run(capfdbinary, "show", file, "-T", "markdown", "--frame", "8", "--frame", "4")
    assert shown.out.splitlines() == ["| what |", "| 8 24 bytes |"]
    assert "packet 4 completes no message" in shown.err  # of this format: it writes no TPDUs
    assert run(capfdbinary, "analyze", file, "-T", "markdown").out == "# 4 transactions\n"


@pytest.mark.usefixtures("markdown")
def test_a_made_format_is_in_the_help_of_these_commands_only(capfdbinary: Capture) -> None:
    for command in ("transactions", "operations", "show", "analyze"):
        assert "markdown" in run(capfdbinary, command, "--help").out
    for command in ("monitor", "diff", "interfaces"):
        assert "markdown" not in run(capfdbinary, command, "--help").out


@pytest.mark.usefixtures("markdown")
def test_what_a_made_format_lacks_is_refused(capfdbinary: Capture, tmp_path: Path) -> None:
    file = simple(tmp_path / "a.pcapng")
    ran = run(capfdbinary, "show", file, "-T", "markdown", "-V")
    assert (ran.code, ran.out) == (2, "")
    assert "-V applies to text only" in ran.err
    ran = run(capfdbinary, "diff", file, file, "-T", "markdown")
    assert ran.code == 2
    assert "markdown is for analyze, transactions, operations, show." in ran.err


@pytest.mark.parametrize(
    ("command", "wrong", "hint"),
    [
        ("transactions", "CSV", "Did you mean csv?"),
        ("show", "jsnl", "Did you mean jsonl?"),
        ("analyze", "jsonn", "Did you mean json?"),
        ("show", "csv", "csv is for transactions, values, blocks, devices, sql."),
        ("tags check", "junit", "junit is for diff, replay."),
        ("operations", "zzz", "'zzz' is not one of 'text', 'jsonl', 'fields'."),
    ],
)
def test_a_wrong_format_is_answered_with_the_nearest(
    capfdbinary: Capture, tmp_path: Path, command: str, wrong: str, hint: str
) -> None:
    ran = run(capfdbinary, *command.split(), simple(tmp_path / "a.pcapng"), "-T", wrong)
    assert (ran.code, ran.out) == (2, "")
    assert hint in ran.err
    assert ("Did you mean" in ran.err) == ("Did you mean" in hint)


def test_the_help_lists_the_table(capfdbinary: Capture) -> None:
    text = " ".join(run(capfdbinary, "transactions", "--help").out.split())
    rows = formats_for(TRANSACTIONS)
    assert len(rows) > 3
    assert f"[{'|'.join([row.name for row in rows])}]" in text
    for row in rows:
        assert f"{row.name} ({row.about})" in text


def test_no_command_asks_for_a_format_by_name() -> None:
    """The table alone knows names; a command that compares with one would not know the next."""
    names = [f'"{name}"' for name in FORMATS]
    folder = Path(__file__).resolve().parents[3] / "dissect" / "cli"
    found = [
        (path.name, line)
        for path in sorted(folder.rglob("*.py"))
        for line in path.read_text(encoding="utf-8").splitlines()
        if "format_" in line and any(name in line for name in names)
    ]
    assert found == []


def test_json_of_records_is_the_same_however_it_is_asked_for(capfdbinary: Capture, tmp_path: Path) -> None:
    file = simple(tmp_path / "a.pcapng")
    local = run(capfdbinary, "transactions", file, "-T", "jsonl", "--local-time").out
    assert local == run(capfdbinary, "transactions", file, "-T", "jsonl").out
    assert [json.loads(line)["number"] for line in local.splitlines()] == [1, 2, 3, 4]
