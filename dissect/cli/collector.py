"""How often Python's collector of cycles looks through the objects of a process that runs commands."""

from __future__ import annotations

from typing import Final

#: How many objects are made before it looks at the young ones, and how often it looks at the older (`gc.set_threshold`). A
#: short run makes fewer: those of its modules, which stay. To look through them took a twentieth of such a run.
RARELY: Final = (100_000, 20, 100)
