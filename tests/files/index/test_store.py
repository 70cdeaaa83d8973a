"""The catalogue on disk: what is put in comes out, and what happens when the file is not ours, locked or old."""

from __future__ import annotations

import errno
import os
import sqlite3
import threading
from pathlib import Path
from typing import Any

import pytest

from dissect.files.index.facts import FileFacts, filled, watched
from dissect.files.index.store import Store, StoreError
from dissect.files.index.update import captures, is_capture, update
from tests.cases import each

CAPTURE = Path(__file__).resolve().parents[3] / "captures" / "item-errors.pcapng"


def some(name: str = "a.pcap", first_ns: int = 5) -> FileFacts:
    return FileFacts(
        name, 100, 7, 3, first_ns, 9, 2, 1, 4, 1, 2,
        {"transaction.slow": 2}, frozenset({(b"\x0a\0\0\x01", 5, bytes(16), 102)}), False, "cut",
    )  # fmt: skip


def test_what_is_put_in_comes_out_in_the_order_of_time(tmp_path: Path) -> None:
    later, sooner = some("a.pcap", 8), some("b.pcap", 5)
    with Store(tmp_path / "index", "1") as store:
        store.write([later])
        store.write([sooner])
    with Store(tmp_path / "index", "1") as store:
        assert list(store.files()) == [sooner, later]
        assert store.known() == {"a.pcap": (100, 7), "b.pcap": (100, 7)}
        again = some("a.pcap", 1)
        again.pairs = frozenset()
        store.write([again])
        assert list(store.files()) == [again, sooner]
        store.write(["b.pcap"])
        assert list(store.files()) == [again]
    with sqlite3.connect(tmp_path / "index") as base:
        assert base.execute("SELECT (SELECT count(*) FROM pairs), (SELECT count(*) FROM findings)").fetchone() == (0, 1)


def test_an_index_of_another_version_is_made_anew(tmp_path: Path) -> None:
    with Store(tmp_path / "index", "1") as store:
        store.write([some()])
    with Store(tmp_path / "index", "2") as store:
        assert list(store.files()) == []
        store.write([some()])
    with Store(tmp_path / "index", "2") as store:
        assert list(store.files()) == [some()]


def test_a_file_that_is_no_index_stays_as_it_is(tmp_path: Path) -> None:
    other = tmp_path / "other"
    with sqlite3.connect(other) as base:
        base.execute("CREATE TABLE mine (a)")
    text = tmp_path / "text"
    text.write_bytes(b"this is no database at all\n" * 100)
    for path, what in ((other, "another program"), (text, "not an index of s7dissect")):
        before = path.read_bytes()
        with pytest.raises(StoreError, match=f"{what}.*--file"), Store(path, "1"):
            pass
        assert path.read_bytes() == before


def test_an_index_that_another_process_writes_is_waited_for_and_then_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("dissect.files.index.store._PATIENCE", 0.05)
    with Store(tmp_path / "index", "1") as store:
        holder = sqlite3.connect(tmp_path / "index", isolation_level=None)
        holder.execute("BEGIN EXCLUSIVE")
        with pytest.raises(StoreError, match="written by another process"):
            store.write([some()])
        holder.close()
        store.write([some()])
        assert list(store.files()) == [some()]


def test_two_that_begin_an_index_at_the_same_time_both_have_it(tmp_path: Path) -> None:
    with Store(tmp_path / "other", "1") as store:
        store.write([some()])
    made = (tmp_path / "other").read_bytes()
    path = tmp_path / "index"
    holder = sqlite3.connect(path, check_same_thread=False, isolation_level=None)
    holder.execute("BEGIN IMMEDIATE")
    with sqlite3.connect(tmp_path / "other") as base:
        for statement in base.iterdump():
            if statement not in {"BEGIN TRANSACTION;", "COMMIT;"}:
                holder.execute(statement)
    base.close()
    holder.execute(f"PRAGMA application_id = {int.from_bytes(made[68:72], 'big')}")
    done = threading.Timer(0.3, holder.execute, ("COMMIT",))
    done.start()
    with Store(path, "1") as store:  # sees no tables, and has to wait until they are there
        assert list(store.files()) == [some()]
    done.join()
    holder.close()


