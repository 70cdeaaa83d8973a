"""`s7dissect blocks`: the list, files, comparison, selection, names, and what is refused."""

from __future__ import annotations

import csv
import json
import os
from pathlib import Path
from typing import Final

import pytest

import dissect
from captures.craft.mc7 import DB2, OB1, OB1_CHANGED
from tests.cli.support import run, simple
from tests.meaning.report.schemas import ROOT

Capture = pytest.CaptureFixture[bytes]
PROGRAM: Final = ROOT / "captures" / "crafted" / "program.pcapng"
TRANSFER: Final = ROOT / "captures" / "transfer.pcapng"
TAGS: Final = ("--tags", ROOT / "captures" / "tags" / "valve.csv")


def test_a_line_for_each_block(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "blocks", PROGRAM)
    lines = ran.out.splitlines()
    assert ran.code == 0
    assert next(line.split("  ")[3:] for line in lines)[-1].startswith(
        "author meier, family plant, version 1.2, code 2023-09-13"
    )
    assert [" activated by packet 32" in line for line in lines] == [False, False, True, False, False, False]
    assert "FC3 (AWL/STL)  96 bytes  complete, not activated" in lines[3]
    assert "DB2 (DB)  90 bytes  INCOMPLETE: 90 of 130 bytes" in lines[5]


def test_the_values_of_a_block_by_tags(capfdbinary: Capture) -> None:
    out = run(capfdbinary, "blocks", PROGRAM, *TAGS).out
    assert "    Valve.pressure = 12.5 bar (DB2.DBD16)\n" in out
    told = json.loads(run(capfdbinary, "blocks", PROGRAM, *TAGS, "-T", "json").out)
    values = {value["name"]: value["value"] for value in told["blocks"][1]["values"] if value["name"]}
    assert values == {
        "Valve.open": True, "Valve.position": 42, "Valve.cycles": 1001, "Valve.balance": -0.2, "Valve.pressure": 12.5,
        "Valve.name": "V-3",
    }  # fmt: skip
    assert "values" not in told["blocks"][0]


def test_a_row_for_each_block(capfdbinary: Capture) -> None:
    rows = list(csv.DictReader(run(capfdbinary, "blocks", PROGRAM, "-T", "csv").out.splitlines()))
    assert [(row["type"], row["number"], row["octets"], row["activated"]) for row in rows] == [
        ("OB", "1", "140", ""), ("DB", "2", "130", ""), ("OB", "1", "160", "true"), ("FC", "3", "96", "false"),
        ("OB", "1", "160", ""), ("DB", "2", "90", ""),
    ]  # fmt: skip


def test_selection(capfdbinary: Capture) -> None:
    out = run(capfdbinary, "blocks", PROGRAM, "-Y", "kind == download").out
    assert [line.split("  ")[-4].split()[0] for line in out.splitlines()] == ["OB1", "FC3"]
    assert len(dissect.blocks(PROGRAM, where="kind == download")) == 2
    ran = run(capfdbinary, "blocks", PROGRAM, "--connection", "9")
    assert (ran.code, ran.out, ran.err) == (2, "", "s7dissect: no connection 9; the capture has 1\n")
    ran = run(capfdbinary, "blocks", PROGRAM, "-Y", "kind == bsend")
    assert (ran.code, ran.out, ran.err) == (0, "", "s7dissect: no block matches kind == bsend\n")


def test_several_files_are_named(capfdbinary: Capture) -> None:
    out = run(capfdbinary, "blocks", PROGRAM, TRANSFER).out
    assert f"{TRANSFER}:10→15" in out
    told = json.loads(run(capfdbinary, "blocks", PROGRAM, TRANSFER, "-T", "json").out)
    assert {block["first_file"] for block in told["blocks"]} == {str(PROGRAM), str(TRANSFER)}


def test_files_and_manifest(capfdbinary: Capture, tmp_path: Path) -> None:
    folder = tmp_path / "blocks"
    ran = run(capfdbinary, "blocks", PROGRAM, "-o", folder, *TAGS)
    assert ran.code == 0
    assert (folder / "0001-OB1-upload.mc7").read_bytes() == OB1
    assert (folder / "0002-DB2-upload.mc7").read_bytes() == DB2
    assert (folder / "0003-OB1-download.mc7").read_bytes() == OB1_CHANGED
    manifest = json.loads((folder / "manifest.json").read_text(encoding="ascii"))
    listed = json.loads(run(capfdbinary, "blocks", PROGRAM, "-T", "json", *TAGS).out)
    files = [block.pop("file") for block in manifest["blocks"]]
    assert manifest == listed
    assert sorted([*files, "manifest.json"]) == sorted(path.name for path in folder.iterdir())
    told = run(capfdbinary, "blocks", folder).out
    assert told.splitlines()[0].startswith("OB1 (AWL/STL)  140 bytes  complete  author meier")
    assert run(capfdbinary, "blocks", folder / "0001-OB1-upload.mc7").out.startswith("OB1 (AWL/STL)  140 bytes")


