from __future__ import annotations

import pytest

from dissect.engine.findings.catalogue import CATALOGUE
from dissect.engine.findings.reporter import Finding
from dissect.meaning.report.kept import BLOCK, FIRST, Findings

SLUGS = ("transaction.refused", "security.write", "stream.hole")
NOW_NS = 1_700_000_000_123_456_789


def made(number: int) -> Finding:
    """Return a finding unlike its neighbours: none, one, two or three packets, words with more than ASCII in them."""
    frames = [(1 << 40) + number + place for place in range(number % 4)]
    return Finding(
        CATALOGUE[SLUGS[number % 3]], number % 5, frames, NOW_NS + number, f"µ→\udc80 {number}" * (number % 3)
    )


def said(finding: Finding) -> tuple[object, ...]:
    return finding.rule, finding.connection, finding.frames, finding.time_ns, finding.detail


@pytest.mark.parametrize(
    "count",
    [
        *(0, 1, FIRST - 1, FIRST, FIRST + 1),
        *(FIRST + BLOCK - 1, FIRST + BLOCK, FIRST + BLOCK + 1, FIRST + 3 * BLOCK + 7),
    ],
)
def test_findings_come_back_as_they_were(count: int) -> None:
    kept = Findings()
    for number in range(count):
        kept.append(made(number))
    expected = [said(made(number)) for number in range(count)]
    assert len(kept) == count
    assert [said(finding) for finding in kept] == expected
    assert [said(finding) for finding in kept] == expected, "as often as it is asked for"
    assert [said(kept[place]) for place in range(0, count, 50)] == expected[::50]
    assert [said(finding) for finding in kept[1:-1:3]] == expected[1:-1:3]
    if count:
        assert said(kept[-1]) == expected[-1]
    for place in (count, -count - 1):
        with pytest.raises(IndexError):
            kept[place]


def test_one_that_was_packed_is_of_the_same_rule() -> None:
    kept = Findings()
    for number in range(FIRST + BLOCK):
        kept.append(made(number))
    assert len(kept._packed) == 1
    assert all(finding.rule is CATALOGUE[finding.slug] for finding in kept)


def test_many_that_are_alike_take_little() -> None:
    kept = Findings()
    for number in range(FIRST + 8 * BLOCK):
        detail = f"10.0.0.{number % 50}:4000 to 10.0.1.1:102: Write Var DB{number % 99}.DBD{number}"
        kept.append(Finding(CATALOGUE["security.write"], number, [number * 9, number * 9 + 2], NOW_NS + number, detail))
    packed = sum(len(block) for block in kept._packed)
    assert packed < 50 * 8 * BLOCK
