"""Craft the captures in captures/crafted: all of them, or those named.

python -m captures.craft                    write the captures and their TOML files
python -m captures.craft holes sections     some of them
python -m captures.craft --list             name and purpose of each
"""

from __future__ import annotations

import sys

from captures.craft.cases import FOLDER, RECIPES, craft


def main(arguments: list[str]) -> int:
    """Craft; returns the exit code."""
    if arguments == ["--list"]:
        for name, (purpose, _) in RECIPES.items():
            print(f"{name}: {purpose}")
        return 0
    unknown = [name for name in arguments if name not in RECIPES]
    if unknown:
        print(f"no capture {', '.join(unknown)}; there are: {', '.join(RECIPES)}", file=sys.stderr)
        return 2
    FOLDER.mkdir(exist_ok=True)
    for name in arguments or RECIPES:
        case = craft(name)
        octets = case.write(case)
        (FOLDER / case.file).write_bytes(octets)
        (FOLDER / f"{case.name}.toml").write_text(case.toml(), encoding="utf-8")
        print(f"{case.file}: {case.counts['packets']} packets, {case.counts['s7_pdus']} PDUs, {len(octets)} octets")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
