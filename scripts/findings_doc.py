"""Write docs/findings.md from the catalogue: `python scripts/findings_doc.py > docs/findings.md`."""

from __future__ import annotations

from dissect.findings.catalogue import CATALOGUE
from dissect.findings.finding import SEVERITIES


def document() -> str:
    """Return the page, from the rules alone."""
    lines = [
        "# Findings",
        "",
        "Made from the catalogue (`scripts/findings_doc.py`); a test keeps it so. Slugs are stable. Each finding names",
        "its connection, the packets that show it and what was seen. Counters are exact; at most 100 findings of a slug",
        "are detailed for one connection, and 1000 in all.",
    ]
    for severity in SEVERITIES:
        lines += ["", f"## {severity}", "", "| slug | what | what to do |", "|---|---|---|"]
        lines += [
            f"| `{rule.slug}` | {rule.sentence} | {rule.advice} |"
            for rule in CATALOGUE.values()
            if rule.severity == severity
        ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    print(document(), end="")
