"""Findings: something in the traffic that deserves attention, with the packets that show it.

Rules report findings to the `Reporter`, which counts all of them and details a bounded number. A flood of a million bad PDUs
must not become a million lines: each slug gets at most `MAX_DETAILED` detailed findings for a connection and `MAX_DETAILED_ALL`
altogether. The counters stay exact.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.findings.catalogue import CATALOGUE, Rule

MAX_DETAILED: Final = 100
MAX_DETAILED_ALL: Final = 1000


class Finding:
    """A rule that applied once.

    ``connection`` is the number of the connection, 0 for the capture as a whole. ``frames`` are the packets that show the
    finding, ``time_ns`` is the time of the last of them, ``detail`` says what was seen this time.
    """

    __slots__ = ("_first_frame", "_frames", "_last_frame", "connection", "detail", "rule", "time_ns")

    def __init__(self, rule: Rule, connection: i64, frames: list[int], time_ns: i64, detail: str) -> None:
        self.rule = rule
        self.connection: i64 = connection
        # Thousands of findings are kept, most with one or two packets: these are kept without a list and int objects.
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
        """The packets that show the finding, as a list that the caller may change."""
        if self._frames is not None:
            return list(self._frames)
        if not self._first_frame:
            return []
        return [self._first_frame, self._last_frame] if self._last_frame else [self._first_frame]

    @frames.setter
    def frames(self, frames: list[int]) -> None:
        """Replace the packets."""
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
    """How many findings of a slug were detailed: in all, and by connection (until `MAX_DETAILED_ALL` is reached)."""

    __slots__ = ("by_connection", "count")

    def __init__(self) -> None:
        self.count: i64 = 0
        self.by_connection: dict[int, int] = {}


class Reporter:
    """Counts findings by slug and passes the detailed ones on.

    ``counts`` is exact. ``fresh`` collects the detailed findings until the pipeline hands them to its observer.
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
        """Count one occurrence; True if it should be detailed. Ask this first, to build no sentence in vain."""
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
            detailed.by_connection = {}  # nothing more will be detailed, on any connection
        return True

    def doubt(self, request_ns: i64) -> str:
        """Return what to say behind a request of that time without an answer: packets were lost since, so it may have come."""
        return (
            "; packets were lost while capturing, the answer perhaps among them" if self.lost_ns >= request_ns else ""
        )

    def renew(self) -> None:
        """Begin the bounds anew: a user who watches a line for days wants today's findings in detail, too."""
        self._detailed = {}

    def forget(self) -> None:
        """Nothing more comes: free what was remembered by connection."""
        for detailed in self._detailed.values():
            detailed.by_connection = {}

    def note(self, slug: str, connection: i64, frames: list[int], time_ns: i64, detail: str = "") -> None:
        """Count a finding and, within the bounds, detail it."""
        if self.wants(slug, connection):
            self.detail(slug, connection, frames, time_ns, detail)

    def detail(self, slug: str, connection: i64, frames: list[int], time_ns: i64, detail: str) -> None:
        """Detail a finding that `wants` has counted already."""
        self.fresh.append(Finding(CATALOGUE[slug], connection, frames, time_ns, detail))
