"""The documents tell the truth: snippets run, printed output is real output, the catalogue's page is the catalogue."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

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


@pytest.mark.parametrize("snippet", SNIPPETS)
def test_a_snippet_runs_and_prints(snippet: str) -> None:
    assert run("-c", snippet).strip()


OUTPUTS = re.findall(r"```\n\$ s7dissect (.*?)\n(.*?)```", README, re.DOTALL)


def test_the_readme_shows_output() -> None:
    assert len(OUTPUTS) == 16


def test_the_page_of_tables_is_their_definition() -> None:
    assert run("scripts/tables_doc.py") == (ROOT / "docs" / "tables.md").read_text(encoding="utf-8")


@pytest.mark.parametrize(("command", "shown"), OUTPUTS)
def test_the_output_in_the_readme_is_real(command: str, shown: str) -> None:
    """The lines shown are lines of the real output in their order; … stands for those left out."""
    real = run("-m", "dissect", *command.split(), codes=(0, 1)).splitlines()  # 1: there are differences
    at = 0
    for line in shown.splitlines():
        if line.strip() == "…":
            at = -1  # some lines are left out: the next one stands further down
            continue
        at = real.index(line) if at < 0 else at
        assert real[at] == line
        at += 1


def test_every_command_and_option_in_the_recipes_exists() -> None:
    recipes = re.findall(r"`s7dissect (\w+) ([^`]*)`", README)
    assert len(recipes) >= 8
    help_texts = {name: run("-m", "dissect", name, "--help") for name in {name for name, _ in recipes}}
    for name, arguments in recipes:
        for option in re.findall(r"(?<!\S)(--?[A-Za-z][\w-]*)", arguments):
            assert option in help_texts[name], f"s7dissect {name} has no {option}"


def test_links_lead_somewhere() -> None:
    for document in [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]:
        for target in re.findall(r"\]\(([^)#]+)\)", document.read_text(encoding="utf-8")):
            if "://" not in target:
                assert (document.parent / target).exists(), f"{document.name}: {target}"


def test_the_tables_of_block_code_are_those_of_the_decoder() -> None:
    assert run("scripts/mc7_doc.py") == (ROOT / "docs" / "mc7.md").read_text(encoding="utf-8")


def test_the_page_of_findings_is_the_catalogue() -> None:
    assert run("scripts/findings_doc.py") == (ROOT / "docs" / "findings.md").read_text(encoding="utf-8")


def test_the_pictures_are_there_and_small_and_fetch_nothing() -> None:
    """``python scripts/pictures.py`` draws them."""
    named = re.findall(r'<img src="(.*?)"', README)
    assert named == ["docs/report.png", "docs/monitor.svg"]
    for name in named:
        assert (ROOT / name).stat().st_size < 200_000, name
    assert (ROOT / named[0]).read_bytes().startswith(b"\x89PNG")
    assert re.findall(r"(?:url\(.?|href=.)https?:", (ROOT / named[1]).read_text(encoding="utf-8")) == []
