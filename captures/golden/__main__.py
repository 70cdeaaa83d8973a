"""Write the golden of every recorded capture anew: ``captures/golden/NAME.s7.txt`` for ``captures/NAME.pcapng``.

python -m captures.golden              all of them
python -m captures.golden szl blocks   some of them

What changed is then seen with ``git diff``; a test holds the files to the captures, and another to tshark's fields.
"""

from __future__ import annotations

import sys
from pathlib import Path

from dissect.golden import golden_text, read_session

FOLDER = Path(__file__).resolve().parent
CAPTURES = FOLDER.parent


def main(names: list[str]) -> int:
    """Write the goldens; returns the exit code."""
    known = sorted(path.stem for path in CAPTURES.glob("*.pcapng"))
    unknown = [name for name in names if name not in known]
    if unknown:
        print(f"no capture {', '.join(unknown)}; there are: {', '.join(known)}", file=sys.stderr)
        return 2
    for name in names or known:
        session = read_session(CAPTURES / f"{name}.pcapng")
        path = FOLDER / f"{name}.s7.txt"
        text = golden_text(session)
        changed = not path.exists() or path.read_text(encoding="utf-8") != text
        path.write_text(text, encoding="utf-8", newline="\n")
        print(f"{path.name}: {len(session.transactions)} transactions{', changed' if changed else ''}")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
