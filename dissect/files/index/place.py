"""Location of the index of a folder: next to its captures if the user created one there, otherwise in the user's cache."""

from __future__ import annotations

import hashlib
import os
import sys
from pathlib import Path

from dissect.files.index.store import NAME


def index_of(folder: Path) -> Path:
    """Return the path of the index of a folder: the one in the folder if there is one, else that in the user's cache."""
    here = folder / NAME
    return here if here.is_file() else cached(folder)


def cached(folder: Path) -> Path:
    """Return the path of the index of a folder in the user's cache, whether it exists or not."""
    whole = os.path.realpath(folder)
    digest = hashlib.sha256(os.fsencode(whole)).hexdigest()[:32]
    return _cache() / "s7dissect" / "index" / f"{digest}.sqlite"


def made_room(path: Path) -> None:
    """Make the folders of the cache for an index; no other user can read them. Raises `OSError`."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)


def _cache() -> Path:
    """Return the system's folder for files that can be made again."""
    given = os.environ.get("XDG_CACHE_HOME", "")
    if os.path.isabs(given):  # noqa: PTH117 - an empty one is none
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
