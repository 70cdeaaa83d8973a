"""`s7dissect.toml`: which file counts, and every mistake in it with its line."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest

from dissect.wire.config.finding import NAME, find_files
from dissect.wire.config.settings import KEYS, ConfigError, load_settings

GOOD = """
tags = ["plc.xlsx", "10.0.0.5=press.csv"]
tags-encoding = "cp1251"
slow = 20
format = "jsonl"
checksums = true
[tags-db]
Tank = 10
[hosts]
"10.0.0.5" = "press"
"""


def written(folder: Path, text: str) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / NAME
    path.write_text(text, encoding="utf-8")
    return path


def test_keys_are_read_and_files_are_found_beside_the_settings(tmp_path: Path) -> None:
    found = load_settings([written(tmp_path, GOOD)], ["jsonl"]).values
    assert found["tags"] == [str(tmp_path / "plc.xlsx"), f"10.0.0.5={tmp_path / 'press.csv'}"]
    assert (found["slow"], found["format"], found["checksums"]) == (20.0, "jsonl", True)
    assert (found["tags-db"], found["hosts"]) == ({"Tank": 10}, {"10.0.0.5": "press"})


def test_the_project_counts_more_than_the_user_and_tables_are_joined(tmp_path: Path) -> None:
    project = written(tmp_path / "p", 'slow = 5\n[hosts]\n"10.0.0.1" = "a"\n')
    user = written(tmp_path / "u", 'slow = 9\nchecksums = true\n[hosts]\n"10.0.0.1" = "b"\n"10.0.0.2" = "c"\n')
    found = load_settings([project, user]).values
    assert found["slow"] == 5.0
    assert found["checksums"] is True
    assert found["hosts"] == {"10.0.0.1": "a", "10.0.0.2": "c"}


def test_the_nearest_file_above_is_the_one_of_the_project(tmp_path: Path) -> None:
    user = written(tmp_path / "u", "")
    outer = written(tmp_path / "p", "")
    inner = tmp_path / "p" / "a" / "b"
    inner.mkdir(parents=True)
    assert find_files(inner, tmp_path / "u") == [outer, user]
    nearer = written(tmp_path / "p" / "a", "")
    assert find_files(inner, tmp_path / "nobody") == [nearer]


def test_a_place_that_may_not_be_looked_into_has_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    outer, user = written(tmp_path / "p", ""), written(tmp_path / "u", "")
    inner = tmp_path / "p" / "a"
    inner.mkdir()
    usual = Path.is_file

    def is_file(path: Path) -> bool:
        if path in {inner / NAME, user}:
            raise PermissionError(errno.EACCES, "Permission denied", str(path))
        return usual(path)

    monkeypatch.setattr(Path, "is_file", is_file)
    assert find_files(inner, tmp_path / "u") == [outer]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = 1\ntag = 'x'\n", ":2: tag: unknown key; close to it: 'tags'"),
        ("\n\nslwo = 3\n", ":3: slwo: unknown key; close to it: 'slow'"),
        ("zzz = 3\n", ":1: zzz: unknown key; known keys: tags, "),
        ("slow = -1\n", ":1: slow: expected milliseconds"),
        ("slow = true\n", ":1: slow: expected milliseconds"),
        ("tags = 3\n", ":1: tags: expected a file or a list of files"),
        ("tags = []\n", ":1: tags: expected a file or a list of files"),
        ("checksums = 'yes'\n", ":1: checksums: expected true or false"),
        ("color = 'pink'\n", ":1: color: expected one of auto, always, never"),
        ("format = 'jsn'\n", ":1: format: 'jsn' is not one of text, json; close to it: 'json'"),
        ("[hosts]\nplc = 'x'\n", ":1: hosts: 'plc' is not an IP address"),
        ("[tags-db]\nTank = 0\n", ":1: tags-db: 'Tank': expected the number of a data block from 1 to 65535"),
        ("slow = \n", ":1: not valid TOML: "),
        ("tags = '\x1b'\n", ":1: not valid TOML: "),
    ],
)
def test_a_mistake_is_reported_with_its_line(text: str, said: str, tmp_path: Path) -> None:
    path = written(tmp_path, text)
    with pytest.raises(ConfigError) as raised:
        load_settings([path], ["text", "json"])
    assert any([f"{path}{said}" in problem for problem in raised.value.problems]), raised.value.problems
    assert "\x1b" not in str(raised.value)


def test_all_mistakes_of_all_files_are_reported_together(tmp_path: Path) -> None:
    one = written(tmp_path / "a", "slow = 'x'\nfoo = 1\n")
    two = written(tmp_path / "b", "bar = 1\n")
    with pytest.raises(ConfigError) as raised:
        load_settings([one, two])
    assert len(raised.value.problems) == 3


def test_a_file_that_is_no_utf_8_or_too_long_is_no_settings_file(tmp_path: Path) -> None:
    path = tmp_path / NAME
    path.write_bytes(b"slow = 1\n# \xff\n")
    with pytest.raises(ConfigError, match=r":2: byte 0xFF is not UTF-8"):
        load_settings([path])
    path.write_bytes(b"#" * (2 << 20))
    with pytest.raises(ConfigError, match="not a file of settings"):
        load_settings([path])


def test_the_manual_names_every_key() -> None:
    page = (Path(__file__).resolve().parents[3] / "docs" / "config.md").read_text(encoding="utf-8")
    for key, (meaning, _) in KEYS.items():
        assert f"| `{key}` |" in page
        assert meaning in page
