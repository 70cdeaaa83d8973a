"""The facts of each rule: how often it applied, when first and last, on how many connections, between which hosts.

They are updated whenever a rule applies, before any limit, so the numbers in texts are true counts of events. `Finding` objects
are only samples. Events that a rule does not report, because it reports once per connection, count here as well.
"""

from __future__ import annotations

from operator import itemgetter
from typing import Final

from mypy_extensions import i64

from dissect.engine.transactions.connection import Connection
from dissect.packets.tcp.link import within
from dissect.wire.copies import leaves

#: Maximum number of pairs of hosts with their own facts; the events of all other pairs are added up in `Ledger.rest`.
MAX_PAIRS: Final = 4096
#: Maximum number of connections that are told apart per rule, and per rule and pair of hosts; the later half is kept.
_LATEST: Final = 4096
_LATEST_OF_PAIR: Final = 64


class Occurrences:
    """The events of one rule: ``events`` is their number, ``reports`` the number of those that became findings.

    First and last event are chosen by time; with them are kept the first and last packets that show them, 0 for none.
    ``connections`` counts the connections with a number. It is exact unless a connection returns after very many others; then
    ``at_least`` is True.
    """

    __slots__ = (
        "_forgotten",
        "_known",
        "_latest",
        "_room",
        "at_least",
        "connections",
        "events",
        "first_frame",
        "first_ns",
        "last_frame",
        "last_ns",
        "reports",
    )

    def __init__(self, room: i64 = _LATEST) -> None:
        self.events: i64 = 0
        self.reports: i64 = 0
        self.first_ns: i64 = 0
        self.first_frame: i64 = 0
        self.last_ns: i64 = 0
        self.last_frame: i64 = 0
        self.connections: i64 = 0
        self.at_least: bool = False
        self._room: i64 = room
        self._latest: i64 = 0  # the connection of the latest event
        self._forgotten: i64 = 0  # the highest connection number that was forgotten
        # Made only with the second connection: most rules apply on a single connection of a pair of hosts.
        self._known: set[int] | None = None

    def __repr__(self) -> str:
        return f"Occurrences({self.events} events, {self.reports} reports, {self.connections} connections)"

    def take(self, connection: i64, first_frame: i64, last_frame: i64, time_ns: i64, reported: bool) -> None:
        """Count an event on a connection, 0 for none."""
        if self.events == 0 or time_ns < self.first_ns:
            self.first_ns = time_ns
            self.first_frame = first_frame
        if self.events == 0 or time_ns >= self.last_ns:
            self.last_ns = time_ns
            self.last_frame = last_frame
        self.events += 1
        if reported:
            self.reports += 1
        if connection != self._latest and connection > 0:
            self._meet(connection)

    def _meet(self, connection: i64) -> None:
        """Count a connection, if unknown; it differs from the connection of the latest event."""
        latest: i64 = self._latest
        self._latest = connection
        if latest == 0:
            self.connections = 1
            return
        known = self._known
        if known is None:
            known = self._known = {int(latest)}
        if connection in known:
            return
        if connection <= self._forgotten:
            self.at_least = True  # it may have been counted before
            return
        self.connections += 1
        known.add(connection)
        if len(known) > self._room:
            self._forget(known)

    def _forget(self, known: set[int]) -> None:
        """Keep the half of the connections with the higher numbers, which are the latest."""
        ordered = sorted(known)
        half = len(ordered) // 2
        self._forgotten = ordered[half - 1]
        self._known = set(ordered[half:])

    def absorb(self, other: Occurrences, connection: i64) -> None:
        """Add events that were counted separately, all of one connection, 0 for none."""
        self._add(other)
        if connection != self._latest and connection > 0 and other.events:
            self._meet(connection)

    def merge(self, other: Occurrences) -> None:
        """Add the events of a later part of a run, which has only other connections."""
        self._add(other)
        self.connections += other.connections
        self.at_least = self.at_least or other.at_least

    def _add(self, other: Occurrences) -> None:
        if other.events == 0:
            return
        if self.events == 0 or other.first_ns < self.first_ns:
            self.first_ns = other.first_ns
            self.first_frame = other.first_frame
        if self.events == 0 or other.last_ns >= self.last_ns:
            self.last_ns = other.last_ns
            self.last_frame = other.last_frame
        self.events += other.events
        self.reports += other.reports

    def lasts(self, begin_ns: i64, end_ns: i64) -> bool:
        """Return whether the last event is in the last tenth of the time from ``begin_ns`` to ``end_ns``."""
        return self.events > 0 and self.last_ns >= end_ns - (end_ns - begin_ns) // 10


