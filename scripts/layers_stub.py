"""Print the stub that names the classes of parts: ``python scripts/layers_stub.py > dissect/layers/part_classes.pyi``."""

from __future__ import annotations

import sys
from typing import Final

from dissect.layers.part_tables import SECTIONS

HEAD: Final = """\
# Made by scripts/layers_stub.py from dissect/layers/part_tables.py.

from typing import Final

from dissect.layers.part_row import Row
from dissect.layers.parts import S7_Part

ROWS: Final[list[Row]]

"""


def stub() -> str:
    """Return the stub: a class for each row."""
    names = sorted(row.name for rows in SECTIONS.values() for row in rows)
    listed = (
        "__all__ = [  # noqa: RUF022  # as Python sorts them\n"
        + "".join([f'    "{name}",\n' for name in names])
        + "]\n\n"
    )
    return HEAD + listed + "".join([f"class {name}(S7_Part): ...\n" for name in names])


if __name__ == "__main__":
    sys.stdout.write(stub())
