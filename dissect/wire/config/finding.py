"""Finds `s7dissect.toml`. This runs at every start, so the code that reads the file is only imported if there is one."""

from __future__ import annotations

from pathlib import Path
from typing import Final

NAME: Final = "s7dissect.toml"
#: At most this many folders above the present one are searched for a project's file.
_MOST_FOLDERS: Final = 64


def find_files(folder: Path, user: Path) -> list[Path]:
    """Return the files that exist, the one with the highest priority first.

    The project's file comes first, in ``folder`` or the nearest folder above it, before that of the ``user``'s folder.
    """
    found = []
    for place in [folder, *folder.parents][:_MOST_FOLDERS]:
        if _is_there(place / NAME):
            found.append(place / NAME)
            break
    if _is_there(user / NAME) and user / NAME not in found:
        found.append(user / NAME)
    return found


def _is_there(file: Path) -> bool:
    """Return whether the file exists; False in an unreadable folder, because the user did not name the file."""
    try:
        return file.is_file()
    except OSError:
        return False
