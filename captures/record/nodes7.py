"""The places where scripts/install-nodes7.sh puts nodes7 and the node that runs it."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

SCRIPT: Final = Path(__file__).resolve().parent / "talk_nodes7.js"


def node_of(environment: Path) -> Path:
    """The node of a virtual environment for which nodes7 was installed; the file does not exist in others."""
    return environment / "nodes7" / "node"


def modules_of(environment: Path) -> Path:
    """The folder of its modules, which must be passed to that node as NODE_PATH."""
    return environment / "nodes7" / "node_modules"


def variables_of(environment: Path) -> dict[str, str]:
    """The environment variables with which that node finds nodes7."""
    return {**os.environ, "NODE_PATH": str(modules_of(environment))}
