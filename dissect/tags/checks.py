"""What is worth knowing about tags that can be used: which of them share octets."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.tags.model import Tag, place_text

#: Pairs that are kept.
MAX_OVERLAPS: Final = 1000


class Overlap(NamedTuple):
    """Two tags that share bits, and where the first of these is."""

    one: Tag
    other: Tag
    at: int

    def __str__(self) -> str:
        byte = place_text(self.one.area, self.one.db, self.at // 8 * 8, 8)
        return f"{self.one.name} ({self.one.address}) and {self.other.name} ({self.other.address}) share {byte}"


def overlaps(tags: list[Tag]) -> tuple[list[Overlap], int]:
    """Return the tags that share bits with one before them, at most `MAX_OVERLAPS`, and how many there are in all."""
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
