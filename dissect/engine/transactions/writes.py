"""`Writes`: the latest writes of a connection, and those that are not counted as events yet."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mypy_extensions import i64

if TYPE_CHECKING:
    from dissect.engine.transactions.transaction import Transaction


class Writes:
    """The latest writes of a connection: their number, and a sample of them (`dissect.engine.findings.security_rules`).

    ``count`` counts all writes ever; the other counts start again with each sample. ``since_ns`` and ``pdus`` are the time, and
    the PDU count of the connection, at the start of the sample; ``variables`` are its distinct requests, ``answers_ns`` the
    answer times. ``hasty`` is the write at which the number of unanswered writes within ``hasty_ns`` may indicate a flood.

    ``again`` are writes to ``areas`` that are not in the facts of findings yet, with the first and the last of them.
    """

    __slots__ = (
        "again",
        "answers_ns",
        "areas",
        "count",
        "first_frame",
        "first_ns",
        "hasty",
        "hasty_ns",
        "last_frame",
        "last_ns",
        "pdus",
        "since_ns",
        "variables",
    )

    def __init__(self) -> None:
        self.areas: i64 = 0
        self.again: i64 = 0
        self.first_frame: i64 = 0
        self.first_ns: i64 = 0
        self.last_frame: i64 = 0
        self.last_ns: i64 = 0
        self.count: i64 = 0
        self.since_ns: i64 = 0
        self.pdus: i64 = 0
        self.answers_ns: list[int] = []
        self.variables: set[bytes] = set()
        self.hasty: Transaction | None = None
        self.hasty_ns: i64 = 0

    def note(self, frame: i64, time_ns: i64) -> None:
        """Count a write to `areas`."""
        if self.again == 0:
            self.first_frame = frame
            self.first_ns = time_ns
        self.again += 1
        self.last_frame = frame
        self.last_ns = time_ns
