"""How a command reads captures: as one, each by itself, by several processes or machines, or as a task of these.

A command gives an observer and writes what it found; `Reading` knows the rest: selection, exit code, what is said on stderr.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import click

from dissect.cli.gate import gate, gate_of
from dissect.cli.indexed import may_match
from dissect.cli.main import EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.nothing import complain_impossible
from dissect.cli.options.jobs import check_jobs
from dissect.cli.run import complain, drive
from dissect.cli.task import current

if TYPE_CHECKING:
    from dissect.cli.options.select import Chosen
    from dissect.engine.observer import Observer
    from dissect.engine.options import Options
    from dissect.inventory.collector import Inventory
    from dissect.jobs.sums import FilePart
    from dissect.report.analysis import Analysis
    from dissect.session import Run

F = TypeVar("F", "Analysis", "Inventory")


class Adder(Protocol[F]):
    """Adds up what was found in files, in their order; ``found`` is the sum."""

    found: F

    def add(self, part: FilePart) -> None:
        """Add the part of the file that comes next."""

    def finish(self) -> None:
        """There are no more files."""


class Reading:
    """Captures, what is read of them, and how.

    ``refused`` are values of options that do not go with files that stand for themselves, and what is said of them. Afterwards
    ``code`` is the exit code so far.
    """

    def __init__(
        self,
        files: tuple[str, ...],
        options: Options,
        chosen: Chosen,
        separate: bool = False,
        jobs: int = 1,
        refused: Sequence[tuple[Any, str]] = (),
    ) -> None:
        self.separate = check_jobs(separate, jobs)
        self.code = EXIT_OK
        self._files = files
        self._options = options
        self._chosen = chosen
        self._jobs = jobs
        self._refused = refused
        self._run: Run | None = None
        self._counts: Any = {}

    @property
    def interrupted(self) -> bool:
        """Whether the reading was broken off."""
        return self.code == EXIT_INTERRUPTED

    def run(self, observer: Observer, before: Callable[[Run], None] = lambda _run: None) -> Run:
        """Read all files as one capture for ``observer``; ``before`` gets the run when nothing was read yet."""
        from dissect.session import Run

        chosen = self._chosen
        self._run = run = Run(self._files, chosen.sieve(observer), chosen.narrow(self._options))
        chosen.begin(run, self._files)
        before(run)
        self.code = drive(run, self._files)
        return run

    def sum(self, nothing: Callable[[], F], adder: Callable[[Options], Adder[F]]) -> F:
        """Return what observers that ``nothing`` makes find: one for all files, or one for each, which an adder adds up.

        Where this is the task of one file, its part is left for whoever gave it, and the command ends.
        """
        of = current()
        if of is not None:
            from dissect.cli.separate import found_task

            found = nothing()
            found_task(of, found, self._chosen.sieve(found), self._options, self._chosen)
            raise click.exceptions.Exit(EXIT_OK)
        if self.separate:
            return self._summed(nothing, adder(self._options))
        found = nothing()
        run = self.run(found)
        found.take(run.pipeline, run.files)
        found.part = self._chosen.part(run)
        return found

    def _summed(self, nothing: Callable[[], F], adder: Adder[F]) -> F:
        from dissect.cli.separate import add_separately, refuse

        refuse(self._chosen, self._refused)
        self.code = add_separately(may_match(self._files, self._chosen), self._jobs, adder, nothing)
        adder.finish()
        self._counts = adder.found.finding_counts
        return adder.found

    def ended(self, fail_on: frozenset[str]) -> int:
        """Say on stderr what the results do not show; return the exit code of the command."""
        run, chosen = self._run, self._chosen
        if run is None:
            return gate_of(self._counts, fail_on, self.code)
        complain(run, self.code)
        complain_impossible(run, chosen)
        return gate(run, fail_on, chosen.ended(self.code), chosen.findings)
