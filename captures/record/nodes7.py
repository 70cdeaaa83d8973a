"""Where scripts/install-nodes7.sh puts nodes7 and the node that runs it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

SCRIPT: Final = Path(__file__).resolve().parent / "talk_nodes7.js"


def node_of(environment: Path) -> Path:
    """The node of a virtual environment that nodes7 was installed for; there is no such file where it was not."""
    return environment / "nodes7" / "node"


def modules_of(environment: Path) -> Path:
    """The folder of its modules, which that node has to be given as NODE_PATH."""
    return environment / "nodes7" / "node_modules"


def variables_of(environment: Path) -> dict[str, str]:
    """The environment variables with which that node finds nodes7."""
    return {**os.environ, "NODE_PATH": str(modules_of(environment))}
