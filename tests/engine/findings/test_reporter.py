from __future__ import annotations

import pytest

from dissect.engine.findings.bounds import KEPT
from dissect.engine.findings.catalogue import CATALOGUE, ERROR, SEVERITIES
from dissect.engine.findings.reporter import MAX_DETAILED, MAX_DETAILED_ALL, Finding, Reporter


def test_a_finding_is_counted_and_told() -> None:
    reporter = Reporter()
    reporter.note("transaction.refused", 3, [7, 9], 123, "what was seen")
    assert reporter.counts == {"transaction.refused": 1}
    (finding,) = reporter.fresh
    assert (finding.slug, finding.connection, finding.frames, finding.time_ns) == (
        "transaction.refused",
        3,
        [7, 9],
        123,
    )
    assert (finding.detail, finding.severity, finding.rule) == (
        "what was seen",
        "warning",
        CATALOGUE["transaction.refused"],
    )
    assert repr(finding) == "Finding('transaction.refused', connection=3, frames=[7, 9])"


@pytest.mark.parametrize("count", [MAX_DETAILED, MAX_DETAILED + 1, 10 * MAX_DETAILED])
def test_so_many_are_told_of_one_connection(count: int) -> None:
    reporter = Reporter()
    for frame in range(count):
        reporter.note("s7.malformed", 1, [frame], frame, "")
    assert reporter.counts["s7.malformed"] == count
    assert [finding.frames[0] for finding in reporter.fresh] == [*range(MAX_DETAILED)]


def test_the_bound_is_by_slug_and_pair_of_hosts() -> None:
    reporter = Reporter()
    for slug in ("stream.refused", "session.idle"):
        for host in ("a", "b", "c"):
            for frame in range(1, MAX_DETAILED + 6):
                if reporter.wants_between(slug, host, "plc", frame, frame, frame):
                    reporter.detail(slug, 0, [frame], frame, "")
    assert reporter.counts == {"stream.refused": 3 * (MAX_DETAILED + 5), "session.idle": 3 * (MAX_DETAILED + 5)}
    assert len(reporter.fresh) == 6 * MAX_DETAILED


def test_the_first_of_each_connection_is_told_and_so_many_are_kept() -> None:
    reporter = Reporter()
    for connection in range(1, 5 * MAX_DETAILED_ALL + 1):
        reporter.note("tpkt.garbage", connection, [1], 1)
        reporter.note("tpkt.garbage", connection, [2], 2)
    assert reporter.counts["tpkt.garbage"] == 10 * MAX_DETAILED_ALL
    assert {finding.connection for finding in reporter.fresh} == {*range(1, 5 * MAX_DETAILED_ALL + 1)}
    kept = [finding for finding in reporter.fresh if finding.room == KEPT]
    assert [finding.number for finding in kept] == [*range(1, MAX_DETAILED_ALL + 1)]
    assert {finding.number for finding in reporter.fresh if finding.room != KEPT} == {0}
    reporter.note("tpkt.bad_length", 1, [3], 3)
    assert reporter.fresh[-1].number == MAX_DETAILED_ALL + 1


def test_nobody_builds_a_sentence_in_vain() -> None:
    reporter = Reporter()
    wanted = [reporter.wants("stream.hole", 1, 4, 4, 4) for _ in range(MAX_DETAILED + 3)]
    assert wanted == [True] * MAX_DETAILED + [False] * 3
    assert reporter.counts["stream.hole"] == MAX_DETAILED + 3
    assert reporter.fresh == []
    reporter.detail("stream.hole", 1, [4], 4, "7 bytes")
    assert reporter.counts["stream.hole"] == MAX_DETAILED + 3
    assert [finding.detail for finding in reporter.fresh] == ["7 bytes"]


def test_a_slug_outside_the_catalogue_is_a_bug_of_ours() -> None:
    with pytest.raises(KeyError):
        Reporter().note("no.such", 0, [], 0)


def test_severities_from_the_heaviest() -> None:
    assert SEVERITIES == ("error", "warning", "note")
    assert Finding(CATALOGUE["internal.bug"], 0, [], 0, "").severity == ERROR
