"""The words for answers that the capture may lack."""

from __future__ import annotations

from dissect.engine.transactions.transaction import CONNECTION_EVICTED, HOLE
from dissect.meaning.report.certainty import not_captured


def test_of_a_connection_that_was_dropped_nothing_is_said_of_the_capture() -> None:
    assert not_captured(1, {HOLE: 1}) == "1 answer not captured"
    assert not_captured(4, {HOLE: 1, CONNECTION_EVICTED: 3}) == "4 answers not captured or on dropped connections"
