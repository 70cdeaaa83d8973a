"""Files that are read separately (option --separate), by one process, several or other machines, with the same result.

Each file is a `dissect.cli.task`. Results arrive here in the order of the files, and are added up.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, Future
from contextlib import contextmanager
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Final, NamedTuple, TypeVar

import click

from dissect.cli import task
from dissect.cli.collector import RARELY
from dissect.cli.folders import any_folder
from dissect.cli.main import ARGUMENTS, EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.options.jobs import cluster_meant
from dissect.cli.run import Bar, Interruption
from dissect.packets.source.packet import CaptureError
from dissect.packets.source.remote import is_remote, shown
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.cli.options.select import Chosen
    from dissect.engine.observer import Observer
    from dissect.files.jobs.sums import FilePart
    from dissect.files.jobs.tasks import About, Done
    from dissect.files.session import Run

#: Fields that count over all files, which no task can know.
_COUNTED: Final = ("connection", "number")

T = TypeVar("T")


class Readers(NamedTuple):
    """An executor and the function for how many tasks it may have ``at_once``; ``check`` is called regularly while it has some.

    ``queued`` further tasks may wait in it, so that a process gets the next one as soon as it has finished. ``folder`` is where
    tasks write their files, "" if they are part of the result. ``settings`` are those of the command here, None if tasks find
    them by themselves; ``troubled`` says at the end whether some helpers could not work.
    """

    executor: Executor
    at_once: Callable[[], int]
    folder: str
    settings: task.Settings | None = None
    check: Callable[[], None] = lambda: None
    troubled: Callable[[], bool] = lambda: False
    queued: int = 0


class Here(Executor):
    """Does each task at once, in this process."""

    def submit(self, fn: Callable[..., T], /, *args: Any, **kwargs: Any) -> Future[T]:
        """Do a task; the future is done."""
        future: Future[T] = Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:  # noqa: BLE001 - as every executor hands it on
            future.set_exception(error)
        return future


def refuse(chosen: Chosen, reasons: Sequence[tuple[Any, str]] = ()) -> None:
    """Raise UsageError for options that exclude --separate; ``reasons`` are values of options and their messages."""
    for given, why in (*reasons, (chosen.most, "-c counts over all files")):
        if given:
            raise click.UsageError(f"{_how()}: {why}.")
    if chosen.where is not None:
        for name in _COUNTED:
            if name in chosen.where.names:
                raise click.UsageError(
                    f"{_how()}: the field {name} counts over all files; choose by host, port or time instead."
                )


def _how() -> str:
    return "the files of a folder are read one by one" if any_folder() else "--separate"


class Interrupted:
    """Whether the run was interrupted; checked by the loop that reads a file in this process."""

    asked: Callable[[], bool] = staticmethod(lambda: False)


def read_file(run: Run, each: Callable[[], None] | None = None) -> None:
    """Read the file of a task; call ``each`` after each step, and at the end. Raises `CaptureError`."""
    gc.disable()  # as in `dissect.cli.run.drive`
    try:
        while run.step():
            if each is not None:
                each()
            if Interrupted.asked():
                break
        run.finish()
        if each is not None:
            each()
    finally:
        run.close()
        gc.enable()


def about(run: Run) -> About:
    """Return the notes on the file of a task, after it was read."""
    from dissect.files.jobs.tasks import About

    file = run.files[0]
    return About(file.name, file.loss, int(file.octets), run.pipeline.first_ns, run.pipeline.now_ns)


def separately(
    files: Sequence[str],
    jobs: int,
    take: Callable[[Done], None],
    direct: Any = None,
    folder: str | None = None,
    kept: bool = True,
) -> int:
    """Run the current command for each of ``files``, ``jobs`` at a time; pass the outcomes to ``take``, in order.

    ``direct`` takes the rows of tasks that run in this process. ``folder`` is where tasks write their files, by default a
    temporary one. ``kept``: there are results after an interruption, which is reported. Return the exit code; unreadable files
    are reported on stderr. Raises `CaptureError` if the only file cannot be read.
    """
    from dissect.files.jobs.tasks import DIED, Files

    if jobs > 1 and "-" in files:
        raise click.UsageError("--separate: standard input can be read by one process only; leave out -j.")
    arguments = click.get_current_context().meta[ARGUMENTS]
    code = EXIT_OK
    octets = 0
    joints = _Joints()

    def again(file: str, where: str) -> None:
        say(file, f"{DIED}; it is read once more", where)

    try:
        with (
            Interruption() as interruption,
            _readers(jobs, files, direct, folder) as readers,
            Bar(files, direct is not None) as bar,
        ):
            Interrupted.asked = staticmethod(lambda: interruption.asked)

            def stop() -> bool:
                readers.check()
                return interruption.asked

            doer = Files(
                readers.executor,
                readers.at_once,
                task.work,
                (arguments, len(files) > 1, readers.settings, readers.folder),
                retried=again,
                queued=readers.queued,
            )
            for done in doer.run(files, stop):
                if done.why and len(files) == 1:
                    raise CaptureError(f"{done.why} ({done.where})" if done.where else done.why)
                take(done)
                why = done.why
                if not why:
                    summary: About = done.result.about
                    why = summary.loss
                    octets += summary.octets
                    joints.add(summary.first_ns, summary.last_ns)
                if why:
                    code = EXIT_DAMAGED
                    say(done.file, why, done.where)
                bar.show(octets)
            if interruption.asked:
                code = EXIT_INTERRUPTED
            elif readers.troubled():
                code = EXIT_DAMAGED
    except (KeyboardInterrupt, click.Abort):
        code = EXIT_INTERRUPTED
    finally:
        Interrupted.asked = staticmethod(lambda: False)
    if code == EXIT_INTERRUPTED and kept:
        click.echo("s7dissect: interrupted; the results cover what was read so far", err=True)
    joints.tell()
    return code


@contextmanager
def _readers(jobs: int, files: Sequence[str], direct: Any, folder: str | None) -> Iterator[Readers]:
    """Yield the executor of the tasks."""
    address = cluster_meant()
    if address:
        from dissect.cli.cluster import readers_of

        with readers_of(address, files, folder or "") as readers:
            yield readers
        return
    if jobs == 1:
        with task.directly(direct):
            yield Readers(Here(), lambda: 1, folder or "")
        return
    from dissect.files.jobs.pool import Pool
    from dissect.files.jobs.spool import ROWS_FOLDER

    count = min(jobs, len(files))
    if folder is not None:
        with Pool(count, "" if is_remote(folder) else folder, RARELY, _say_of_pool) as pool:
            yield Readers(pool, lambda: count, folder, queued=count)
        return
    with TemporaryDirectory(prefix=ROWS_FOLDER) as own, Pool(count, own, RARELY, _say_of_pool) as pool:
        yield Readers(pool, lambda: count, own, queued=count)


def _say_of_pool(text: str) -> None:
    click.echo(f"s7dissect: {printable(text)}", err=True)


def say(file: str, why: str, where: str = "") -> None:
    """Report a message about a file on stderr, once, with the file's name, and its machine unless it is this one."""
    name = printable(shown(file))
    text = printable(why)
    at = f" ({printable(where)})" if where else ""
    click.echo(f"s7dissect: {text if text.startswith(f'{name}: ') else f'{name}: {text}'}{at}", err=True)


