"""`s7dissect blocks --code`, `--xref` and the code of `--diff`."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Final

import pytest

from tests.cases import each
from tests.cli.support import run
from tests.meaning.report.schemas import ROOT
from tests.protocols.mc7.samples import TIME_2, fb7, fc5, ob1

Capture = pytest.CaptureFixture[bytes]
PROGRAM: Final = ROOT / "captures" / "crafted" / "program.pcapng"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder of our blocks."""
    home = tmp_path / "blocks"
    home.mkdir()
    for name, octets in (("ob1", ob1()), ("fc5", fc5()), ("fb7", fb7())):
        (home / f"{name}.mc7").write_bytes(octets)
    return home


def test_the_code_of_a_folder_knows_the_blocks_that_are_called(capfdbinary: Capture, folder: Path) -> None:
    ran = run(capfdbinary, "blocks", "--code", folder)
    assert ran.code == 0
    lines = [" ".join(line.split()) for line in ran.out.splitlines()]
    assert "CALL FC 5 (IN0 := MW 30, OUT0 => M 40.0)" in lines
    assert "CALL FB 7, DB7 (IN0 := MW 50, OUT0 => MW 52)" in lines


@each(
    ("options", "line"),
    [
        (["--code"], "A I 0.0"), (["--code", "STL"], "A I 0.0"), (["--code=awl"], "U E 0.0"), (["--code", "AWL"], "U E 0.0"),
    ],
)  # fmt: skip
def test_mnemonics(capfdbinary: Capture, options: list[str], line: str) -> None:
    orders: tuple[list[str | Path], ...] = ([*options, PROGRAM], [PROGRAM, *options])
    for arguments in orders:
        ran = run(capfdbinary, "blocks", *arguments)
        assert (ran.code, ran.err) == (0, "")
        assert line in [" ".join(text.split()) for text in ran.out.splitlines()]


def test_addresses_have_their_tags(capfdbinary: Capture, tmp_path: Path) -> None:
    tags = tmp_path / "tags.csv"
    tags.write_text("name,address,type\nStart,I0.0,BOOL\nLevel,DB2.DBW2,INT\n")
    for option in ("--code", "--code=AWL"):
        out = run(capfdbinary, "blocks", PROGRAM, option, "--tags", tags).out
        assert "// Start" in out
        assert "// Level" in out


def test_a_data_block_shows_its_values_by_declaration(capfdbinary: Capture) -> None:
    lines = [" ".join(line.split()) for line in run(capfdbinary, "blocks", "--code", PROGRAM).out.splitlines()]
    assert "DB2.DBD16 STAT0.m7 : REAL = 1.250000e+001" in lines
    assert "DB2.DBB20 STAT0.m8 : STRING[6] = 'V-3'" in lines


def test_a_changed_time_value_is_one_line(capfdbinary: Capture, tmp_path: Path) -> None:
    old, new = tmp_path / "old.mc7", tmp_path / "new.mc7"
    old.write_bytes(ob1())
    new.write_bytes(ob1("10S", TIME_2, 0x9999))
    ran = run(capfdbinary, "blocks", "--diff", old, new)
    assert ran.code == 1
    assert [line for line in ran.out.splitlines() if "network" in line] == ["    OB1 network 2: L S5T#35S → S5T#10S"]
    told = json.loads(run(capfdbinary, "blocks", "--diff", old, new, "-T", "json").out)
    details = told["changes"][0]["details"]
    assert [one["text"] for one in details if one["about"] == "network"] == ["L S5T#35S → S5T#10S"]
    assert run(capfdbinary, "blocks", "--diff", old, old).code == 0


def test_two_times_in_one_capture_are_compared(capfdbinary: Capture) -> None:
    out = run(capfdbinary, "blocks", "--diff", PROGRAM).out
    assert "    OB1 network 1: L S5T#35S → S5T#10S\n" in out
    assert "    OB1 network 3 added (3 instructions)\n" in out
    assert "    OB1 calls: SFC46 is called now\n" in out


