"""Checks of usable tags: which of them share octets."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.meaning.tags.model import Tag, place_text

#: Maximum number of pairs that are kept.
MAX_OVERLAPS: Final = 1000


class Overlap(NamedTuple):
    """Two tags that share bits, and the first shared bit."""

    one: Tag
    other: Tag
    at: int

    def __str__(self) -> str:
        byte = place_text(self.one.area, self.one.db, self.at // 8 * 8, 8)
        return f"{self.one.name} ({self.one.address}) and {self.other.name} ({self.other.address}) share {byte}"


def overlaps(tags: list[Tag]) -> tuple[list[Overlap], int]:
    """Return tags that share bits with an earlier one, at most `MAX_OVERLAPS`, and the number of all of them."""
    found: list[Overlap] = []
    count = 0
    furthest: Tag | None = None
    for tag in sorted(tags, key=lambda each: (each.area, each.db, each.start, -each.end, each.name)):
        if furthest is not None and (furthest.area, furthest.db) == (tag.area, tag.db) and tag.start < furthest.end:
            count += 1
            if len(found) < MAX_OVERLAPS:
                found.append(Overlap(furthest, tag, int(tag.start)))
            if tag.end <= furthest.end:
                continue
        furthest = tag
    return found, count
