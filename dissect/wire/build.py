"""`COMPILED`: whether the engine runs compiled by mypyc, or as the same source interpreted."""

from __future__ import annotations

from typing import Final

#: True in the compiled build. This module is compiled whenever the hot ones are, so its own file name shows it.
COMPILED: Final[bool] = not __file__.endswith(".py")
