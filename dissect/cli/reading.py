"""How a command reads captures: as one, each separately, with several processes or machines, or as a task of these.

A command provides an observer, an adder or rows, and writes the results; `Reading` does the rest: files, selection, options of
the engine, exit code, and messages on stderr. `dissect.cli.options.reading` makes one of the options of a command.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

import click

from dissect.cli.formats import write_out
from dissect.cli.gate import gate, gate_of
from dissect.cli.main import EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.no_results import CountedOutput, complain_impossible, complain_no_results, expect_possible
from dissect.cli.options.jobs import check_jobs
from dissect.cli.options.select import Chosen
from dissect.cli.run import complain, complain_of, drive, places_of
from dissect.cli.task import Task, current

if TYPE_CHECKING:
    from dissect.cli.rows import Rows, Total
    from dissect.engine.exchange import PayloadDecoder
    from dissect.engine.observer import Observer
    from dissect.engine.options import Options
    from dissect.engine.transactions.naming import Naming
    from dissect.files import session
    from dissect.files.jobs.sums import FilePart
    from dissect.files.jobs.tasks import About, Done
    from dissect.files.session import Run
    from dissect.meaning.inventory.collector import Inventory
    from dissect.meaning.report.analysis import Analysis, Part
    from dissect.meaning.report.styled import Written
    from dissect.packets.source.packet import SourceFile
    from dissect.protocols.tls.key_log import KeyLog

F = TypeVar("F", "Analysis", "Inventory")


class Summarized(Protocol):
    """The results of a file that is read separately."""

    @property
    def about(self) -> About:
        """The file."""


L = TypeVar("L", bound=Summarized)


class Adder(Protocol[F]):
    """Adds up the results of files, in their order; ``result`` is the sum."""

    result: F

    def add(self, part: FilePart) -> None:
        """Add the results of the next file."""

    def finish(self) -> None:
        """End the sum, after the last file."""


class Reading:
    """Captures, and how to read them, by the options of a command.

    ``separate`` is None for a command that always reads all files as one capture, also those of a folder. ``whole_only`` are
    values of options that do not apply to separate files, with their messages. Afterwards ``code`` is the exit code so far.
    """

    def __init__(
        self,
        files: tuple[str, ...] = (),
        chosen: Chosen | None = None,
        *,
        decoder: PayloadDecoder | None = None,
        naming: Naming | None = None,
        tls_keys: KeyLog | None = None,
        checksums: bool = False,
        slow_ns: int | None = None,
        fail_on: frozenset[str] = frozenset(),
        separate: bool | None = None,
        jobs: int = 1,
    ) -> None:
        self.files = files
        self.chosen = chosen if chosen is not None else Chosen(None)
        self.decoder = decoder
        self.naming = naming
        self.tls_keys = tls_keys
        self.checksums = checksums
        self.slow_ns = slow_ns
        self.fail_on = fail_on
        self.jobs = jobs
        self.code = EXIT_OK
        self.whole_only: list[tuple[Any, str]] = [(decoder, "SCD is decoded over all files")]
        self._asked_separate = separate
        self._run: Run | None = None
        self._reading: session.Reading | None = None
        self._counts: Any = {}
        self._shown: CountedOutput | None = None
        self._rows, self._noun = 0, ""
        self._part: Part | None = None  # for separate files

    @property
    def separate(self) -> bool:
        """Whether each file is read separately. Raises UsageError if other options exclude that."""
        return self._asked_separate is not None and check_jobs(self._asked_separate, self.jobs)

    @property
    def named(self) -> Sequence[str]:
        """The files; a task has only one, but must know whether packets are named with their file."""
        of = current()
        return self.files if of is None else of.files

    @property
    def interrupted(self) -> bool:
        """Whether the reading was interrupted."""
        return self.code == EXIT_INTERRUPTED

    @property
    def read(self) -> Sequence[SourceFile]:
        """The files that were read as one capture."""
        return self._run.files if self._run is not None else ()

    def options(self) -> Options:
        """Return the options of the engine, for one run."""
        from dissect.engine.options import Options

        options = Options(decoder=self.decoder, checksums=self.checksums, tls_keys=self.tls_keys, naming=self.naming)
        if self.slow_ns is not None:
            options.slow_ns = self.slow_ns
        return options

    @property
    def findings(self) -> Mapping[str, int] | None:
        """The findings of a selection, by slug; None if no findings were held back."""
        sieve = self._reading.sieve if self._reading is not None else None
        return sieve.findings if sieve is not None else None

    def part(self, run: Run) -> Part | None:
        """Return a description of the selection for an analysis; None for everything."""
        return self._reading.part(run.pipeline) if self._reading is not None else None

    # ---- as one -----------------------------------------------------------------------------------------------------

    def prepared(self, observer: Observer, sieved: bool = True, make: Callable[..., Run] | None = None) -> Run:
        """Return a run over the files that reports to ``observer`` the selection, or everything if not ``sieved``.

        ``make`` makes it of files, observer and options.
        """
        from dissect.files import session

        chosen = self.chosen
        context = chosen.context if chosen.columns else None
        self._reading = session.Reading(self.files, self.options(), chosen.where, context)
        return self._reading.run(observer, sieved, len(self.named) > 1, make or session.Run)

    def run(
        self,
        observer: Observer,
        begun: Callable[[Run], None] = lambda _run: None,
        sieved: bool = True,
        make: Callable[..., Run] | None = None,
        each: Callable[[], None] | None = None,
    ) -> Run:
        """Read all files as one capture for ``observer``; ``begun`` is called with the run before anything is read.

        ``sieved`` and ``make`` are those of `prepared`; ``each`` is called after each step.
        """
        self._run = run = self.prepared(observer, sieved, make)
        begun(run)
        self.code = drive(run, self.files, each, lambda: self.chosen.full)
        return run

    # ---- one by one, here or elsewhere ------------------------------------------------------------------------------

    def as_task(self, work: Callable[[Task], None]) -> None:
        """If this is the task of one file, let ``work`` store its results there, and end the command."""
        of = current()
        if of is not None:
            work(of)
            raise click.exceptions.Exit(EXIT_OK)

    def check(self) -> None:
        """Raise UsageError for contradictory options on how to read; otherwise this happens when reading begins."""
        check_jobs(bool(self._asked_separate), self.jobs)

    def stand_alone(self) -> bool:
        """Return whether the files are read separately; if so, leave out those that the index rules out.

        Raises UsageError for options that exclude that.
        """
        if not self.separate:
            return False
        from dissect.cli.indexed import may_match
        from dissect.cli.separate import refuse

        refuse(self.chosen, self.whole_only)
        self.files = may_match(self.files, self.chosen)
        return True

    def apart(
        self, take: Callable[[Done], None], direct: Any = None, folder: str | None = None, kept: bool = True
    ) -> None:
        """Run the present command for each file, and pass each result to ``take``, in their order.

        ``direct``, ``folder`` and ``kept`` are those of `separately`.
        """
        from dissect.cli.separate import separately

        self.code = separately(self.files, self.jobs, take, direct, folder, kept)

    def one_by_one(self, read: Callable[[str], L], take: Callable[[str, L], None]) -> None:
        """Call ``read`` for each file separately, as its task does, and pass the results to ``take``."""
        if self.separate:
            self.apart(lambda done: None if done.why else take(done.file, done.result))
            return
        for file in self.files:
            result = read(file)
            if loss := result.about.loss:
                complain_of([(file, loss)], EXIT_OK)
                self.code = EXIT_DAMAGED
            take(file, result)

    # ---- however ----------------------------------------------------------------------------------------------------

    def sum(self, empty: Callable[[], F], adder: Callable[[Options], Adder[F]]) -> F:
        """Return the result of observers made by ``empty``: of one for all files, or the sum of one for each file."""

        def work(of: Task) -> None:
            from dissect.cli.separate import read_file
            from dissect.files.jobs.sums import part_of

            result = empty()
            run = self.prepared(result)
            read_file(run)
            result.part = self.part(run)
            of.result = part_of(result, run.pipeline, run.files)

        self.as_task(work)
        if self.stand_alone():
            return self._summed(empty, adder(self.options()))
        result = empty()
        run = self.run(result)
        result.take(run.pipeline, run.files)
        result.part = self.part(run)
        return result

    def _summed(self, empty: Callable[[], F], adder: Adder[F]) -> F:
        from dissect.cli.separate import part_of_done

        self.apart(lambda done: adder.add(part_of_done(done, empty)))
        adder.finish()
        self._counts = adder.result.finding_counts
        self._part = adder.result.part
        return adder.result

    def rows(self, rows: Rows, noun: str) -> Total:
        """Read for rows, write them, and return the totals of all files; a row is called ``noun``."""
        from dissect.cli.rows import Total, counts_of

        def work(of: Task) -> None:
            from dissect.cli.separate_rows import rows_task

            rows_task(of, self, rows)

        self.as_task(work)
        total = Total()
        if self.stand_alone():
            from dissect.cli.separate_rows import rows_separately

            rows_separately(self, rows, total)
            self._counts = total.findings
            self._rows, self._noun = total.rows, noun
            return total
        self._run = run = self.prepared(rows.observer, self.sieves(rows))
        rows.begin(places_of(run, self.files))
        self._shown = shown = CountedOutput(noun, len(rows.writer.lines))
        write = (lambda: shown.write(rows.take(run))) if rows.at_once else None
        self.code = drive(run, self.files, write, lambda: self.chosen.full)
        total.add(counts_of(run.pipeline, self.findings, rows.left()))
        return total

    def write(self, lines: list[Written], results: bool) -> None:
        """Write lines after `rows`; ``results`` tells whether they count as results."""
        if results and self._shown is not None:
            self._shown.write(lines)
        else:
            write_out(lines)

    def sieves(self, rows: Rows) -> bool:
        """Return whether the findings of a selection must be separated from others."""
        return rows.sieved and bool(self.fail_on)

    # ---- the end ----------------------------------------------------------------------------------------------------

    def complain(self) -> None:
        """Report on stderr problems that the results do not show: damaged files, an interruption."""
        if self._run is not None:  # for separate files this was done
            complain(self._run, self.code)

    def possible(self) -> bool:
        """Return whether the selection may match; otherwise report an unknown number or time on stderr."""
        return self._run is None or not complain_impossible(self._run, self.chosen)

    def expect_possible(self) -> None:
        """Do the same for a command that writes a file: refuse an unknown number; report a selection without a match."""
        if self._run is not None:
            expect_possible(self._run, self.chosen)
            self.match()

    def explain(self, narrowed: Iterable[str] = ()) -> None:
        """Explain on stderr why there are no rows, if so; ``narrowed`` are other options that select."""
        if self._shown is not None and self._run is not None:
            self._shown.explain(self._run, self.chosen, narrowed)
        elif not self._rows and not self.interrupted:
            complain_no_results(self._noun, self.chosen, narrowed)

    def match(self) -> None:
        """Report on stderr a selection that matches nothing."""
        sieve = self._reading.sieve if self._reading is not None else None
        unmatched = sieve.nothing if sieve is not None else self._part is not None and not self._part.passed
        if unmatched and not self.chosen.impossible:
            complain_no_results("", self.chosen)

    def gated(self) -> int:
        """Return the exit code of the command; say on stderr why the gate of --fail-on failed."""
        if self._run is None:
            return gate_of(self._counts, self.fail_on, self.code)
        return gate(self._run, self.fail_on, self.chosen.ended(self.code), self.findings)

    def ended(self) -> int:
        """Report all that and return the exit code, for a command with one result."""
        self.complain()
        self.possible()
        return self.gated()
