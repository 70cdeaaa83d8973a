"""`s7dissect report`: what it refuses, what it writes, and that nothing is lost by it."""

from __future__ import annotations

import json
import re
import resource
import shlex
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from dissect.output.page import rendering
from tests.cli.support import WITHOUT_CACHE, run, simple
from tests.meaning.report.schemas import ROOT
from tests.meaning.report.support import saved
from tests.output.page.support import command_of, data_of, session_of

Capture = pytest.CaptureFixture[bytes]
OWN = ROOT / "captures"


def test_a_page_is_written_once_unless_forced(capfdbinary: Capture, tmp_path: Path) -> None:
    capture, out = simple(tmp_path / "a.pcapng"), tmp_path / "a.html"
    assert run(capfdbinary, "report", capture, "-o", out) == (0, "", "")
    page = out.read_text(encoding="utf-8")
    assert session_of(page)["name"] == "a.pcapng"
    ran = run(capfdbinary, "report", capture, "-o", out)
    assert (ran.code, "exists; --force overwrites it" in ran.err) == (2, True)
    assert run(capfdbinary, "report", capture, "-o", out, "--force").code == 0
    assert out.read_text(encoding="utf-8") == page
    before = capture.read_bytes()
    ran = run(capfdbinary, "report", capture, "-o", capture, "--force")
    assert (ran.code, "is both input and output" in ran.err) == (2, True)
    assert capture.read_bytes() == before
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.html", "a.pcapng"]


def test_the_page_goes_to_standard_output(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "report", simple(tmp_path / "a.pcapng"), "-o", "-")
    assert ran.code == 0
    assert ran.out.startswith("<!DOCTYPE html>")
    assert ran.out.rstrip().endswith("</html>")


def test_wrong_use_is_told(capfdbinary: Capture, tmp_path: Path) -> None:
    capture = simple(tmp_path / "a.pcapng")
    for words, said in (
        (("-o", tmp_path / "o.html"), "missing FILE (or --diff A B)"),
        ((capture, "--diff", capture, capture, "-o", tmp_path / "o.html"), "give either FILE or --diff A B"),
        (
            ("--diff", capture, "-o", tmp_path / "o.html"),
            f"expected two captures, got {str(capture)!r} and the option '-o'",
        ),
        (("--diff", capture, capture, "-Y", "failed", "-o", tmp_path / "o.html"), "--diff compares whole captures"),
    ):
        ran = run(capfdbinary, "report", *words)
        assert (ran.code, said in ran.err) == (2, True), ran.err
    assert not (tmp_path / "o.html").exists()


def test_a_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    """A limit on the size of files stands for a disk without room."""

    def limited() -> None:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))

    ran = subprocess.run(
        [sys.executable, "-m", "dissect", "report", OWN / "transfer.pcapng", "-o", tmp_path / "out.html"],
        preexec_fn=limited, capture_output=True, text=True, check=False, timeout=60, env=WITHOUT_CACHE,
    )  # fmt: skip
    assert ran.returncode == 5, ran.stderr
    (line,) = ran.stderr.splitlines()
    assert "out.html" in line
    assert not list(tmp_path.iterdir())


def test_what_is_missing_is_named(capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering, "is_installed", lambda: False)
    ran = run(capfdbinary, "report", simple(tmp_path / "a.pcapng"), "-o", tmp_path / "o.html")
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == "Error: reports need jinja2: pip install 's7dissect[report]'\n"


def test_each_row_shows_itself_by_its_command(capfdbinary: Capture, tmp_path: Path) -> None:
    """What a row says to type runs, and shows something."""
    out = tmp_path / "o.html"
    assert run(capfdbinary, "report", OWN / "transfer.pcapng", "-o", out, "--full-paths").code == 0
    session = session_of(out.read_text(encoding="utf-8"))
    tables = {table["name"]: table for table in session["tables"]}
    assert {name for name, table in tables.items() if table["rows"]} >= {
        "slowest",
        "connections",
        "operations",
        "functions",
        "devices",
        "blocks",
    }
    for name, table in tables.items():
        for row in table["rows"][:2]:
            ran = run(capfdbinary, *shlex.split(command_of(session, row))[1:])
            assert ran.code == 0, (name, row, ran.err)
            assert ran.out, (name, row)


