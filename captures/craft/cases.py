"""All crafted captures. Importing this module gathers the recipes of the others."""

from __future__ import annotations

from pathlib import Path

from captures.craft import (
    causes,
    coverage,
    coverage_userdata,
    files,
    iso,
    links,
    losses,
    lying,
    neighbours,
    netlink,
    pairing,
    plus,
    program,
    rules,
    streams,
    worked,
)
from captures.craft.case import RECIPES, Case, craft

__all__ = ["FOLDER", "GROUPS", "RECIPES", "Case", "craft"]

GROUPS = (
    streams,
    losses,
    links,
    files,
    iso,
    lying,
    rules,
    causes,
    pairing,
    plus,
    program,
    neighbours,
    netlink,
    worked,
    coverage,
    coverage_userdata,
)
FOLDER = Path(__file__).resolve().parent.parent / "crafted"