def test_the_cross_reference(capfdbinary: Capture, folder: Path) -> None:
    lines = [" ".join(line.split()) for line in run(capfdbinary, "blocks", "--references", folder).out.splitlines()]
    assert "MW 22 write: OB1 network 3 (2 times)" in lines
    assert "FC5 called by: OB1 network 4" in lines
    told = json.loads(run(capfdbinary, "blocks", "--references", "-T", "json", folder).out)
    assert [plc["plc"] for plc in told["plcs"]] == [None]


def test_what_is_left_of_a_damaged_block_is_shown(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "cut.mc7"
    path.write_bytes(ob1()[:100])
    ran = run(capfdbinary, "blocks", "--code", path)
    assert ran.code == 0
    assert "A     I 0.0" in ran.out
    assert "! 100 of 253 bytes are there" in ran.out


def test_an_encrypted_block_shows_its_header(capfdbinary: Capture, tmp_path: Path) -> None:
    octets = bytearray(ob1())
    octets[4] = 0x29
    path = tmp_path / "secret.mc7"
    path.write_bytes(bytes(octets))
    out = run(capfdbinary, "blocks", "--code", path).out
    assert "author plant" in out
    assert "encrypted (block privacy): the code cannot be read" in out
    assert "NETWORK" not in out


def test_blocks_of_other_cpus_are_said_to_be_closed(capfdbinary: Capture) -> None:
    plant = ROOT / "captures" / "crafted" / "plus-plant.pcapng"
    out = run(capfdbinary, "blocks", "--code", plant).out
    assert "(MC7plus) is not shown: its encoding is not public" in out


def test_a_file_that_is_no_block_is_one_line(capfdbinary: Capture, tmp_path: Path) -> None:
    path = tmp_path / "letter.txt"
    path.write_bytes(b"Dear plant, this is no block at all.\n" * 4)
    ran = run(capfdbinary, "blocks", "--code", path)
    assert ran.code == 2
    assert ran.err.count("\n") == 1


def test_names_from_the_wire_steer_no_terminal(capfdbinary: Capture, tmp_path: Path) -> None:
    octets = bytearray(ob1())
    octets[-36:-28] = b"\x1b[31mx\x07\0"
    path = tmp_path / "odd.mc7"
    path.write_bytes(bytes(octets))
    out = run(capfdbinary, "blocks", "--code", path).out
    assert "author \\x1b[31mx\\x07" in out
    assert "\x1b" not in out


@each(
    ("options", "words"),
    [
        (["--code", "--references"], "cannot be combined"),
        (["--references", "--diff"], "cannot be combined"),
        (["--code=SCL"], "is not one of"),
    ],
)
def test_what_does_not_go_together_is_refused(capfdbinary: Capture, options: list[str], words: str) -> None:
    ran = run(capfdbinary, "blocks", PROGRAM, *options)
    assert ran.code == 2
    assert words in ran.err


RECORDED: Final = ROOT / "captures" / "program-python.pcapng"


def test_a_recorded_download_carries_what_our_assembler_made(capfdbinary: Capture, tmp_path: Path) -> None:
    """The client and the server that carried the blocks are python-snap7; the capture is dumpcap's."""
    folder = ROOT / "captures" / "record" / "blocks"
    made = {"ob1-35s": ob1(), "ob1-10s": ob1("10S", TIME_2, 0x2E81), "fc5": fc5(), "fb7": fb7()}
    assert {path.stem: path.read_bytes() for path in folder.glob("*.mc7")} == made
    assert run(capfdbinary, "blocks", RECORDED, "-o", tmp_path / "out").code == 0
    carved = [path.read_bytes() for path in sorted((tmp_path / "out").glob("*.mc7"))]
    assert carved == [made["ob1-35s"], made["fc5"], made["fb7"], made["ob1-10s"]]


def test_two_versions_in_a_recording_differ_in_one_line(capfdbinary: Capture) -> None:
    ran = run(capfdbinary, "blocks", "--diff", RECORDED)
    assert ran.code == 1
    assert [line for line in ran.out.splitlines() if "network" in line] == ["    OB1 network 2: L S5T#35S → S5T#10S"]
    lines = [" ".join(line.split()) for line in run(capfdbinary, "blocks", "--code", RECORDED).out.splitlines()]
    assert lines.count("CALL FC 5 (IN0 := MW 30, OUT0 => M 40.0)") == 2
