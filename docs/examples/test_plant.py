"""Check a recording with pytest: nothing is refused, nothing is slow."""

import dissect
import pytest

CAPTURES = ["captures/read-areas.pcapng", "captures/multi-items.pcapng"]


@pytest.mark.parametrize("capture", CAPTURES)
def test_no_request_is_refused_or_unanswered(capture: str) -> None:
    failed = [
        event for event in dissect.open(capture, pdus=False) if isinstance(event, dissect.Transaction) and event.failed
    ]
    assert not failed


@pytest.mark.parametrize("capture", CAPTURES)
def test_answers_come_within_a_second(capture: str) -> None:
    slowest = dissect.analyze(capture).latencies.quantile(1.0)
    assert slowest is not None
    assert slowest < 1_000_000_000


def test_the_client_still_says_what_it_said(s7_golden) -> None:
    s7_golden.check(CAPTURES[0])
