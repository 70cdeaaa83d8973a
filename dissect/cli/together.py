"""Results in rows by several processes (option -j): each runs the same command line, and here their rows become one output.

A worker is a process that runs the command with its own share of the connections; `Worker` in place of the drive through the
files. Whoever started it merges (`dissect.jobs.merging`). Where several processes cannot find exactly what one finds, one
process does it: at once where that is known before, or from where it shows, without writing anything twice.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Callable, Iterable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dissect.cli.formats import write_out
from dissect.cli.main import ARGUMENTS, EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.run import Bar, Signals, check_captures, places_of
from dissect.source.packet import CaptureError
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.cli.options.select import Chosen
    from dissect.engine.order import Order
    from dissect.engine.pipeline import Options
    from dissect.jobs.merging import Merger
    from dissect.jobs.parts import End, Piece, Rows
    from dissect.jobs.share import Key, Share
    from dissect.report.styled import Line

#: Makes the observer of a worker.
MakeRows = Callable[["Share", "Order"], "Rows"]


class Refused:
    """What a worker sends instead of results when a file cannot be read; ``file`` stays the one it named last."""

    def __init__(self, text: str) -> None:
        self.text = text


class Worker:
    """What a command is in a worker: the part that does a share of the run over ``files``."""

    def __init__(self, send: Callable[[Any], None], files: Sequence[str], index: int, count: int) -> None:
        self._send = send
        self._files = files
        self._index = index
        self._count = count

    def rows(self, options: Options, chosen: Chosen, key: Key, make: MakeRows) -> int:
        """Do the share, with the observer that ``make(share, order)`` returns; send what is found."""
        from dissect.engine.order import Order
        from dissect.jobs.parts import pieces
        from dissect.jobs.share import Share
        from dissect.session import Run

        chosen.narrow(options)
        order, share = Order(), Share(self._index, self._count, key, options.only)
        options.only = share
        options.order = order
        rows = make(share, order)
        run = Run(self._files, rows, options)
        chosen.begin(run, self._files)
        rows.begin(places_of(run, self._files))
        gc.disable()  # as in `dissect.cli.run.drive`
        try:
            for piece in pieces(run, rows, share, order):
                self._send(piece)
        except CaptureError as error:
            self._send(Refused(str(error)))
        return EXIT_OK


#: The worker that this process is, if it is one.
_worker: Worker | None = None


def working() -> Worker | None:
    """Return the worker that this process is, None in every other process."""
    return _worker


def work(channel: Any, arguments: list[str], files: Sequence[str], index: int, count: int) -> None:
    """Be a worker: run the command line ``arguments``, with the files that its names stood for when all workers were started.

    What is to be said is said by whoever started it.
    """
    from dissect.cli.main import group

    global _worker  # noqa: PLW0603 - a process is a worker or it is not
    _worker = Worker(channel.send, files, index, count)
    with Path(os.devnull).open("w", encoding="utf-8") as nowhere, redirect_stdout(nowhere), redirect_stderr(nowhere):
        try:
            group.main(arguments, prog_name="s7dissect", standalone_mode=False)
        except BrokenPipeError:
            pass  # nobody listens any more
        except Exception as error:  # noqa: BLE001 - it would be lost
            channel.send(Refused(f"{type(error).__name__}: {error}"))
        finally:
            channel.close()


class Output:
    """Writes lines to standard output, but not those again that were written before it began anew."""

    def __init__(self) -> None:
        self._written = 0
        self._skip = 0

    def write(self, lines: Iterable[str | Line]) -> None:
        """Write lines."""
        fresh = list(lines)
        skipped = min(self._skip, len(fresh))
        self._skip -= skipped
        self._written += len(fresh) - skipped
        write_out(fresh[skipped:])

    def again(self) -> None:
        """What comes now begins with what was written."""
        self._skip = self._written


def alone_because(files: Sequence[str], chosen: Chosen, reasons: Iterable[tuple[Any, str]] = ()) -> str:
    """Return why a run has to be done by one process, empty for no reason; ``reasons`` are those of options that were given."""
    if any([file == "-" or not Path(file).is_file() for file in files if file == "-" or Path(file).exists()]):
        return "what is no regular file can be read only once"
    if chosen.where is not None and "number" in chosen.where.names:
        return "the field number is known only when all connections are read"
    if chosen.most:
        return "-c ends the reading early"
    return next((why for given, why in reasons if given), "")


def alone(why: str) -> None:
    """Say that one process does it."""
    click.echo(f"s7dissect: -j: done by one process: {why}", err=True)


def together(
    files: Sequence[str], merger: Merger, jobs: int, merged: Callable[[list[str | Line], list[int], int], None]
) -> tuple[int, list[End]] | None:
    """Have workers do the command at hand; give ``merged`` the lines of each stretch, their packets, and the first held back.

    Return the exit code and what each share came to (nothing when it was interrupted); None when one process has to begin
    anew. Raises `CaptureError` for a file that cannot be read, and ClickException when a worker was lost.
    """
    from dissect.jobs.merging import DiffersError
    from dissect.jobs.parts import End
    from dissect.jobs.team import Team, WorkerError

    check_captures(files)
    ends: list[End] = []
    arguments = click.get_current_context().meta[ARGUMENTS]
    try:
        with Signals() as interruption, Bar(files, True) as bar, Team(work, (arguments, tuple(files)), jobs) as team:
            for said in team.rounds(lambda: interruption.asked):
                for one in said:
                    if isinstance(one, Refused):
                        raise CaptureError(printable(one.text))
                if isinstance(said[0], End):
                    ends = said
                    continue
                found: list[Piece] = said
                merged(*merger.merge(found), min([piece.held for piece in found if piece.held], default=0))
                bar.show(min([piece.octets for piece in found]))
    except DiffersError as error:
        alone(str(error))
        return None
    except WorkerError as error:
        raise click.ClickException(f"{printable(str(error))}; the results stop there") from None
    if not ends:
        return EXIT_INTERRUPTED, ends
    return EXIT_DAMAGED if any([loss for _, loss in ends[0].files]) else EXIT_OK, ends
