"""What shares found, put together: order and numbers of one run, and an end where they cannot be had."""

from __future__ import annotations

from typing import Any

import pytest

from dissect.engine.options import MEMORY
from dissect.jobs.merging import DiffersError, Merger
from dissect.jobs.parts import Piece, Row
from dissect.transactions.pairing import MAX_OPEN_ALL
from dissect.variables.tracker import MAX_KEPT, MAX_VARIABLES
from tests.cases import each


def piece(**values: Any) -> Piece:
    lists = dict.fromkeys(("begun", "ended", "left", "opened", "rows", "unshown", "plcs"))
    empty: dict[str, Any] = {name: [] for name in lists}
    numbers = dict.fromkeys(("held", "room", "requests", "sessions", "variables", "kept", "octets"), 0)
    return Piece(**{**empty, **numbers, "tangled": False, "file": "", **values})


def row(stamp: int, number: int) -> Row:
    return Row(stamp, number, 0, [["#", ""]], None)


def test_transactions_have_the_numbers_and_the_order_of_one_run() -> None:
    """Numbers count by beginning, rows come by end, and a number is still known stretches later."""
    merger = Merger(2)
    first = merger.merge([piece(begun=[10, 30], rows=[row(40, 2)]), piece(begun=[20], unshown=[1])])
    second = merger.merge([piece(rows=[row(60, 1)]), piece(begun=[50], rows=[row(55, 2)])])
    assert [(one.stamp, one.number) for one in first] == [(40, 3)]
    assert [(one.stamp, one.number) for one in second] == [(55, 4), (60, 1)]


def test_rows_without_numbers_are_only_put_in_order() -> None:
    rows = Merger(2).merge([piece(rows=[row(4, 0), row(9, 0)]), piece(rows=[row(5, 0)])], numbered=False)
    assert [one.stamp for one in rows] == [4, 5, 9]


@each(
    ("one", "other", "why"),
    [
        ({"opened": [1]}, {"opened": [2]}, "begins or ends"),
        ({"ended": [1, 9]}, {"ended": []}, "begins or ends"),
        ({"left": [3]}, {"left": []}, "begins or ends"),
        ({"tangled": True}, {}, "waited for each other"),
        ({"begun": [7, 5]}, {}, "waited for each other"),
        ({"rows": [row(7, 0), row(5, 0)]}, {}, "waited for each other"),
        ({"begun": [7]}, {"begun": [7]}, "at the same packet"),
        ({"rows": [row(7, 0)]}, {"rows": [row(7, 0)]}, "at the same packet"),
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