def test_what_is_wrong_with_an_index_that_is_only_read(tmp_path: Path) -> None:
    with Store(tmp_path / "index", "1") as store:
        store.write([some()])
    octets = (tmp_path / "index").read_bytes()
    (tmp_path / "cut").write_bytes(octets[: len(octets) // 2])
    with (
        pytest.raises(StoreError, match=r"cut is damaged: remove it, `s7dissect index` makes it again$"),
        Store(tmp_path / "cut", "1", changes=False) as store,
    ):
        list(store.files())
    with pytest.raises(StoreError, match=r"none cannot be read$"), Store(tmp_path / "none", "1", changes=False):
        pass


def test_a_full_disk_and_a_place_that_is_not_there_are_told(tmp_path: Path) -> None:
    with Store(tmp_path / "index", "1") as store:
        pages = store._base.execute("PRAGMA page_count").fetchone()[0]
        store._base.execute(f"PRAGMA max_page_count = {pages}")
        big = some()
        big.pairs = frozenset([(number.to_bytes(4, "big"), 1, b"\0\0\0\0", 102) for number in range(5000)])
        with pytest.raises(StoreError) as told:
            store.write([big])
        assert told.value.full == errno.ENOSPC
        assert list(store.files()) == []
    with pytest.raises(StoreError, match="cannot be written: choose another place"), Store(tmp_path / "no" / "x", "1"):
        pass


@each(
    ("name", "wanted"),
    [
        ("a.pcap", True), ("A.PCAPNG", True), ("a.cap", True), ("a.pcap.gz", True), ("a.pcapng.zst", True),
        ("ring.pcap12", True), ("a.txt", False), ("pcap", False), ("a.pcap.txt", False), ("a.gz", False),
    ],
)  # fmt: skip
def test_names_of_captures(name: str, wanted: bool) -> None:
    assert is_capture(name) is wanted


def test_only_what_is_new_or_changed_is_read(tmp_path: Path) -> None:
    folder = tmp_path / "ring"
    (folder / "old").mkdir(parents=True)
    for name in ("b.pcapng", "old/a.pcapng", ".hidden.pcapng"):
        (folder / name).write_bytes(CAPTURE.read_bytes())
    (folder / "readme.txt").write_text("no capture")
    (folder / "loop").symlink_to(folder)
    assert list(captures(folder)) == ["b.pcapng", "old/a.pcapng"]
    asked: list[str] = []

    def read(path: str, facts: FileFacts) -> FileFacts | str | None:
        asked.append(facts.name)
        run, seen = watched(path)
        while run.step():
            pass
        return filled(facts, run, seen)

    with Store(tmp_path / "index", "1") as store:
        assert update(store, folder, read).read == ["b.pcapng", "old/a.pcapng"] == asked
        changes = update(store, folder, read)
        assert (changes.read, changes.unchanged, changes.gone) == ([], 2, [])
        os.utime(folder / "b.pcapng", ns=(1, 1))
        (folder / "old" / "a.pcapng").unlink()
        changes = update(store, folder, read)
        assert (changes.read, changes.unchanged, changes.gone) == (["b.pcapng"], 0, ["old/a.pcapng"])
        assert len(asked) == 3
        assert [facts.name for facts in store.files()] == ["b.pcapng"]


def test_what_cannot_be_read_is_told_and_what_is_broken_off_is_read_the_next_time(tmp_path: Path) -> None:
    for name in ("a.pcap", "b.pcap", "c.pcap"):
        (tmp_path / name).write_bytes(b"x")
    answers: dict[str, FileFacts | str | None] = {"a.pcap": "not a capture", "b.pcap": some("b.pcap"), "c.pcap": None}
    with Store(tmp_path / "index", "1") as store:
        changes = update(store, tmp_path, lambda _path, facts: answers[facts.name])
        assert (changes.unreadable, changes.read, changes.whole) == ({"a.pcap": "not a capture"}, ["b.pcap"], False)
        assert list(store.known()) == ["b.pcap"]


def test_what_a_disk_or_server_broke_off_is_read_again(tmp_path: Path) -> None:
    """What was not read may hold anything: the index must not know the file."""
    (tmp_path / "a.pcap").write_bytes(b"x")

    def broken(_: str, facts: FileFacts) -> FileFacts:
        facts.damage = (
            "reading failed after byte 4096: Input/output error; the capture that could be read ends at byte 4096"
        )
        return facts

    with Store(tmp_path / "index", "1") as store:
        for _ in range(2):
            changes = update(store, tmp_path, broken)
            assert (changes.read, changes.unchanged, changes.damaged) == ([], 0, {})
            assert changes.unreadable["a.pcap"].startswith("reading failed after byte 4096: Input/output error")
            assert store.known() == {}
        assert update(store, tmp_path, lambda _, facts: facts).read == ["a.pcap"]


def test_a_name_may_be_of_any_bytes(tmp_path: Path) -> None:
    name = os.fsdecode(b"m\xfcnchen.pcap")
    with Store(tmp_path / "index", "1") as store:
        store.write([some(name)])
        store.write([some("z\u00fc.pcap")])
    with Store(tmp_path / "index", "1") as store:
        assert list(store.files()) == [some(name), some("z\u00fc.pcap")] or os.name == "nt"
        assert store.known() == {name: (100, 7), "z\u00fc.pcap": (100, 7)}
        store.write([some(name)])
        store.write([name])
        assert list(store.known()) == ["z\u00fc.pcap"]


def test_what_is_in_a_folder_that_cannot_be_read_is_not_gone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("a.pcap", "closed/b.pcap", "closed/deep/c.pcap", "open/shut/d.pcap", "open/e.pcap"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(b"x")
    scandir = os.scandir

    def refused(folder: Path) -> Any:
        if folder.name in {"closed", "shut"}:
            raise PermissionError(errno.EACCES, "Permission denied")
        return scandir(folder)

    with Store(tmp_path / ".index", "1") as store:
        assert len(update(store, tmp_path, lambda _path, facts: facts).read) == 5
        (tmp_path / "open" / "e.pcap").unlink()
        monkeypatch.setattr(os, "scandir", refused)
        changes = update(store, tmp_path, lambda _path, facts: facts)
        assert changes.unreadable == {"closed/": "Permission denied", "open/shut/": "Permission denied"}
        assert (changes.gone, changes.unchanged) == (["open/e.pcap"], 1)
        assert sorted(store.known()) == ["a.pcap", "closed/b.pcap", "closed/deep/c.pcap", "open/shut/d.pcap"]
        monkeypatch.undo()
        assert update(store, tmp_path, lambda _path, facts: facts).unchanged == 4
