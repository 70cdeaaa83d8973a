"""How often a client comes."""

from __future__ import annotations

import pytest

from dissect.variables.statistics import Pace


@pytest.mark.parametrize(
    ("times", "period", "jitter"),
    [
        ([], None, None),
        ([5], None, None),
        ([5, 5], 0, None),
        ([0, 100, 300], 150, 50),
        ([0, 100, 300, -5000, -4900, -4700], 150, 50),  # the clock of the capture was set back
        ([0, 100, 300, -5000, -4850], 150, 41),
        ([300, 200, 100], None, None),
    ],
)
def test_a_period_is_of_times_that_the_clock_tells(times: list[int], period: int | None, jitter: int | None) -> None:
    pace = Pace()
    for time_ns in times:
        pace.add(time_ns)
    assert (pace.count, pace.period_ns, pace.jitter_ns) == (len(times), period, jitter)
