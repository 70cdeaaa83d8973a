"""Write the table of fields in docs/select.md: `PYTHONPATH=. python scripts/select_doc.py`."""

from __future__ import annotations

import re
from pathlib import Path

from dissect.meaning.select.fields import FIELDS
from dissect.meaning.select.where import PLURALS

PAGE = Path(__file__).resolve().parent.parent / "docs" / "select.md"
MARKS = re.compile(r"(<!-- fields -->\n).*?(<!-- end -->)", re.DOTALL)


def document(page: str) -> str:
    """Return the page with the table as the source has it."""
    rows = ["| field | type | of | meaning | example |", "|---|---|---|---|---|"]
    for field in FIELDS.values():
        of = "all" if len(field.things) == len(PLURALS) else ", ".join([PLURALS[kind] for kind in field.things])
        example = field.example.replace("|", "\\|")
        rows.append(f"| `{field.name}` | {field.kind.name} | {of} | {field.about} | `{example}` |")
    table = "".join([f"{row}\n" for row in rows])
    return MARKS.sub(lambda found: found[1] + table + found[2], page)


if __name__ == "__main__":
    PAGE.write_text(document(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
