"""What makes room by forgetting its oldest entry does so in constant time.

The first key of a dict whose first entries were deleted is found by stepping over what they left: of 65,536 entries that
takes 120 µs for each new one. An `OrderedDict` keeps its first entry at hand.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from typing import Final

from tests.conftest import ROOT

#: Dicts that hold so few that stepping over all of them costs nothing to speak of: at most 512 entries.
SMALL: Final = frozenset(
    (
        ("export/rotating.py", "_open"),  # one for each table
        ("findings/explaining.py", "requests"),
        ("findings/plus_rules.py", "_cpus"),
        ("engine/plus.py", "begun"),
        ("jobs/sending.py", "CATALOGUE"),  # never forgotten
        ("index/possible.py", "CATALOGUE"),
        ("metrics/server.py", "_clients"),
        ("oracle/plus.py", "_asked"),
        ("playback/server/session.py", "_jobs"),
        ("playback/server/session.py", "_references"),
        ("s7plus/session.py", "subscriptions"),
        ("source/live/dumpcap.py", "statistics"),
        ("stations/evidence.py", "_answers"),
        ("tags/loading.py", "programs"),
        ("transactions/multipart.py", "_chains"),
        ("transactions/plus_operations.py", "polls"),
        ("cluster/executor.py", "refused"),
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
