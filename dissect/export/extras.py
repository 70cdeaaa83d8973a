"""Libraries that not every installation has, imported when they are needed."""

from __future__ import annotations

import importlib
from typing import Any, Final

#: Each library and the extra that brings it.
_EXTRAS: Final = {"pyarrow": "data", "duckdb": "data"}
#: These are the user's own choice.
_THEIRS: Final = ("pandas", "polars")


class MissingLibraryError(ImportError):
    """A library is not installed; its text says what to type."""


def needed(name: str, what: str = "this export") -> Any:
    """Import a library. Raises `MissingLibraryError` with the line to type when it is missing; ``what`` needs it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        install = package if package in _THEIRS else f"'s7dissect[{_EXTRAS[package]}]'"
        raise MissingLibraryError(f"{what} needs {package}: pip install {install}") from error
