"""The documents tell the truth: snippets run, printed output is real output, the catalogue's page is the catalogue."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
import shutil
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import dissect
from dissect.cli.main import COMMANDS
from tests.cli.support import run as cli
from tests.conftest import Command
from tests.extras import hidden_modules, hiding

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SNIPPETS = re.findall(r"```python\n(.*?)```", README, re.DOTALL)


def run(*arguments: str, codes: tuple[int, ...] = (0,)) -> str:
    done = subprocess.run(
        [sys.executable, *arguments], cwd=ROOT, capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode in codes, done.stderr
    return done.stdout


def test_the_readme_has_snippets() -> None:
    assert len(SNIPPETS) == 4


def test_the_readme_can_be_read_at_once() -> None:
    assert len(README.splitlines()) <= 250


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_a_snippet_runs_and_prints(snippet: str) -> None:
    assert run("-c", hiding("s7dissect[data] pandas" if "frames" in snippet else "") + snippet).strip()


PAGES = [path.name for path in sorted((ROOT / "docs").glob("*.md"))]
#: Pages whose Python runs as it stands, beside the captures and the files of SCD's example.
RUNNING = ("api.md", "devices.md", "golden.md", "scd-traffic.md", "scd.md", "select.md", "tags.md", "values.md")


def python_of(page: str) -> list[str]:
    """Return the Python of a page that is no session at a prompt."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return [block for block in re.findall(r"```python[^\n]*\n(.*?)```", text, re.DOTALL) if ">>>" not in block]


@pytest.mark.parametrize("page", [page for page in PAGES if python_of(page)])
def test_what_a_page_imports_is_there(page: str) -> None:
    for block in python_of(page):
        for one in ast.walk(ast.parse(block)):
            if isinstance(one, ast.ImportFrom) and (one.module or "").split(".")[0] == "dissect":
                found = importlib.import_module(one.module or "")
                assert [alias.name for alias in one.names if not hasattr(found, alias.name)] == []


