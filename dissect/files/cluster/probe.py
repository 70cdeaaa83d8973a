"""Finds out whether a machine can read captures: its versions and packages.

The source of this module is sent to workers and runs there. So it may only use the standard library; this package may not be
installed there.
"""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import os
import platform
from collections.abc import Mapping, Sequence
from typing import Any


def facts(extras: Mapping[str, Sequence[str]]) -> dict[str, Any]:
    """Return facts about this machine, and which ``extras`` are complete; ``extras`` has the distributions of each.

    ``version`` is that of this package, "" if it cannot be used; ``problem`` says why. ``dask`` is that of Dask's workers.
    """
    found: dict[str, Any] = {
        "host": platform.node(),
        "process": os.getpid(),
        "python": platform.python_version(),
        "dask": _version("distributed"),
        "version": "",
        "compiled": False,
        "problem": "",
        "extras": [name for name, needed in extras.items() if all(map(_version, needed))],
    }
    try:
        found["version"] = str(importlib.import_module("dissect").__version__)
        build = importlib.util.find_spec("dissect.wire.build")
    except Exception as error:  # noqa: BLE001 - whatever an import may raise is why the package cannot be used
        found["problem"] = str(error) or type(error).__name__
    else:
        found["compiled"] = build is not None and not str(build.origin).endswith(".py")
    return found


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""
