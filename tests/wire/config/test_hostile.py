"""Content that was made to harm: one kind of error, in good time."""

from __future__ import annotations

import gzip
import random
import time
from pathlib import Path
from typing import Any

import pytest

from dissect.cli.main import EXIT_OK
from dissect.files.index.store import Store
from dissect.protocols.tls import key_log
from dissect.protocols.tls.key_log import KeyLog
from dissect.wire.config.hostile import ContentError, check_code_page, read_json, read_toml
from tests.cli.support import run, simple
from tests.growth import assert_growth

Capture = pytest.CaptureFixture[bytes]

HARM = [
    "[" * 100_000,
    '{"a":' * 100_000,
    "9" * 10_000,
    '"\\ud800',
    "",
    "\0",
]


@pytest.mark.parametrize("text", HARM, ids=range(len(HARM)))
def test_json_has_one_kind_of_error(text: str) -> None:
    for content in (text, text.encode("utf-8", "surrogatepass"), b"\xff\xfe" + text.encode("utf-8")):
        with pytest.raises(ContentError):
            read_json(content)


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("a = " + "[" * 100_000, 0),
        ("\na = " + "9" * 10_000, 2),
        ("\n\n" + "a." * 32_000 + "b = 1", 3),
        ("x = {" + "a." * 40 + "b = 1}", 1),
        ("a = 1\na = 2", 2),
        ("[" * 70, 1),
    ],
    ids=range(6),
)
def test_toml_has_one_kind_of_error(text: str, line: int) -> None:
    with pytest.raises(ContentError) as told:
        read_toml(text)
    assert told.value.line == line


@pytest.mark.parametrize(
    "name",
    [
        "rot13",
        "rot_13",
        "base64",
        "hex",
        "zlib",
        "bz2",
        "uu",
        "quopri",
        "undefined",
        "idna",
        "punycode",
        "x",
        "\0",
        "é",
    ],
)
def test_what_is_no_code_page(name: str, capfdbinary: Capture, tmp_path: Path) -> None:
    with pytest.raises(ContentError):
        check_code_page(name)
    tags = tmp_path / "tags.csv"
    tags.write_text("Name;Address\nLevel;%MW4\n", encoding="utf-8")
    if "\0" in name:
        return
    ran = run(capfdbinary, "tags", tags, "--tags-encoding", name)
    assert ran.code == 2
    assert "Traceback" not in ran.err


@pytest.mark.parametrize(
    "name", ["utf-8", "cp1252", "cp1251", "gbk", "utf-16", "utf-16-le", "utf-7", "latin-1", "big5"]
)
def test_what_is_one(name: str) -> None:
    check_code_page(name)


@pytest.mark.parametrize("name", ["rot13", "undefined", "hex"])
def test_a_code_page_in_the_settings(
    name: str, capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s7dissect.toml").write_text(f'tags-encoding = "{name}"\n', encoding="utf-8")
    ran = run(capfdbinary, "analyze", simple(tmp_path / "a.pcapng"))
    assert ran.code == 2
    assert f"s7dissect.toml:1: tags-encoding: '{name}' is not an encoding of texts" in ran.err


def test_a_long_key_in_the_settings(capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s7dissect.toml").write_text("a." * 32_000 + "b = 1\n", encoding="utf-8")
    begun = time.process_time()
    ran = run(capfdbinary, "analyze", simple(tmp_path / "a.pcapng"))
    assert time.process_time() - begun < 5  # 10 s and more without the bound
    assert (ran.code, "a key of more than 16 parts" in ran.err) == (2, True)


@pytest.mark.parametrize("manifest", ["[" * 100_000, '{"schema": ' + "9" * 5000, "\xff", "{}", "[]", '{"blocks": 1}'])
def test_a_manifest_of_blocks(manifest: str, capfdbinary: Capture, tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text(manifest, encoding="latin-1")
    ran = run(capfdbinary, "blocks", tmp_path)
    assert (ran.code, "not a manifest of blocks" in ran.err) == (2, True), ran.err
    assert "Traceback" not in ran.err


def test_a_damaged_index(capfdbinary: Capture, tmp_path: Path) -> None:
    """Names and texts of the database that are no UTF-8, and any other octet that is wrong."""
    simple(tmp_path / "a.pcapng")
    path = tmp_path / "index.sqlite"
    assert run(capfdbinary, "index", tmp_path, "--file", path).code == EXIT_OK
    sound = path.read_bytes()
    place = sound.index(b"CREATE TABLE files")
    cases = [bytearray(sound)]
    cases[0][place + 13] = 0x97
    rng = random.Random(7)
    for _ in range(40):
        case = bytearray(sound)
        for _ in range(rng.choice((1, 8, 200))):
            case[rng.randrange(16, len(case))] = rng.randrange(256)
        cases.append(case)
    for case in cases:
        path.write_bytes(case)
        ran = run(capfdbinary, "index", tmp_path, "--file", path)
        assert ran.code in {0, 2}, ran.err
        assert "Traceback" not in ran.err
    path.write_bytes(cases[0])
    assert "is damaged: remove it" in run(capfdbinary, "index", tmp_path, "--file", path).err
    path.write_bytes(gzip.compress(sound))
    assert "is not an index of s7dissect" in run(capfdbinary, "index", tmp_path, "--file", path).err


def test_an_index_is_written_in_batches(capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(30):
        simple(tmp_path / f"{number:02}.pcapng", 1)
    sizes: list[int] = []
    write = Store.write

    def counted(self: Store, changes: Any) -> None:
        sizes.append(len(changes))
        write(self, changes)

    monkeypatch.setattr(Store, "write", counted)
    monkeypatch.setattr("dissect.files.index.update._LONGEST_S", 3600.0)
    monkeypatch.setattr("dissect.files.index.update._TOGETHER", 12)
    ran = run(capfdbinary, "index", tmp_path)
    assert ran.code == EXIT_OK
    assert sizes == [12, 12, 6]
    assert "30 files: 30 read" in ran.out
    assert "0 read, 30 unchanged" in run(capfdbinary, "index", tmp_path).out


def test_a_key_log_forgets_its_oldest_session_without_a_search(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(key_log, "MAX_SESSIONS", 2000)
    lines = [f"CLIENT_RANDOM {number:064x} {'00' * 48}\n".encode() for number in range(12_000)]

    def read(count: int) -> float:
        log = KeyLog()
        begun = time.process_time()
        log.add(b"".join(lines[:count]))
        assert log.forgotten == max(count - 2000, 0)
        return time.process_time() - begun

    read(2000)
    assert read(12_000) < 20 * max(read(4000), 0.005)
    assert_growth(lambda: read(4000), lambda: read(8000), 2.2)
