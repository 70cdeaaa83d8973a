"""Two baselines put together."""

from __future__ import annotations

from dissect.output.baseline import merged
from tests.output.baseline.wire import learned


def test_merging_adds_and_keeps_the_higher() -> None:
    one, other = learned("10.0.0.1").baseline(("a",)), learned("10.0.0.1", "10.0.0.3").baseline(("a", "b"))
    pair = ("10.0.0.1", "10.0.0.2")
    one.pairs[pair].longest_ms = 7000.0
    one.pairs[pair].reads = frozenset(("T",))
    one.pairs[pair].writes = None
    both = merged(one, other)
    norm = both.pairs[pair]
    assert both.captures == ("a", "b")
    assert len(both.pairs) == 2
    assert norm.transactions == 16
    assert norm.longest_ms == 7000.0
    assert norm.reads == frozenset(
        (
            "T",
            "DB10",
            "M",
        )
    )
    assert norm.writes is None  # anything was allowed, and still is
