"""All files of TOML that a user writes say what is wrong equally well: the line of the key, what was meant, all at once."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest

from dissect.meaning.bindings import load_bindings
from dissect.online.alerts import load_rules
from dissect.output.baseline import load_baseline
from dissect.scd.errors import DictionaryError
from dissect.scd.loading import load
from dissect.scd.user_file import FileError, UserFile
from tests.meaning.bindings.plant import dictionary


def bindings(path: Path) -> object:
    return load_bindings(path, dictionary())


class Kind(NamedTuple):
    """A kind of file: two sound tables, a key of each and its value, one that is misspelt, and what reads it."""

    read: Callable[[Path], object]
    head: str
    tables: tuple[str, str]
    key: str
    wrong: str
    misspelt: str


def table(head: str, *lines: str) -> str:
    return "".join([f"{line}\n" for line in (head, *lines)])


KINDS = {
    "bindings": Kind(
        bindings, "",
        (table("[[binding]]", "udp = 5000", 'holds = "messages"'), table("[[binding]]", "udp = 5001", 'holds = "messages"')),
        "device", '"pear"', "hots",
    ),
    "alerts": Kind(
        load_rules, "",
        (table("[[rule]]", 'name = "a"', 'when = "new"'), table("[[rule]]", 'name = "b"', 'when = "new"')),
        "severity", '"eror"', "cooldwn",
    ),
    "baseline": Kind(
        load_baseline, "format = 1\n",
        (table("[[pair]]", 'client = "::5"', 'server = "::1"'), table("[[pair]]", 'client = "::6"', 'server = "::1"')),
        "connections", "-3", "raets",
    ),
    "scd": Kind(
        load, '[dictionary]\nname = "d"\n',
        (table("[[object]]", "index = 0x6000", 'name = "A"', 'type = "uint8"'),
         table("[[object]]", "index = 0x6001", 'name = "B"', 'type = "uint8"')),
        "access", '"wr"', "unti",
    ),
}  # fmt: skip


def told(kind: Kind, path: Path, text: str) -> list[str]:
    """Return the errors of a text, each with its line."""
    path.write_text(text, encoding="utf-8")
    with pytest.raises((FileError, DictionaryError)) as caught:
        kind.read(path)
    first = caught.value
    assert isinstance(first, (FileError, DictionaryError))
    if isinstance(first, FileError):
        assert str(first).count("\n") == len(first.others), "each error has a line of its own"
    where = first.key if isinstance(first, FileError) else first.where
    others = [f"{error.line}: {error.where}: {error.detail}" for error in first.others]
    return [f"{first.line}: {where}: {first.detail}", *others]


@pytest.mark.parametrize("name", KINDS)
def test_a_sound_file(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    path = tmp_path / "file.toml"
    path.write_text(kind.head + "".join(kind.tables), encoding="utf-8")
    assert kind.read(path) is not None


@pytest.mark.parametrize("name", KINDS)
def test_the_line_of_the_key_and_what_was_meant(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    before = (kind.head + kind.tables[0]).count("\n")
    (error,) = told(
        kind, tmp_path / "file.toml", f"{kind.head}{kind.tables[0]}\n\n{kind.misspelt} = 3\n{kind.tables[1]}"
    )
    assert error.startswith(f"{before + 3}: ")
    assert f"{kind.misspelt}: no such key here; close to it: '" in error


@pytest.mark.parametrize("name", KINDS)
def test_all_mistakes_are_told_at_once(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    wrong = f"{kind.key} = {kind.wrong}\n"
    first, second = told(kind, tmp_path / "file.toml", kind.head + kind.tables[0] + wrong + kind.tables[1] + wrong)
    line = (kind.head + kind.tables[0] + wrong).count("\n")
    assert first.startswith(f"{line}: ")
    assert second.startswith(f"{line + (kind.tables[1] + wrong).count(chr(10))}: ")
    assert f", {kind.key}: " in first
    assert f", {kind.key}: " in second


@pytest.mark.parametrize("name", KINDS)
@pytest.mark.parametrize(
    ("octets", "line"),
    [
        (b"a = 1\na = \n", 2),
        (b"\n\xff\n", 2),
        (b"a = " + b"9" * 5000, 1),
        (b"\n" + b".".join([b"a"] * 20) + b" = 1", 2),
    ],
)
def test_what_is_no_toml_has_its_line(name: str, octets: bytes, line: int, tmp_path: Path) -> None:
    path = tmp_path / "file.toml"
    path.write_bytes(octets)
    with pytest.raises((FileError, DictionaryError)) as caught:
        KINDS[name].read(path)
    error = caught.value
    assert isinstance(error, (FileError, DictionaryError))
    assert (error.path, error.line) == (str(path), line)
    assert str(error).startswith(f"{path}:{line}: ")


def test_an_action_that_is_wrong_is_not_missed_by_the_rule_that_names_it(tmp_path: Path) -> None:
    text = '[[action]]\nname = "a"\ncommand = []\n[[rule]]\nname = "r"\nwhen = "new"\nactions = ["a", "stder"]\n'
    first, second = told(KINDS["alerts"], tmp_path / "file.toml", text)
    assert first.startswith("3: [[action]] 1, command: ")
    assert (
        second == "7: [[rule]] 1, actions: 'stder' names no [[action]]; known actions: stderr, a; close to it: 'stderr'"
    )


def test_many_errors_are_counted(tmp_path: Path) -> None:
    pairs = "".join([f'[[pair]]\nclient = "x{number}"\nserver = "10.0.0.1"\n' for number in range(100)])
    path = tmp_path / "file.toml"
    path.write_text(f"format = 1\n{pairs}", encoding="utf-8")
    with pytest.raises(FileError) as caught:
        load_baseline(path)
    lines = str(caught.value).split("\n")
    assert len(lines) == 21
    assert lines[-1] == f"80 more errors in {path}"
    assert len(caught.value.others) == 99


def test_more_tables_than_a_file_may_have() -> None:
    file = UserFile("[[row]]\n" * 3, ("row",))
    assert list(file.tables("row", 2)) == []
    with pytest.raises(DictionaryError, match="3 of them, expected 2 at most"):
        file.done()
