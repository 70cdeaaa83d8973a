"""Write the known differences into docs/oracle.md, and the further fields that Wireshark shows in all captures.

PYTHONPATH=. python scripts/oracle_doc.py [FOLDER of the public captures]
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "oracle.md"
KNOWN_HEADING = "## Known differences\n"
HEADING = "## What Wireshark shows besides\n"


def main(arguments: list[str]) -> int:
    """Compare, and put each table below its heading; return the exit code."""
    from dissect.testing.oracle import known
    from dissect.testing.oracle.compare import compare
    from dissect.testing.oracle.uncarried import as_markdown, without_reason

    folders = [ROOT / "captures", ROOT / "captures" / "crafted", *map(Path, arguments)]
    paths = [path for folder in folders for path in sorted(folder.glob("*.pc*")) if not path.name.startswith("cut-")]
    other: Counter[str] = Counter()
    again: Counter[str] = Counter()
    for path in paths:
        comparison = compare(str(path))
        other += comparison.other
        again += comparison.again
    text = with_table(PAGE.read_text(encoding="utf-8"), KNOWN_HEADING, known.as_markdown())
    PAGE.write_text(with_table(text, HEADING, as_markdown(other, again)), encoding="utf-8")
    missing = without_reason(other, again)
    print(f"{len(paths)} captures, {len(other)} names; without a reason: {', '.join(missing) or 'none'}")
    return 1 if missing else 0


def with_table(text: str, heading: str, table: str) -> str:
    """Return the page with this table in place of the first one after a heading."""
    before, _, after = text.partition(heading)
    introduction, _, rest = re.split(r"((?:^\|.*\n)+)", after, maxsplit=1, flags=re.MULTILINE)
    return before + heading + introduction + table + rest


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
