"""What makes room by forgetting its oldest entry does so in constant time.

The first key of a dict whose first entries were deleted is found by stepping over what they left: of 65,536 entries that
takes 120 µs for each new one. An `OrderedDict` keeps its first entry at hand.
"""

from __future__ import annotations

import ast
import time
from collections.abc import Callable, Iterator, Sized
from typing import Final

import pytest

from dissect.meaning.select.selection import MAX_CONNECTIONS, ContextBook
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.cooldown import MAX_REMEMBERED, Cooldown
from dissect.online.alerts.rules import PROBLEM, Rule
from dissect.packets.tcp.ip import MAX_DATAGRAMS, FragmentStore
from tests.conftest import ROOT

#: Dicts that hold so few that stepping over all of them costs nothing to speak of: at most 512 entries.
SMALL: Final = frozenset(
    (
        ("output/export/rotating.py", "_open"),  # one for each table
        ("engine/findings/explaining.py", "requests"),
        ("engine/findings/plus_rules.py", "_cpus"),
        ("engine/plus.py", "begun"),
        ("files/jobs/sending.py", "CATALOGUE"),  # never forgotten
        ("files/index/possible.py", "CATALOGUE"),
        ("online/metrics/server.py", "_clients"),
        ("testing/oracle/plus.py", "_asked"),
        ("testing/playback/server/session.py", "_jobs"),
        ("testing/playback/server/session.py", "_references"),
        ("protocols/s7plus/session.py", "subscriptions"),
        ("packets/source/live/dumpcap.py", "statistics"),
        ("engine/stations/evidence.py", "_answers"),
        ("meaning/tags/loading.py", "programs"),
        ("engine/transactions/multipart.py", "_chains"),
        ("engine/transactions/plus_operations.py", "polls"),
        ("files/cluster/executor.py", "refused"),
    )
)


def first_keys(tree: ast.AST) -> Iterator[str]:
    """Yield the name of each table whose first entry is asked for: ``next(iter(table))``."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "next" and node.args:
            inner = node.args[0]
            if isinstance(inner, ast.Call) and isinstance(inner.func, ast.Name) and inner.func.id == "iter":
                table = inner.args[0]
                if isinstance(table, ast.Call) and isinstance(table.func, ast.Attribute):
                    table = table.func.value  # values()
                yield table.attr if isinstance(table, ast.Attribute) else getattr(table, "id", "?")


def ordered(tree: ast.AST) -> set[str]:
    """Return the names of attributes that are made as an `OrderedDict`."""
    return {
        node.target.attr
        for node in ast.walk(tree)
        if isinstance(node, ast.AnnAssign)
        and isinstance(node.target, ast.Attribute)
        and ast.unparse(node.annotation).startswith("OrderedDict")
    }


def test_large_tables_forget_their_oldest_in_constant_time() -> None:
    wrong = set()
    for path in sorted((ROOT / "dissect").rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        name = path.relative_to(ROOT / "dissect").as_posix()
        wrong |= {(name, table) for table in first_keys(tree) if table not in ordered(tree)}
    assert wrong <= SMALL, wrong - SMALL
    assert wrong >= SMALL, SMALL - wrong  # none is named that is gone


def test_such_a_place_is_found() -> None:
    tree = ast.parse("self._a: dict[int, int] = {}\nself._b: OrderedDict[int, int] = OrderedDict()\n"
                     "del self._a[next(iter(self._a))]\ndel self._b[next(iter(self._b))]\n")  # fmt: skip
    assert (list(first_keys(tree)), ordered(tree)) == (["_a", "_b"], {"_b"})


def context_book(count: int) -> Sized:
    book = ContextBook()
    for number in range(count):
        book.opened(number, number, 0, None)
    return book._known


def fragments(count: int) -> Sized:
    store = FragmentStore()
    for number in range(count):
        store.add(number.to_bytes(16, "big"), 0, True, b"12345678", 1)
    return store._datagrams


def states_of_pairs(count: int) -> Sized:
    cooldown = Cooldown(lambda _: None)
    rule = Rule("r", PROBLEM)
    for number in range(count):
        cooldown.event(rule, number, number, lambda _: Alert(rule, 1, "note", None, "x", {}))
    return cooldown._told


@pytest.mark.parametrize(
    ("fill", "bound"),
    [
        (context_book, MAX_CONNECTIONS),
        (fragments, MAX_DATAGRAMS),
        (states_of_pairs, MAX_REMEMBERED),
    ],
)
def test_twice_the_bound_takes_twice_the_time_and_no_more_room(fill: Callable[[int], Sized], bound: int) -> None:
    """In a plain dict whose first entries are deleted, the second half takes some hundred times as long as the first."""
    few = min([_seconds(lambda: fill(bound // 2)) for _ in range(3)])
    begun = time.process_time()
    assert len(fill(2 * bound)) <= bound
    assert time.process_time() - begun < 16 * few + 0.2  # it is four times as many; the rest is for other processes


def _seconds(work: Callable[[], object]) -> float:
    begun = time.process_time()
    work()
    return time.process_time() - begun
