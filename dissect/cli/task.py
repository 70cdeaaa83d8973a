"""A command as the task of one file of several that are read separately (option --separate).

The process for the file runs the same command line with this one file instead of all; only the words of the command line are
sent to another process or machine. The command stores its results in `Task.result`, and writes nothing.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import click

#: Options of a command that come from settings files (`dissect.cli.configuration`), by parameter.
Settings = Mapping[str, Any]


class Task:
    """A file to read, one of ``several`` or the only one.

    ``settings`` replace those of this machine; None keeps them. ``folder`` is for its rows, empty if there is none
    (`dissect.files.jobs.tasks`); ``place`` is the position of the file among all, from 0. ``direct`` takes its rows at once, if
    this process writes the output.
    """

    def __init__(
        self, file: str, several: bool, settings: Settings | None, folder: str, place: int, direct: Any
    ) -> None:
        self.file = file
        self.settings = settings
        self.folder = folder
        self.place = place
        self.direct = direct
        self.result: Any = None
        #: Two names, so that code which checks for several files names packets with their file.
        self.files: Sequence[str] = (file, file) if several else (file,)


#: The task that this process is doing now, if any.
_task: Task | None = None
#: `Task.direct` of tasks that this process gives itself.
_direct: Any = None


def current() -> Task | None:
    """Return the task that this process is doing, None when it is not doing one."""
    return _task


@contextmanager
def directly(sink: Any) -> Iterator[None]:
    """Let tasks of this process pass their rows to ``sink`` at once."""
    global _direct  # noqa: PLW0603 - as below
    _direct = sink
    try:
        yield
    finally:
        _direct = None


def work(arguments: list[str], several: bool, settings: Settings | None, folder: str, place: int, file: str) -> Any:
    """Run the command line ``arguments`` for one file; return its results. Raises `FileError` if that fails.

    ``settings`` are those of the sender of the task; None for those found here.
    """
    from dissect.cli.main import FULL, group
    from dissect.files.jobs.spool import ROWS_FOLDER
    from dissect.files.jobs.tasks import FileError
    from dissect.packets.source.packet import CaptureError

    global _task  # noqa: PLW0603 - a process does one task at a time
    _task = task = Task(file, several, settings, folder, place, _direct)
    try:
        with (
            Path(os.devnull).open("w", encoding="utf-8") as nowhere,
            redirect_stdout(nowhere if _direct is None else sys.stdout),
            redirect_stderr(nowhere),
        ):
            group.main(arguments, prog_name="s7dissect", standalone_mode=False)
    except CaptureError as error:
        raise FileError(str(error)) from None
    except click.ClickException as error:
        raise FileError(error.format_message()) from None
    except OSError as error:
        if _direct is not None and error.filename is None:
            raise  # the output of this process
        if error.errno in FULL and Path(folder).name.startswith(ROWS_FOLDER):
            raise FileError(
                f"its rows cannot be written to {folder}: {error.strerror}; TMPDIR names another place for them"
            ) from None
        raise FileError(f"{error.filename or file}: {error.strerror or type(error).__name__}") from None
    finally:
        _task = None
    return task.result
