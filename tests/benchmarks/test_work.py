"""The work of one packet is bounded, whatever the stream: counted lines, on every machine the same."""

from __future__ import annotations

import pytest

from benchmarks.streams import NAMES
from benchmarks.work import MOST_LINES, work
from dissect.wire.build import COMPILED
from tests.growth import UNCOUNTED

PACKETS = 1500


@pytest.mark.skipif(COMPILED, reason=UNCOUNTED)
@pytest.mark.parametrize("name", NAMES)
def test_no_packet_makes_much_work(name: str) -> None:
    told = work(name, PACKETS)
    assert 0 < told.middle <= told.most <= told.worst <= MOST_LINES // 5
