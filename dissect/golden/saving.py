"""Writing a golden: whole, or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path


def save_whole(path: Path, octets: bytes) -> None:
    """Write a file whole or not at all, whoever else writes or reads it. Raises `OSError`; the folder must exist."""
    handle, name = tempfile.mkstemp(prefix=f".{path.name[:100]}.", dir=path.parent)
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(octets)
        mask = os.umask(0)
        os.umask(mask)
        Path(name).chmod(0o666 & ~mask)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise
