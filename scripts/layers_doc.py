"""Print the page of structures that Scapy can build and dissect: ``python scripts/layers_doc.py > docs/layers-parts.md``."""

from __future__ import annotations

import re
import sys
from typing import Final

import dissect.layers
from dissect.layers.parts import CLASSES

HEAD: Final = """\
# The parts of S7 bodies as Scapy classes

Every structure that `dissect.s7` knows, with its class in `dissect.layers`; how they are put together is in
[layers.md](layers.md), and a session of them in [layers-tutorial.md](layers-tutorial.md). `ls(CLASS)` prints the fields. Fields
named in *filled in* count something and may be left out. This page is made by `scripts/layers_doc.py`.
"""


def main() -> None:
    """Print the page, one table a module."""
    page = [HEAD]
    modules: dict[str, list[str]] = {}
    for layout, cls in sorted(CLASSES.items(), key=lambda item: item[1].__name__):
        filled = [f"`{name}`" for name, default in cls().default_fields.items() if default is None and name != "fill"]
        text = re.sub(r" ``[^.]* filled in when left out\.$", "", (cls.__doc__ or "").split("\n")[0]).replace("``", "`")
        row = f"| `{cls.__name__}` | {text} | {layout.source} | {', '.join(filled)} |"
        modules.setdefault(cls.__module__, []).append(row)
    for name, rows in sorted(modules.items()):
        title = re.split(r",? as Scapy|:", (sys.modules[name].__doc__ or "").split("\n")[0])[0]
        page.append(
            f"\n## {title}\n\n| class | what | source | filled in |\n|---|---|---|---|\n" + "\n".join(rows) + "\n"
        )
    sys.stdout.write("".join(page))


if __name__ == "__main__":
    assert dissect.layers.__all__  # whose import enters the classes
    main()
