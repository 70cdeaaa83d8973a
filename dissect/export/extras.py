"""Optional libraries, imported when they are needed."""

from __future__ import annotations

import importlib
from typing import Any, Final

#: The extra of this package that installs each library.
_EXTRAS: Final = {"pyarrow": "data", "duckdb": "data"}
#: Libraries that users choose and install themselves.
_THEIRS: Final = ("pandas", "polars")


class MissingLibraryError(ImportError):
    """A library is not installed; the text has the command that installs it."""


def needed(name: str, what: str = "this export") -> Any:
    """Import a library. If it is missing, raises `MissingLibraryError`, which says that ``what`` needs it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        install = package if package in _THEIRS else f"'s7dissect[{_EXTRAS[package]}]'"
        raise MissingLibraryError(f"{what} needs {package}: pip install {install}") from error
