"""The pages of `man`: one for each command, with its options, examples and exit codes as its help has them."""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Final

import click
import pytest

from dissect.cli.examples import EXAMPLES
from dissect.cli.main import COMMANDS, group
from tests.cli.test_outputs import commands

ROOT: Final = Path(__file__).resolve().parent.parent
SCRIPT: Final = ROOT / "scripts" / "man_pages.py"
#: Text that roff would take for something of its own, or show as other characters.
NAUGHTY: Final = (
    ".SH a request\n'ft with a quote\n\\fBbold\\fP \\n(.x \\*[date]",
    "back\\slash \\ at the end\\",
    "'quotes' `and` \"more\" -- --option=-1 ^ ~ | {} [] %s $1",
    "Привет, йод, café, Ärger: … → µs ½",
    ".\n..\n'\n\\\n.\\\" no comment",
)


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """The pages as a build makes them, by name."""
    folder = tmp_path_factory.mktemp("man1")
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    subprocess.run([sys.executable, SCRIPT, folder], env=environment, check=True, capture_output=True, timeout=60)
    return {path.stem: path for path in folder.iterdir()}


@pytest.fixture(scope="module")
def shown(pages: dict[str, Path]) -> dict[str, str]:
    """The pages as a terminal shows them."""
    return {name: rendered(path) for name, path in pages.items()}


@pytest.fixture(scope="module")
def script() -> ModuleType:
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("man_pages", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def rendered(*files: Path, source: str = "", columns: int = 80) -> str:
    """Return pages as a terminal shows them; every warning of groff is an error."""
    if not shutil.which("groff"):
        pytest.skip("needs groff (apt install groff-base)")
    style = ["-man", "-Tutf8", f"-rLL={columns}n", "-rHY=0", "-P-c", "-P-b", "-P-o", "-P-u"]
    ran = subprocess.run(
        ["groff", "-ww", *style, *map(str, files)],
        input=source, capture_output=True, encoding="utf-8", check=True, timeout=60,
    )  # fmt: skip
    assert ran.stderr == ""
    return ran.stdout


def words(text: str) -> str:
    """Return text without its line breaks."""
    return " ".join(text.split())


def test_every_command_has_its_page(shown: dict[str, str]) -> None:
    paths = ["", *COMMANDS, *commands()]
    assert set(shown) == {f"s7dissect {path}".strip().replace(" ", "-") for path in paths}
    for name, page in shown.items():
        assert max(map(len, page.splitlines())) <= 80, name
        assert f"\nNAME\n       {name} " in page


def test_a_page_says_what_the_help_says(shown: dict[str, str]) -> None:
    for name, command in commands().items():
        page = shown[f"s7dissect-{name.replace(' ', '-')}"]
        said = words(page)
        with click.Context(group, info_name="s7dissect") as root, click.Context(command, root, name) as ctx:
            records = [
                one.get_help_record(ctx)
                for one in command.get_params(ctx)
                if isinstance(one, click.Option) and not one.hidden
            ]
            usage = words(f"s7dissect {name} {' '.join(command.collect_usage_pieces(ctx))}")
        assert records
        for record in records:
            assert record is not None
            assert words(f"{record[0]} {record[1]}") in said, (name, record)
        assert usage in said
        for paragraph in (command.help or "").replace("\b\n", "").split("\n\n"):
            assert words(paragraph) in said, name
        for line in EXAMPLES[name]:
            assert f"\n   {line}\n" in page, line
        (codes,) = [text for text in (command.epilog or "").split("\n\n") if text.startswith("Exit code: ")]
        listed = page.partition("\nEXIT STATUS\n")[2].partition("\nSEE ALSO\n")[0]
        expected = re.findall(r"(?:: |[,;] )(?:and )?(\d+) (?=[a-z-])", codes)
        assert re.findall(r"^ {7}(\d+)\b", listed, re.MULTILINE) == expected


def test_the_first_page_has_the_codes_and_variables_of_the_docs(shown: dict[str, str]) -> None:
    page = shown["s7dissect"]
    for code in ("0", "1", "2", "3", "5", "130"):
        assert f"\n       {code} " in page
    for name in ("NO_COLOR", "COLUMNS", "TZ", "PAGER"):
        assert f"\n       {name}" in page
    for name, summary in COMMANDS.items():
        assert words(f"s7dissect-{name}(1) {summary}") in words(page)


def test_no_text_is_taken_for_roff(script: ModuleType) -> None:
    source = "\n".join([f".nf\n{script.roff(text)}\n.fi" for text in NAUGHTY])
    lines = [line.strip() for line in rendered(source=f".TH T 1\n.SH TEXT\n{source}\n", columns=200).splitlines()]
    at = lines.index("TEXT")
    expected = [line for text in NAUGHTY for line in text.split("\n")]
    assert lines[at + 1 : at + 1 + len(expected)] == expected


def test_what_click_keeps_in_lines_stays_in_lines(script: ModuleType) -> None:
    source = script.paragraphs("First\nparagraph.\n\n\b\none\ntwo\n\nLast.")
    shown = rendered(source=f".TH T 1\n.SH TEXT\n{source}\n")
    assert "First paragraph." in shown
    assert "\n       one\n       two\n" in shown
