"""Print the stubs that name the Scapy layers to type checkers.

``python scripts/layers_stub.py > dissect/layers/part_classes.pyi`` for the classes of parts, and
``python scripts/layers_stub.py package > dissect/layers/__init__.pyi`` for the package.
"""

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


PACKAGE_HEAD: Final = """\
# Made by scripts/layers_stub.py from the names of dissect/layers/__init__.py.
# ruff: noqa: F403, F405, I001 - the star stands for the names of another stub; lines are in the order of Python

"""


def stub() -> str:
    """Return the stub: a class for each row."""
    names = sorted(row.name for rows in SECTIONS.values() for row in rows)
    return HEAD + _listed(names) + "\n" + "".join([f"class {name}(S7_Part): ...\n" for name in names])


def _listed(names: list[str]) -> str:
    lines = "".join([f'    "{name}",\n' for name in names])
    return f"__all__ = [  # noqa: RUF022  # as Python sorts them\n{lines}]\n"


def package_stub() -> str:
    """Return the stub of the package: mypy does not see additions to ``__all__``, so a star import lacked the parts."""
    from dissect import layers
    from dissect.layers import part_classes

    names = set(layers.__all__) - set(part_classes.__all__)
    lines = [f"from {getattr(layers, name).__module__} import {name} as {name}" for name in names]
    lines.append(f"from {part_classes.__name__} import *")
    return PACKAGE_HEAD + "".join([f"{line}\n" for line in sorted(lines)]) + "\n" + _listed(sorted(layers.__all__))


if __name__ == "__main__":
    sys.stdout.write(package_stub() if sys.argv[1:] == ["package"] else stub())
