"""Lines of many items: short on a terminal, whole in a pipe."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.cli.support import on_terminal, run
from tests.properties import messages
from tests.properties.messages import Item, dt
from tests.report.support import begun, saved


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
