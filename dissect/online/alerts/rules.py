"""`Rule`: its condition, the hosts it applies to, how often it may give alerts, and to which actions."""

from __future__ import annotations

from dataclasses import dataclass
from ipaddress import IPv4Network, IPv6Network, ip_address
from typing import Final

from dissect.output.baseline.subjects import Pair

Network = IPv4Network | IPv6Network

# Conditions of rules (`Rule.when`).
FINDING: Final = "finding"
NEW: Final = "new"
RATE: Final = "rate"
LATENCY: Final = "latency"
SILENCE: Final = "silence"
OUTCOME: Final = "outcome"
PROBLEM: Final = "problem"

WHENS: Final = (FINDING, NEW, RATE, LATENCY, SILENCE, OUTCOME, PROBLEM)
#: Kinds of rules that look for single events; the others look for a lasting state.
EVENTS: Final = frozenset((FINDING, NEW, PROBLEM))

# For what state rules measure separately (`Rule.per`).
PER_PAIR: Final = "pair"
PER_CONNECTION: Final = "connection"
PER_ALL: Final = "all"

#: The action that always exists.
STDERR: Final = "stderr"

_S: Final = 1_000_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Rule:
    """One [[rule]]. Times are nanoseconds; ``when`` decides which fields are used.

    ``slugs`` are findings; ``kinds`` are kinds of new things or of problems; ``of`` names the measured quantity. ``above`` and
    ``below`` are a rate per second, an answer time in nanoseconds, or outcomes per minute; ``longer_ns`` is a silence.
    ``learned`` is a factor for the values of the baseline (0: none). ``burst`` is how many different alerts of one kind and
    severity the rule gives a minute before the rest is summed up (0: no limit).
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
        """Whether the rule cannot work without a baseline."""
        return self.when == NEW or self.learned > 0

    @property
    def anyone(self) -> bool:
        """Whether the rule applies to every client and server."""
        return self.client is None and self.server is None

    def covers(self, pair: Pair | None) -> bool:
        """Return whether the rule applies to a pair; None means that the pair is not known."""
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
