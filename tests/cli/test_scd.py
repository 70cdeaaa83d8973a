"""`s7dissect scd compile`, `dump`, `check`, `diff`: files of every kind, round trips, exit codes, what a terminal gets."""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dissect import scd
from dissect.cli.main import group
from dissect.scd.source import parse_toml
from tests.cli.support import Ran, run
from tests.scd.test_eds import PUMP as EDS
from tests.scd.test_xdd import PUMP as XDD

PLANT = Path(__file__).resolve().parents[2] / "captures" / "scd" / "plant.toml"
Capture = pytest.CaptureFixture[bytes]
EVIL = '[dictionary]\nname = "a"\n[[object]]\nindex = 0x2000\nname = "b"\ntype = "uint8"\nunit = "\\u001b[2J\\u202e\\u0085"\n'


def source(folder: Path, kind: str) -> Path:
    """A source of a kind, by its suffix."""
    path = folder / f"source.{kind}"
    texts = {"toml": PLANT.read_text("utf-8"), "eds": EDS, "dcf": EDS, "xdd": XDD, "xdc": XDD}
    path.write_text(texts[kind], "utf-8")
    return path


def compiled(capture: Capture, folder: Path, kind: str = "toml") -> Path:
    out = folder / f"{kind}.scd"
    assert run(capture, "scd", "compile", source(folder, kind), "-o", out).code == 0
    return out


@pytest.mark.parametrize("kind", ["toml", "eds", "dcf", "xdd", "xdc"])
def test_source_compiled_dump_compiled(capfdbinary: Capture, tmp_path: Path, kind: str) -> None:
    out = compiled(capfdbinary, tmp_path, kind)
    for form in ("toml", "json"):
        ran = run(capfdbinary, "scd", "dump", out, f"--{form}")
        assert (ran.code, ran.err) == (0, "")
        again = tmp_path / f"again.{form}"
        again.write_text(ran.out, "utf-8")
        ran = run(capfdbinary, "scd", "compile", again, "-o", tmp_path / "again.scd", "--force")
        assert (ran.code, ran.err) == (0, "")
        assert (tmp_path / "again.scd").read_bytes() == out.read_bytes()
        assert run(capfdbinary, "scd", "diff", out, again).code == 0


