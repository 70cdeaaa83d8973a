"""How much of the traffic of a capture the tags cover, and where a layout and the capture contradict each other."""

from __future__ import annotations

from typing import Final

from dissect.engine.observer import Observer
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.tags.loading import TagSet
from dissect.meaning.tags.model import Tag
from dissect.meaning.tags.naming import TagNaming
from dissect.protocols.s7.items import Item
from dissect.protocols.s7.tables import DB, DB_AREAS, NUMBERED_AREAS, SUCCESS

#: Maximum number of distinct items that are kept; further ones are only counted.
MAX_ITEMS: Final = 100_000


class AreaCoverage:
    """The traffic of one area or block: items, the bytes that they carried, and how many of both the tags cover.

    ``beyond`` counts items that were answered although they end after the end of the block in its layout; ``furthest`` is the
    last byte of any of them.
    """

    def __init__(self, area: int, db: int) -> None:
        self.area = area
        self.db = db
        self.items = 0
        self.named = 0
        self.octets = 0
        self.covered = 0
        self.beyond = 0
        self.furthest = 0


class Coverage(Observer):
    """Counts items of transactions; ``unknown`` has the distinct addresses without any tag, and how often each occurred."""

    def __init__(self, tags: TagSet) -> None:
        super().__init__()
        self._tags = tags
        self.naming: TagNaming = tags.naming()
        self.areas: dict[tuple[int, int], AreaCoverage] = {}
        self.unknown: dict[str, int] = {}
        self.seen: set[Tag] = set()
        self.items = 0
        self.lost = 0

    def transaction(self, transaction: Transaction) -> None:
        """Count the items of a transaction."""
        for result in transaction.s7_results:
            item = result.item
            if item is None or item.area < 0 or item.start_bit < 0:
                continue
            size = len(result.data) if result.data is not None else max(int(item.size), 0)
            answered = result.return_code == SUCCESS and result.data is not None
            self._count(item, size, answered)

    def _count(self, item: Item, size: int, answered: bool) -> None:
        self.items += 1
        db = int(item.db) if item.area in DB_AREAS else 0
        key = (int(item.area), db)
        row = self.areas.get(key)
        if row is None:
            row = self.areas[key] = AreaCoverage(*key)
        row.items += 1
        row.octets += size
        cover = self.naming.cover(item, size) if size else None
        if cover is None:
            self._unknown(item)
        else:
            row.named += 1
            row.covered += size - sum([count for _, count in cover.free])
            self.seen.update([part.tag for part in cover.parts])
        limit = self._tags.sizes.get(db, 0) if item.area == DB else 0
        if limit and answered and item.area not in NUMBERED_AREAS:
            last = int(item.start_bit) // 8 + size - 1
            if last >= limit:
                row.beyond += 1
                row.furthest = max(row.furthest, last)

    def _unknown(self, item: Item) -> None:
        label = item.label
        if label in self.unknown or len(self.unknown) < MAX_ITEMS:
            self.unknown[label] = self.unknown.get(label, 0) + 1
        else:
            self.lost += 1

    def disagreements(self) -> list[str]:
        """Return a sentence for each block whose layout the capture contradicts."""
        told = []
        for row in self.areas.values():
            if row.beyond:
                size, name = self._tags.sizes[row.db], self._tags.names[row.db]
                told.append(
                    f"DB{row.db} {name!r} has {size} bytes in the source, but {row.beyond} items that end beyond them were "
                    f"answered, up to byte {row.furthest}: the source is not that of the running program, or DB{row.db} is "
                    "a different block"
                )
        return told
