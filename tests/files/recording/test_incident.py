"""One incident is exported of the evidence of a ring, and the export proves itself."""

from __future__ import annotations

import errno
import json
import os
import shutil
from collections.abc import Callable
from pathlib import Path
from subprocess import CompletedProcess
from typing import Any

import pytest

import dissect
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Options
from dissect.files.recording import incident, manifest
from dissect.files.recording.manifest import ENDING, Manifest, verified
from dissect.files.session import Run
from dissect.wire.text import Clock
from tests.conftest import ROOT

CLOCK = Clock()
Command = Callable[..., "CompletedProcess[bytes]"]
#: Captures in the order in which they were recorded, and when (2026-11-21T01:31:…).
RECORDED = ["szl", "blocks", "clock", "bsend"]
NAMES = [f"s7dissect_0000{number}_20261121T013120Z.pcapng" for number in range(1, 5)]


def times_of(path: Path) -> tuple[int, int]:
    """Return the time of the first and of the last packet."""
    run = Run([str(path)], Observer(), Options())
    while run.step():
        pass
    return int(run.pipeline.first_ns), int(run.pipeline.now_ns)


def evidence(folder: Path) -> list[str]:
    """Make the evidence of four captures; return the hash of each entry."""
    folder.mkdir()
    kept = Manifest(folder / f"s7dissect{ENDING}")
    kept.add(manifest.BEGIN, CLOCK.iso(0), host="probe")
    heads = [kept.head]
    for recorded, name in zip(RECORDED, NAMES, strict=True):
        shutil.copyfile(ROOT / "captures" / f"{recorded}.pcapng", folder / name)
        first, last = times_of(folder / name)
        kept.add_file(folder / name, CLOCK.iso(last), first=CLOCK.iso(first), last=CLOCK.iso(last))
        heads.append(kept.head)
    kept.add(manifest.END, CLOCK.iso(0))
    return [*heads, kept.head]


def test_an_incident_is_exported_and_proves_itself(tmp_path: Path, s7dissect: Command) -> None:
    heads = evidence(tmp_path / "ring")
    begin, end = times_of(tmp_path / "ring" / NAMES[1])
    out = tmp_path / "out"
    window = f"{CLOCK.iso(begin)}..{CLOCK.iso(end)}"
    done = s7dissect("evidence", "export", tmp_path / "ring", "-o", out, "--time", window)
    assert (done.returncode, done.stdout) == (0, b""), done.stderr
    assert sorted(path.name for path in out.iterdir()) == [
        "incident.html",
        f"incident{ENDING}",
        "incident.pcapng",
        f"s7dissect.part{ENDING}",
        NAMES[1],
    ]
    assert (out / NAMES[1]).read_bytes() == (tmp_path / "ring" / NAMES[1]).read_bytes()
    assert all(path.stat().st_mode & 0o007 == 0 for path in out.iterdir() if path.suffix == ".pcapng")
    # The entries from the first about that file to the end of the chain, so that a hash noted later proves them.
    for head in (heads[2], heads[-1]):
        done = s7dissect("evidence", "verify", out, "--head", head)
        assert done.returncode == 0, done.stdout
    text = done.stdout.decode()
    assert f"{NAMES[1]}: whole" in text
    assert "incident.pcapng: whole" in text
    assert f"part of a chain, behind {heads[1]}; 4 entries, head {heads[-1]}; entries 1 to 4 are those" in text
    assert s7dissect("evidence", "verify", out, "--head", heads[0]).returncode == 1  # that entry is not in the part
    account = json.loads((out / f"incident{ENDING}").read_bytes().splitlines()[0])
    assert (account["from"], account["to"], account["files"]) == (CLOCK.iso(begin), CLOCK.iso(end), [NAMES[1]])
    inside = [
        one for one in dissect.open(str(out / "incident.pcapng"), pdus=False) if isinstance(one, dissect.Transaction)
    ]
    assert len(inside) > 5


def test_an_alert_names_the_time(tmp_path: Path, s7dissect: Command) -> None:
    evidence(tmp_path / "ring")
    begin, _ = times_of(tmp_path / "ring" / NAMES[2])
    alert = tmp_path / "alert.json"
    alert.write_text(json.dumps({"schema": "s7dissect.alert/1", "time": CLOCK.iso(begin), "since": None}))
    done = s7dissect("evidence", "export", tmp_path / "ring", "-o", tmp_path / "one", "--alert", alert, "--around", "0")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "one" / NAMES[2]).exists()
    assert len(list((tmp_path / "one").glob("s7dissect_*"))) == 1
    done = s7dissect(
        "evidence", "export", tmp_path / "ring", "-o", tmp_path / "all", "--alert", alert, "--around", "3600"
    )
    assert len(list((tmp_path / "all").glob("s7dissect_*"))) == 4


