"""`s7dissect help`: the pages of docs/, for the command line that was installed without them."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest

from dissect.cli.help import formatted, groups, page, pages, unfolded
from dissect.cli.main import COMMANDS
from tests.cli.support import on_terminal, run, simple
from tests.cli.test_outputs import commands
from tests.meaning.report.schemas import ROOT

if TYPE_CHECKING:
    from tests.conftest import Command

Capture = pytest.CaptureFixture[bytes]
DOCS = [path for path in sorted((ROOT / "docs").glob("*.md")) if path.stem != "index"]  # which lists them


def test_every_page_of_the_docs_is_a_topic() -> None:
    assert list(pages()) == [path.stem for path in DOCS]
    for path in DOCS:
        assert pages()[path.stem].read_bytes() == path.read_bytes()


def test_links_say_what_to_type() -> None:
    for topic in pages():
        text = page(topic)
        for link in re.findall(r"\]\(([^)]*)\)", text):
            assert link.startswith(("http:", "https:")), (topic, link)
        for named in re.findall(r"s7dissect help ([a-z0-9-]+)", text):
            assert named in pages(), (topic, named)
    assert "`s7dissect help live`" in page("commands")


def test_a_page_in_a_pipe_is_markdown(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "help", "golden")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith("# Goldens and diffs\n")


def test_a_page_on_a_terminal_fits_it() -> None:
    ran = on_terminal("help", "live", environment={"PAGER": "cat", "NO_COLOR": "1"})
    assert ran.code == 0
    assert "\x1b" not in ran.out
    assert "Live capture" in ran.out
    assert max(map(len, ran.out.splitlines())) <= 80


def test_a_command_has_its_page_or_its_options(capfdbinary: Capture) -> None:
    for name in COMMANDS:
        ran = run(capfdbinary, "help", name)
        assert (ran.code, ran.err) == (0, ""), name
        assert name in ran.out
    assert run(capfdbinary, "help", "help").out.startswith("Usage: s7dissect help ")


def test_without_a_topic_everything_is_listed(capfdbinary: Capture) -> None:
    told = run(capfdbinary, "help").out
    for name in (*COMMANDS, *pages()):
        assert f"\n  {name} " in told
    titles = [f"\n{title}:\n  {next(iter(topics))} " for title, topics in groups().items()]
    assert [told.index(title) for title in titles] == sorted(told.index(title) for title in titles)
    assert max(map(len, told.splitlines())) <= 80


def test_an_unknown_topic_is_wrong_use(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "help", "finding")
    assert (ran.code, ran.out) == (2, "")
    assert "did you mean findings?" in ran.err
    assert "`s7dissect help` lists the topics" in run(capfdbinary, "help", "qqqq").err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["analyz"], "Did you mean analyze?"),
        (["trans"], "Did you mean transactions?"),
        (["scd", "chek"], "Did you mean check?"),
        (["docs"], "It is a folder: s7dissect index docs"),
        (["trace.pcapng"], "There is no such file either."),
    ],
)
def test_a_wrong_command_is_answered_by_the_right_one(
    capfdbinary: Capture, monkeypatch: pytest.MonkeyPatch, words: list[str], said: str
) -> None:
    monkeypatch.chdir(ROOT)
    ran = run(capfdbinary, *words)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err


def slips(option: str) -> list[str]:
    """Return three ways to mistype an option: two letters swapped, one missing, one twice."""
    at = len(option) // 2
    return [
        option[:at] + option[at + 1] + option[at] + option[at + 2 :],
        option[:at] + option[at + 1 :],
        option[:at] + option[at] + option[at:],
    ]


def test_a_wrong_option_is_answered_by_the_right_one() -> None:
    """Of every option of every command."""
    count = 0
    for name, command in commands().items():
        known = {opt for option in command.params if isinstance(option, click.Option) for opt in option.opts}
        for right in [opt for opt in known if opt.startswith("--")]:
            for wrong in {slip for slip in slips(right) if slip not in known}:
                with pytest.raises(click.NoSuchOption) as told:
                    command.make_context(name, [wrong])
                assert right in told.value.format_message(), (name, wrong)
                count += 1
    assert count > 700


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--fail-on", "note", "analyze", "x"], "Options follow their command: s7dissect analyze --fail-on"),
        (["operations", "--kind", "uplod", "x"], "Did you mean upload?"),
        (["operations", "--kind=uplod", "x"], "Did you mean upload?"),
        (["completion", "bsh"], "Did you mean bash or zsh?"),
        (["schema", "analisys"], "Did you mean analysis"),
        (["transactions", "-T", "jsno", "x"], "Did you mean jsonl?"),
        (["fields", "latncy"], "Did you mean latency"),
        (["sql", "slowst", "x"], "Did you mean slowest or slow-items?"),
        (["export", "x", "-o", "x.parqet"], "Did you mean .parquet?"),
    ],
)
def test_a_wrong_value_is_answered_by_the_right_one(capfdbinary: Capture, words: list[str], said: str) -> None:
    ran = run(capfdbinary, *words)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err


def test_a_file_alone_is_analyzed(s7dissect: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    capture = simple(tmp_path / "a.pcapng")
    real = s7dissect("analyze", capture, "-T", "json")
    assert real.returncode == 0
    assert s7dissect(capture, "-T", "json").stdout == real.stdout
    assert s7dissect("-r", capture, "-T", "json").stdout == real.stdout
    monkeypatch.chdir(tmp_path)
    (tmp_path / "help").write_bytes(capture.read_bytes())
    assert s7dissect("help").stdout != s7dissect("analyze", "help").stdout  # a command keeps its name


def test_version_is_a_word(s7dissect: Command) -> None:
    ran = s7dissect("version")
    assert (ran.returncode, ran.stdout) == (0, s7dissect("--version").stdout)


def test_messages_point_to_topics_that_are_there() -> None:
    """pip installs no docs/: what a message names must be a page of the package."""
    named = set()
    for path in sorted((ROOT / "dissect").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        named |= {(path.name, topic) for topic in re.findall(r"s7dissect help ([a-z][a-z0-9-]*)", text)}
    assert {topic for _, topic in named} >= {"findings", "live"}
    for file, topic in named:
        assert topic in {*pages(), *COMMANDS}, file


# ---- tables ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("topic", ["findings", "tags", "metrics", "select", "config"])
def test_no_word_of_a_page_is_cut_off_on_a_terminal(topic: str) -> None:
    text = page(topic)
    shown = formatted(unfolded(text, 80), 80)
    assert shown.count("…") == text.count("…")
    assert max(map(len, shown.splitlines())) <= 80
    said = re.sub(r"\s", "", shown)
    for slug in re.findall(r"^\| `([^`|]+)`", text, re.MULTILINE):
        assert re.sub(r"\s", "", slug) in said, slug


def test_a_table_that_does_not_fit_is_a_list_and_one_that_fits_stays_one() -> None:
    small = "| a | b |\n|---|---|\n| 1 | 2 |\n"
    assert unfolded(small, 80) == small
    wide = f"| name | what | note |\n|---|---|---|\n| `x` | {'long ' * 20}| {'w' * 70} |\n| `y\\|z` | short | |\n"
    told = unfolded(f"before\n\n{wide}\nafter\n", 80)
    assert told.startswith(f"before\n\n**`x`**\n\n- what: {'long ' * 20}".rstrip())
    assert f"\n- note: {'w' * 70}\n" in told
    assert "\n**`y|z`**\n\n- what: short\n\n" in told  # an empty cell says nothing
    assert told.endswith("\nafter\n")


def test_every_row_of_a_table_has_as_many_cells_as_its_head() -> None:
    """What is left over would be shown nowhere."""
    for path in DOCS:
        for head, rows in re.findall(r"^(\|.+)\n\|[-:| ]+\|\n((?:\|.+\n?)*)", path.read_text("utf-8"), re.MULTILINE):
            borders = [len(re.findall(r"(?<!\\)\|", row)) for row in (head, *rows.splitlines())]
            assert len(set(borders)) == 1, (path.name, head)
