"""`s7_golden`: compares a session with the golden of a test."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from itertools import islice
from pathlib import Path
from typing import Final

import pytest

from dissect.engine.transactions.naming import Naming
from dissect.meaning.report import words
from dissect.testing.captures import MISTAKES, CaptureFolder, near, path_of
from dissect.testing.golden.comparison import differences
from dissect.testing.golden.difference import DiffOptions
from dissect.testing.golden.model import GoldenError, Session
from dissect.testing.golden.reading import load_golden, read_session
from dissect.testing.golden.writing import golden_text
from dissect.testing.golden_files import ALL, NONE, GoldenFiles, folder_of, golden_of, stem_of
from dissect.wire.config.saving import save

#: Maximum number of differences in a failure.
MAX_DIFFERENCES: Final = 20
MAX_LINE: Final = 400
MAX_PROBLEMS: Final = 5


class GoldenCheck:
    """Compares sessions with the goldens of one test.

    ``update`` says which goldens may be written: none (``none``), missing ones (``new``), or differing ones as well (``all``).
    No golden is written from a session in which a fake PLC received an unrecorded request (``has_unmatched``): the test fails.
    """

    def __init__(
        self,
        ledger: GoldenFiles,
        captures: CaptureFolder,
        test: tuple[str, Path],
        update: str,
        has_unmatched: Callable[[], bool],
        naming: Naming | None = None,
    ) -> None:
        self._naming = naming
        self._ledger = ledger
        self._captures = captures
        self._stem = stem_of(test[0])
        self._folder = folder_of(ledger.goldens, test[1])
        self._update = update
        self._has_unmatched = has_unmatched
        self._checked: set[str] = set()

    def path(self, name: str | None = None) -> Path:
        """Return the path of the golden, which need not exist."""
        return self._ledger.goldens / golden_of(self._folder, self._stem, name)

    def check(
        self,
        what: object,
        name: str | None = None,
        ignore: Iterable[str] = (),
        latency: str | None = None,
        where: str | None = None,
    ) -> None:
        """Fail if ``what`` differs from its golden.

        ``what`` is a capture (a path, or a name in the captures' folder), a recorder or a session. ``name`` distinguishes
        several goldens of one test. ``ignore`` and ``latency`` are those of `s7dissect diff`
        (`dissect.testing.golden.DiffOptions`); with ``latency`` answer times are stored in the golden. ``where`` is the option
        -Y: only the part of a capture or recorder that the expression selects is compared and stored (docs/select.md). Raises
        ValueError for an invalid option, `SelectError` for a wrong expression.
        """
        __tracebackhide__ = True
        try:
            wrong = self._check(what, name, ignore, latency, where)
        except (*MISTAKES, GoldenError) as mistake:
            raise mistake.with_traceback(None) from None
        if wrong:
            problems = list(getattr(what, "problems", ()))[:MAX_PROBLEMS]
            pytest.fail("\n".join([wrong, *[f"the recorder: {problem}" for problem in problems]]), pytrace=False)

    def _check(
        self, what: object, name: str | None, ignore: Iterable[str], latency: str | None, where: str | None
    ) -> str:
        __tracebackhide__ = True
        if name is not None and not isinstance(name, str):
            raise TypeError(f"name={name!r}: the name of a golden must be a string")
        options = DiffOptions([ignore] if isinstance(ignore, str) else ignore, latency, self._naming)
        place = golden_of(self._folder, self._stem, name)
        if place in self._checked:
            raise ValueError(f"{self._shown(place)} was already checked in this test: give this one a name (name=...)")
        self._checked.add(place)
        self._ledger.used.add(place)
        session = self._session(what, where)
        if where is not None and not session.links and not session.damage:
            return f"where={where!r} selects nothing of {near(session.name)}, so there is nothing to compare"
        return self._compare(place, session, options, latency is not None)

    def _session(self, what: object, where: str | None) -> Session:
        """Return the session, or the selected part of it."""
        __tracebackhide__ = True
        if not isinstance(what, Session):
            return read_session(path_of(what, self._captures), where=where)
        if where is not None:
            raise ValueError(f"where={where!r} needs a capture or a recorder, not a session that was read already")
        return what

    def _compare(self, place: str, session: Session, options: DiffOptions, timed: bool) -> str:
        """Compare, write if allowed, and return what is wrong, empty for nothing."""
        if session.damage:
            return f"{near(session.name)} is damaged, so it cannot be compared: {'; '.join(session.damage)}"
        if not session.links:
            return f"{near(session.name)} has no connections, so there is nothing to compare"
        path = self._ledger.goldens / place
        if not path.is_file():
            if self._update == NONE:
                return _missing(self._shown(place), session)
            return self._keep(place, session, timed, self._ledger.written)
        lines = _differing(path, session, options, timed)
        if lines and self._update == ALL:
            return self._keep(place, session, timed, self._ledger.changed)
        return _changed(self._shown(place), session, lines) if lines else ""

    def _keep(self, place: str, session: Session, timed: bool, kept: set[str]) -> str:
        """Write a golden and add it to ``kept``, or return why this is not possible."""
        if self._has_unmatched():
            return (
                f"{self._shown(place)} is not written: a fake PLC received a request that was not recorded, "
                "so the golden would contain refused requests"
            )
        path = self._ledger.goldens / place
        path.parent.mkdir(parents=True, exist_ok=True)
        save(path, golden_text(session, ("latency",) if timed else ()).encode())
        kept.add(place)
        return ""

    def _shown(self, place: str) -> str:
        return near(self._ledger.goldens / place)


def _differing(path: Path, session: Session, options: DiffOptions, timed: bool) -> list[str]:
    """Return the differences, one per line, and how many more there are."""
    try:
        golden = load_golden(path)
    except GoldenError as error:
        return [_cut(str(error))]
    differing = differences(golden, session, options)
    lines = [_cut(difference.text) for difference in islice(differing, MAX_DIFFERENCES)]
    rest = sum([1 for _ in differing])
    if rest:
        lines.append(f"and {words.count(rest, 'further difference')}")
    if timed and not _timed(golden) and _timed(session):
        lines.append("the golden has no answer times to compare")
    return lines


def _timed(session: Session) -> bool:
    return any([transaction.latency_ns is not None for transaction in session.transactions])


def _missing(golden: str, session: Session) -> str:
    held = f"{words.count(len(session.transactions), 'transaction')} on {words.count(len(session.links), 'connection')}"
    return (
        f"there is no golden {golden} yet.\n"
        f"  recorded: {held}, in {near(session.name)}\n"
        "To keep the recording: pytest --s7-update new, then review and commit the golden."
    )


def _changed(golden: str, session: Session, lines: list[str]) -> str:
    listing = "\n".join([f"  {line}" for line in lines])
    return (
        f"session differs from golden {golden} (was = golden, is = this run):\n{listing}\n"
        f"  recorded: {near(session.name)}\n"
        "If the change is intended: pytest --s7-update all, then review and commit the changes."
    )


def _cut(text: str) -> str:
    return text if len(text) <= MAX_LINE else f"{text[:MAX_LINE]} … ({len(text)} characters)"
