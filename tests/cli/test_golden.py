from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.cli.support import halves, run, simple
from tests.meaning.report.support import ROOT
from tests.testing.golden.support import WRITTEN

Capture = pytest.CaptureFixture[bytes]
PLANT = ROOT / "captures" / "scd"


def test_a_capture_is_written_to_standard_output(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "golden", simple(tmp_path / "a.pcapng"))
    assert (ran.code, ran.err) == (0, "")
    assert ran.out == (
        "s7dissect golden 1\n\nconnection 1\n  protocol s7comm\n"
        "  client TSAP <01 00>  # 01.00 (PG)\n  server TSAP <01 02>  # 01.02 (PG, rack 0 slot 2)\n"
        "  TPDU size 1024, asked 1024\n\n"
        "1 client SETUP\n  asks PDU 480, AmQ 1/1\n  gets PDU 480, AmQ 1/1\n\n"
        "2 client READ\n  DB10.DBW4 WORD = 1234\n\n"
        "3 client READ\n  DB10.DBW4 WORD refused 0x0a  # Object does not exist\n\n"
        "4 client READ\n  DB10.DBW4 WORD = 1234\n"
    )


def test_a_file_is_written_whole_and_like_standard_output(capfdbinary: Capture, tmp_path: Path) -> None:
    capture = simple(tmp_path / "a.pcapng")
    shown = run(capfdbinary, "golden", capture).out
    path = tmp_path / "a.s7.txt"
    path.write_text("old", encoding="utf-8")
    kept = run(capfdbinary, "golden", capture, "-o", path)
    assert (kept.code, path.read_text(encoding="utf-8")) == (2, "old")
    assert f"{path} exists; --force overwrites it." in kept.err
    ran = run(capfdbinary, "golden", capture, "-o", path, "--force")
    assert (ran.code, ran.out, ran.err) == (0, "", "")
    assert path.read_bytes().decode() == shown
    assert sorted([each.name for each in tmp_path.iterdir()]) == ["a.pcapng", "a.s7.txt"]
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask


def test_a_capture_is_never_overwritten_by_its_golden(capfdbinary: Capture, tmp_path: Path) -> None:
    capture = simple(tmp_path / "a.pcapng")
    before = capture.read_bytes()
    link = tmp_path / "link.pcapng"
    link.symlink_to(capture)
    for out in (capture, link):
        ran = run(capfdbinary, "golden", capture, "-o", out, "--force")
        assert (ran.code, capture.read_bytes()) == (2, before)
        assert f"{out} is both input and output; choose another OUT." in ran.err


def test_what_belongs_to_one_recording_is_kept_when_asked_for(capfdbinary: Capture, tmp_path: Path) -> None:
    capture = simple(tmp_path / "a.pcapng")
    ran = run(capfdbinary, "golden", capture, "--with", "time, latency,addresses,refs")
    assert "  client address 10.0.0.1:49152\n" in ran.out
    assert "  latency 1000000 ns  # 1.00 ms\n" in ran.out
    assert "  reference 0x0003\n" in ran.out
    assert ran.out.count("  at 20") == 4
    refused = run(capfdbinary, "golden", capture, "--with", "times")
    assert refused.code == 2
    assert "expected time, addresses, refs, latency, got 'times'" in refused.err


def test_a_golden_is_written_anew(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "a.s7.txt"
    path.write_text(WRITTEN, encoding="utf-8")
    once = run(capfdbinary, "golden", path)
    assert once.code == 0
    assert "# SZL 0x0424 operating modes" in once.out
    path.write_text(once.out, encoding="utf-8")
    assert run(capfdbinary, "golden", path).out == once.out


def test_files_of_a_ring_are_one_session(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "golden", *halves(tmp_path))
    assert ran.code == 0
    assert ran.out.count("connection ") == 1
    assert ran.out.count("no answer") == 1  # the third read; the second was answered in the other file


def test_scd_stands_in_it(capfdbinary: Capture) -> None:
    ran = run(
        capfdbinary,
        "golden",
        *("--scd", PLANT / "plant.toml", "--bind", PLANT / "plant.bind.toml"),
        PLANT / "plant.pcapng",
    )
    assert ran.code == 0
    assert '  scd "answer   0x6061:0 Режим 1 = 8 (автомат)"\n' in ran.out


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("bad.s7.txt", b"s7dissect golden 1\nnonsense", "bad.s7.txt: line 2: 'nonsense' starts neither"),
        ("old.s7.txt", b"s7dissect golden 9\n", "format '9' is unknown"),
        ("other.txt", b"hello, world, this is a text\n", "other.txt"),
    ],
)
def test_what_cannot_be_read_is_told_in_one_line(
    capfdbinary: Capture, tmp_path: Path, name: str, content: bytes, said: str
) -> None:
    path = tmp_path / name
    path.write_bytes(content)
    ran = run(capfdbinary, "golden", path)
    assert (ran.code, ran.out) == (2, "")
    assert said in ran.err
    assert len(ran.err.splitlines()) == 1


def test_a_place_that_cannot_be_written_leaves_nothing(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "golden", simple(tmp_path / "a.pcapng"), "-o", tmp_path / "missing" / "a.s7.txt")
    assert ran.code == 2
    assert "No such file or directory" in ran.err


def test_damage_is_told_and_what_was_read_is_written(capfdbinary: Capture, tmp_path: Path) -> None:
    path = simple(tmp_path / "a.pcapng")
    path.write_bytes(path.read_bytes()[:-5])
    ran = run(capfdbinary, "golden", path)
    assert ran.code == 3
    assert "no answer: capture_ended" in ran.out
    assert "a.pcapng" in ran.err
