"""Write the golden of every capture again: ``captures/golden/NAME.s7.txt``, ``crafted/NAME.s7.txt``, ``scd/NAME.s7.txt``.

python -m captures.golden                    all of them
python -m captures.golden szl crafted/holes  some of them

``git diff`` then shows the changes; a test compares the files with the captures, and another one with tshark's fields.
"""

from __future__ import annotations

import sys

from captures.golden.sources import SOURCES


def main(names: list[str]) -> int:
    """Write the goldens; returns the exit code."""
    unknown = [name for name in names if name not in SOURCES]
    if unknown:
        print(f"no capture {', '.join(unknown)}; there are: {', '.join(SOURCES)}", file=sys.stderr)
        return 2
    for source in [SOURCES[name] for name in names or SOURCES]:
        text = source.text()
        changed = not source.golden.exists() or source.golden.read_text(encoding="utf-8") != text
        source.golden.parent.mkdir(exist_ok=True)
        source.golden.write_text(text, encoding="utf-8", newline="\n")
        print(f"{source.name}: {len(text)} characters{', changed' if changed else ''}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
