"""Which goldens belong to which test, and which of them a run wrote, used and left unused. Imports no engine, opens no file."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable, Iterator
from fnmatch import fnmatch
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

SUFFIX: Final = ".s7.txt"
#: Which goldens a run writes: none, missing ones, or all that differ.
NONE: Final = "none"
NEW: Final = "new"
ALL: Final = "all"
#: Replaces ".." in paths, for tests outside of the folder that contains the folder of goldens.
UP: Final = "__"
#: Characters of a test's name that are used in a file name unchanged.
_PLAIN: Final = " +,-.=@[]_~"
#: Maximum length of a test's name in a file name; a longer one is cut, and a digest makes it unique.
_MAX_STEM: Final = 150
#: Maximum length of the name that a test gives to one of its goldens; file names have at most 255 characters.
_MAX_NAME: Final = 60
_DIGEST: Final = 12


def folder_of(goldens: Path, module: Path) -> str:
    """Return the folder in ``goldens`` of a test module, with slashes: ``io/test_pump`` for io/test_pump.py."""
    where = module.with_suffix("") if module.suffix == ".py" else module
    # Up to the folder of the module, not the module itself: a folder that contains the goldens may have the same name.
    steps = (*Path(os.path.relpath(where.parent, goldens.parent)).parts, where.name)
    return "/".join([UP if step == os.pardir else step for step in steps])


def module_of(goldens: Path, folder: str) -> Path:
    """Return the test module that a folder of goldens belongs to."""
    steps = [os.pardir if step == UP else step for step in folder.split("/")]
    return Path(os.path.normpath(goldens.parent.joinpath(*steps[:-1], f"{steps[-1]}.py")))


def stem_of(node_id: str) -> str:
    """Return the beginning of a test's goldens: its name after its classes; characters that file names forbid as ``%..``."""
    names = node_id.partition("[")[0].split("::")[1:]
    return _short(quote(".".join(names) + node_id[len(node_id.partition("[")[0]) :], safe=_PLAIN), _MAX_STEM)


def _short(text: str, most: int) -> str:
    """Return a part of a file name; a longer one is cut, and a digest makes it unique."""
    return text if len(text) <= most else f"{text[:most]}~{hashlib.sha256(text.encode()).hexdigest()[:_DIGEST]}"


def golden_of(folder: str, stem: str, name: str | None) -> str:
    """Return the path of a golden in the folder of goldens."""
    more = f"-{_short(quote(name, safe=_PLAIN), _MAX_NAME)}" if name else ""
    return f"{folder}/{stem}{more}{SUFFIX}"


class GoldenFiles:
    """The use of goldens in a run; under xdist each worker has its own, and the controller adds them up.

    ``written``, ``changed`` and ``used`` are paths in the folder of goldens. ``whole`` is False if pytest was started with
    arguments from which the complete modules cannot be derived.
    """

    def __init__(self, goldens: Path) -> None:
        self.goldens = goldens
        self.written: set[str] = set()
        self.changed: set[str] = set()
        self.used: set[str] = set()
        self.whole = True
        self._folders: dict[Path, str] = {}  # by module of the tests that were found; empty without goldens
        self._tests: dict[str, str] = {}  # folder of each test's goldens by its id, for modules with goldens
        self._partial: set[str] = set()  # folders of modules some of whose tests were left out
        self._ran: set[str] = set()
        self._failed: set[str] = set()  # also skipped: the goldens that such a test uses are unknown

    def _folder(self, module: Path) -> str:
        folder = self._folders.get(module)
        if folder is None:
            folder = folder_of(self.goldens, module)
            if not (self.goldens / folder).is_dir():
                folder = ""
            self._folders[module] = folder
        return folder

    # ---- events ----------------------------------------------------------------------------------------------------

    def collected(self, node_id: str, module: Path) -> None:
        """Note a test that was found."""
        folder = self._folder(module)
        if folder:
            self._tests[node_id] = folder

    def left_out(self, module: Path) -> None:
        """Note that some tests of a module are not run."""
        self._partial.add(self._folder(module))

    def ended(self, node_id: str, passed: bool, last: bool) -> None:
        """Note the end of a phase of a test, perhaps of the last one."""
        if not passed:
            self._failed.add(node_id)
        if last:
            self._ran.add(node_id)

    # ---- from worker to controller ----------------------------------------------------------------------------------

    def results(self) -> dict[str, Any]:
        """Return the results for a controller as plain values; it learns the outcomes of tests by itself."""
        return {
            "written": sorted(self.written),
            "changed": sorted(self.changed),
            "used": sorted(self.used),
            "partial": sorted(self._partial),
            "tests": self._tests,
        }

    def add(self, results: dict[str, Any]) -> None:
        """Add the results of a worker."""
        self.written.update(results["written"])
        self.changed.update(results["changed"])
        self.used.update(results["used"])
        self._partial.update(results["partial"])
        self._tests.update(results["tests"])

    # ---- unused -----------------------------------------------------------------------------------------------------

    def unused(self, searched: Iterable[Path] = (), patterns: Iterable[str] = ()) -> list[str]:
        """Return goldens that no test used, for modules all of whose tests ran.

        Goldens of failed or skipped tests are left out. Goldens of deleted modules are included if their folder was
        ``searched`` and their name matches ``patterns``.
        """
        if not self.whole:
            return []
        searched, patterns = list(searched), list(patterns)
        owners: dict[str, list[str]] = {}
        for node_id, folder in self._tests.items():
            owners.setdefault(folder, []).append(node_id)
        known = self.used | self.written | self.changed
        unused = []
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
                    unused.append(path)
        return unused

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