@pytest.mark.parametrize("page", RUNNING)
def test_the_python_of_a_page_runs_with_the_extras_that_it_names(page: str, tmp_path: Path) -> None:
    blocks = [block for block in python_of(page) if "pump.eds" not in block]  # which nobody has
    assert blocks
    (tmp_path / "captures").symlink_to(ROOT / "captures")
    for path in (ROOT / "captures" / "scd").glob("plant.*"):
        shutil.copy(path, tmp_path)
    done = subprocess.run(
        [sys.executable, "-c", "\n".join([hiding((ROOT / "docs" / page).read_text(encoding="utf-8")), *blocks])],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr


#: Each page that shows output of commands, and how often.
SHOWING = {"README.md": 2, "docs/devices.md": 1, "docs/recipes.md": 15, "docs/tutorial.md": 8, "docs/values.md": 2}
OUTPUTS = [
    (name, command, shown)
    for name in SHOWING
    for command, shown in re.findall(
        r"```(?:console)?\n\$ s7dissect (.*?)\n(.*?)```", (ROOT / name).read_text(encoding="utf-8"), re.DOTALL
    )
]


def test_the_pages_show_output() -> None:
    assert Counter([name for name, _, _ in OUTPUTS]) == SHOWING


def test_the_page_of_tables_is_their_definition() -> None:
    assert run("scripts/tables_doc.py") == (ROOT / "docs" / "tables.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("page", "command", "shown"), OUTPUTS)
def test_the_output_in_a_page_is_real(
    capfdbinary: pytest.CaptureFixture[bytes], monkeypatch: pytest.MonkeyPatch, page: str, command: str, shown: str
) -> None:
    """The lines shown are lines of the real output in their order; … stands for those left out."""
    monkeypatch.chdir(ROOT)
    ran = cli(capfdbinary, *shlex.split(command))
    assert ran.code in {0, 1, 2 if "Error: " in shown else 0}, ran.err  # 1: there are differences
    real = (ran.out + ran.err).splitlines()
    at = 0
    for line in shown.splitlines():
        if line.strip() == "…":
            at = -1  # some lines are left out: the next one stands further down
            continue
        at = real.index(line) if at < 0 else at
        assert real[at] == line
        at += 1


@pytest.mark.parametrize(("page", "command", "shown"), [one for one in OUTPUTS if one[0] != "README.md"])
def test_a_command_of_a_page_runs_with_the_extras_that_it_names(page: str, command: str, shown: str) -> None:
    arguments = ["s7dissect", *shlex.split(command)]
    program = (
        f"{hiding((ROOT / page).read_text(encoding='utf-8'))}\nsys.argv = {arguments!r}\nimport dissect.__main__\n"
    )
    run("-c", f"{program}dissect.__main__.main()", codes=(0, 1, 2 if "Error: " in shown else 0))


def test_an_extra_that_a_page_does_not_name_is_hidden() -> None:
    assert {"pyarrow", "duckdb", "textual", "numpy"} <= hidden_modules("nothing is named")
    assert hidden_modules("pip install 's7dissect[data,scd]'").isdisjoint({"pyarrow", "duckdb", "numpy", "anycrc"})
    assert "textual" in hidden_modules("pip install 's7dissect[data,scd]'")
    assert not hidden_modules("nothing is named") & {"click", "scapy", "lark", "rich", "msgspec"}
    with pytest.raises(AssertionError, match="hidden: no extra of this page has it"):
        run("-c", hiding("") + "import pyarrow")


def test_the_comment_in_the_page_of_evidence_is_real(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    shown = re.search(
        r"^    3\t(s7dissect: .*)$", (ROOT / "docs" / "evidence.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert shown is not None
    out = tmp_path / "stop.pcapng"
    capture = str(ROOT / "captures" / "plc-control.pcapng")
    assert cli(capfdbinary, "cut", capture, "-o", str(out), "--finding", "security.plc_stop", "--around", "2").code == 0
    assert shown[1].encode() in out.read_bytes()


def test_every_command_and_option_in_the_recipes_exists(s7dissect: Command) -> None:
    tutorial = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    pages = README + (ROOT / "docs" / "recipes.md").read_text(encoding="utf-8")
    recipes = re.findall(r"`s7dissect (\w+) ([^`]*)`", pages) + re.findall(
        r"^s7dissect (\w+) (.*)$", tutorial, re.MULTILINE
    )
    assert len(recipes) >= 8
    help_texts = {name: s7dissect(name, "--help").stdout.decode() for name in {name for name, _ in recipes}}
    for name, arguments in recipes:
        for option in re.findall(r"(?<!\S)(--?[A-Za-z][\w-]*)", arguments):
            assert option in help_texts[name], f"s7dissect {name} has no {option}"


def test_the_tables_of_block_code_are_those_of_the_decoder() -> None:
    assert run("scripts/mc7_doc.py") == (ROOT / "docs" / "mc7.md").read_text(encoding="utf-8")


def test_the_page_of_the_api_is_made_from_the_source() -> None:
    assert run("scripts/api_doc.py") == (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    names = {name for name in dir(dissect) if name in dissect._PUBLIC}
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    listed, _, given = page.partition("\n## What these give\n")
    assert set(re.findall(r"^### (\w+)$", listed, re.MULTILINE)) == names
    assert {"Live", "Stream", "Frames", "Endpoint"} <= set(re.findall(r"^### (\w+)$", given, re.MULTILINE))


def test_the_page_of_findings_is_the_catalogue() -> None:
    assert run("scripts/findings_doc.py") == (ROOT / "docs" / "findings.md").read_text(encoding="utf-8")


def test_the_page_of_known_bugs_is_the_table() -> None:
    assert run("scripts/known_bugs_doc.py") == (ROOT / "docs" / "known-bugs.md").read_text(encoding="utf-8")


def test_the_pictures_are_there_and_small_and_fetch_nothing() -> None:
    """``python scripts/pictures.py`` draws them."""
    named = re.findall(r'<img src="(.*?)"', README)
    assert named == ["docs/browser.png", "docs/report.png", "docs/monitor.svg"]
    for name in named:
        assert (ROOT / name).stat().st_size < 200_000, name
    assert (ROOT / named[0]).read_bytes().startswith(b"\x89PNG")
    assert re.findall(r"(?:url\(.?|href=.)https?:", (ROOT / "docs/monitor.svg").read_text(encoding="utf-8")) == []


def test_the_page_of_commands_has_all_of_them_and_who_takes_which_option(s7dissect: Command) -> None:
    page = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    cells = [line.split(" | ")[0] for line in page.split("\n\n")[1].splitlines()]
    assert set(re.findall(r"`([a-z-]+)[ `]", "\n".join(cells))) == set(COMMANDS)
    helps = {name: s7dissect(name, "--help").stdout.decode() for name in COMMANDS}
    for option, told in (
        ("--where EXPR", re.search(r"^(`analyze`, .*) take `-Y EXPR`", page, re.MULTILINE)),
        ("--fail-on WHAT", re.search(r"^`--fail-on WHAT` \((.*);", page, re.MULTILINE)),
    ):
        assert told is not None
        takes = {name for name, text in helps.items() if option in text} - {
            "index",
            "extcap",
        }  # which say so themselves
        assert set(re.findall(r"`([a-z-]+)`", told[1])) == takes
