"""The options ``-j`` and ``--cluster``: how many processes read at the same time, or which machines."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any, Final

import click

from dissect.cli.folders import any_folder
from dissect.cli.task import current

AUTO: Final = "auto"
#: Keys in the context of a command: the address of a cluster, and whether files are looked up in their index.
_CLUSTER: Final = "dissect.cli.options.jobs.cluster"
_INDEXED: Final = "dissect.cli.options.jobs.indexed"


def processors() -> int:
    """Return how many processors this process may use."""
    if sys.platform == "linux":
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _jobs(ctx: click.Context, param: click.Parameter, value: str) -> int:
    if value == AUTO:
        return processors()
    try:
        number = int(value)
    except ValueError:
        raise click.BadParameter(f"expected a number of processes or {AUTO}, got {value!r}.", ctx, param) from None
    most = processors()
    if number < 1:
        raise click.BadParameter(f"{number} processes can do nothing; 1 or more, or {AUTO}.", ctx, param)
    if number > most:
        have = "there is 1 processor" if most == 1 else f"there are {most} processors"
        raise click.BadParameter(f"{number} is too many, {have} here; {AUTO} takes all.", ctx, param)
    return number


def _option(**attributes: Any) -> Callable[[Any], Any]:
    return click.option(
        "-j", "--jobs", "jobs", callback=_jobs, default="1", show_default=True, metavar="N", **attributes
    )


def cluster_address(ctx: click.Context, param: click.Parameter, value: str | None) -> str | None:
    """Return the address of a scheduler, None when none was given."""
    if value is None or ctx.resilient_parsing:
        return value
    from dissect.files.cluster.connect import checked_address

    try:
        ctx.meta[_CLUSTER] = checked_address(value)
    except ValueError as error:
        raise click.BadParameter(str(error), ctx, param) from None
    return str(ctx.meta[_CLUSTER])


def cluster_meant() -> str:
    """Return the address in ``--cluster`` of the running command, "" for none."""
    return str(click.get_current_context().meta.get(_CLUSTER, ""))


def _indexed(ctx: click.Context, _param: click.Parameter, value: bool) -> bool:
    ctx.meta[_INDEXED] = value
    return value


def indexed_option(command: Any) -> Any:
    """Add ``--indexed`` to a command that has ``-Y``; `dissect.cli.indexed` implements it."""
    return click.option(
        "--indexed",
        is_flag=True,
        callback=_indexed,
        expose_value=False,
        help="With --separate and -Y: do not open files in which the index of their folder has nothing for -Y.",
    )(command)


def indexed_meant() -> bool:
    """Return whether the command at hand has ``--indexed``."""
    return bool(click.get_current_context().meta.get(_INDEXED))


def separate_options(command: Any) -> Any:
    """Add ``--separate``, ``-j N`` and ``--cluster``; the command's arguments are ``separate`` and ``jobs``."""
    command = click.option(
        "--cluster",
        callback=cluster_address,
        expose_value=False,
        metavar="ADDRESS",
        help="With --separate: have the workers of a Dask cluster read the files; tcp://HOST:8786 is its scheduler.",
    )(command)
    command = _option(
        help="With --separate: read N files at the same time, or auto for one on each processor. The results are the same."
    )(command)
    return click.option(
        "--separate",
        is_flag=True,
        help="Each file is a capture of its own: no connection goes on from one to the next.",
    )(command)


def check_jobs(separate: bool, jobs: int) -> bool:
    """Return whether each file is a separate capture: by option, or because the files belong to a folder.

    Raises UsageError for several processes, machines or an index if files may continue one another (decision 18).
    """
    separate = separate or any_folder() or current() is not None
    if indexed_meant() and not separate:
        raise click.UsageError("--indexed leaves out files, and needs --separate: each is a capture of its own.")
    if cluster_meant() and jobs > 1:
        raise click.UsageError("-j is for this machine, and --cluster for others; choose one.")
    if cluster_meant() and not separate:
        raise click.UsageError(
            "--cluster has each file read by one of its workers, and needs --separate: each is a capture of its own."
        )
    if jobs > 1 and not separate:
        raise click.UsageError(
            "-j reads several files at the same time, and needs --separate: each is a capture of its own."
        )
    return separate
