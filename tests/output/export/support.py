"""Shared by the tests of exports: rows of synthetic captures and of our own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from dissect.engine.pipeline import Options
from dissect.files.session import Run
from dissect.output.export.feed import Sink, TableFeed
from dissect.output.export.tables import TABLES, Table
from dissect.output.export.transaction_rows import Row


class Kept(Sink):
    """Keeps rows as they come."""

    def __init__(self) -> None:
        self.rows: dict[str, list[Row]] = {name: [] for name in TABLES}
        self.handed = 0

    def take(self, table: Table, rows: Sequence[Row]) -> None:
        self.rows[table.name] += rows
        self.handed += 1


def rows_of(*paths: Path, options: Options | None = None) -> dict[str, list[dict[str, Any]]]:
    """Return the rows of captures read as one, by table, each as names and values of its stored columns."""
    kept = Kept()
    feed = TableFeed(TABLES.values(), kept)
    run = Run(paths, feed, options)
    feed.begin(run.files)
    while run.step():
        pass
    feed.finish(run.pipeline, run.files)
    return {
        name: [dict(zip([column.name for column in TABLES[name].stored], row, strict=True)) for row in rows]
        for name, rows in kept.rows.items()
    }
