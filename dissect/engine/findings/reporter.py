"""Findings: notable events in the traffic, with the packets that show them.

Rules report to the `Reporter`, which counts all findings and details a limited number (`dissect.engine.findings.bounds`): a
flood of a million bad PDUs must not become a million lines. The counters stay exact, as do the facts of each rule
(`dissect.engine.findings.ledger`).

A finding may be explained by its cause, which is also a finding (`dissect.engine.findings.cause_tables`). Only this module
applies that table: while `Reporter.because` is set, findings that it explains are counted separately and name it.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.findings.bounds import COUNTED, KEPT, MAX_DETAILED, MAX_DETAILED_ALL, Bounds
from dissect.engine.findings.catalogue import CATALOGUE, Rule
from dissect.engine.findings.cause_tables import EXPLAINS, WAITS
from dissect.engine.findings.known_bugs_tables import SEEN
from dissect.engine.findings.ledger import NO_PAIR, Ledger, Occurrences, Pair
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.wire.copies import leaves
from dissect.wire.text import printable

__all__ = ["MAX_DETAILED", "MAX_DETAILED_ALL", "Finding", "Reporter"]

#: Maximum number of characters of a cause in the finding that it explains.
_SAID: Final = 200


class Finding:
    """One event that a rule reports.

    ``connection`` is the number of the connection, 0 for the capture as a whole. ``frames`` are the packets that show the
    finding, ``time_ns`` is the time of the last of them, ``detail`` describes this case.

    ``number`` counts the findings that are kept for the report of a run, from 1, in the order in which they are reported; it is
    0 before that, and for all others. ``because`` is the slug of the finding's cause if it is explained, else empty;
    ``explained_by`` is the number of the cause, 0 if the cause itself was only counted. ``client`` and ``server`` are the hosts
    that the finding is about, empty for none.

    ``room`` says what happens to it (`dissect.engine.findings.bounds`). ``bare`` is True for an event that is not reported,
    because an earlier one is sufficient; ``reported`` is whether it counts as a finding. ``repeated`` is the number of findings
    without detail that this one sums up (`Observer.repeated`), 0 for others.
    """

    __slots__ = (
        "_first_frame",
        "_frames",
        "_last_frame",
        "bare",
        "because",
        "client",
        "connection",
        "detail",
        "explained_by",
        "number",
        "repeated",
        "reported",
        "room",
        "rule",
        "server",
        "time_ns",
    )

    def __init__(self, rule: Rule, connection: i64, frames: list[int], time_ns: i64, detail: str) -> None:
        self.rule = rule
        self.connection: i64 = connection
        # Thousands of findings are kept, most with one or two packets: these need neither a list nor int objects.
        self._frames: list[int] | None = None
        self._first_frame: i64 = 0
        self._last_frame: i64 = 0
        self.time_ns: i64 = time_ns
        self.detail = detail
        self.number: i64 = 0
        self.explained_by: i64 = 0
        self.because: str = ""
        self.client: str = ""
        self.server: str = ""
        self.room: i64 = KEPT
        self.bare: bool = False
        self.reported: bool = True
        self.repeated: i64 = 0
        self.frames = frames

    def __repr__(self) -> str:
        return f"Finding({self.rule.slug!r}, connection={self.connection}, frames={self.frames})"

    def __str__(self) -> str:
        """Return the finding and its packets: ``error security.plc_stop, packets 12, 13: …``."""
        frames = self.frames
        where = (
            f", packet{'s' if len(frames) > 1 else ''} {', '.join([str(frame) for frame in frames])}" if frames else ""
        )
        return printable(f"{self.severity} {self.slug}{where}: {self.detail or self.rule.sentence}")

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


class _Waiting:
    """Findings of a connection that wait for a cause: the facts of each rule, and the detailed findings.

    Once ``cause`` is known, findings that it explains no longer wait.
    """

    __slots__ = ("cause", "events", "findings")

    def __init__(self) -> None:
        self.cause: Finding | None = None
        self.events: dict[str, Occurrences] = {}
        self.findings: list[Finding] = []


class Reporter:
    """Counts findings by slug and passes the detailed ones on.

    ``counts`` is exact; so is ``explained``: how many findings a cause explains, by the two slugs. ``ledger`` has more facts of
    each rule. ``fresh`` collects the detailed findings, explained ones included, until the pipeline passes them to its
    observer. ``because`` is the finding that explains findings of the current judgement.

    With ``every`` each finding and each event that is not reported (`Finding.bare`) is passed on, for an observer that selects
    before the limits apply; ``room`` says which of them would have been reported.
    """

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self.explained: dict[tuple[str, str], int] = {}
        self.ledger: Ledger = Ledger()
        self.period: Ledger | None = None  # the same since a time that the reader chose, if the reader wants that
        self.fresh: list[Finding] = []
        self.because: Finding | None = None
        self.latest: Finding | None = None  # the finding that was counted last, None if it was not detailed
        self.number: i64 = 0  # of the latest finding in `fresh`
        self._pair: Pair = NO_PAIR  # the hosts of the finding that was counted last
        self._cause: Finding | None = None  # the cause of that finding
        self.every: bool = False
        self._room: i64 = COUNTED  # of the finding that was counted last
        self._bounds: Bounds = Bounds()
        self._explained_bounds: Bounds = Bounds()  # for explained findings, which must not use up the room of others
        self._waiting: dict[int, _Waiting] = {}  # by connection
        #: When the source last reported lost packets, on whichever connection; -1 for never.
        self.lost_ns: i64 = -1

    # ---- findings ---------------------------------------------------------------------------------------------------

    def count(self, slug: str, connection: i64, frame: i64, time_ns: i64) -> None:
        """Count a finding that an earlier detailed one already covers."""
        self._count(slug, self.ledger.pair(connection), connection, frame, frame, time_ns, True)
        if self.every:
            self._pass_bare(slug, connection, frame, time_ns, True)

    def again(self, slug: str, connection: i64, frame: i64, time_ns: i64) -> None:
        """Count an event that is not reported, because the rule reports only the first one."""
        self._count(slug, self.ledger.pair(connection), connection, frame, frame, time_ns, False)
        if self.every:
            self._pass_bare(slug, connection, frame, time_ns, False)

    def _pass_bare(self, slug: str, connection: i64, frame: i64, time_ns: i64, reported: bool) -> None:
        """Pass on an event without a detail."""
        frames: list[int] = []
        if frame:
            frames.append(frame)
        self._room = COUNTED
        self.detail(slug, connection, frames, time_ns, "")
        finding = self.latest
        if finding is not None:
            finding.bare = True
            finding.reported = reported
        self.latest = None

    def many(self, slug: str, connection: i64, events: Occurrences) -> None:
        """Count events of a connection that were added up; none of them is a finding or waits for a cause."""
        pair = self.ledger.pair(connection)
        self.ledger.settle(slug, pair, connection, events, "")
        if self.period is not None:
            self.period.settle(slug, self.period.same(pair), connection, events, "")

    def first(self, connection: Connection, slug: str, frame: i64, time_ns: i64) -> bool:
        """Return whether an event is the first on a connection, for a rule that reports only the first; count the others."""
        if connection.traits.first(slug):
            return True
        self.again(slug, connection.number, frame, time_ns)
        return False

    def _count(
        self, slug: str, pair: Pair, connection: i64, first_frame: i64, last_frame: i64, time_ns: i64, reported: bool
    ) -> None:
        self.latest = None
        self._pair = pair
        cause = self._cause = self.cause_of(slug, connection)
        if cause is not None:
            self.ledger.explain(cause.slug, slug, connection, first_frame, last_frame, time_ns, reported)
            if reported:
                key = (cause.slug, slug)
                self.explained[key] = self.explained.get(key, 0) + 1
        elif self._waiting and self._waits(slug, connection):
            events = self._waiting[connection].events
            found = events.get(slug)
            if found is None:
                found = events[slug] = Occurrences()
            found.take(connection, first_frame, last_frame, time_ns, reported)
        else:
            self.ledger.take(slug, pair, connection, first_frame, last_frame, time_ns, reported)
            period = self.period
            if period is not None:
                period.take(slug, period.same(pair), connection, first_frame, last_frame, time_ns, reported)
            if reported:
                self.counts[slug] = self.counts.get(slug, 0) + 1

    def wants(self, slug: str, connection: i64, first_frame: i64, last_frame: i64, time_ns: i64) -> bool:
        """Count a finding of these packets; True if it should be detailed.

        Ask this first, so that no unneeded sentence is built.
        """
        self._count(slug, self.ledger.pair(connection), connection, first_frame, last_frame, time_ns, True)
        return self._has_room(slug, connection, last_frame, time_ns)

    def wants_of(self, slug: str, transaction: Transaction) -> bool:
        """Count a finding about a transaction, as `wants` does."""
        first: i64 = transaction.request_frame
        last: i64 = transaction.response_frame
        time_ns: i64 = max(transaction.request_ns, transaction.response_ns)
        return self.wants(slug, transaction.connection.number, first or last, last or first, time_ns)

    def wants_between(self, slug: str, client: str, server: str, first_frame: i64, frame: i64, time_ns: i64) -> bool:
        """Count a finding about two hosts without a connection, as `wants` does."""
        self._count(slug, self.ledger.between(client, server), 0, first_frame, frame, time_ns, True)
        return self._has_room(slug, 0, frame, time_ns)

    def _has_room(self, slug: str, connection: i64, frame: i64, time_ns: i64) -> bool:
        """Return whether one more finding is detailed."""
        pair = self._pair
        if self._cause is not None:
            self._room = self._explained_bounds.take(slug, pair.client, pair.server, connection)
        else:
            bounds = self._bounds
            self._room = bounds.take(slug, pair.client, pair.server, connection)
            if self._room == COUNTED and not self.every and not (self._waiting and self._waits(slug, connection)):
                bounds.leave(frame, time_ns)
            if bounds.due(time_ns):
                self.remind()
        return self.every or self._room != COUNTED

    def remind(self) -> None:
        """Report how many findings were only counted."""
        for one in self._bounds.remind():
            frames: list[int] = []
            if one.frame:
                frames.append(one.frame)
            finding = Finding(CATALOGUE[one.slug], 0, frames, one.time_ns, one.detail)
            finding.client, finding.server = one.client, one.server
            finding.repeated = one.repeated
            finding.room = COUNTED
            self.fresh.append(finding)

    def tick(self, now_ns: i64) -> None:
        """Time has passed."""
        if self._bounds.due(now_ns):
            self.remind()

    def over(self, connection: i64) -> None:
        """A connection is over and fully reported: forget it."""
        self.ledger.over(connection)
        self._bounds.over(connection)
        self._explained_bounds.over(connection)

    def note(self, slug: str, connection: i64, frames: list[int], time_ns: i64, detail: str = "") -> None:
        """Count a finding and, within the bounds, detail it."""
        first_frame: i64 = 0
        last_frame: i64 = 0
        if frames:
            first_frame = frames[0]
            last_frame = frames[-1]
        self._count(slug, self.ledger.pair(connection), connection, first_frame, last_frame, time_ns, True)
        if self._has_room(slug, connection, last_frame, time_ns):
            self.detail(slug, connection, frames, time_ns, detail)

    def detail(self, slug: str, connection: i64, frames: list[int], time_ns: i64, detail: str) -> None:
        """Detail the finding that was counted last."""
        finding = Finding(CATALOGUE[slug], connection, frames, time_ns, detail)
        finding.client = self._pair.client
        finding.server = self._pair.server
        finding.room = self._room
        self.latest = finding
        cause = self._cause
        if cause is not None:
            _explain(finding, cause)
        elif self._waiting and self._waits(slug, connection):
            self._waiting[connection].findings.append(finding)
            return
        self._report(finding)

    def _report(self, finding: Finding) -> None:
        if finding.room == KEPT:
            self.number += 1
            finding.number = self.number
        self.fresh.append(finding)

    # ---- causes -----------------------------------------------------------------------------------------------------

    def cause_of(self, slug: str, connection: i64) -> Finding | None:
        """Return the finding that would explain a finding of this rule now; None if there is none."""
        cause = self.because
        if cause is not None and slug in EXPLAINS[cause.slug]:
            return cause
        if self._waiting:
            waiting = self._waiting.get(connection)
            if waiting is not None and waiting.cause is not None and slug in EXPLAINS[waiting.cause.slug]:
                return waiting.cause
        return None

    def noted(self, slug: str) -> Finding | None:
        """Return the latest finding as a cause for others; None if it has a cause itself or waits for one."""
        found = self.latest
        if found is None or found.slug != slug:
            return Finding(CATALOGUE[slug], 0, [], 0, "")  # it was only counted: there are too many of its kind
        return None if found.because or (found.number == 0 and found.room == KEPT) else found

    def blame(self, slug: str) -> None:
        """Make the latest finding the cause for the rest of the current judgement of a message."""
        if self.because is None:
            self.because = self.noted(slug)

    def hold(self, connection: i64) -> None:
        """From now on, until `release`, findings that a later cause may explain have to wait."""
        if connection not in self._waiting:
            self._waiting[connection] = _Waiting()

    def release(self, connection: i64, cause: Finding | None) -> None:
        """Report the waiting findings of a connection: explained by ``cause`` (later ones too), or unexplained if None."""
        waiting = self._waiting.pop(connection, None) if self._waiting else None
        if cause is not None:
            follows = self._waiting[connection] = _Waiting()
            follows.cause = cause
        if waiting is None:
            return
        explains = EXPLAINS[cause.slug] if cause is not None else frozenset()
        for slug, events in waiting.events.items():
            count: int = events.reports
            explained: bool = cause is not None and slug in explains
            blamed = cause.slug if cause is not None and explained else ""
            pair = self.ledger.pair(connection)
            self.ledger.settle(slug, pair, connection, events, blamed)
            if self.period is not None:
                self.period.settle(slug, self.period.same(pair), connection, events, blamed)
            if count and cause is not None and explained:
                self.explained[cause.slug, slug] = self.explained.get((cause.slug, slug), 0) + count
            elif count:
                self.counts[slug] = self.counts.get(slug, 0) + count
        for finding in waiting.findings:
            if cause is not None and finding.slug in explains:
                _explain(finding, cause)
            self._report(finding)

    def _waits(self, slug: str, connection: i64) -> bool:
        if slug not in WAITS:
            return False
        waiting = self._waiting.get(connection)
        return waiting is not None and waiting.cause is None

    # ---- bounds and losses ------------------------------------------------------------------------------------------

    def doubt(self, request_ns: i64) -> str:
        """Return a text for an unanswered request of that time: packets were lost since then, so the answer may have come."""
        return (
            "; packets were lost while capturing, the answer perhaps among them" if self.lost_ns >= request_ns else ""
        )

    def renew(self) -> None:
        """Reset the limits: a user who watches a network for days wants details of today's findings, too."""
        self._bounds.renew()
        self._explained_bounds.renew()

    def forget(self) -> None:
        """Nothing more comes: free what was remembered per connection."""
        self._bounds = Bounds()
        self._explained_bounds = Bounds()


def _explain(finding: Finding, cause: Finding) -> None:
    """Name the cause of a finding in it."""
    finding.because = cause.slug
    finding.explained_by = cause.number
    said = cause.detail.partition(SEEN)[0]
    if len(said) > _SAID:
        said = f"{said[:_SAID]}…"
    why = f"because of {cause.slug}: {said}" if said else f"because of {cause.slug}"
    finding.detail = f"{finding.detail}; {why}" if finding.detail else why


leaves(Finding)
