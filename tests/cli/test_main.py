from __future__ import annotations

import errno
import os
import re
import sys
import types
from pathlib import Path
from typing import TYPE_CHECKING

import click
import pytest

import dissect
from dissect.cli import main as cli
from dissect.packets.source.packet import CaptureError
from dissect.wire.build import COMPILED
from tests.cases import each
from tests.cli.test_outputs import commands

if TYPE_CHECKING:
    from tests.conftest import Command


def ends_with(monkeypatch: pytest.MonkeyPatch, outcome: object) -> int:
    """Run the command line on a command that returns or raises ``outcome``; give the exit code."""

    @click.command()
    def command() -> object:
        if isinstance(outcome, BaseException):
            raise outcome
        return outcome

    module = types.ModuleType("dissect.cli.trial")
    module.__dict__["command"] = command
    monkeypatch.setitem(sys.modules, "dissect.cli.trial", module)
    monkeypatch.setitem(cli.COMMANDS, "trial", "A command for this test.")
    with pytest.raises(SystemExit) as end:
        cli.main(["trial"])
    assert isinstance(end.value.code, int)
    return end.value.code


@pytest.mark.parametrize(
    ("outcome", "code", "said"),
    [
        (None, 0, ""),
        (cli.EXIT_DAMAGED, 3, ""),
        (click.UsageError("no such option"), 2, "no such option"),
        (click.ClickException("cannot be done"), 2, "Error: cannot be done"),
        (CaptureError("notes.txt: neither pcap nor pcapng"), 2, "s7dissect: notes.txt: neither pcap nor pcapng\n"),
        (FileNotFoundError(errno.ENOENT, "No such file or directory", "gone.pcap"), 2, "gone.pcap: No such file"),
        (KeyboardInterrupt(), 130, "s7dissect: interrupted\n"),
        (click.Abort(), 130, "s7dissect: interrupted\n"),
    ],
)
def test_exit_code(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], outcome: object, code: int, said: str
) -> None:
    assert ends_with(monkeypatch, outcome) == code
    printed = capsys.readouterr()
    assert printed.out == ""
    assert said in printed.err
    assert bool(printed.err) == bool(said)


def test_a_bug_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ZeroDivisionError):
        ends_with(monkeypatch, ZeroDivisionError("a bug"))


def test_a_closed_pipe_is_quiet(s7dissect: Command) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    try:
        ran = s7dissect("--help", stdout=writer)
    finally:
        os.close(writer)
    assert (ran.returncode, ran.stderr) == (0, b"")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_full_disk_is_told(s7dissect: Command) -> None:
    with Path("/dev/full").open("wb") as full:
        ran = s7dissect("--help", stdout=full.fileno())
    assert ran.returncode == 5
    assert ran.stderr == b"s7dissect: cannot write the results: No space left on device\n"


def test_version_tells_the_build(s7dissect: Command) -> None:
    ran = s7dissect("--version")
    build = "compiled" if COMPILED else "interpreted"
    assert (ran.returncode, ran.stdout.decode()) == (0, f"s7dissect {dissect.__version__} ({build})\n")


@pytest.mark.parametrize("arguments", [["--help"], ["-h"]])
def test_help_lists_every_command_on_one_line(s7dissect: Command, arguments: list[str]) -> None:
    ran = s7dissect(*arguments)
    assert ran.returncode == 0
    for name, text in cli.COMMANDS.items():
        assert [line.split() for line in ran.stdout.decode().splitlines() if line.startswith(f"  {name} ")] == [
            [name, *text.split()]
        ]


def test_every_help_fits_80_columns_and_speaks_plainly() -> None:
    for name, command in commands().items():
        with click.Context(command, info_name=f"s7dissect {name}") as context:
            text = command.get_help(context)
        assert max(map(len, text.split("\n"))) <= 80, name
        assert re.findall(r"\b(?:octets?|somebody|told|hole|unless said|not any more)\b", text) == [], name


@each("name", cli.COMMANDS)
def test_every_command_is_there(s7dissect: Command, name: str) -> None:
    ran = s7dissect(name, "--help")
    assert (ran.returncode, ran.stderr) == (0, b"")
    assert ran.stdout.decode().startswith(f"Usage: s7dissect {name} ")


def test_the_shell_completes_commands(monkeypatch: pytest.MonkeyPatch, s7dissect: Command) -> None:
    monkeypatch.setenv("_S7DISSECT_COMPLETE", "bash_complete")
    monkeypatch.setenv("COMP_WORDS", "s7dissect tran")
    monkeypatch.setenv("COMP_CWORD", "1")
    ran = s7dissect()
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, b"plain,transactions\n", b"")


@pytest.mark.parametrize("arguments", [[], ["nonsense"], ["--nonsense"]])
def test_wrong_use_is_exit_code_2_and_nothing_on_stdout(s7dissect: Command, arguments: list[str]) -> None:
    ran = s7dissect(*arguments)
    assert (ran.returncode, ran.stdout) == (2, b"")
    assert b"Usage: s7dissect " in ran.stderr


def test_help_has_headings_and_reference_commands_are_last(s7dissect: Command) -> None:
    lines = s7dissect("--help").stdout.decode().splitlines()
    places = [lines.index(f"{heading}:") for heading in cli.HEADINGS]
    assert places == sorted(places)
    reference = "\n".join(lines[lines.index("Reference:") :])
    for name in ("schema", "completion", "fields", "interfaces", "extcap", "cluster-check"):
        assert f"\n  {name} " in reference


def test_the_options_of_a_command_precede_those_of_many() -> None:
    """An option that five commands have is a common one, except the form of their output."""
    having: dict[str, set[str]] = {}
    for name, command in commands().items():
        for parameter in command.params:
            if isinstance(parameter, click.Option):
                having.setdefault(str(parameter.name), set()).add(name)
    many = {name for name, of in having.items() if len(of) >= 8}
    own_everywhere = {"format_", "output", "force", "slow_ns", "dictionary"}
    assert many - own_everywhere <= cli._COMMON
    assert set(having) >= cli._COMMON
    with click.Context(commands()["show"], info_name="s7dissect show") as context:
        own, common = commands()["show"].get_help(context).split("\nCommon options:\n")
    assert "--frame" in own
    assert "--tags" not in own
    assert "--tags" in common
    assert "--help" in common
