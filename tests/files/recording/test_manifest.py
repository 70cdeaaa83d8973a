"""The manifest: what is changed, removed, cut off, reordered or written anew shows, up to the entry whose hash is known."""

from __future__ import annotations

import hashlib
import json
import os
from pathlib import Path

import pytest

from dissect.files.recording import manifest
from dissect.files.recording.manifest import ENDING, Manifest, hash_of, masked, verified
from dissect.wire.text import Clock

NAMES = [f"s7dissect_0000{number}_20231114T221320Z.pcapng" for number in range(1, 5)]
TIME = Clock().iso(1_700_000_000_000_000_000)


def made(folder: Path) -> tuple[Path, list[str]]:
    """Make a folder with four files and their manifest; return the manifest and the hash of each entry."""
    path = folder / f"s7dissect{ENDING}"
    kept = Manifest(path)
    heads = []
    kept.add(manifest.BEGIN, TIME, host="probe")
    heads.append(kept.head)
    for number, name in enumerate(NAMES):
        (folder / name).write_bytes(bytes([number]) * 100)
        kept.add_file(folder / name, TIME, packets=number)
        heads.append(kept.head)
    kept.add(manifest.END, TIME)
    heads.append(kept.head)
    return path, heads


def said(folder: Path, *heads: str) -> dict[str, str]:
    return {verdict.name: verdict.state for verdict in verified(folder, heads) if not verdict.well}


