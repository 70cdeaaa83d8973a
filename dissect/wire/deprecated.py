"""Old names of public things: they work for one version more and warn at the line that uses them."""

from __future__ import annotations

import sys
import warnings


def warn_of(old: str, new: str) -> None:
    """Warn that a name is old. The warning names the line of the program: the first one outside this package.

    Compiled functions have no frame of their own, so that the number of frames between here and there is counted.
    """
    level = 1
    frame = sys._getframe()  # noqa: SLF001 - what `inspect.currentframe` returns, without its imports
    while frame.f_globals.get("__name__", "").startswith("dissect.") and frame.f_back is not None:
        frame = frame.f_back
        level += 1
    warnings.warn(f"{old} is now {new}; the old name goes with the next version", DeprecationWarning, stacklevel=level)
