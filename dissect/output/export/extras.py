"""Optional libraries, imported when they are needed."""

from __future__ import annotations

import importlib
import importlib.util
from typing import Any, Final

#: The extra of this package that installs each library.
_EXTRAS: Final = {"pyarrow": "data", "duckdb": "data"}
#: Libraries that users choose and install themselves.
_THEIRS: Final = ("pandas", "polars")


class MissingLibraryError(ImportError):
    """A library is not installed; the text has the command that installs it."""


def check_needed(name: str, what: str = "this export") -> None:
    """Raise `MissingLibraryError` if a library is not installed, without importing it: some start threads when they are."""
    package = name.partition(".")[0]
    if importlib.util.find_spec(package) is None:
        needed(package, what)


def needed(name: str, what: str = "this export") -> Any:
    """Import a library. If it is missing, raises `MissingLibraryError`, which says that ``what`` needs it."""
    try:
        return importlib.import_module(name)
    except ImportError as error:
        package = name.partition(".")[0]
        install = package if package in _THEIRS else f"'s7dissect[{_EXTRAS[package]}]'"
        raise MissingLibraryError(f"{what} needs {package}: pip install {install}") from error
