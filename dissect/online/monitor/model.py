"""`Model`: the data that the screens show, a bounded state of the events. It does not depend on a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.select import Where
from dissect.online.live.events import ALERT, CLOSED, Event
from dissect.online.monitor.entries import Entry, Ring, What, detached
from dissect.online.monitor.filter import Wanted, is_slow
from dissect.online.monitor.lists import ConnectionFacts, ConnectionList, FindingFacts, FindingList
from dissect.online.monitor.watched import Watched
from dissect.output.variables.wanted import WantedSet

#: Greatest number of entries in each list, and of the octets of their PDUs.
MAX_ENTRIES: Final = 1000
MAX_OCTETS: Final = 8_000_000


class Model:
    """Keeps the state of the events.

    Failed and slow transactions are kept in a list of their own, so that the others do not push them out; so are entries that a
    filter wants, from the moment when it is set. An answer later than ``slow_ns`` is slow. ``said`` counts problems of the
    monitor and alerts, ``latest`` is the latest of these.
    """

    def __init__(self, slow_ns: int = 1_000_000_000, most: int = MAX_ENTRIES, most_octets: int = MAX_OCTETS) -> None:
        self.slow_ns = slow_ns
        self.wanted = Wanted("", slow_ns)
        self.said = 0
        self.latest = ""
        self.came = 0
        self._most = most
        self._most_octets = most_octets
        self._connections = ConnectionList()
        self._findings = FindingList()
        self._recent = Ring(most, most_octets)
        self._odd = Ring(most, most_octets)
        self._matching = Ring(most, most_octets)
        self.watched: Watched | None = None

    def watch(self, wanted: WantedSet | None) -> None:
        """Watch variables from now on (None: all of them), beginning with the transactions that are still kept."""
        self.watched = Watched(wanted)
        self.watched.take([entry.what for entry in self._recent.entries if isinstance(entry.what, Transaction)])

    def take(self, events: Iterable[Event]) -> None:
        """Take events, in their order."""
        fresh: list[tuple[int, What]] = []
        for event in events:
            what = event.what
            if isinstance(what, Transaction):
                doubt = what.doubt if what.is_likely else ""
                self._connections.transaction(what.connection, event.time_ns, what.latency_ns, doubt)
                fresh.append((event.time_ns, what))
            elif isinstance(what, Connection):
                self._connections.note(what)
                if self.watched is not None and event.kind == CLOSED:
                    self.watched.forget(what)
            elif isinstance(what, Finding):
                self._findings.note(what)
            elif isinstance(what, str):
                self.said += 1
                self.latest = what if event.kind == ALERT else f"PROBLEM {what}"
            elif isinstance(what, Fact):
                continue  # shown only by the plain form
            elif not isinstance(what, tuple) or not what[0].message.phase:  # SCD with a phase is in a transaction
                fresh.append((event.time_ns, what))
        if self.watched is not None:
            self.watched.take([what for _, what in fresh if isinstance(what, Transaction)])
        self._keep(fresh)

    def select(self, where: Where | None) -> None:
        """Show only what an expression selects and the words want; None for no expression."""
        self._want(Wanted(self.wanted.typed, self.slow_ns, where))

    def filter(self, typed: str) -> None:
        """Show only entries that the typed words want, among them those that are still kept."""
        self._want(Wanted(typed, self.slow_ns, self.wanted.where))

    def _want(self, wanted: Wanted) -> None:
        self.wanted = wanted
        self._matching = Ring(self._most, self._most_octets)
        if self.wanted.everything:
            return
        there = {entry.order: entry for ring in (self._odd, self._recent) for entry in ring.entries}
        for _, entry in sorted(there.items()):
            if self.wanted.takes(entry.what):
                self._matching.add(entry)

    @property
    def entries(self) -> list[Entry]:
        """The entries that are shown, the newest last."""
        return list((self._recent if self.wanted.everything else self._matching).entries)

    def connections(self, now_ns: int) -> list[ConnectionFacts]:
        """Return the state of the connections at a time by the clock of the capture."""
        return self._connections.facts(now_ns)

    @property
    def connections_left_out(self) -> int:
        """The number of connections that were dropped from the list."""
        return self._connections.left_out

    def findings(self, counts: Mapping[str, int]) -> list[FindingFacts]:
        """Return the findings by rule; ``counts`` says how many there are of each."""
        return self._findings.facts(counts)

    def _keep(self, fresh: list[tuple[int, What]]) -> None:
        """Keep only those new entries that the lists have room for: copying the others would be wasted."""
        first_recent = len(fresh) - self._most
        odd = self._last([at for at, (_, what) in enumerate(fresh) if self._is_odd(what)])
        self.wanted.begin()
        matching: set[int] = set()
        if not self.wanted.everything:
            matching = self._last([at for at, (_, what) in enumerate(fresh) if self.wanted.takes(what)])
        for at, (time_ns, what) in enumerate(fresh):
            self.came += 1
            if at < first_recent and at not in odd and at not in matching:
                continue
            kept = detached(what) if isinstance(what, Transaction) else what
            slow = isinstance(what, Transaction) and is_slow(what, self.slow_ns)
            entry = Entry(self.came, time_ns, kept, slow)
            if at >= first_recent:
                self._recent.add(entry)
            if at in odd:
                self._odd.add(entry)
            if at in matching:
                self._matching.add(entry)

    def _last(self, places: list[int]) -> set[int]:
        return set(places[-self._most :])

    def _is_odd(self, what: What) -> bool:
        return isinstance(what, Transaction) and bool(what.failed or is_slow(what, self.slow_ns))
