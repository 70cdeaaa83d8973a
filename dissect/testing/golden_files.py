"""Which golden belongs to which test, and which of them a run wrote, used and left unused. No engine, no file is opened."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

SUFFIX: Final = ".s7.txt"
#: Which goldens a run writes: none, those that are missing, all that differ.
NONE: Final = "none"
NEW: Final = "new"
ALL: Final = "all"
#: What stands for a step upwards, for tests that are not below the folder that the folder of goldens is in.
UP: Final = "__"
#: What may stand in the name of a file as it stands in the name of a test.
_PLAIN: Final = " +,-.=@[]_~"
#: Letters of a name of a test; what is longer is cut, and told apart by a digest.
_MAX_STEM: Final = 150
#: Characters of the name a test gives to one of its goldens; a file name has 255 at most.
_MAX_NAME: Final = 60
_DIGEST: Final = 12


def folder_of(goldens: Path, module: Path) -> str:
    """Return the folder in ``goldens`` of a module of tests, with slashes: ``io/test_pump`` for io/test_pump.py."""
    where = module.with_suffix("") if module.suffix == ".py" else module
    # Up to the folder of the module and not to the module itself: a folder that holds the goldens may have its name.
    steps = (*Path(os.path.relpath(where.parent, goldens.parent)).parts, where.name)
    return "/".join([UP if step == os.pardir else step for step in steps])


def module_of(goldens: Path, folder: str) -> Path:
    """Return the module of tests that a folder of goldens belongs to."""
    steps = [os.pardir if step == UP else step for step in folder.split("/")]
    return Path(os.path.normpath(goldens.parent.joinpath(*steps[:-1], f"{steps[-1]}.py")))


def stem_of(node_id: str) -> str:
    """Return how the goldens of a test begin: its name behind its classes, with what no file is called by as ``%..``."""
    names = node_id.partition("[")[0].split("::")[1:]
    return _short(quote(".".join(names) + node_id[len(node_id.partition("[")[0]) :], safe=_PLAIN), _MAX_STEM)


def _short(text: str, most: int) -> str:
    """Return a part of a file name; of a longer one the beginning, and what tells it from others that begin alike."""
    return text if len(text) <= most else f"{text[:most]}~{hashlib.sha256(text.encode()).hexdigest()[:_DIGEST]}"


def golden_of(folder: str, stem: str, name: str | None) -> str:
    """Return the path of a golden in the folder of goldens."""
    more = f"-{_short(quote(name, safe=_PLAIN), _MAX_NAME)}" if name else ""
    return f"{folder}/{stem}{more}{SUFFIX}"


class GoldenFiles:
    """What a run did with goldens; under xdist each worker keeps one, and the controller adds them up.

    ``written``, ``changed`` and ``used`` are paths in the folder of goldens. ``whole`` is False when not all tests were asked
    for in a way that does not tell of which modules.
    """

    def __init__(self, goldens: Path) -> None:
        self.goldens = goldens
        self.written: set[str] = set()
        self.changed: set[str] = set()
        self.used: set[str] = set()
        self.whole = True
        self._folders: dict[Path, str] = {}  # of modules that were seen, empty where there are no goldens
        self._tests: dict[str, str] = {}  # folder of each test's goldens by its id, for modules that have any
        self._partial: set[str] = set()  # folders of modules of which tests were left out
        self._ran: set[str] = set()
        self._failed: set[str] = set()  # also skipped: what these would have used is not known

    def _folder(self, module: Path) -> str:
        folder = self._folders.get(module)
        if folder is None:
            folder = folder_of(self.goldens, module)
            if not (self.goldens / folder).is_dir():
                folder = ""
            self._folders[module] = folder
        return folder

    # ---- what happens -----------------------------------------------------------------------------------------------

    def collected(self, node_id: str, module: Path) -> None:
        """A test was found."""
        folder = self._folder(module)
        if folder:
            self._tests[node_id] = folder

    def left_out(self, module: Path) -> None:
        """Not all tests of a module are wanted."""
        self._partial.add(self._folder(module))

    def ended(self, node_id: str, passed: bool, last: bool) -> None:
        """A phase of a test ended, the last one perhaps."""
        if not passed:
            self._failed.add(node_id)
        if last:
            self._ran.add(node_id)

    # ---- from worker to controller ----------------------------------------------------------------------------------

    def told(self) -> dict[str, Any]:
        """Return what a controller has to know, as plain values; how tests ended it hears by itself."""
        return {
            "written": sorted(self.written),
            "changed": sorted(self.changed),
            "used": sorted(self.used),
            "partial": sorted(self._partial),
            "tests": self._tests,
        }

    def add(self, told: dict[str, Any]) -> None:
        """Take what a worker told."""
        self.written.update(told["written"])
        self.changed.update(told["changed"])
        self.used.update(told["used"])
        self._partial.update(told["partial"])
        self._tests.update(told["tests"])

    # ---- what is left -----------------------------------------------------------------------------------------------

    def unused(self, searched: Iterable[Path] = (), patterns: Iterable[str] = ()) -> list[str]:
        """Return goldens that no test used, of modules all of whose tests ran.

        A golden of a test that failed or was skipped is not among them. Those of modules that are gone are, where their
        folder was ``searched`` and their name matches ``patterns``.
        """
        if not self.whole:
            return []
        searched, patterns = list(searched), list(patterns)
        owners: dict[str, list[str]] = {}
        for node_id, folder in self._tests.items():
            owners.setdefault(folder, []).append(node_id)
        known = self.used | self.written | self.changed
        found = []
        for folder, names in self._present():
            tests = owners.get(folder)
            if tests is None:
                if self._partial or not self._gone(folder, searched, patterns):
                    continue
            elif folder in self._partial or not self._ran.issuperset(tests):
                continue
            failed = [stem_of(node_id) for node_id in tests or () if node_id in self._failed]
            for name in names:
                path = f"{folder}/{name}"
                if path not in known and not any([_owns(stem, name) for stem in failed]):
                    found.append(path)
        return found

    def _present(self) -> Iterator[tuple[str, list[str]]]:
        for where, folders, names in os.walk(self.goldens):
            folders.sort()
            goldens = sorted([name for name in names if name.endswith(SUFFIX) and not name.startswith(".")])
            if goldens and Path(where) != self.goldens:
                yield Path(where).relative_to(self.goldens).as_posix(), goldens

    def _gone(self, folder: str, searched: list[Path], patterns: list[str]) -> bool:
        module = module_of(self.goldens, folder)
        if module.exists() or not any([fnmatch(module.name, pattern) for pattern in patterns]):
            return False
        return any([module.is_relative_to(place) for place in searched])


def _owns(stem: str, name: str) -> bool:
    return name == stem + SUFFIX or name.startswith(f"{stem}-")
