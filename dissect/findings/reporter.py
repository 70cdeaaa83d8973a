"""Findings: something in the traffic that deserves attention, with the packets that show it.

Rules hand them to the `Reporter`, which counts them all and keeps a bounded number in detail.

A flood of a million bad PDUs must not become a million lines, so each slug gives at most `MAX_DETAILED` detailed findings
for a connection and `MAX_DETAILED_ALL` in all; the counters stay exact.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.findings.catalogue import CATALOGUE, Rule

MAX_DETAILED: Final = 100
MAX_DETAILED_ALL: Final = 1000


class Finding:
    """A rule that applied once.

    ``connection`` is the connection's number, 0 for the capture as a whole. ``frames`` are the packets that show it,
    ``time_ns`` the time of the last of them, ``detail`` what was seen this time.
    """

    __slots__ = ("_first_frame", "_frames", "_last_frame", "connection", "detail", "rule", "time_ns")

    def __init__(self, rule: Rule, connection: i64, frames: list[int], time_ns: i64, detail: str) -> None:
        self.rule = rule
        self.connection: i64 = connection
        # Thousands are kept, and most are shown by one packet or two, which need no list and no objects.
        self._frames: list[int] | None = None
        self._first_frame: i64 = 0
        self._last_frame: i64 = 0
        self.time_ns: i64 = time_ns
        self.detail = detail
        self.frames = frames

    def __repr__(self) -> str:
        return f"Finding({self.rule.slug!r}, connection={self.connection}, frames={self.frames})"

    @property
    def frames(self) -> list[int]:
        """The packets that show it, a list of its own."""
        if self._frames is not None:
            return list(self._frames)
        if not self._first_frame:
            return []
        return [self._first_frame, self._last_frame] if self._last_frame else [self._first_frame]

    @frames.setter
    def frames(self, frames: list[int]) -> None:
        """Keep them."""
        few = 0 < len(frames) <= 2 and 0 not in frames
        self._frames = None if few or not frames else list(frames)
        self._first_frame = frames[0] if few else 0
        self._last_frame = frames[1] if few and len(frames) == 2 else 0

    @property
    def slug(self) -> str:
        """The rule's stable name."""
        return self.rule.slug

    @property
    def severity(self) -> str:
        """``error``, ``warning`` or ``note``."""
        return self.rule.severity


class _Detailed:
    """How many findings of a slug were detailed: in all, and of each connection while more may be."""

    __slots__ = ("by_connection", "count")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.by_connection: dict[int, int] = {}


class Reporter:
    """Counts findings by slug and passes the detailed ones on.

    ``counts`` is exact. ``fresh`` collects detailed findings until the pipeline hands them to its observer.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.fresh: list[Finding] = []
        self._detailed: dict[str, _Detailed] = {}  # by slug
        #: When the source last said that it lost packets, of whichever connection; -1 for never.
        self.lost_ns: i64 = -1

    def count(self, slug: str) -> None:
        """Count one occurrence, of which one that was detailed says all there is to say."""
        self.counts[slug] = self.counts.get(slug, 0) + 1

    def wants(self, slug: str, connection: i64) -> bool:
        """Count one occurrence; True when it should be detailed, so that no sentence is built in vain."""
        self.count(slug)
        detailed = self._detailed.get(slug)
        if detailed is None:
            detailed = self._detailed[slug] = _Detailed()
        if detailed.count >= MAX_DETAILED_ALL:
            return False
        by_connection = detailed.by_connection
        here = by_connection.get(connection, 0)
        if here >= MAX_DETAILED:
            return False
        by_connection[connection] = here + 1
        detailed.count += 1
        if detailed.count == MAX_DETAILED_ALL:
            detailed.by_connection = {}  # no more will be detailed, on whichever connection
        return True

    def doubt(self, request_ns: i64) -> str:
        """Return what to say behind a request of that time without an answer: packets were lost since, so it may have come."""
        return (
            "; packets were lost while capturing, the answer perhaps among them" if self.lost_ns >= request_ns else ""
        )

    def renew(self) -> None:
        """Allow as many detailed findings again as in the beginning: who watches a line for days wants those of today."""
        self._detailed = {}

    def forget(self) -> None:
        """Nothing more comes: forget which connections were detailed."""
        for detailed in self._detailed.values():
            detailed.by_connection = {}

    def note(self, slug: str, connection: i64, frames: list[int], time_ns: i64, detail: str = "") -> None:
        """Count and, within the bounds, detail a finding."""
        if self.wants(slug, connection):
            self.detail(slug, connection, frames, time_ns, detail)

    def detail(self, slug: str, connection: i64, frames: list[int], time_ns: i64, detail: str) -> None:
        """Detail a finding that `wants` has counted."""
        self.fresh.append(Finding(CATALOGUE[slug], connection, frames, time_ns, detail))
