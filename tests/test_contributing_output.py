"""The recipe "To add an output" of CONTRIBUTING.md, carried out on a copy of the tree; there the suites that it names run."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from tests.test_contributing import GUIDE, Tree, listed

RECIPE: Final = "To add an output"
WRITER: Final = '''"""Transactions as tab-separated values."""

from __future__ import annotations

from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.words import Places
from dissect.meaning.report.writer import Writer


class TabWriter(Writer):
    """Writes the names of the columns, then a row for each transaction."""

    def begin(self, places: Places) -> None:
        """Begin with the names."""
        super().begin(places)
        self.lines.append("number\\tfunction\\tcertainty\\tdoubt")

    def transaction(self, transaction: Transaction) -> None:
        """Add a row."""
        name, certainty = transaction.function_name, transaction.certainty
        self.lines.append(f"{transaction.number}\\t{name}\\t{certainty}\\t{transaction.doubt}")
'''
LAST_ROW: Final = """        _row("junit", "JUnit XML", ("dissect.meaning.report.writers.junit:junit_outcome", (DIFFERENCES,))),
"""
TABS_ROW: Final = """        _row("tabs", "with tabs", ("dissect.meaning.report.writers.tabs:TabWriter", (TRANSACTIONS,))),
"""
CSV_DESCRIBED: Final = "| `s7dissect transactions -T csv FILE…` | "
TABS_DESCRIBED: Final = "| `s7dissect transactions -T tabs FILE…` | a row for each transaction | | |\n"
READING: Final = """def tabs(fd: Capture, _: Path) -> Told:
    rows = csv.DictReader(io.StringIO(run(fd, "transactions", "-T", "tabs", CAPTURE).out), delimiter="\\t")
    return by_columns(rows, "number")


def fields(fd: Capture, _: Path) -> Told:
"""


def test_to_add_an_output(tmp_path: Path) -> None:
    tree = Tree(tmp_path / "tree")
    tree.write("dissect/meaning/report/writers/tabs.py", WRITER)
    tree.replace("dissect/meaning/report/formats.py", LAST_ROW, LAST_ROW + TABS_ROW)
    tree.replace("docs/json.md", CSV_DESCRIBED, TABS_DESCRIBED + CSV_DESCRIBED)
    tree.replace("tests/cli/test_outputs.py", '"junit", "html", "fields"', '"junit", "html", "tabs", "fields"')
    faces = "tests/promises/test_certainty.py"
    tree.replace(faces, "def fields(fd: Capture, _: Path) -> Told:\n", READING)
    tree.replace(faces, '    "fields": fields,\n', '    "fields": fields,\n    "tabs": tabs,\n')
    assert {name.replace("tabs", "NAME") for name in tree.touched()} == listed(RECIPE)
    section = GUIDE[GUIDE.index(f"### {RECIPE}\n") :].partition("\n### ")[0]
    (command,) = re.findall(r"^\.venv/bin/pytest (.*)$", section, re.MULTILINE)
    # Of the suites those tests that look at the table of formats: captures of all kinds, which others read, take minutes.
    chosen = "test_formats or called_the_same or row_and_a_schema or left_out or tabs"
    told = tree.python("-m", "pytest", "-q", "-n", "0", "-p", "no:cacheprovider", "-k", chosen, *command.split())
    assert re.search(r"^\d\d+ passed", told, re.MULTILINE), told
