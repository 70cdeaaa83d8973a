"""The manifest of a live run: who writes what and when, over restarts, kills and a full disk."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest

from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.files.recording.manifest import Manifest, verified
from dissect.files.recording.ring_buffer import RingBuffer, RingLimits
from dissect.online.live.evidence import RingCompanion
from dissect.online.live.problems import Problems
from dissect.packets.source.live.reader import Drops
from tests.cli.support import run, simple
from tests.online.live.small_disk import on_a_small_disk
from tests.properties.packets import EPOCH_NS

NONE = Drops(0, 0)


def ring(folder: Path, files: int = 0) -> RingCompanion:
    companion = RingCompanion(RingBuffer(folder, RingLimits(octets=1000, files=files)), about={"host": "probe"})
    companion.begin(Pipeline(Observer()))
    return companion


def put(companion: RingCompanion, count: int) -> None:
    for number in range(count):
        companion.packet(EPOCH_NS + number, bytes(60), 60, 1, "eth0")


def entries(folder: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (folder / "s7dissect.manifest.jsonl").read_bytes().splitlines()]


def test_each_finished_file_has_its_entry(tmp_path: Path) -> None:
    companion = ring(tmp_path, files=2)
    put(companion, 50)
    companion.close()
    found = entries(tmp_path)
    kinds = [str(entry["kind"]) for entry in found]
    assert (kinds[0], kinds[-1]) == ("begin", "end")
    files = [entry for entry in found if entry["kind"] == "file"]
    assert sum([int(str(entry["packets"])) for entry in files]) == 50
    assert kinds.count("removed") == companion.ring.removed > 0
    assert [verdict for verdict in verified(tmp_path) if not verdict.well] == []


def test_a_file_that_the_ring_removed_before_it_is_hashed_keeps_its_entry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On a slow disk the ring is ahead of the hashes; the entries behind such a file are written, too."""
    add_file = Manifest.add_file
    gone: list[str] = []

    def late(kept: Manifest, path: Path, time: str, kind: str = "file", **facts: Any) -> None:
        path.unlink(missing_ok=True)
        gone.append(path.name)
        add_file(kept, path, time, kind, **facts)

    monkeypatch.setattr(Manifest, "add_file", late)
    companion = ring(tmp_path)
    put(companion, 50)
    companion.close()
    found = entries(tmp_path)
    assert (found[0]["kind"], found[-1]["kind"]) == ("begin", "end")
    files = [entry for entry in found if entry["kind"] == "file"]
    assert [entry["name"] for entry in files] == gone
    assert len(gone) > 1
    assert sum([int(str(entry["packets"])) for entry in files]) == 50
    assert not [entry for entry in files if "sha256" in entry]


def test_what_a_kill_left_is_named_at_the_next_start(tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    folder = tmp_path / "kept"
    companion = ring(folder)
    put(companion, 3)
    shutil.copytree(folder, killed)  # as it is now: a file that is being written, in no entry
    companion.close()
    states = [verdict.state for verdict in verified(killed)]
    assert "unfinished, in no entry" in states
    again = ring(killed)
    again.close()
    (left,) = [entry for entry in entries(killed) if entry["kind"] == "left"]
    assert str(left["name"]).endswith(".pcapng.part")
    last = ring(killed)  # once is enough
    last.close()
    assert [entry["kind"] for entry in entries(killed)].count("left") == 1


def test_the_head_is_told(tmp_path: Path) -> None:
    companion = ring(tmp_path)
    problems = companion.problems = Problems()
    told: list[tuple[str, str]] = []
    problems.listen(lambda problem: told.append((problem.kind, problem.text)))
    put(companion, 50)
    companion.close()
    companion.tick(EPOCH_NS + 100, NONE)
    kind, text = told[-1]
    assert kind == "head"
    assert problems.heads == {"s7dissect": text.split()[-1]}
    assert [verdict for verdict in verified(tmp_path, [text.split()[-1]]) if not verdict.well] == []
    assert (problems.take(), problems.counts.get("head", 0)) == ([], 0)


def test_a_full_disk_is_an_entry_as_soon_as_there_is_room(tmp_path: Path) -> None:
    got = on_a_small_disk(
        tmp_path,
        256,
        """
from dissect.engine.observer import Observer
from dissect.engine.pipeline import Pipeline
from dissect.online.live.evidence import RingCompanion
from dissect.files.recording.manifest import Manifest, verified
from dissect.files.recording.ring_buffer import RingBuffer, RingLimits
companion = RingCompanion(RingBuffer(FOLDER, RingLimits(octets=20_000)), CLOCK, {})
companion.problems.listen(companion.problem)
companion.begin(Pipeline(Observer()))

def put(count):
    for number in range(count):
        try:
            companion.packet(TIME + number, octets(number), 100, 1, "eth0")
        except OSError as error:
            assert companion.recover(error)

put(200)
fill()
put(100)
free()
CLOCK.now += 5
put(200)
companion.close()
lines = [json.loads(line) for line in (FOLDER / "s7dissect.manifest.jsonl").read_bytes().splitlines()]
wrong = [verdict.state for verdict in verified(FOLDER) if not verdict.well]
print(json.dumps([[line["kind"] for line in lines], lines[-1], list(companion.lost), wrong]))
""",
    )
    kinds, end, lost, wrong = got
    assert kinds.count("event") == 2
    assert (end["kind"], end["lost"], end["lost_octets"]) == ("end", *lost)
    assert lost[0] > 0
    assert wrong == []


# ---- the commands ---------------------------------------------------------------------------------------------------


def test_evidence_of_a_run_is_verified(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    kept = tmp_path / "kept"
    ran = run(
        capfdbinary,
        "monitor",
        "--plain",
        simple(tmp_path / "a.pcapng", 100),
        "-w",
        kept,
        "-b",
        "filesize:5",
        "--manifest",
    )
    assert ran.code == 0
    begin = entries(kept)[0]
    assert {"program", "host", "command", "source", "filter", "clock", "clock_offset_s"} <= begin.keys()
    ran = run(capfdbinary, "evidence", "verify", kept)
    assert (ran.code, ran.out.count(": whole\n")) == (0, len(list(kept.glob("*.pcapng"))))
    assert "without --head this proves only" in ran.err
    head = ran.out.splitlines()[0].split()[-1]
    ran = run(capfdbinary, "evidence", "verify", kept, "--head", head)
    assert (ran.code, ran.err) == (0, "")
    assert run(capfdbinary, "evidence", "verify", kept, "--head", "0" * 64).code == 1
    file = next(iter(sorted(kept.glob("*.pcapng"))))
    file.write_bytes(file.read_bytes() + b"x")
    ran = run(capfdbinary, "evidence", "verify", kept, "--head", head)
    assert (ran.code, f"{file.name}: changed" in ran.out) == (1, True)


def test_no_manifest_is_wrong_use(capfdbinary: pytest.CaptureFixture[bytes], tmp_path: Path) -> None:
    ran = run(capfdbinary, "evidence", "verify", tmp_path)
    assert (ran.code, "no manifest" in ran.err) == (2, True)
    assert run(capfdbinary, "evidence", "verify", tmp_path / "none").code == 2
    ran = run(capfdbinary, "monitor", simple(tmp_path / "a.pcapng"), "--manifest")
    assert (ran.code, "--manifest needs -w" in ran.err) == (2, True)
