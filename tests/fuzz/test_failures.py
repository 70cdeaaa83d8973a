"""What is kept of failures, how inputs become smaller, what the runner says."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

from tests.fuzz import __main__ as runner
from tests.fuzz import failures
from tests.fuzz.failures import Failures, failure_of, kind_of, minimised


def picky(octets: bytes) -> None:
    if b"\xfe" in octets:
        raise KeyError("one")
    if octets[:1] == b"\x07" and octets[-1:] == b"\x07":
        raise ValueError("two")


def test_kinds_are_told_apart_and_the_first_of_each_is_kept(tmp_path: Path) -> None:
    folder = tmp_path / "artifacts"
    kept = Failures("picky", picky, folder)
    for octets in (b"", b"good", b"ab\xfec", b"\xfe", b"\x07 \x07", b"\x07"):
        kept(octets)
    assert sorted(kept.counts.values()) == [2, 2]
    assert sorted(path.read_bytes() for path in folder.glob("picky-*.bin")) == [b"\x07 \x07", b"ab\xfec"]
    assert all("picky" in path.read_text("utf-8") for path in folder.glob("*.txt"))


def test_a_failure_has_a_kind_and_a_report_and_what_is_good_has_none() -> None:
    kind, report = failure_of(picky, b"\xfe")
    assert kind.startswith("KeyError in test_failures.py:")
    assert "one" in report
    assert failure_of(picky, b"good") == ("", "")
    assert kind_of(OSError()) == "OSError"


def test_slow_is_what_runs_too_many_lines_however_long_it_took() -> None:
    def busy(octets: bytes) -> None:
        for _ in range(failures.LINES_AT_ALL):
            pass

    kind, report = failure_of(busy, b"x", 0)
    assert kind == "slow"
    assert report.startswith("one input of 1 bytes runs ")
    assert failure_of(picky, b"good", 0) == ("", "")
    assert failure_of(busy, bytes(1000), 0) == ("", "")  # much work for a large input is no failure
    assert failure_of(busy, b"x") == ("", "")


def test_a_failing_input_becomes_as_small_as_it_can() -> None:
    assert minimised(picky, b"some text \xfe and more of it") == b"\xfe"
    assert minimised(picky, b"\x07" + bytes(range(1, 7)) * 9 + b"\x07") == b"\x07"
    with pytest.raises(ValueError, match="does not fail"):
        minimised(picky, b"good")


def test_without_atheris_there_is_one_line_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", {}.get)
    assert runner.main(["pdus"]) == 2
    told = capsys.readouterr()
    assert not told.out
    assert "pip install atheris" in told.err
    assert told.err.count("\n") == 1


def test_single_inputs_run_without_atheris(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    good, bad = tmp_path / "good", tmp_path / "bad"
    good.write_bytes(b"\0\x32\x01")
    bad.write_bytes(b"xx\xfe")
    assert runner.main(["pdus", "--run", str(good)]) == 0
    assert capsys.readouterr().out == f"{good}: good\n"
    monkeypatch.setitem(runner.targets(), "pdus", (picky, list, 10))
    assert runner.main(["pdus", "--run", str(good), str(bad), "--minimise"]) == 1
    assert "1 bytes do the same: b'\\xfe'" in capsys.readouterr().out


def test_the_summary_tells_what_libfuzzer_counted(capsys: pytest.CaptureFixture[str]) -> None:
    account = runner.Account()
    account.read(
        [
            "INFO: Running with entropic power schedule (0xFF, 100).\n",
            "#376\tINITED cov: 2404 ft: 8921 corp: 301/38Kb exec/s: 188 rss: 96Mb\n",
            "FAILURE KeyError in message.py:7: a.bin\n",
            "#3860\tDONE   cov: 2553 ft: 9921 corp: 401/58Kb lim: 1004 exec/s: 386 rss: 102Mb\n",
            "stat::number_of_executed_units: 3860\n",
            "stat::new_units_added:          217\n",
            "stat::peak_rss_mb:              102\n",
        ]
    )
    assert account.summary("pdus", 10) == (
        "pdus: 3860 executions in 10 s, 386/s; coverage 2553 edges, 149 of them new; 217 inputs kept; RSS 102 MB; "
        "1 kinds of failure"
    )
    assert capsys.readouterr().err == "FAILURE KeyError in message.py:7: a.bin\n"
    assert "0 executions" in runner.Account().summary("pdus", 10)