class Pair:
    """A client and a server by address and VLAN, with the facts of each rule between them.

    ``further`` is True for a pair without its own record, because there are too many pairs.
    """

    __slots__ = ("client", "further", "records", "server")

    def __init__(self, client: str, server: str, further: bool = False) -> None:
        self.client: str = client
        self.server: str = server
        self.further: bool = further
        self.records: dict[str, Occurrences] = {}

    def __repr__(self) -> str:
        return f"Pair({self.client} → {self.server}, {len(self.records)} rules)"


#: The hosts of an event without hosts.
NO_PAIR: Final = Pair("", "")


class Ledger:
    """Facts by rule (``rules``), and by pair of hosts and rule (``pairs``, by client and server).

    ``explained`` are the events that another finding explains, by the two slugs. They are in no other record.
    """

    __slots__ = ("_by_rule", "_met", "_of", "explained", "pairs", "rest", "rules")

    def __init__(self) -> None:
        self.rules: dict[str, Occurrences] = {}
        self.explained: dict[tuple[str, str], Occurrences] = {}
        self.pairs: dict[tuple[str, str], Pair] = {}
        self.rest: dict[str, Occurrences] = {}  # of pairs beyond `MAX_PAIRS`
        self._by_rule: dict[str, list[Pair]] = {}
        self._met: dict[int, Connection] = {}  # open connections, by number
        self._of: dict[int, Pair] = {}  # the hosts of those of them that have findings

    def __repr__(self) -> str:
        return f"Ledger({len(self.rules)} rules, {len(self.pairs)} pairs of hosts)"

    # ---- connections ------------------------------------------------------------------------------------------------

    def met(self, connection: Connection) -> None:
        """A connection got its number."""
        self._met[connection.number] = connection

    def over(self, connection: i64) -> None:
        """A connection is over and fully reported: forget it."""
        if connection in self._met:
            del self._met[connection]
        if connection in self._of:
            del self._of[connection]

    def pair(self, connection: i64) -> Pair:
        """Return the hosts of an open connection; `NO_PAIR` for the capture as a whole."""
        found = self._of.get(connection) if self._of else None
        if found is not None:
            return found
        known = self._met.get(connection)
        if known is None:
            return NO_PAIR
        client, server = known.client.host, known.server.host
        if known.tcp.vlan:
            client, server = within(client, known.tcp.vlan), within(server, known.tcp.vlan)
        found = self.between(client, server)
        self._of[connection] = found
        return found

    def between(self, client: str, server: str) -> Pair:
        """Return the pair of two hosts; `further` is True for it when there are too many pairs."""
        found = self.pairs.get((client, server))
        if found is None:
            found = Pair(client, server, len(self.pairs) >= MAX_PAIRS)
            if not found.further:
                self.pairs[client, server] = found
        return found

    def same(self, pair: Pair) -> Pair:
        """Return the pair of this ledger that corresponds to a pair of another ledger."""
        return pair if pair is NO_PAIR else self.between(pair.client, pair.server)

    # ---- events -----------------------------------------------------------------------------------------------------

    def take(
        self, slug: str, pair: Pair, connection: i64, first_frame: i64, last_frame: i64, time_ns: i64, reported: bool
    ) -> None:
        """Count an event of a rule."""
        self.rule(slug).take(connection, first_frame, last_frame, time_ns, reported)
        if pair is not NO_PAIR:
            self._of_hosts(pair, slug).take(connection, first_frame, last_frame, time_ns, reported)

    def add(
        self,
        slug: str,
        because: str,
        client: str,
        server: str,
        connection: i64,
        frames: list[int],
        time_ns: i64,
        reported: bool,
    ) -> None:
        """Count an event under the rule of its finding; ``because`` is the rule that explains it, empty for none."""
        first: i64 = 0
        last: i64 = 0
        if frames:
            first = frames[0]
            last = frames[-1]
        if because:
            self.explain(because, slug, connection, first, last, time_ns, reported)
            return
        pair = self.between(client, server) if client else NO_PAIR
        self.take(slug, pair, connection, first, last, time_ns, reported)

    def explain(
        self, cause: str, slug: str, connection: i64, first_frame: i64, last_frame: i64, time_ns: i64, reported: bool
    ) -> None:
        """Count an event that the rule ``cause`` explains."""
        self.explanation(cause, slug).take(connection, first_frame, last_frame, time_ns, reported)

    def rule(self, slug: str) -> Occurrences:
        """Return the facts of a rule; make them if they do not exist."""
        found = self.rules.get(slug)
        if found is None:
            found = self.rules[slug] = Occurrences()
        return found

    def explanation(self, cause: str, slug: str) -> Occurrences:
        """Return the facts of a rule as explained by a different rule; make them if they do not exist."""
        found = self.explained.get((cause, slug))
        if found is None:
            found = self.explained[cause, slug] = Occurrences()
        return found

    def _of_hosts(self, pair: Pair, slug: str) -> Occurrences:
        found = (self.rest if pair.further else pair.records).get(slug)
        if found is not None:
            return found
        if pair.further:
            found = self.rest[slug] = Occurrences()
            return found
        found = pair.records[slug] = Occurrences(_LATEST_OF_PAIR)
        pairs = self._by_rule.get(slug)
        if pairs is None:
            self._by_rule[slug] = [pair]
        else:
            pairs.append(pair)
        return found

    def settle(self, slug: str, pair: Pair, connection: i64, events: Occurrences, cause: str) -> None:
        """Add events of a connection that waited for a cause; ``cause`` is the rule that explains them, empty for none."""
        if cause:
            self.explanation(cause, slug).absorb(events, connection)
            return
        self.rule(slug).absorb(events, connection)
        if pair is not NO_PAIR:
            self._of_hosts(pair, slug).absorb(events, connection)

    def merge(self, other: Ledger) -> None:
        """Add the facts of a later part of a run, which has only other connections."""
        for slug, found in other.rules.items():
            self.rule(slug).merge(found)
        for (cause, slug), found in other.explained.items():
            self.explanation(cause, slug).merge(found)
        for (client, server), pair in other.pairs.items():
            mine = self.between(client, server)
            for slug, found in pair.records.items():
                self._of_hosts(mine, slug).merge(found)
        for slug, found in other.rest.items():
            self._of_hosts(Pair("", "", True), slug).merge(found)

    # ---- questions --------------------------------------------------------------------------------------------------

    def pairs_with(self, slug: str) -> list[Pair]:
        """Return the pairs of hosts between which a rule applied, in the order of their first events."""
        return list(self._by_rule.get(slug, ()))  # a copy: a screen may read it while packets arrive

    def pairs_of(self, slug: str) -> list[Pair]:
        """Return the pairs of hosts between which a rule applied: those with most events first, then the earliest."""
        found = [(_weight(pair, slug), pair) for pair in self.pairs_with(slug)]
        found.sort(key=itemgetter(0))
        return [pair for _, pair in found]

    def hosts_of(self, slug: str) -> int:
        """Return how many hosts a rule concerns, counted over the pairs with their own records."""
        hosts: set[str] = set()
        for pair in self.pairs_with(slug):
            hosts.add(pair.client)
            hosts.add(pair.server)
        return len(hosts)

    def further(self, slug: str) -> int:
        """Return how many events of a rule were between hosts without their own record."""
        found = self.rest.get(slug)
        return int(found.events) if found is not None else 0


def _weight(pair: Pair, slug: str) -> tuple[int, int, str, str]:
    found = pair.records[slug]
    return -int(found.events), int(found.first_ns), pair.client, pair.server


leaves(Ledger, without=("_met", "_of"))
leaves(Occurrences, without=("_forgotten", "_known", "_latest"))
leaves(Pair)
