"""A number that nothing has is wrong use; what matches nothing is a sentence and no mistake: in every command that reads."""

from __future__ import annotations

import re
import tempfile
from pathlib import Path
from typing import Final

import click
import pytest

from dissect.cli.main import COMMANDS, EXIT_OK, EXIT_USAGE, group
from tests.cases import each
from tests.cli.support import Ran, run
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]

FILE: Final = str(ROOT / "captures" / "transfer.pcapng")  # one connection, with blocks
OTHER: Final = str(ROOT / "captures" / "szl.pcapng")
#: A call of each command that takes a selection, in each of its ways; OUT is to be made.
CALLS: Final = """
analyze FILE
analyze --brief FILE
analyze --per-file FILE
analyze -T json FILE
transactions FILE
transactions -T csv FILE
transactions --failed FILE
values FILE
values --summary FILE
values FILE DB1.DBB0
operations FILE
operations --kind control FILE
devices FILE
show FILE
show -V FILE
show --frame 8 FILE
blocks FILE
blocks --code FILE
blocks --diff FILE OTHER
report FILE -o OUT
sql talkers FILE
export FILE -o csv:OUT
golden FILE
diff FILE OTHER
cut FILE -o OUT
"""
#: The same where each file stands for itself: there no connection has a number.
APART: Final = """
analyze FILE OTHER
analyze --brief FILE OTHER
analyze --per-file FILE OTHER
transactions FILE OTHER
values FILE OTHER
devices FILE OTHER
export FILE OTHER -o csv:OUT
"""
#: Commands that select by numbers of their own, or by packets of a folder.
OTHERWISE: Final = frozenset(("monitor", "index", "open", "fields", "extcap"))
#: What says that there is nothing: on stderr, or as a part of the result.
NOTHING: Final = re.compile(
    r"no (packet|transaction|value|operation|message|block)\b.* (within|matches|in what was|match)|nothing matches"
    r"|selected: 0 transactions|\"transactions\": \{\s*\"total\": 0|No device: nothing",
    re.IGNORECASE,
)


def calls(text: str) -> list[str]:
    return [line for line in text.split("\n") if line]


def called(capfdbinary: Capture, tmp_path: Path, call: str, *options: str) -> Ran:
    out = Path(tempfile.mkdtemp(dir=tmp_path)) / "out"
    files = {"FILE": FILE, "OTHER": OTHER, "OUT": str(out), "csv:OUT": f"csv:{out}"}
    return run(capfdbinary, *[files.get(word, word) for word in call.split()], *options)


def test_every_command_that_selects_has_a_call() -> None:
    selecting = set()
    for name in COMMANDS:
        command = group.get_command(click.Context(group), name)
        assert command is not None
        if any(parameter.name == "where" for parameter in command.params):
            selecting.add(name)
    assert {call.split()[0] for call in calls(CALLS)} == selecting - OTHERWISE


@each("call", calls(CALLS))
def test_a_number_that_nothing_has_is_wrong_use(capfdbinary: Capture, tmp_path: Path, call: str) -> None:
    ran = called(capfdbinary, tmp_path, call, "--connection", "99")
    assert ran.code == EXIT_USAGE
    assert re.search(r"no connection 99(; the capture has 1| in the capture)", ran.err), ran.err


@each("call", calls(CALLS))
@each("options", [("--time", "2001-01-01"), ("-Y", "connection == 99"), ("-Y", "host == 192.0.2.99")])
def test_what_matches_nothing_is_no_mistake_and_said(
    capfdbinary: Capture, tmp_path: Path, call: str, options: tuple[str, str]
) -> None:
    ran = called(capfdbinary, tmp_path, call, *options)
    if call.startswith("cut"):  # an empty capture is no use
        assert (ran.code, "Error: no packet matches; nothing was written." in ran.err) == (EXIT_USAGE, True)
        return
    assert ran.code == EXIT_OK, ran.err
    assert NOTHING.search(ran.err) or NOTHING.search(ran.out), (ran.err, ran.out)
    assert "no connection" not in ran.err


@each("call", calls(APART))
@each("options", [("--time", "2001-01-01"), ("-Y", "host == 192.0.2.99")])
def test_so_it_is_of_files_that_stand_for_themselves(
    capfdbinary: Capture, tmp_path: Path, call: str, options: tuple[str, str]
) -> None:
    ran = called(capfdbinary, tmp_path, call, "--separate", *options)
    assert ran.code == EXIT_OK, ran.err
    assert NOTHING.search(ran.err) or NOTHING.search(ran.out), (ran.err, ran.out)
    ran = called(capfdbinary, tmp_path, call, "--separate", "--connection", "1")
    assert (ran.code, "the field connection counts over all files" in ran.err) == (EXIT_USAGE, True)


@each("options", [(), ("--separate",)])
def test_what_matches_and_has_no_row_in_a_table_matches(
    capfdbinary: Capture, tmp_path: Path, options: tuple[str, ...]
) -> None:
    ran = called(
        capfdbinary, tmp_path, "export FILE OTHER --only values -o csv:OUT", *options, "-Y", "function == 0xf0"
    )
    assert ran.code == EXIT_OK
    assert "nothing matches" not in ran.err
    assert ("no row of values matches function == 0xf0" in ran.err) == bool(options)


@each("call", ["show --frame 99 FILE", "cut --transaction 99 FILE -o OUT", "cut --finding 99 FILE -o OUT"])
def test_other_numbers_that_nothing_has(capfdbinary: Capture, tmp_path: Path, call: str) -> None:
    ran = called(capfdbinary, tmp_path, call)
    assert (ran.code, bool(re.search(r"no (packet|transaction|finding) 99\b", ran.err))) == (EXIT_USAGE, True), ran.err


def test_of_two_captures_the_number_has_to_be_in_both(capfdbinary: Capture, tmp_path: Path) -> None:
    """It was wrong use only when the second one lacked it."""
    several = str(ROOT / "captures" / "refused-full.pcapng")
    for files in ((FILE, several), (several, FILE)):
        ran = run(capfdbinary, "blocks", "--diff", *files, "--connection", "2")
        assert (ran.code, ran.err.count("no connection 2; the capture has 1")) == (EXIT_USAGE, 1)