def test_nothing_is_overwritten(capfdbinary: Capture, tmp_path: Path) -> None:
    kept = tmp_path / "0001-OB1-upload.mc7"
    kept.write_bytes(b"mine")
    ran = run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err.endswith(f"{kept} exists; --force overwrites it.\n")
    assert kept.read_bytes() == b"mine"
    assert list(tmp_path.iterdir()) == [kept]
    assert run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path, "--force").code == 0
    assert kept.read_bytes() == OB1
    assert "manifest.json exists" in run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path).err
    ran = run(capfdbinary, "blocks", PROGRAM, "-o", kept)
    assert (ran.code, "is not a folder" in ran.err) == (2, True)


def test_wrong_use(capfdbinary: Capture, tmp_path: Path) -> None:
    for arguments, why in (
        ((PROGRAM, "--force"), "--force needs -o DIR"),
        (("--diff", PROGRAM, "-o", tmp_path / "x"), "cannot be combined"),
        (("--diff", PROGRAM, PROGRAM, PROGRAM), "--diff takes A and B"),
        ((tmp_path,), "no block in this folder"),
    ):
        ran = run(capfdbinary, "blocks", *arguments)
        assert (ran.code, why in ran.err) == (2, True), ran
    run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path)
    assert "is not a capture" in run(capfdbinary, "blocks", tmp_path, "-Y", "kind == upload").err


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_disk_that_is_full(capfdbinary: Capture, tmp_path: Path) -> None:
    (tmp_path / "0001-OB1-upload.mc7").symlink_to("/dev/full")
    ran = run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path, "--force")
    assert (ran.code, ran.out) == (5, "")
    assert "No space left on device" in ran.err
    assert not (tmp_path / "manifest.json").exists()


@pytest.mark.skipif(os.geteuid() == 0 if hasattr(os, "geteuid") else True, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written(capfdbinary: Capture, tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    ran = run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path / "x")
    assert ran.code in {2, 5}
    assert "Permission denied" in ran.err


def test_what_changed(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "blocks", "--diff", PROGRAM)
    assert ran.code == 1
    assert ran.out.splitlines()[0] == "changed  OB1 (AWL/STL): code, header"
    assert "    OB1 time: code 2023-09-13 08:30:00.000 → 2023-11-14 08:30:00.000" in ran.out.splitlines()
    assert run(capfdbinary, "blocks", "--diff", PROGRAM, PROGRAM).code == 0
    run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path)
    assert run(capfdbinary, "blocks", "--diff", tmp_path, PROGRAM).out == ""
    first = tmp_path / "0001-OB1-upload.mc7"
    told = json.loads(run(capfdbinary, "blocks", "--diff", first, PROGRAM, "-T", "json").out)
    assert [(change["state"], change["label"]) for change in told["changes"]] == [
        ("changed", "OB1"), ("new", "DB2"), ("new", "FC3"),
    ]  # fmt: skip
    rows = list(csv.DictReader(run(capfdbinary, "blocks", "--diff", first, PROGRAM, "-T", "csv").out.splitlines()))
    assert next((row["state"], row["type"], row["parts"]) for row in rows) == ("changed", "OB", "code, header")


def test_a_comparison_that_finds_nothing_says_of_what(capfdbinary: Capture, tmp_path: Path) -> None:
    """Two captures without a block are alike, too, and nobody wants to hear that for an answer."""
    without = simple(tmp_path / "a.pcapng")
    assert run(capfdbinary, "blocks", "--diff", PROGRAM, PROGRAM) == (0, "", "s7dissect: no differences in 3 blocks\n")
    none = f"s7dissect: {without}: no block was downloaded or uploaded\n"
    assert run(capfdbinary, "blocks", "--diff", without, without) == (0, "", none * 2)
    assert run(capfdbinary, "blocks", "--diff", without) == (0, "", none)
    ran = run(capfdbinary, "blocks", "--diff", PROGRAM, without)
    assert (ran.code, ran.err, "gone" in ran.out) == (1, none, True)
    cut = tmp_path / "cut.pcapng"
    run(capfdbinary, "cut", PROGRAM, "-o", cut, "-Y", "frame < 20")
    assert run(capfdbinary, "blocks", "--diff", cut).err == (
        "s7dissect: no differences between the versions of 2 blocks; 2 versions are incomplete, compared as far as possible\n"
    )
    assert "; 4 versions are incomplete" in run(capfdbinary, "blocks", "--diff", cut, cut).err


