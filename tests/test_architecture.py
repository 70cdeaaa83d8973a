"""docs/architecture.md is true: the rooms are the rooms, and a packet goes the way that is written there."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import FrameType
from typing import Final

import pytest
from click.testing import CliRunner

import dissect
from dissect.cli import transactions
from dissect.wire.build import COMPILED
from tests.test_house import ORDER, WINGS, is_bare_wing, module_name, room_of
from tests.test_house import PACKAGE as SOURCES

ROOT: Final = Path(__file__).resolve().parent.parent
PACKAGE: Final = Path(dissect.__file__).resolve().parent
MAP: Final = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
CAPTURE: Final = ROOT / "captures" / "nodes7-poll-missing.pcapng"
#: Its packet 11 is the response to a Read Var of which two items are refused.
RESPONSE: Final = 11
#: Rooms of which no file may be missing on the map, and the one that does nothing when nobody overrides it.
COMPLETE: Final = ("engine", "engine/transactions")
NOBODY: Final = "engine/observer.py"
#: How many files one packet may lead a reader through, helpers included, from the frame to the line.
MOST: Final = {"text": 34, "jsonl": 32}
#: How many of them, with the table of names, have a function to read for a return code.
MOST_READ: Final = {"text": 13, "jsonl": 12}
#: Where the names of return codes are.
NAMES: Final = "protocols/s7/tables.py"


def ways() -> list[list[str]]:
    """Return the numbered lists of files: reading, engine, text, JSON lines."""
    found: list[list[str]] = []
    section = MAP[MAP.index("## The way of a byte") : MAP.index("## Rooms")]
    for number, file in re.findall(r"^(\d+)\. `([\w/]+\.py)`", section, re.MULTILINE):
        if number == "1":
            found.append([])
        found[-1].append(file)
        assert len(found[-1]) == int(number)
    return found


def return_code(output: str) -> list[tuple[str, str]]:
    """Return the files and functions through which the map follows a return code to an output."""
    rows = re.findall(r"^\| (both|text|JSON) \| `([\w/]+\.py)` \| `(\w+)` \|", MAP, re.MULTILINE)
    return [(file, function) for whose, file, function in rows if whose in {"both", output}]


def traced(format_: str) -> tuple[list[str], list[tuple[str, str]]]:
    """Return the files reached before the first packet and the functions called in the response, with their files, in order."""
    before: dict[str, None] = {}
    inside: dict[tuple[str, str], None] = {}
    packets = 0
    depth: FrameType | None = None

    def look(frame: FrameType, event: str, _argument: object) -> None:
        nonlocal packets, depth
        if event == "return" and frame is depth:
            depth = None
        if event != "call" or not frame.f_code.co_filename.startswith(f"{PACKAGE}/"):
            return
        file = Path(frame.f_code.co_filename).relative_to(PACKAGE).as_posix()
        if (file, frame.f_code.co_name) == ("engine/pipeline.py", "frame"):
            packets += 1
            depth = frame if packets == RESPONSE else None
        if depth is not None:
            inside[file, frame.f_code.co_name] = None
        elif not packets:
            before[file] = None

    sys.setprofile(look)
    try:
        ran = CliRunner().invoke(transactions.command, ["-T", format_, str(CAPTURE)], standalone_mode=False)
    finally:
        sys.setprofile(None)
    assert ran.exception is None
    assert packets == 18
    return list(before), list(inside)


def in_order(way: list[str], reached: list[str]) -> bool:
    return [file for file in reached if file in way] == way


@pytest.mark.skipif(COMPILED, reason="compiled functions cannot be traced")
def test_the_way_of_a_byte_is_the_one_that_is_written() -> None:
    reading, engine, text, jsonl = ways()
    assert len(engine) > 10
    for format_, output in (("text", text), ("jsonl", jsonl)):
        before, called = traced(format_)
        inside = list(dict.fromkeys(file for file, _ in called))
        # The capture is pcapng, the map says pcap or pcapng.
        assert in_order([file.replace("pcap.py", "pcapng.py") for file in reading], before)
        assert in_order([*engine, *output], inside)
        assert len(inside) <= MOST[format_], inside
        assert [
            file for file in inside if file.rpartition("/")[0] in COMPLETE and file not in {*engine, *output, NOBODY}
        ] == []
        code = return_code({"text": "text", "jsonl": "JSON"}[format_])
        assert len(code) > 10
        assert [step for step in called if step in code] == code
        assert len({NAMES, *(file for file, _ in code)}) <= MOST_READ[format_]


def test_the_rooms_are_listed_in_their_order() -> None:
    section = MAP[MAP.index("## Rooms") : MAP.index("## The seam")]
    listed = re.findall(r"^\| `(\w+)` \|", section, re.MULTILINE)
    modules = [module_name(path) for path in SOURCES.rglob("*.py")]
    assert listed == list(ORDER)
    assert set(listed) == {room_of(module) for module in modules if not is_bare_wing(module)} - {"", "__main__"}


def test_the_wings_are_listed_with_their_rooms_and_their_sentences() -> None:
    section = MAP[MAP.index("## Rooms") : MAP.index("## The seam")]
    rows = re.findall(r"^\| `(\w+)/` \| ([\w, ]+) \| (.+) \|$", section, re.MULTILINE)
    assert [(wing, tuple(rooms.split(", "))) for wing, rooms, _ in rows] == list(WINGS.items())
    for wing, _, sentence in rows:
        if is_bare_wing(f"dissect.{wing}"):
            said = (SOURCES / wing / "__init__.py").read_text(encoding="utf-8")
            assert said == f'"""{sentence[0].upper()}{sentence[1:]}."""\n'


def test_files_that_are_named_exist() -> None:
    named = set(re.findall(r"`([\w/]+/[\w/]+\.py)`", MAP))
    assert len(named) > 20
    assert [
        file for file in sorted(named) if not (ROOT / "dissect" / file).exists() and not (ROOT / file).exists()
    ] == []
