"""What shares found, put together: order and numbers of one run, and an end where they cannot be had."""

from __future__ import annotations

from typing import Any

import pytest

from dissect.engine.options import MEMORY
from dissect.jobs.merging import DiffersError, Merger
from dissect.jobs.parts import Lines, Piece
from dissect.report.styled import Line
from dissect.transactions.pairing import MAX_OPEN_ALL
from dissect.variables.tracker import MAX_KEPT, MAX_VARIABLES
from tests.cases import each


def piece(**values: Any) -> Piece:
    lists = ("begun", "ended", "left", "opened", "unshown", "plcs")
    empty: dict[str, Any] = {name: [] for name in lists}
    numbers = dict.fromkeys(("held", "room", "requests", "sessions", "variables", "kept", "octets"), 0)
    return Piece(**{**empty, **numbers, "lines": lines(), "tangled": False, "file": "", **values})


def lines(*found: tuple[int, int], look: tuple[str, int] | None = None) -> Lines:
    """Return lines, each of a stamp and the number of a transaction."""
    stamps, numbers = [stamp for stamp, _ in found], [number for _, number in found]
    looks = [look for _ in found if look is not None]
    return Lines(stamps, numbers, stamps, [f"#MARK at {stamp}" for stamp in stamps], looks, "MARK")


def test_transactions_have_the_numbers_and_the_order_of_one_run() -> None:
    """Numbers count by beginning, rows come by end, and a number is still known stretches later."""
    merger = Merger(2)
    first = merger.merge([piece(begun=[10, 30], lines=lines((40, 2))), piece(begun=[20], unshown=[1])])
    second = merger.merge([piece(lines=lines((60, 1))), piece(begun=[50], lines=lines((55, 2)))])
    assert first == (["#3 at 40"], [40])
    assert second == (["#4 at 55", "#1 at 60"], [55, 60])


def test_lines_of_one_result_stay_together_and_have_its_number() -> None:
    merged, packets = Merger(2, 3).merge(
        [piece(begun=[5], lines=lines((9, 1), (9, 1))), piece(begun=[4], lines=lines((8, 1)))]
    )
    assert merged == ["#1   at 8", "#2   at 9", "#2   at 9"]
    assert packets == [8, 9, 9]


def test_lines_keep_their_style() -> None:
    merged, _ = Merger(1).merge([piece(begun=[1], lines=lines((2, 1), look=("failed", 6)))])
    assert merged == [Line("#1 at 2", "failed", 6)]


def test_lines_without_numbers_are_only_put_in_order() -> None:
    merged, _ = Merger(2, numbered=False).merge([piece(lines=lines((4, 0), (9, 0))), piece(lines=lines((5, 0)))])
    assert merged == ["#MARK at 4", "#MARK at 5", "#MARK at 9"]


@each(
    ("one", "other", "why"),
    [
        ({"opened": [1]}, {"opened": [2]}, "begins or ends"),
        ({"ended": [1, 9]}, {"ended": []}, "begins or ends"),
        ({"left": [3]}, {"left": []}, "begins or ends"),
        ({"tangled": True}, {}, "waited for each other"),
        ({"begun": [7, 5]}, {}, "waited for each other"),
        ({"lines": lines((7, 0), (5, 0))}, {}, "waited for each other"),
        ({"begun": [7]}, {"begun": [7]}, "at the same packet"),
        ({"lines": lines((7, 0))}, {"lines": lines((7, 0))}, "at the same packet"),
        ({"room": MEMORY}, {"room": 1}, "unfinished"),
        ({"requests": MAX_OPEN_ALL}, {"requests": 1}, "open at once"),
        ({"sessions": 1}, {"sessions": 1}, "TLS"),
        ({"variables": MAX_VARIABLES - 1}, {"variables": 1}, "variables"),
        ({"kept": MAX_KEPT - 1}, {"kept": 1}, "variables"),
        ({"plcs": ["a"]}, {"plcs": ["a"]}, "both asked and asking"),
    ],
)
def test_what_shares_cannot_know_ends_it(one: dict[str, Any], other: dict[str, Any], why: str) -> None:
    with pytest.raises(DiffersError, match=why):
        Merger(2).merge([piece(**one), piece(**other)])


def test_one_share_may_have_what_two_may_not() -> None:
    """The bounds are those of one run: as much as it takes is no reason."""
    merger = Merger(2)
    merger.merge([piece(room=MEMORY, requests=MAX_OPEN_ALL, sessions=1, plcs=["a"]), piece(plcs=["b"])])
    merger.merge([piece(plcs=["c"]), piece()])
    with pytest.raises(DiffersError, match="asked and asking"):
        merger.merge([piece(), piece(plcs=["a"])])
