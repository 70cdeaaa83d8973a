"""The lists of connections and findings: bounded, each in an order that stays the same."""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Mapping
from typing import Final, NamedTuple

from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES, Rule
from dissect.engine.findings.reporter import Finding
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.ending import DISCONNECT, ERROR_TPDU, EVICTED, FIN, OPEN, REPLACED, RESET, REUSED
from dissect.online.monitor.rate_history import SECONDS, RateHistory

#: Greatest number of listed connections.
MAX_CONNECTIONS: Final = 500
#: Greatest number of findings of a rule that are kept in detail.
MAX_DETAILS: Final = 50

#: How a connection ended, in a word.
_ENDED: Final = {
    FIN: "closed",
    RESET: "reset",
    DISCONNECT: "ended",
    ERROR_TPDU: "error",
    REUSED: "reused",
    REPLACED: "replaced",
    EVICTED: "dropped",
    OPEN: "left",
}


class ConnectionFacts(NamedTuple):
    """The state of a connection at one moment.

    ``waiting`` is the number of open requests; ``worst`` has the longest answer time of each of the last seconds, -1 for none.
    ``doubts`` has how many pairs are only likely, by `Transaction.doubt`; they are in no answer time.
    """

    connection: Connection
    state: str
    over: bool
    rate: float
    rate_10: float
    latency_ns: int | None
    worst: list[int]
    answered: int
    unanswered: int
    errors: int
    waiting: int
    doubts: Mapping[str, int]

    @property
    def key(self) -> int:
        """The key of the connection in the list."""
        return int(self.connection.number)

    @property
    def failed(self) -> int:
        """The number of transactions that were refused or not answered."""
        return self.unanswered + self.errors


class _Listed:
    __slots__ = ("connection", "doubts", "latency_ns", "pulse")

    def __init__(self, connection: Connection) -> None:
        self.connection = connection
        self.pulse = RateHistory()
        self.latency_ns: int | None = None
        self.doubts: dict[str, int] = {}


class ConnectionList:
    """The connections. If there are too many, closed ones are dropped first, then those that were silent for longest."""

    def __init__(self, most: int = MAX_CONNECTIONS) -> None:
        self.left_out = 0
        self._most = most
        self._listed: OrderedDict[int, _Listed] = OrderedDict()  # in the order of their last transactions
        self._closed: OrderedDict[int, None] = OrderedDict()

    def note(self, connection: Connection) -> None:
        """Note a connection that was opened or closed."""
        self._find(connection)
        if connection.ending is not None:
            self._closed[int(connection.number)] = None
            self._bound()

    def transaction(self, connection: Connection, time_ns: int, latency_ns: int | None, doubt: str = "") -> None:
        """Note a transaction on a connection; ``doubt`` is why its pair is only likely."""
        listed = self._find(connection)
        self._listed.move_to_end(int(connection.number))
        listed.pulse.add(time_ns, latency_ns)
        if doubt:
            listed.doubts[doubt] = listed.doubts.get(doubt, 0) + 1
        if latency_ns is not None:
            listed.latency_ns = latency_ns

    def facts(self, now_ns: int) -> list[ConnectionFacts]:
        """Return the state of all connections: open ones by number, then closed ones, the newest first."""
        every = [_facts(listed, now_ns) for listed in list(self._listed.values())]
        return sorted(every, key=lambda one: (one.over, -one.key if one.over else one.key))

    def _find(self, connection: Connection) -> _Listed:
        number = int(connection.number)
        listed = self._listed.get(number)
        if listed is None:
            listed = _Listed(connection)
            self._listed[number] = listed
            self._bound()
        return listed

    def _bound(self) -> None:
        while len(self._listed) > self._most:
            number, _ = self._closed.popitem(last=False) if self._closed else (next(iter(self._listed)), None)
            del self._listed[number]
            self.left_out += 1


def _facts(listed: _Listed, now_ns: int) -> ConnectionFacts:
    connection = listed.connection
    pulse = listed.pulse
    return ConnectionFacts(
        connection,
        _state(connection),
        connection.ending is not None,
        pulse.rate(now_ns, 1),
        pulse.rate(now_ns, 10),
        listed.latency_ns,
        pulse.worst(now_ns, SECONDS),
        int(connection.answered),
        int(connection.missed),
        int(connection.errors),
        sum([int(side.count) for side in connection.open_requests]),
        dict(listed.doubts),
    )


def _state(connection: Connection) -> str:
    """Return the state of a connection in a word; a refusal has priority over how it ended."""
    if connection.refused:
        return "refused"
    ending = connection.ending
    return "open" if ending is None else _ENDED[ending.how]


class FindingFacts(NamedTuple):
    """The findings of one rule: their number, and the latest ones in detail."""

    rule: Rule
    times: int
    details: tuple[Finding, ...]

    @property
    def key(self) -> str:
        """The key of the rule in the list."""
        return self.rule.slug


class FindingList:
    """The findings by rule; there are no more rules than in the catalogue.

    If a rule has too many findings, the oldest of the host pair with the most is dropped, so that many of one pair do not hide
    those of others.
    """

    def __init__(self) -> None:
        self._details: dict[str, list[Finding]] = {}

    def note(self, finding: Finding) -> None:
        """Note a finding, unless another one is its cause, or it only sums up others."""
        if finding.because or finding.repeated:
            return
        kept = self._details.get(finding.slug)
        if kept is None:
            kept = self._details[finding.slug] = []
        kept.append(finding)
        if len(kept) > MAX_DETAILS:
            most = Counter([_hosts(one) for one in kept]).most_common(1)[0][0]
            del kept[next(place for place, one in enumerate(kept) if _hosts(one) == most)]

    def facts(self, counts: Mapping[str, int]) -> list[FindingFacts]:
        """Return the rules that applied: by severity, those that change a plant first, then the newest.

        ``counts`` are exact and may precede details.
        """
        found = [
            FindingFacts(CATALOGUE[slug], count, tuple(self._details.get(slug, ()))) for slug, count in counts.items()
        ]
        return sorted(
            found, key=lambda one: (SEVERITIES.index(one.rule.severity), one.rule.gravity, -_last(one), one.key)
        )


def _hosts(finding: Finding) -> tuple[str, str]:
    return finding.client, finding.server


def _last(facts: FindingFacts) -> int:
    return int(facts.details[-1].time_ns) if facts.details else 0