@pytest.mark.parametrize("what", ["changed", "missing", "left", "unfinished"])
def test_what_is_not_whole_is_told(what: str, tmp_path: Path, s7dissect: Command) -> None:
    ring = tmp_path / "ring"
    evidence(ring)
    begin, end = times_of(ring / NAMES[1])
    if what == "changed":
        (ring / NAMES[1]).write_bytes((ring / NAMES[1]).read_bytes() + b"\0" * 4)
    elif what == "missing":
        (ring / NAMES[1]).unlink()
    elif what == "left":
        left = ring / "s7dissect_00009_20261121T013120Z.pcapng"
        shutil.copyfile(ring / NAMES[3], left)
        Manifest(ring / f"s7dissect{ENDING}").add_file(left, CLOCK.iso(0), manifest.LEFT)
    else:
        shutil.copyfile(ring / NAMES[3], ring / "s7dissect_00009_20261121T013120Z.pcapng.part")
    out = tmp_path / "out"
    done = s7dissect("evidence", "export", ring, "-o", out, "--time", f"{CLOCK.iso(begin)}..{CLOCK.iso(end)}")
    told = done.stderr.decode()
    if what == "missing":
        assert done.returncode == 2
        assert "no file in a manifest holds that time" in told
        assert not out.exists()
        return
    assert done.returncode == 1
    expected = {"changed": "is changed", "left": "a kill or a power cut left it", "unfinished": "is in no entry"}[what]
    assert expected in told
    account = json.loads((out / f"incident{ENDING}").read_bytes().splitlines()[0])
    assert any(expected in problem for problem in account["problems"])
    assert any(not verdict.well for verdict in verified(out)) == (what != "unfinished")


@pytest.mark.parametrize("how", ["entry", "file", "made", "first"])
def test_a_changed_export_shows(how: str, tmp_path: Path, s7dissect: Command) -> None:
    heads = evidence(tmp_path / "ring")
    begin, end = times_of(tmp_path / "ring" / NAMES[1])
    out = tmp_path / "out"
    s7dissect("evidence", "export", tmp_path / "ring", "-o", out, "--time", f"{CLOCK.iso(begin)}..{CLOCK.iso(end)}")
    part = out / f"s7dissect.part{ENDING}"
    lines = part.read_bytes().splitlines(keepends=True)
    if how == "entry":
        part.write_bytes(b"".join([lines[0], *lines[2:]]))
    elif how == "file":
        (out / NAMES[1]).write_bytes(b"")
    elif how == "made":
        (out / "incident.html").write_text("nothing happened")
    else:
        part.write_bytes(b"".join(lines[1:]))
    assert any(not verdict.well for verdict in verified(out, [heads[-1]]))


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ([], "give either --time or --alert"),
        (["--time", "04:00..05:00"], "give both ends as date and time"),
        (["--time", "2026-11-21..2026-11-22", "--around", "5"], "--around needs --alert"),
        (["--time", "2001-01-01..2001-01-02"], "no file in a manifest holds that time"),
        (["--alert", "no.json"], "No such file"),
        (["--alert", "bad.json"], "invalid alert: it has no time"),
        (["--alert", "deep.json"], "Invalid value for '--alert'"),
    ],
)
def test_wrong_use_is_refused(
    arguments: list[str], told: str, tmp_path: Path, s7dissect: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence(tmp_path / "ring")
    monkeypatch.chdir(tmp_path)
    Path("bad.json").write_text("[1]")
    Path("deep.json").write_text("[" * 100_000)
    done = s7dissect("evidence", "export", "ring", "-o", "out", *arguments)
    assert done.returncode == 2
    assert told in done.stderr.decode()
    assert not Path("out").exists()


def test_a_folder_that_exists_is_left_alone(tmp_path: Path, s7dissect: Command) -> None:
    evidence(tmp_path / "ring")
    (tmp_path / "out").mkdir()
    done = s7dissect(
        "evidence", "export", tmp_path / "ring", "-o", tmp_path / "out", "--time", "2026-11-20..2026-11-22"
    )
    assert done.returncode == 2
    assert b"exists" in done.stderr
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("step", ["copy_into", "account"])
def test_what_fails_halfway_leaves_nothing(
    step: str, tmp_path: Path, s7dissect: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A full disk after the first files were written: no folder that would look like an incident."""
    evidence(tmp_path / "ring")
    whole = getattr(incident, step)

    def full(*given: Any, **named: Any) -> None:
        whole(*given, **named)
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(incident, step, full)
    out = tmp_path / "out"
    done = s7dissect("evidence", "export", tmp_path / "ring", "-o", out, "--time", "2026-11-20..2026-11-22")
    assert done.returncode == 2
    assert b"No space left" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["ring"]


@pytest.mark.parametrize("command", ["cut", "report"])
def test_what_is_interrupted_leaves_nothing(
    command: str, tmp_path: Path, s7dissect: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence(tmp_path / "ring")
    monkeypatch.setattr(f"dissect.cli.{command}.command.main", lambda *_, **__: 130)
    done = s7dissect(
        "evidence", "export", tmp_path / "ring", "-o", tmp_path / "out", "--time", "2026-11-20..2026-11-22"
    )
    assert done.returncode == 130
    assert [path.name for path in tmp_path.iterdir()] == ["ring"]


def test_it_names_what_it_made(tmp_path: Path, s7dissect: Command) -> None:
    evidence(tmp_path / "ring")
    out = tmp_path / "out"
    done = s7dissect("evidence", "export", tmp_path / "ring", "-o", out, "--time", "2026-11-20..2026-11-22")
    assert f"packets written to {out}/incident.pcapng" in done.stderr.decode()


def test_an_alert_that_is_too_long_is_told(tmp_path: Path, s7dissect: Command) -> None:
    evidence(tmp_path / "ring")
    alert = tmp_path / "alert.json"
    alert.write_text(json.dumps({"time": "2026-11-21T01:31:20Z", "text": "x" * (1 << 20)}))
    done = s7dissect("evidence", "export", tmp_path / "ring", "-o", tmp_path / "out", "--alert", alert)
    assert (done.returncode, b"more than 1 MiB" in done.stderr) == (2, True)
