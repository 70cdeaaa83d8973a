"""`monitor --report DIR --every TIME`: a page for each period, whole and of that period alone."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.cli.support import run, simple
from tests.meaning.report.support import WORD, begun, read, saved
from tests.output.page.support import session_of
from tests.properties.packets import EPOCH_NS

Capture = pytest.CaptureFixture[bytes]
MINUTE = 60_000_000_000


def pages(folder: Path) -> dict[str, str]:
    return {path.name: path.read_text(encoding="utf-8") for path in sorted(folder.iterdir())}


def test_each_period_has_its_page(capfdbinary: Capture, tmp_path: Path) -> None:
    """From 05:06:07 on: eight transactions in the first minute, one of them refused, then nothing, and two in the third."""
    talk = begun()
    for ref in range(1, 8):
        read(talk, ref, WORD, 0x0A if ref == 2 else b"\x00\x01")
    packets = talk.packets()
    for ref in (8, 9):
        read(talk, ref)
    later = talk.packets(start_ns=EPOCH_NS + 2 * MINUTE)[len(packets) :]
    out = tmp_path / "made" / "reports"
    ran = run(
        capfdbinary,
        *("monitor", "--plain", saved(tmp_path / "a.pcapng", [*packets, *later]), "--report", out, "--every", "60s"),
    )
    assert ran.code == 0, ran.err
    made = pages(out)
    assert list(made) == ["s7dissect-20240304T050600Z.html", "s7dissect-20240304T050800Z.html"]
    first, last = [session_of(page) for page in made.values()]
    assert [sum([sum(one[1:]) for one in session["rates"]["bins"]]) for session in (first, last)] == [8, 2]
    assert "transaction.item_error, once" in made["s7dissect-20240304T050600Z.html"]
    for page, began, transactions in zip(made.values(), ("05:06:07", "05:08:00"), (8, 2), strict=True):
        (about,) = re.findall(r'<p class="quiet">(from .*?)</p>', page)
        assert about.startswith(f"from 2024-03-04 {began}"), about
        assert f", 1 connection, {transactions} transactions" in about
    assert "transaction.item_error" not in made["s7dissect-20240304T050800Z.html"]
    for session in (first, last):
        (connections,) = [table for table in session["tables"] if table["name"] == "connections"]
        assert len(connections["rows"]) == 1
        assert {row["show"] for table in session["tables"] for row in table["rows"]} == {""}  # there is no file to read


def test_a_page_that_exists_is_kept(capfdbinary: Capture, tmp_path: Path) -> None:
    capture, out = simple(tmp_path / "a.pcapng"), tmp_path / "reports"
    for _ in range(2):
        assert run(capfdbinary, "monitor", "--plain", capture, "--report", out).code == 0
    assert list(pages(out)) == ["s7dissect-20240304T050000Z-2.html", "s7dissect-20240304T050000Z.html"]


def test_what_cannot_be_done_is_told_before_anything_is_watched(capfdbinary: Capture, tmp_path: Path) -> None:
    capture = simple(tmp_path / "a.pcapng")
    for words, said in (
        (("--every", "1h"), "--every needs --report"),
        (("--report", tmp_path / "r", "--every", "5s"), "at least 10 s"),
        (("--report", tmp_path / "r", "--every", "soon"), "such as 15min or 1h"),
        (("--report", capture), "is not a folder"),
    ):
        ran = run(capfdbinary, "monitor", "--plain", capture, *words)
        assert (ran.code, ran.out) == (2, ""), words
        assert said in ran.err
    assert not (tmp_path / "r").exists()


def test_a_report_that_fails_does_not_end_the_watch(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object) -> None:
        raise OSError(28, "No space left on device", "reports/a.html")

    monkeypatch.setattr("dissect.online.live.reports.save", full)
    ran = run(capfdbinary, "monitor", "--plain", simple(tmp_path / "a.pcapng"), "--report", tmp_path / "r")
    assert ran.code == 5
    assert "the report: 1 page not written in " in ran.err
    assert "reports/a.html: No space left on device" in ran.err
    assert "Read Var" in ran.out
