"""What a command is while it reads one file of several that stand for themselves (option --separate).

Whoever reads the file runs the same command line, with this one file in the place of all; nothing but the words of the command
line has to be sent to another process or machine. The command leaves in `Task.found` what it found, and writes nothing.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import click

#: Options of a command that come from settings files (`dissect.cli.configuration`), by parameter.
Settings = Mapping[str, Any]


class Task:
    """A file to read, one of ``several`` or the only one, with ``settings`` that take the place of those of this machine."""

    def __init__(self, file: str, several: bool, settings: Settings | None = None) -> None:
        self.file = file
        self.settings = settings
        self.found: Any = None
        #: Stand for the files of the whole, wherever it matters whether packets are named with their file.
        self.files: Sequence[str] = (file, file) if several else (file,)


#: The task that is done by this process right now, if any.
_task: Task | None = None


def current() -> Task | None:
    """Return the task that this process is doing, None when it is not doing one."""
    return _task


def work(arguments: list[str], several: bool, settings: Settings | None, file: str) -> Any:
    """Run the command line ``arguments`` for one file; return what it found. Raises `FileError` when that cannot be done.

    ``settings`` are those of whoever gave the task; None for those that are found here.
    """
    from dissect.cli.main import group
    from dissect.jobs.tasks import FileError
    from dissect.source.packet import CaptureError

    global _task  # noqa: PLW0603 - a process does one task at a time
    _task = task = Task(file, several, settings)
    try:
        with (
            Path(os.devnull).open("w", encoding="utf-8") as nowhere,
            redirect_stdout(nowhere),
            redirect_stderr(nowhere),
        ):
            group.main(arguments, prog_name="s7dissect", standalone_mode=False)
    except CaptureError as error:
        raise FileError(str(error)) from None
    except click.ClickException as error:
        raise FileError(error.format_message()) from None
    except OSError as error:
        raise FileError(f"{error.filename or file}: {error.strerror or type(error).__name__}") from None
    finally:
        _task = None
    return task.found
