"""Lines of many items: short on a terminal, whole in a pipe."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

import pytest

from tests.cases import each
from tests.cli.support import on_terminal, run
from tests.meaning.report.support import begun, saved
from tests.properties import messages
from tests.properties.messages import Item, dt


@pytest.mark.parametrize(("count", "more"), [(12, 0), (13, 1), (19, 7)])
def test_a_line_on_a_terminal_names_a_dozen_items(
    capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, count: int, more: int
) -> None:
    items = [Item(db=number) for number in range(1, count + 1)]
    talk = begun()
    talk.send(0, dt(messages.read_job(1, items)))
    talk.send(1, dt(messages.read_answer(1, items, [b"\x07"] * count)))
    file = saved(tmp_path / "many.pcapng", talk.packets())
    for command in ("transactions", "show"):
        whole = run(capfdbinary, command, file).out
        assert whole.count(".DBB0") == count
        assert run(capfdbinary, command, "--color=always", file).out.count(".DBB0") == count
        shown = on_terminal(command, file, columns=5000, environment={"NO_COLOR": "1"}).out
        assert shown.count(".DBB0") == min(count, 12)
        assert (f" and {more} more" in shown) == bool(more)


def test_of_many_refused_items_a_line_on_a_terminal_names_a_dozen(tmp_path: Path) -> None:
    items = [Item(db=number) for number in range(1, 16)]
    talk = begun()
    talk.send(0, dt(messages.read_job(1, items)))
    talk.send(1, dt(messages.read_answer(1, items, [0x0A] * 15)))
    file = saved(tmp_path / "many.pcapng", talk.packets())
    shown = on_terminal("show", file, columns=5000, environment={"NO_COLOR": "1"}).out
    assert "15 of 15 items refused: item 1: " in shown
    assert "item 12: Object does not exist and 3 more" in shown


#: Calls that give lines for a person, of a capture with reads of many items; OTHER is one with other answers.
LINES: Final = """
analyze
analyze --brief
transactions
values
values --summary
operations
devices
show
show -V
blocks
golden
sql refused
sql changes
sql periods
diff OTHER
"""
#: What a line calls an item.
_ITEM: Final = re.compile(r"\bDB[0-9]+(?:[.,]|\b)|\bitem [0-9]+:")


def many(tmp_path: Path, name: str, refused: int) -> Path:
    """Return a capture of three reads of 40 items, of which every one at a multiple of ``refused`` is refused."""
    items = [Item(db=number) for number in range(1, 41)]
    talk = begun()
    for reference in (1, 2, 3):
        talk.send(0, dt(messages.read_job(reference, items)))
        answers = [0x0A if at % refused == 0 else bytes([reference]) for at in range(40)]
        talk.send(1, dt(messages.read_answer(reference, items, answers)))
    return saved(tmp_path / name, talk.packets())


def test_no_line_of_any_command_on_a_terminal_names_more_than_a_dozen(tmp_path: Path) -> None:
    half, none = many(tmp_path, "half.pcapng", 2), many(tmp_path, "none.pcapng", 99)
    found = 0
    for file in (half, none):
        for call in LINES.strip().split("\n"):
            words = [str(none) if word == "OTHER" else word for word in call.split()]
            shown = on_terminal(*words, file, columns=5000, environment={"NO_COLOR": "1"}).out
            longest = max([len(_ITEM.findall(line)) for line in shown.split("\n")])
            assert longest <= 12, (call, longest)
            found += longest == 12
    assert found >= 6


@each("call", ["transactions", "show"])
def test_a_pipe_gets_them_all(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path, call: str) -> None:
    out = run(capfdbinary, call, many(tmp_path, "none.pcapng", 99)).out
    assert max([len(_ITEM.findall(line)) for line in out.split("\n")]) == 40