def test_a_damaged_capture_is_told(capfdbinary: Capture, tmp_path: Path) -> None:
    cut = tmp_path / "cut.pcapng"
    cut.write_bytes(PROGRAM.read_bytes()[:-500])
    ran = run(capfdbinary, "blocks", cut)
    assert (ran.code, "cut.pcapng" in ran.err) == (3, True)
    assert run(capfdbinary, "blocks", "--diff", PROGRAM, cut).code == 2


def test_code_and_references(capfdbinary: Capture, tmp_path: Path) -> None:
    stl = run(capfdbinary, "blocks", "--code", PROGRAM, "-Y", "kind == download")
    assert (stl.code, "       JCN   M2_1" in stl.out.splitlines()) == (0, True)
    for words in (("--code", "AWL", PROGRAM), (PROGRAM, "--code", "awl")):
        assert "       SPBN  M2_1" in run(capfdbinary, "blocks", *words).out.splitlines()
    assert run(capfdbinary, "blocks", PROGRAM, "--code").out.startswith("2023-11-14 22:13:20.003500 UTC  8→21")
    rows = list(csv.DictReader(run(capfdbinary, "blocks", "--code", PROGRAM, "-T", "csv").out.splitlines()))
    assert ("OB1", "3", "UC", "SFC 46 ()") in {
        (row["block"], row["network"], row["name"], row["operand"]) for row in rows
    }
    told = run(capfdbinary, "blocks", "--references", PROGRAM).out
    assert told.splitlines()[0] == "192.0.2.20"
    assert "  Q 4.0                    write: OB1 network 1" in told.splitlines()
    run(capfdbinary, "blocks", PROGRAM, "-o", tmp_path)
    assert (
        "       JCN   M2_1" in run(capfdbinary, "blocks", "--code", tmp_path / "0001-OB1-upload.mc7").out.splitlines()
    )
    for option in ("--code", "--diff"):
        ran = run(capfdbinary, "blocks", option, PROGRAM, "--references")
        assert (ran.code, "cannot be combined" in ran.err) == (2, True)


def test_a_change_in_the_words_of_the_code(capfdbinary: Capture) -> None:
    assert "    OB1 network 1: L S5T#35S → S5T#10S" in run(capfdbinary, "blocks", "--diff", PROGRAM).out.splitlines()
    german = run(capfdbinary, "blocks", "--diff", "--code", "AWL", PROGRAM)
    assert (german.code, "    OB1 network 1: L S5T#35S → S5T#10S" in german.out.splitlines()) == (1, True)


def test_a_page_of_the_comparison(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "blocks", "--diff", PROGRAM, "-T", "html")
    assert ran.code == 1
    assert (
        '<tr><td>network 1</td><td class="was">L S5T#35S</td><td class="now">L S5T#10S</td></tr>'
        in ran.out.splitlines()
    )
    assert "default-src 'none'" in ran.out
    evil = tmp_path / "evil.mc7"
    evil.write_bytes(OB1[:-36] + b"<script>" + OB1[-28:])
    ran = run(capfdbinary, "blocks", "--diff", tmp_path / "evil.mc7", PROGRAM, "-T", "html")
    assert "&lt;script&gt;" in ran.out
    assert "<script" not in ran.out
    ran = run(capfdbinary, "blocks", evil, "-T", "html")
    assert ran.out.startswith("<!DOCTYPE html>")
    assert "author &lt;script&gt;" in ran.out
    assert "No differences" in run(capfdbinary, "blocks", "--diff", PROGRAM, PROGRAM, "-T", "html").out


def test_without_a_block_no_folder_is_made(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    out = tmp_path / "blocks"
    for _ in range(2):
        ran = run(capfdbinary, "blocks", simple(tmp_path / "a.pcapng"), "-o", out)
        assert (ran.code, out.exists()) == (0, False)
        assert "no block was downloaded or uploaded" in ran.err
