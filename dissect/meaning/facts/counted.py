"""The facts of the events of a rule: all of them, those between two hosts, or those that another finding explains."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final, NamedTuple

from dissect.engine.findings.catalogue import CATALOGUE, Rule
from dissect.engine.findings.ledger import Ledger, Occurrences, Pair
from dissect.meaning.facts.fact import COUNT, FILE, FLAG, FRAME, TIME, WORD, Fact, by_name

_ROWS: Final[tuple[Fact[Occurrences], ...]] = (
    Fact("events", COUNT, "Number of times that the rule applied.", lambda of: int(of.events), least=1),
    Fact("reports", COUNT, "Number of findings that report them.", lambda of: int(of.reports)),
    Fact("first_time", TIME, "Time of the first event.", lambda of: int(of.first_ns) or None, column="ts", null=True),
    Fact("first_frame", FRAME, "Packet of the first event.", lambda of: int(of.first_frame), null=True),
    Fact("last_time", TIME, "Time of the last event.", lambda of: int(of.last_ns) or None, column="end", null=True),
    Fact("last_frame", FRAME, "Packet of the last event.", lambda of: int(of.last_frame), null=True),
    Fact("connections", COUNT, "Connections on which it applied.", lambda of: int(of.connections)),
    Fact("connections_at_least", FLAG, "True if there may be more connections: of very many, one that comes back is not told"
         " apart.", lambda of: of.at_least),
    Fact("file", FILE, "Capture file of the first event.", lambda of: int(of.first_frame), key=""),
    Fact("last_file", FILE, "Capture file of the last event.", lambda of: int(of.last_frame), key=""),
)  # fmt: skip

#: The facts of events by their names, in the order of their keys in JSON.
OCCURRENCES: Final[dict[str, Fact[Occurrences]]] = by_name(_ROWS)


class Counted(NamedTuple):
    """Events of a rule; ``scope`` says which ones. ``lasts``: there were some in the last tenth of the capture."""

    scope: str
    rule: Rule
    found: Occurrences
    lasts: bool
    pair: Pair | None = None
    because: str = ""
    hosts: int | None = None


def counted(ledger: Ledger, begin_ns: int, end_ns: int) -> Iterator[Counted]:
    """Yield the facts of the events of each rule in a capture of this time."""

    def of(scope: str, slug: str, found: Occurrences, **more: Any) -> Counted:
        return Counted(scope, CATALOGUE[slug], found, found.lasts(begin_ns, end_ns), **more)

    for slug, found in ledger.rules.items():
        yield of("rule", slug, found, hosts=ledger.hosts_of(slug))
        for pair in ledger.pairs_of(slug):
            yield of("pair", slug, pair.records[slug], pair=pair)
        if slug in ledger.rest:
            yield of("further_pairs", slug, ledger.rest[slug])
    for (cause, slug), found in ledger.explained.items():
        yield of("explained", slug, found, because=cause)


def _of_found(fact: Fact[Occurrences]) -> Fact[Counted]:
    """Return a fact of the events as one of `Counted`."""
    get = fact.get

    def got(of: Counted) -> Any:
        return get(of.found) if get is not None else None

    return Fact(fact.name, fact.kind, fact.about, got, column=fact.column)


def _pair(name: str) -> Callable[[Counted], str | None]:
    return lambda of: getattr(of.pair, name) if of.pair is not None else None


_COUNTED: Final[tuple[Fact[Counted], ...]] = (
    Fact("scope", WORD, "rule, or of its events pair, further_pairs; or explained.", lambda of: of.scope),
    Fact("slug", WORD, "The stable name of the rule.", lambda of: of.rule.slug),
    Fact("severity", WORD, "Severity of the rule.", lambda of: of.rule.severity),
    Fact("kind", WORD, "Kind of the rule.", lambda of: of.rule.kind),
    Fact("reported", WORD, "How often the rule reports: each, once a connection …", lambda of: of.rule.reported),
    Fact("client_host", WORD, "Address of the client, in the rows of pairs.", _pair("client")),
    Fact("server_host", WORD, "Address of the server, in the rows of pairs.", _pair("server")),
    Fact("because_of", WORD, "Slug of the finding that explains these, null for none.", lambda of: of.because or None),
    Fact("hosts", COUNT, "Hosts that it concerns, in the row of a rule.", lambda of: of.hosts),
    Fact("in_last_tenth", FLAG, "It still applied in the last tenth of the capture.", lambda of: of.lasts),
    *[_of_found(fact) for fact in _ROWS],
)  # fmt: skip

#: The facts of `Counted` by their names.
COUNTED: Final[dict[str, Fact[Counted]]] = by_name(_COUNTED)
