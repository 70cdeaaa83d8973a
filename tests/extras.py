"""The packages that a page requires: everything else from extras is hidden while its examples run."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterable, Iterator
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parents[1]
#: Extras for developers, which no page of a user needs.
_OURS: Final = frozenset(("all", "docs", "fuzz", "test"))

#: Runs in the process of the example, in front of it.
_HIDE: Final = """
import importlib.abc, sys
class _Hide(importlib.abc.MetaPathFinder):
    hidden = {hidden!r}
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in self.hidden:
            raise ModuleNotFoundError(f"No module named {{name!r}} (hidden: no extra of this page has it)", name=name)
sys.meta_path.insert(0, _Hide())
"""


def _plain(name: str) -> str:
    return re.sub(r"[-_.]+", "-", name).lower()


@cache
def extras() -> dict[str, frozenset[str]]:
    """Return the distributions of each extra that a user may install."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return {
        name: frozenset(_names(lines)) for name, lines in project["optional-dependencies"].items() if name not in _OURS
    }


def _names(requirements: Iterable[str]) -> Iterator[str]:
    for line in requirements:
        if "extra ==" not in line and (found := re.match(r"[\w.-]+", line)):
            yield _plain(found[0])


@cache
def _with_theirs(name: str) -> frozenset[str]:
    """Return a distribution and all that it requires."""
    found, open_ = set(), [name]
    while open_:
        one = open_.pop()
        if one in found:
            continue
        found.add(one)
        try:
            open_ += _names(metadata.requires(one) or [])
        except metadata.PackageNotFoundError:
            continue
    return frozenset(found)


def hidden_modules(text: str) -> frozenset[str]:
    """Return the modules that are missing if only the packages named in ``text`` are installed: ``s7dissect[data]``, pandas."""
    named = {
        one.strip()
        for found in re.findall(r"s7dissect\[([\w, ]+)\]|extras? `?\[([\w, ]+)\]", text)
        for one in ",".join(found).split(",")
    }
    allowed = {"s7dissect", "pandas", "polars"} & set(re.findall(r"[\w-]+", text.lower())) | {"s7dissect"}
    allowed |= {one for name, dists in extras().items() if name in named for one in dists}
    reachable = frozenset().union(*[_with_theirs(one) for one in allowed])
    gone = {one for dists in extras().values() for one in dists} - reachable
    return frozenset(
        module
        for module, dists in metadata.packages_distributions().items()
        if dists and all(_plain(one) in gone for one in dists)
    )


def hiding(text: str) -> str:
    """Return the lines that hide the modules for which ``text`` names no extra."""
    return _HIDE.format(hidden=set(hidden_modules(text)))
