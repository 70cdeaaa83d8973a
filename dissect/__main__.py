"""The start of a process: ``s7dissect`` and ``python -m dissect``."""

from __future__ import annotations

import atexit
import gc
import os
import sys
from typing import NoReturn

from dissect.cli.collector import RARELY


class _End:
    """Ends the process with ``code`` once all else is done, without taking apart what it holds.

    The system takes the memory back at once; Python would free thousands of objects one by one before that, which is a
    twentieth to a tenth of a short run. While ``code`` is None, as when an exception ends the process, it does nothing.
    """

    def __init__(self) -> None:
        self.code: int | None = None

    def __call__(self) -> None:
        if self.code is None:
            return
        try:
            for stream in (sys.stdout, sys.stderr):
                if stream is not None:
                    stream.flush()
        except (OSError, ValueError):
            return  # Python meets it again, and says so
        os._exit(self.code)


def main() -> NoReturn:
    """Run the command line on the arguments of the process and end the process with its exit code."""
    gc.set_threshold(*RARELY)
    end = _End()
    if sys.gettrace() is None:  # a debugger, or a measurement of coverage, is there to see the end
        atexit.register(end)  # as the first, so that it is called last, and when all threads are over
    # Only now: to import the command line makes most of the objects that a short run has.
    from dissect.cli.main import run

    end.code = run()
    sys.exit(end.code)


if __name__ == "__main__":
    main()
