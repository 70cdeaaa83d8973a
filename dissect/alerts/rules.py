"""A rule: what it looks for, with whom, how often it may speak, and to whom."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Network, ip_address
from typing import Final

from dissect.baseline.subjects import Pair

Network = IPv4Network | IPv6Network

# What a rule can look for (`Rule.when`).
FINDING: Final = "finding"
NEW: Final = "new"
RATE: Final = "rate"
LATENCY: Final = "latency"
SILENCE: Final = "silence"
OUTCOME: Final = "outcome"

WHENS: Final = (FINDING, NEW, RATE, LATENCY, SILENCE, OUTCOME)
#: Those that look at single events; the others look at a state that lasts.
EVENTS: Final = frozenset((FINDING, NEW))

# What state rules look at together (`Rule.per`).
PER_PAIR: Final = "pair"
PER_CONNECTION: Final = "connection"
PER_ALL: Final = "all"

#: The action that is always there.
STDERR: Final = "stderr"

_S: Final = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Rule:
    """One [[rule]]. Times are nanoseconds; which fields mean something depends on ``when``.

    ``slugs`` for findings; ``kinds`` for what is new; ``of`` names what is measured; ``above`` and ``below`` are a rate per
    second, an answer time in nanoseconds, or outcomes per minute; ``longer_ns`` a silence; ``learned`` is a factor over what
    the baseline holds (0: none). ``burst`` is how many different alerts of one kind and severity it gives a minute before the
    rest is summed up (0: no limit).
    """

    name: str
    when: str
    severity: str = ""
    client: Network | None = None
    server: Network | None = None
    slugs: frozenset[str] = frozenset()
    kinds: frozenset[str] = frozenset()
    of: str = ""
    per: str = PER_PAIR
    window_ns: int = 10 * _S
    above: float | None = None
    below: float | None = None
    longer_ns: int = 0
    learned: float = 0.0
    for_ns: int = 0
    cooldown_ns: int = 60 * _S
    once: bool = False
    burst: int = 0
    actions: tuple[str, ...] = (STDERR,)

    @property
    def needs_baseline(self) -> bool:
        """True when the rule means nothing without a baseline."""
        return self.when == NEW or self.learned > 0

    @property
    def anyone(self) -> bool:
        """True when the rule looks at every client and server."""
        return self.client is None and self.server is None

    def covers(self, pair: Pair | None) -> bool:
        """Return whether the rule looks at what a pair does; None is a pair nobody knows."""
        if self.anyone:
            return True
        if pair is None:
            return False
        return _within(pair[0], self.client) and _within(pair[1], self.server)


def _within(host: str, network: Network | None) -> bool:
    if network is None:
        return True
    try:
        return ip_address(host) in network
    except ValueError:
        return False
