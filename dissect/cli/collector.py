"""How often Python's collector of cycles looks through the objects of a process that runs commands."""

from __future__ import annotations

from typing import Final

#: Number of new objects before a collection of the young ones, and how often older ones are included (`gc.set_threshold`). A
#: short run makes fewer: those of its modules, which stay. Collecting them took a twentieth of such a run.
RARELY: Final = (100_000, 20, 100)