def part_of_done(done: Done, empty: Callable[[], Observer]) -> FilePart:
    """Return the results of the task for a file; ``empty`` makes empty results for an unreadable file."""
    from dissect.files.jobs.sums import unread

    if not done.why:
        part: FilePart = done.result
        return part
    name = shown(done.file)
    return unread(name, done.why.removeprefix(f"{printable(name)}: "), empty())


class _Joints:
    """Counts files that continue the one before, because their connections are cut in two."""

    def __init__(self) -> None:
        self._last_ns = 0
        self._count = 0

    def add(self, first_ns: int, last_ns: int) -> None:
        """Take the times of the packets at both ends of the next file, 0 for a file without packets."""
        from dissect.packets.source.packet import CONTINUES_NS

        if self._last_ns and first_ns and 0 <= first_ns - self._last_ns <= CONTINUES_NS:
            self._count += 1
        self._last_ns = last_ns or self._last_ns

    def tell(self) -> None:
        """Report them on stderr, if there are any."""
        if self._count:
            files = "1 file goes" if self._count == 1 else f"{self._count} files go"
            followed = (
                "Named one by one they are followed." if any_folder() else "Without --separate they are followed."
            )
            click.echo(
                f"s7dissect: {files} on where the file before ends; connections that go on are counted once in each file. "
                f"{followed}",
                err=True,
            )