@pytest.mark.skipif(os.name == "nt", reason="Windows removes no file that is open")
def test_a_file_that_is_removed_while_it_is_hashed_has_its_hash(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, path = b"octets of a ring" * 100, tmp_path / NAMES[0]
    path.write_bytes(whole)
    kept = Manifest(tmp_path / f"s7dissect{ENDING}")
    sync = os.fsync

    def removing(descriptor: int) -> None:
        sync(descriptor)
        path.unlink(missing_ok=True)

    monkeypatch.setattr("os.fsync", removing)
    kept.add_file(path, TIME)
    (entry,) = [json.loads(line) for line in kept.path.read_bytes().splitlines()]
    assert not path.exists()
    assert (entry["sha256"], entry["octets"]) == (hashlib.sha256(whole).hexdigest(), len(whole))


def test_all_is_whole(tmp_path: Path) -> None:
    path, heads = made(tmp_path)
    assert said(tmp_path, *heads) == {}
    told = {verdict.name: verdict.state for verdict in verified(tmp_path, [heads[3].upper()])}
    assert told == {
        path.name: f"6 entries, head {heads[-1]}; entries 1 to 4 are those whose hash is known",
        **dict.fromkeys(NAMES, "whole"),
    }


@pytest.mark.parametrize("how", ["octet", "shorter", "longer", "empty", "link"])
def test_a_changed_file(how: str, tmp_path: Path) -> None:
    made(tmp_path)
    path = tmp_path / NAMES[1]
    octets = path.read_bytes()
    if how == "link":
        path.rename(tmp_path / "moved")
        path.symlink_to(tmp_path / "moved")
        assert said(tmp_path) == {NAMES[1]: "missing"}
        return
    path.write_bytes({"octet": b"x" + octets[1:], "shorter": octets[:-1], "longer": octets + b"x"}.get(how, b""))
    assert said(tmp_path) == {NAMES[1]: "changed"}


def test_a_deleted_file_and_one_that_the_ring_removed(tmp_path: Path) -> None:
    path, _ = made(tmp_path)
    Manifest(path).add(manifest.REMOVED, TIME, name=NAMES[0])
    (tmp_path / NAMES[0]).unlink()
    (tmp_path / NAMES[2]).unlink()
    assert said(tmp_path) == {NAMES[2]: "missing"}
    assert "removed by the ring" in [verdict.state for verdict in verified(tmp_path)]


def test_files_in_no_entry(tmp_path: Path) -> None:
    made(tmp_path)
    (tmp_path / "other.pcapng").write_bytes(b"x")
    (tmp_path / "s7dissect_00009_20231114T221320Z.pcapng.part").write_bytes(b"x")
    assert said(tmp_path) == {
        "other.pcapng": "in no entry",
        "s7dissect_00009_20231114T221320Z.pcapng.part": "unfinished, in no entry",
    }


def test_what_is_done_to_the_chain(tmp_path: Path) -> None:
    path, heads = made(tmp_path)
    lines = path.read_bytes().splitlines()
    gone = "is the hash of no entry: entries were changed or removed since it was noted"
    # cut off at the end, with its files: only the head shows it
    path.write_bytes(b"\n".join(lines[:4]) + b"\n")
    for name in NAMES[3:]:
        (tmp_path / name).rename(tmp_path / f"{name}.gone")
    assert said(tmp_path) == {}
    assert said(tmp_path, heads[-1]) == {heads[-1]: gone}
    for name in NAMES[3:]:
        (tmp_path / f"{name}.gone").rename(tmp_path / name)
    # an entry left out, two exchanged, one changed: the chain breaks
    broken = "does not follow the entry before it: the chain is broken"
    for wrong in (
        [*lines[:2], *lines[3:]],
        [lines[0], lines[2], lines[1], *lines[3:]],
        [*lines[:2], lines[2].replace(b'"packets": 1', b'"packets": 9'), *lines[3:]],
        lines[1:],
    ):
        path.write_bytes(b"\n".join(wrong) + b"\n")
        assert broken in said(tmp_path).values()
    # a chain that was written anew fits together, and its head is another one
    path.unlink()
    (tmp_path / NAMES[1]).write_bytes(b"forged")
    again = Manifest(path)
    for name in NAMES:
        again.add_file(tmp_path / name, TIME)
    assert said(tmp_path) == {}
    assert said(tmp_path, heads[-1]) == {heads[-1]: gone}


@pytest.mark.parametrize("kept", [1, 20, -1])
def test_a_line_that_a_kill_cut_is_named_and_chained(kept: int, tmp_path: Path) -> None:
    path, _ = made(tmp_path)
    lines = path.read_bytes().splitlines()
    path.write_bytes(b"\n".join([*lines[:-1], lines[-1][:kept]]))
    assert said(tmp_path) == {f"{path.name}:6": "was cut off by a kill"}
    again = Manifest(path)
    again.add(manifest.BEGIN, TIME)
    again.add(manifest.END, TIME)
    assert said(tmp_path) == {f"{path.name}:6": "was cut off by a kill"}
    assert again.entries == 8
    (tmp_path / path.name).write_bytes(path.read_bytes().replace(lines[-1][:kept] + b"\n{", b"x\n{"))
    assert "does not follow the entry before it: the chain is broken" in said(tmp_path).values()


def test_what_a_kill_left_is_never_called_whole(tmp_path: Path) -> None:
    path, _ = made(tmp_path)
    left = tmp_path / "s7dissect_00005_20231114T221320Z.pcapng.part"
    left.write_bytes(b"half")
    Manifest(path).add_file(left, TIME, manifest.LEFT)
    assert said(tmp_path)[left.name].startswith("whole since it was found: a kill or a power cut left it")
    left.write_bytes(b"more")
    assert said(tmp_path)[left.name] == "changed"


@pytest.mark.parametrize("line", [b"[" * 60_000, b"\xff", b"1", b'{"name": 5}', b'{"name": "../x", "kind": "file"}'])
def test_a_hostile_manifest(line: bytes, tmp_path: Path) -> None:
    (tmp_path / f"x{ENDING}").write_bytes(line + b"\n" + line + b"\n")
    assert said(tmp_path) != {}


def test_an_entry_is_the_hash_of_the_line_before(tmp_path: Path) -> None:
    path, heads = made(tmp_path)
    lines = path.read_bytes().splitlines()
    assert [hash_of(line) for line in lines] == heads
    assert [json.loads(line)["previous"] for line in lines[1:]] == heads[:-1]


def test_a_command_line_is_kept_without_its_secrets() -> None:
    words = [
        "s7dissect",
        "-i",
        "eth0",
        "--token",
        "abc",
        "--password=x",
        "http://u:p@h/x?token=abc",
        "-b",
        "files:3",
    ]
    assert masked(words) == [
        "s7dissect", "-i", "eth0", "--token", "…", "--password=…", "http://…h/x?…", "-b", "files:3",
    ]  # fmt: skip
