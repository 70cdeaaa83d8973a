"""`Baseline`: what is normal for each pair of client and server, and how often."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final, TypeVar

from dissect.output.baseline.subjects import Pair

#: The sets of a pair, by their keys in the file.
NAME_KEYS: Final = ("tsaps", "functions", "reads", "writes", "acts")
#: Measures of a pair that a further capture can only raise.
_HIGHEST: Final = ("highest_1s", "highest_10s", "median_ms", "p99_ms", "longest_ms", "longest_silence")
#: Maximum number of captures that a baseline names.
MAX_CAPTURES: Final = 64

_Entry = TypeVar("_Entry", int, str)


@dataclass(slots=True)
class PairNorm:
    """The normal traffic of a client and a server. A set that is None allows anything; a measure that is None is not known.

    ``highest_1s`` and ``highest_10s`` are transactions within so many seconds; ``longest_silence`` and ``seconds`` (from the
    first transaction to the last, all captures together) are seconds; answer times are milliseconds.

    ``acts`` are kinds of acts (`dissect.engine.acts.tables`) that the client may do. Learning allows none: ``acts_seen`` has
    the number of each kind in the learned captures, and ``functions_seen`` the functions that only served acts of S7comm.
    """

    client: str
    server: str
    server_ports: frozenset[int] | None = None
    tsaps: frozenset[str] | None = None
    functions: frozenset[str] | None = None
    reads: frozenset[str] | None = None
    writes: frozenset[str] | None = None
    acts: frozenset[str] | None = None
    acts_seen: dict[str, int] = field(default_factory=dict)
    functions_seen: frozenset[str] = frozenset()
    connections: int = 0
    transactions: int = 0
    seconds: float = 0.0
    highest_1s: int | None = None
    highest_10s: int | None = None
    median_ms: float | None = None
    p99_ms: float | None = None
    longest_ms: float | None = None
    longest_silence: float | None = None


@dataclass(slots=True)
class Baseline:
    """Pairs by their addresses. ``captures`` are names of files, ``begin`` and ``end`` times in ISO 8601, empty for none.

    ``left_out`` counts entries that exceeded the limits of the learner.
    """

    pairs: dict[Pair, PairNorm] = field(default_factory=dict)
    captures: tuple[str, ...] = ()
    begin: str = ""
    end: str = ""
    left_out: int = 0


def merged(one: Baseline, other: Baseline) -> Baseline:
    """Return a baseline that allows what either of the two allows: sets are joined, counts added, higher measures taken."""
    captures = tuple(dict.fromkeys([*one.captures, *other.captures]))[:MAX_CAPTURES]
    begins = [begin for begin in (one.begin, other.begin) if begin]
    both = Baseline(dict(one.pairs), captures, min(begins, default=""), max(one.end, other.end))
    both.left_out = one.left_out + other.left_out
    for pair, norm in other.pairs.items():
        known = both.pairs.get(pair)
        both.pairs[pair] = norm if known is None else _joined(known, norm)
    return both


def _joined(one: PairNorm, other: PairNorm) -> PairNorm:
    norm = PairNorm(one.client, one.server)
    norm.server_ports = _either(one.server_ports, other.server_ports)
    for key in NAME_KEYS:
        setattr(norm, key, _either(getattr(one, key), getattr(other, key)))
    norm.acts_seen = dict(one.acts_seen)
    for kind, count in other.acts_seen.items():
        norm.acts_seen[kind] = norm.acts_seen.get(kind, 0) + count
    norm.functions_seen = one.functions_seen | other.functions_seen
    norm.connections = one.connections + other.connections
    norm.transactions = one.transactions + other.transactions
    norm.seconds = one.seconds + other.seconds
    for key in _HIGHEST:
        known = [measure for measure in (getattr(one, key), getattr(other, key)) if measure is not None]
        setattr(norm, key, max(known, default=None))
    return norm


def _either(one: frozenset[_Entry] | None, other: frozenset[_Entry] | None) -> frozenset[_Entry] | None:
    """Return the union of two sets; None, which allows anything, if one is None."""
    return None if one is None or other is None else one | other
