"""Which build of the engine runs: compiled by mypyc, or the same source interpreted."""

from __future__ import annotations

from typing import Final

#: True in the compiled build. This module is compiled with the hot ones, so its own file tells the truth.
COMPILED: Final[bool] = not __file__.endswith(".py")
