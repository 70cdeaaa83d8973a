"""Write docs/known-bugs.md from the table of known bugs: `python scripts/known_bugs_doc.py > docs/known-bugs.md`."""

from __future__ import annotations

from dissect.engine.findings.known_bugs_tables import KNOWN_BUGS, KnownBug


def document() -> str:
    """Return the page, from the table alone."""
    lines = [
        "# Known bugs of clients and servers",
        "",
        "Made from the table of known bugs (`scripts/known_bugs_doc.py`); a test keeps it so. The signs were taken from public",
        "issue threads and tried on packets made for each. A sign proves nothing about who sent it: other programs may",
        "do the same, and later versions of those named here may not.",
        "",
        "*Finding* is where the sign shows. In bold: the finding names the bug and what helps, where it sees the sign.",
        "",
        "| sign on the wire | seen with | what it means | what to do | finding | public reports |",
        "|---|---|---|---|---|---|",
    ]
    for bug in KNOWN_BUGS.values():
        cells = [_cell(text) for text in (bug.sign, bug.who, bug.means, bug.remedy)]
        lines.append(f"| {' | '.join([*cells, _findings(bug), bug.sources])} |")
    return "\n".join(lines) + "\n"


def _cell(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}" if not text.startswith(("nodes7", "python-", "node-")) else text


def _findings(bug: KnownBug) -> str:
    if not bug.slugs:
        return "none; `show` has it"
    mark = "**" if bug.told else ""
    return ", ".join([f"{mark}[`{slug}`](findings.md){mark}" for slug in bug.slugs])


if __name__ == "__main__":
    print(document(), end="")