def test_files_as_one_capture_name_their_packets(capfdbinary: Capture, tmp_path: Path) -> None:
    one, other = simple(tmp_path / "one.pcapng"), simple(tmp_path / "other.pcapng", 5)
    out = tmp_path / "o.html"
    assert run(capfdbinary, "report", one, other, "-o", out).code == 0
    session = session_of(out.read_text(encoding="utf-8"))
    assert session["name"] == "one.pcapng and 1 more"
    (failed,) = [table for table in session["tables"] if table["name"] == "failed"]
    shown = [command_of(session, row) for row in failed["rows"]]
    assert shown == ["s7dissect show -V --frame 10 one.pcapng", "s7dissect show -V --frame 10 other.pcapng"]


@pytest.mark.parametrize("count", [1, 2])
def test_a_page_names_no_folder_unless_it_is_asked_to(capfdbinary: Capture, tmp_path: Path, count: int) -> None:
    """It is given away: whose folder the capture was in is nobody's business. With the option the path stands there once."""
    folder = tmp_path / "secret-customer"
    folder.mkdir()
    (folder / "names.csv").write_text("name,address,type\nLevel,DB9.DBD0,REAL\n", encoding="utf-8")
    files = [simple(folder / f"{number}.pcapng", 5 * number) for number in range(count)]
    options = ["--tags", f"10.0.0.2={folder / 'names.csv'}"]
    out = tmp_path / "o.html"
    assert run(capfdbinary, "report", *files, "-o", out, *options).code == 0
    page = out.read_text(encoding="utf-8")
    assert "secret-customer" not in page
    command = session_of(page)["command"]
    assert (command["all"], command["options"]) == (
        " ".join([path.name for path in files]), " --tags 10.0.0.2=names.csv",
    )  # fmt: skip
    assert run(capfdbinary, "report", *files, "-o", out, "--full-paths", "--force", *options).code == 0
    command = session_of(out.read_text(encoding="utf-8"))["command"]
    assert json.dumps(command["files"] or command["all"]).count("secret-customer") == count


