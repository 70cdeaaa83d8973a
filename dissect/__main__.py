"""Where a process begins: ``s7dissect`` and ``python -m dissect``."""

from __future__ import annotations

import gc
import sys
from typing import NoReturn

from dissect.cli.collector import RARELY


def main() -> NoReturn:
    """Run the command line on the arguments of the process and end the process with its exit code."""
    gc.set_threshold(*RARELY)
    # Only now: to import the command line makes most of the objects that a short run has.
    from dissect.cli.main import run

    code = run()
    # Nor at the end, when it would look through all results although the process gives everything back at once.
    gc.freeze()
    sys.exit(code)


if __name__ == "__main__":
    main()
