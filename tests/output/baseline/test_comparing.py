"""What a run has that a baseline has not, as a program asks for it."""

from __future__ import annotations

import pytest

from dissect.files.session import Run
from dissect.output.baseline import Baseline, BaselineComparison, Learner, comparing
from tests.meaning.report.support import ROOT


def learned(name: str) -> Baseline:
    learner = Learner()
    Run(ROOT / "captures" / name, learner).read()
    return learner.baseline()


def compared(baseline: Baseline, name: str) -> BaselineComparison:
    comparison = BaselineComparison(baseline)
    Run(ROOT / "captures" / name, comparison).read()
    return comparison


def test_the_same_capture_deviates_in_nothing() -> None:
    assert compared(learned("nodes7-poll.pcapng"), "nodes7-poll.pcapng").found == []


def test_each_deviation_is_found_once() -> None:
    found = compared(learned("nodes7-poll.pcapng"), "plc-control.pcapng").found
    assert [one.what for one in found if one.kind == "act"] == [
        "stop", "start", "restart", "compress", "copy_ram_to_rom", "delete",
    ]  # fmt: skip
    assert len({str(one) for one in found}) == len(found)


def test_what_nobody_learned_is_all_new_and_the_list_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    nothing = Baseline({})
    every = compared(nothing, "nodes7-write.pcapng").found
    assert {one.kind for one in every} == {"act", "client", "function", "write"}
    monkeypatch.setattr(comparing, "MOST", 2)
    few = compared(nothing, "nodes7-write.pcapng")
    assert len(few.found) == 2
    assert few.more >= len(every) - 2


def test_a_connection_without_transactions_is_compared() -> None:
    assert [one.kind for one in compared(Baseline({}), "crafted/cotp-refused.pcapng").found] == ["client"]