def test_check_reports_everything_that_is_wrong(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "x.toml"
    wrong = '[[object]]\nindex = 1\nnaem = "b"\n[[object]]\nindex = 0x2000\ntype = "int9"\nname = "c"\n'
    path.write_text(f'[dictionary]\nname = "a"\n{wrong}')
    ran = run(capfdbinary, "scd", "check", path)
    assert ran.code == 1
    assert [line.removeprefix(f"{path}:").split(":")[0] for line in ran.out.splitlines()] == ["5", "8"]
    assert "name is missing; 'naem' is there" in ran.out
    assert "no type 'int9'; close to it: 'int8'" in ran.out
    told = json.loads(run(capfdbinary, "scd", "check", path, "-T", "json").out)
    assert [error["line"] for error in told["errors"]] == [5, 8]
    assert told["error"] == told["errors"][0]


def test_a_node_id_for_a_description(capfdbinary: Capture, tmp_path: Path) -> None:
    path = source(tmp_path, "eds")
    assert "depends on the node id" in run(capfdbinary, "scd", "dump", path).err
    ran = run(capfdbinary, "scd", "dump", path, "--node", "7")
    assert (ran.code, "depends on the node id" in ran.err) == (0, False)
    assert f"default = {0x80 + 7}" in ran.out
    refused = run(capfdbinary, "scd", "check", PLANT, "--node", "7")
    assert (refused.code, "--node applies to device descriptions (EDS, DCF, XDD, XDC) only" in refused.err) == (2, True)


def test_compile_says_what_it_made(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "p.scd"
    ran = run(capfdbinary, "scd", "compile", PLANT, "-o", out)
    od = scd.load(out)
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.splitlines() == [
        f"{out}: {len(od.octets)} bytes",
        "  Насосная 1.0.0: 24 objects, 3 types, 4 TPDOs, 2 RPDOs, the default envelope",
        f"  file id  {hashlib.sha256(out.read_bytes()).hexdigest()}",
        f"  wire id  {od.wire_id.hex()}",
    ]
    assert [path.name for path in tmp_path.iterdir()] == ["p.scd"]  # nothing is left beside it


@pytest.mark.parametrize("kind", ["toml", "eds", "xdd"])
def test_the_same_octets_under_any_hash_seed(tmp_path: Path, kind: str) -> None:
    path = source(tmp_path, kind)
    made = set()
    for seed in ("0", "1", "4711"):
        ran = subprocess.run(
            [sys.executable, "-m", "dissect", "scd", "compile", path, "-o", "-"],
            env={**os.environ, "PYTHONHASHSEED": seed}, capture_output=True, check=True,
        )  # fmt: skip
        made.add(ran.stdout)
    assert made == {scd.compile(path).octets}


def test_notes_of_an_import_go_to_stderr(capfdbinary: Capture, tmp_path: Path) -> None:
    path = source(tmp_path, "eds")
    for ran in (
        run(capfdbinary, "scd", "compile", path, "-o", tmp_path / "x.scd"),
        run(capfdbinary, "scd", "dump", path),
    ):
        assert ran.code == 0
        assert f"s7dissect: {path}: 0xc000: omitted: SCD has no objects there (reserved)\n" in ran.err
        assert "omitted" not in ran.out
        assert ran.err.count("\n") == len(scd.import_file(path).notes)


def test_an_eds_in_another_encoding(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "x.eds"
    path.write_bytes("[1000]\nParameterName=Насос\nDataType=7\nAccessType=ro\n".encode("cp1251"))
    assert 'name = "Насос"' in run(capfdbinary, "scd", "dump", "--encoding", "cp1251", path).out
    guessed = run(capfdbinary, "scd", "dump", path)
    assert "not UTF-8 and was read as Latin-1; if its names are wrong, specify the encoding" in guessed.err
    wrong = run(capfdbinary, "scd", "dump", "--encoding", "cp1251", PLANT)
    assert (wrong.code, wrong.out) == (2, "")
    assert "--encoding applies to EDS and DCF" in wrong.err


def test_what_cannot_be_compiled(capfdbinary: Capture, tmp_path: Path) -> None:
    out = tmp_path / "out.scd"
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('[dictionary]\nname = "a"\n\n[[object]]\nindex = 0x20000\nname = "b"\ntype = "uint8"\n')
    ran = run(capfdbinary, "scd", "compile", wrong, "-o", out)
    assert (ran.code, ran.out) == (2, "")
    assert ran.err == f"s7dissect: {wrong}:4: object 131072 'b': an index has 16 bits (R57)\n"
    missing = run(capfdbinary, "scd", "compile", tmp_path / "none.toml", "-o", out)
    assert (missing.code, missing.err) == (2, f"s7dissect: {tmp_path / 'none.toml'}: No such file or directory\n")
    same = run(capfdbinary, "scd", "compile", wrong, "-o", wrong)
    assert (same.code, "both input and output" in same.err) == (2, True)
    out.write_bytes(b"mine")
    kept = run(capfdbinary, "scd", "compile", PLANT, "-o", out)
    assert (kept.code, out.read_bytes(), "--force overwrites it" in kept.err) == (2, b"mine", True)
    out.unlink()
    nowhere = run(capfdbinary, "scd", "compile", PLANT, "-o", tmp_path / "no" / "out.scd")
    assert (nowhere.code, nowhere.out) == (2, "")
    assert f"{tmp_path / 'no' / 'out.scd'}: No such file or directory" in nowhere.err
    assert not out.exists()
    already = run(capfdbinary, "scd", "compile", compiled(capfdbinary, tmp_path), "-o", out)
    assert (already.code, "is compiled already" in already.err) == (2, True)


@pytest.mark.parametrize(("kind", "package"), [("eds", "canopen"), ("xdc", "defusedxml")])
def test_without_what_reads_a_description(
    capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, package: str
) -> None:
    for name in (package, f"{package}.common"):
        monkeypatch.setitem(sys.modules, name, None)
    ran = run(capfdbinary, "scd", "compile", source(tmp_path, kind), "-o", tmp_path / "x.scd")
    assert (ran.code, ran.out, ran.err.count("\n")) == (2, "", 1)
    assert f"needs the package {package}: pip install 's7dissect[eds]'" in ran.err


def test_a_failure_leaves_what_was_there(capfdbinary: Capture, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "out.scd"
    out.write_bytes(b"old")

    def full(_self: Path, _target: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    ran = run(capfdbinary, "scd", "compile", PLANT, "-o", out, "--force")
    assert (ran.code, ran.err) == (5, f"s7dissect: cannot write {out}: No space left on device\n")
    assert [(path.name, path.read_bytes()) for path in tmp_path.iterdir()] == [("out.scd", b"old")]


# check


def test_check(capfdbinary: Capture, tmp_path: Path) -> None:
    bad = tmp_path / "bad.scd"
    bad.write_bytes(scd.compile(PLANT).octets[:-1])
    good = run(capfdbinary, "scd", "check", PLANT)
    assert (good.code, good.err) == (0, "")
    assert good.out.splitlines()[0] == f"{PLANT}: valid"
    assert "  T2   0x1a01  4 bytes  Насос и давление 1" in good.out.splitlines()
    both = run(capfdbinary, "scd", "check", bad, PLANT)
    assert (both.code, both.err) == (1, "")
    assert both.out == f"{bad}: header, byte 12: the file should have 1817 bytes and has 1816\n" + good.out
    assert run(capfdbinary, "scd", "check", tmp_path / "none.scd").code == 2


def test_check_shows_pdos_that_are_off_and_notes(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "scd", "check", source(tmp_path, "xdd"))
    assert ran.code == 0
    lines = [line.split() for line in ran.out.splitlines()]
    assert ["T1", "0x1a00", "5", "bytes", "TPDO_MappParam_AU64"] in lines
    assert ["T2", "0x1a01", "off", "TPDO_Bool8"] in lines
    assert "  not kept: 0x2007: omitted: no type is given" in ran.out.splitlines()


def test_check_for_programs(capfdbinary: Capture, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.toml"
    wrong.write_text('[dictionary]\nname = "a"\n[[object]]\nindex = 0x0001\nname = "b"\ntype = "uint8"\n')
    ran = run(capfdbinary, "scd", "check", "-T", "json", PLANT, wrong)
    good, bad = map(json.loads, ran.out.splitlines())
    assert ran.code == 1
    od = scd.compile(PLANT)
    assert (good["schema"], good["error"], good["file_id"]) == ("s7dissect.scd-check/1", None, od.file_id.hex())
    assert good["pdos"][1] == {
        "pdo": "T2", "name": "Насос и давление 1", "mapping": 0x1A01, "bits": 32,
        "variables": [[0x6000, 1], [0x6000, 2], [0x6001, 0], [0x6000, 4]],
    }  # fmt: skip
    assert (bad["error"]["line"], bad["error"]["index"], bad["error"]["rule"]) == (3, 1, "R77")
    assert ran.out.isascii()


# diff


@pytest.mark.parametrize(
    ("old", "new", "code", "line"),
    [
        ("", "", 0, "the same bytes"),
        ('"Журнал"', '"Log"', 1, "names  object 0x2003  name  Журнал → Log"),
        ("bits = 12", "bits = 13", 2, "wire  type 0x0060    bits     12 → 13"),
    ],
)
def test_diff(capfdbinary: Capture, tmp_path: Path, old: str, new: str, code: int, line: str) -> None:
    other = tmp_path / "other.toml"
    other.write_text(PLANT.read_text("utf-8").replace(old, new), "utf-8")
    ran = run(capfdbinary, "scd", "diff", PLANT, other)
    assert (ran.code, ran.err) == (code, "")
    assert line in ran.out
    last = ran.out.splitlines()[-1]
    said = [
        "the same bytes",
        "only names, texts, units or limits differ: both decode alike",
        "they decode differently",
    ]
    assert last == f"{PLANT} and {other}: {said[code]}"
    told = json.loads(run(capfdbinary, "scd", "diff", "-T", "json", PLANT, other).out)
    assert told["level"] == ["same", "names", "wire"][code]
    assert len(told["changes"]) == len(ran.out.splitlines()) - 1
    assert (told["wire_ids"][0] == told["wire_ids"][1]) == (code < 2)


def test_diff_of_what_only_one_has(capfdbinary: Capture, tmp_path: Path) -> None:
    other = tmp_path / "other.toml"
    other.write_text(PLANT.read_text("utf-8") + '\n[[object]]\nindex = 0x2004\nname = "new"\ntype = "uint8"\n', "utf-8")
    assert "wire  object 0x2004    only in B: new\n" in run(capfdbinary, "scd", "diff", PLANT, other).out
    assert "wire  object 0x2004    only in A: new\n" in run(capfdbinary, "scd", "diff", other, PLANT).out


def test_diff_of_what_cannot_be_read(capfdbinary: Capture, tmp_path: Path) -> None:
    ran = run(capfdbinary, "scd", "diff", PLANT, tmp_path / "none.scd")
    assert (ran.code, ran.out) == (2, "")
    assert "No such file" in ran.err


# what is shown


@pytest.mark.parametrize("form", ["toml", "json"])
def test_a_dump_steers_no_terminal(capfdbinary: Capture, tmp_path: Path, form: str) -> None:
    path = tmp_path / "evil.toml"
    path.write_text(EVIL)
    ran = run(capfdbinary, "scd", "dump", f"--{form}", path)
    assert ran.out.replace("\n", "").isprintable()
    again = tmp_path / f"again.{form}"
    again.write_text(ran.out)
    assert scd.compile(again).octets == parse_toml(EVIL).octets


def test_nothing_steers_a_terminal(capfdbinary: Capture, tmp_path: Path) -> None:
    first, second = tmp_path / "a\x1b[2J.toml", tmp_path / "b.toml"
    first.write_text(EVIL)
    second.write_text(EVIL.replace("202e", "202d"))
    runs: list[Ran] = [
        run(capfdbinary, "scd", "check", first),
        run(capfdbinary, "scd", "diff", first, second),
        run(capfdbinary, "scd", "decode", "-d", first, "--value", "0x2000", "05"),
        run(capfdbinary, "scd", "compile", first, "-o", tmp_path / "c\x9b.scd"),
        run(capfdbinary, "scd", "compile", second, "-o", first / "x"),
        run(capfdbinary, "scd", "encode", "-d", first, "--value", "b", "\x1b"),
    ]
    for ran in runs:
        assert (ran.out + ran.err).replace("\n", "").isprintable(), ran
    assert "a\\x1b[2J.toml" in runs[0].out


# the group


def test_help_is_cheap_and_lists_every_command() -> None:
    ran = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "dissect", "scd", "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    imported = {line.rsplit("|", 1)[1].strip() for line in ran.stderr.splitlines() if line.startswith("import time:")}
    assert {
        name for name in imported if name.split(".")[0] in {"msgspec", "canopen", "numpy", "bitstruct", "defusedxml"}
    } == set()
    listed = [
        line.split()[0] for line in ran.stdout.splitlines() if line.startswith("  ") and line.split()[0].isalpha()
    ]
    assert listed[-6:] == ["compile", "dump", "check", "diff", "decode", "encode"]


@pytest.mark.parametrize("name", ["compile", "dump", "check", "diff", "decode", "encode"])
def test_every_command_has_its_help(capfdbinary: Capture, name: str) -> None:
    ran = run(capfdbinary, "scd", name, "--help")
    assert (ran.code, ran.err) == (0, "")
    assert ran.out.startswith(f"Usage: s7dissect scd {name} ")
    assert "scd" in group.list_commands(None)  # type: ignore[arg-type]


def test_no_such_command(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "scd", "nonsense")
    assert (ran.code, ran.out) == (2, "")
    assert "No such command" in ran.err


def test_one_of_a_thing_is_told_in_the_singular(capfdbinary: Capture, tmp_path: Path) -> None:
    source = tmp_path / "one.toml"
    source.write_text(
        '[dictionary]\nname = "One"\n[[object]]\nindex = 0x6000\nname = "a"\ntype = "bool"\n'
        '[[pdo]]\ndir = "T"\nnumber = 1\nmap = ["a"]\n',
        encoding="utf-8",
    )
    out = run(capfdbinary, "scd", "check", source).out
    assert "One: 2 objects, 0 types, 1 TPDO, 0 RPDOs, the default envelope" in out
    assert "T1  0x1a00  1 byte" in out
