"""Print the page of structures that Scapy can build and dissect: ``python scripts/layers_doc.py > docs/layers-parts.md``."""

from __future__ import annotations

import re
import sys
from typing import Final

from scapy.packet import Packet

import dissect.layers
from dissect.layers.part_tables import SECTIONS
from dissect.layers.parts import CLASSES

HEAD: Final = """\
# The parts of S7 bodies as Scapy classes

Every structure that `dissect.protocols.s7` knows, with its class in `dissect.layers`; how they are put together is in
[layers.md](layers.md), and a session of them in [layers-tutorial.md](layers-tutorial.md). `ls(CLASS)` prints the fields. Fields
named in *filled in* count something and may be left out. This page is made by `scripts/layers_doc.py`.
"""


def titled() -> dict[str, list[type[Packet]]]:
    """Return the classes by title: their section in the table, else that of their module."""
    sections = {row.name: title for title, rows in SECTIONS.items() for row in rows}
    found: dict[str, list[type[Packet]]] = {}
    for cls in CLASSES.values():
        title = sections.get(cls.__name__)
        if title is None:
            title = re.split(r",? as Scapy|:", (sys.modules[cls.__module__].__doc__ or "").split("\n")[0])[0]
        found.setdefault(title, []).append(cls)
    return found


def main() -> None:
    """Print the page, one table a section."""
    sources = {cls: layout.source for layout, cls in CLASSES.items()}
    page = [HEAD]
    for title, classes in sorted(titled().items()):
        rows = []
        for cls in sorted(classes, key=lambda cls: cls.__name__):
            filled = [
                f"`{name}`" for name, default in cls().default_fields.items() if default is None and name != "fill"
            ]
            text = re.sub(r" ``[^.]* filled in when left out\.$", "", (cls.__doc__ or "").split("\n")[0])
            rows.append(f"| `{cls.__name__}` | {text.replace('``', '`')} | {sources[cls]} | {', '.join(filled)} |")
        page.append(
            f"\n## {title}\n\n| class | what | source | filled in |\n|---|---|---|---|\n" + "\n".join(rows) + "\n"
        )
    sys.stdout.write("".join(page))


if __name__ == "__main__":
    assert dissect.layers.__all__  # its import registers the classes
    main()