def test_files_of_one_name_keep_their_folders(capfdbinary: Capture, tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
    files = [simple(tmp_path / name / "x.pcapng") for name in ("a", "b")]
    out = tmp_path / "o.html"
    assert run(capfdbinary, "report", *files, "-o", out).code == 0
    assert session_of(out.read_text(encoding="utf-8"))["command"]["files"] == [str(path) for path in files]


def test_a_selection_says_what_it_is_of(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "o.html"
    assert run(capfdbinary, "report", simple(tmp_path / "a.pcapng"), "-Y", "failed", "-o", out).code == 0
    page = out.read_text(encoding="utf-8")
    assert "selected by failed" in page
    assert sum([sum(one[1:]) for one in session_of(page)["rates"]["bins"]]) == 1


def test_the_command_that_lists_all_lists_what_was_selected(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    simple(tmp_path / "a.pcapng", 8)
    tables: dict[str, Any] = {}
    for options in ((), ("-Y", "pdu_ref > 3 or failed", "--connection", "1")):
        assert run(capfdbinary, "report", "a.pcapng", *options, "-o", "o.html", "--force").code == 0
        session = session_of((tmp_path / "o.html").read_text(encoding="utf-8"))
        tables = {table["name"]: table for table in session["tables"]}
        for name in ("failed", "slowest"):
            command = command_of(session, {"show": tables[name]["all"]})
            ran = run(capfdbinary, *shlex.split(command)[1:], "-T", "jsonl")
            assert (ran.code, len(ran.out.splitlines())) == (0, tables[name]["total"]), command
    assert tables["connections"]["all"] == ""
    assert tables["slowest"]["total"] < 9


def test_two_sessions_and_what_changed(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "o.html"
    ran = run(
        capfdbinary, "report", "--diff", OWN / "nodes7-poll.pcapng", OWN / "nodes7-poll-missing.pcapng", "-o", out
    )
    assert ran == (0, "", "")
    page = out.read_text(encoding="utf-8")
    assert len(data_of(page)["sessions"]) == 2
    assert "<li>transaction 4, READ " in page
    same = tmp_path / "same.html"
    assert run(capfdbinary, "report", "--diff", OWN / "szl.pcapng", OWN / "szl.pcapng", "-o", same).code == 0
    assert "The two sessions request the same" in same.read_text(encoding="utf-8")


def test_a_tag_of_which_nothing_was_seen_is_named(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "o.html"
    capture = simple(tmp_path / "a.pcapng", 5)
    assert run(capfdbinary, "report", capture, "--plot", "DB10.DBW4", "--plot", "DB9.DBD0", "-o", out).code == 0
    tags = session_of(out.read_text(encoding="utf-8"))["tags"]
    assert tags["missing"] == ["DB9.DBD0"]
    (series,) = tags["series"]
    assert series["steps"][0][1] == 1234


def test_a_capture_without_s7_gives_a_report(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "o.html"
    assert run(capfdbinary, "report", saved(tmp_path / "a.pcapng", []), "-o", out).code == 0
    assert "The capture holds no packets." in out.read_text(encoding="utf-8")


def test_a_damaged_capture_says_so_in_the_page(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "o.html"
    ran = run(capfdbinary, "report", OWN / "crafted" / "cut-pcapng.pcapng", "-o", out)
    assert (ran.code, "cut off" in ran.err) == (3, True)
    assert re.search(r"<li>DAMAGED: cut off", out.read_text(encoding="utf-8"))


def test_what_a_row_says_to_type_reads_the_file_as_the_page_did(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without the dictionary a command that selects a message of SCD finds nothing."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "names.csv").write_text("name,address,type\nLevel,DB9.DBD0,REAL\n", encoding="utf-8")
    (tmp_path / "hosts.toml").write_text('[hosts]\n"192.0.2.20" = "Press"\n', encoding="utf-8")
    scd = ["--scd", str(OWN / "scd" / "plant.toml"), "--bind", str(OWN / "scd" / "plant.bind.toml")]
    tags = ["--tags", "192.0.2.20=names.csv"]
    first = ["--config", "hosts.toml", "--checksums"]
    reading = [*first, *scd, *tags]
    assert run(capfdbinary, "report", OWN / "scd" / "plant.pcapng", "-o", "o.html", "--full-paths", *reading).code == 0
    shown = set()
    session = session_of((tmp_path / "o.html").read_text(encoding="utf-8"))
    for table in session["tables"]:
        for row in table["rows"]:
            words = shlex.split(command_of(session, row))
            expected = reading if words[1] not in {"operations", "devices"} else [*first, *tags]
            assert words[-1 - len(expected) : -1] == expected
            if words[1] not in shown or "SCD" in row["show"]:
                ran = run(capfdbinary, *words[1:])
                assert (ran.code, bool(ran.out)) == (0, True), (row, ran.err)
            shown.add(words[1])
    assert shown >= {"transactions", "devices", "show"}


def test_options_that_take_too_much_room_are_named_only(capfdbinary: Capture, tmp_path: Path) -> None:
    tags = []
    for number in range(9):
        path = tmp_path / f"{number}{'long' * 20}.csv"
        path.write_text(f"name,address,type\nLevel{number},DB9.DBD{4 * number},REAL\n", encoding="utf-8")
        tags += ["--tags", str(path)]
    out = tmp_path / "o.html"
    assert run(capfdbinary, "report", OWN / "transfer.pcapng", "-o", out, "--checksums", *tags).code == 0
    session = session_of(out.read_text(encoding="utf-8"))
    (devices,) = [one for one in session["tables"] if one["name"] == "devices"]
    assert command_of(session, devices["rows"][0]).endswith(f"--checksums{' --tags …' * 9} transfer.pcapng")
