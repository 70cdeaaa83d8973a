"""The option ``-j``: how many processes read at the same time."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, Final

import click

AUTO: Final = "auto"


def processors() -> int:
    """Return how many processors this process may use."""
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not on macOS and Windows
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


#: ``-j N``; the command's argument is ``jobs``. Not shown: its results are right, but it does not pay yet (decision 15).
jobs_option: Final[Callable[[Any], Any]] = click.option(
    "-j",
    "--jobs",
    "jobs",
    callback=_jobs,
    default="1",
    show_default=True,
    metavar="N",
    hidden=True,
    help="Share the work among N processes, or auto for as many as there are processors. The results are the same.",
)
