"""Tags as a table in the format of this program, which `load_tags` reads back (docs/tags.md)."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Iterator
from typing import Final

from dissect.meaning.tags.model import Tag
from dissect.wire.text import cell

COLUMNS: Final = ("address", "type", "name", "unit", "scale", "comment")


def table_lines(tags: Iterable[Tag]) -> Iterator[str]:
    """Yield the lines of a table, the header first."""
    yield _line(COLUMNS)
    for tag in tags:
        name = f"{tag.name}[{tag.prefix[:-1]}]" if tag.prefix else tag.name
        yield _line([tag.address, tag.declared, cell(name), cell(tag.unit), scale_text(tag), cell(tag.comment)])


def scale_text(tag: Tag) -> str:
    """Return the scale of a tag as text for the table; empty for none."""
    if not tag.scaled:
        return ""
    return f"{tag.factor!r}{tag.shift:+}" if tag.shift else repr(tag.factor)


def _line(cells: Iterable[str]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="").writerow(cells)
    return text.getvalue()
