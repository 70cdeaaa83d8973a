"""Twice the packets are twice the work, for every command that reads captures: calls are counted, never timed.

A list that is searched from end to end for every packet is fast on the small captures of tests and takes minutes on those of a
plant. Here the calls of a command grow from capture to capture: one connection with ever more reads, and ever more connections.
"""

from __future__ import annotations

import sys
from pathlib import Path
from types import FrameType
from typing import Any, Final

import pytest
from click.testing import CliRunner

from benchmarks.many_connections import many_connections
from dissect.cli.main import group
from dissect.wire.build import COMPILED
from tests.growth import UNCOUNTED

#: IN is the capture, OUT a file to write. Each way to find packets, rows and findings is there once.
COMMANDS: Final = (
    "analyze IN",
    "analyze IN -T json",
    "analyze IN --connection 1 --time ..+1h -Y latency>1us",
    "transactions IN",
    "transactions IN -T csv -Y function==read",
    "transactions IN -T fields -e frame -e address -e value",
    "values IN",
    "values IN --summary",
    "operations IN",
    "blocks IN",
    "devices IN",
    "show IN",
    "show IN -Y function==read",
    "report IN -o OUT.html",
    "golden IN -o OUT",
    "diff IN IN",
    "anonymize IN -o OUT",
    "cut IN -o OUT -Y function==read",
    "cut IN -o OUT --connection 1",
    "cut IN -o OUT -Y host==10.16.0.0",
    "baseline IN -o OUT",
    "export IN -o OUT.csv",
    "export IN -o OUT.stix",
    "export IN -o ecs:OUT",
    "export IN -o zeek:OUT",
)
#: Packets of the three captures.
PACKETS: Final = (300, 600, 1200)
#: What the second step may take of what the first one takes, which is half as large. A search through all that was there
#: before makes it up to four times as much; what is sorted, and tables that fill up to their bound, a bit more than twice.
MOST: Final = 2.8


def counted(words: list[str]) -> int:
    """Return how many calls a command makes, those of functions in C among them."""
    calls = 0

    def count(frame: FrameType, event: str, argument: Any) -> None:
        nonlocal calls
        calls += event in {"call", "c_call"}

    runner = CliRunner()
    before = sys.getprofile()
    sys.setprofile(count)
    try:
        ran = runner.invoke(group, words)
    finally:
        sys.setprofile(before)
    assert ran.exit_code in {0, 1}, ran.output
    return calls


@pytest.fixture(scope="module")
def captures(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[Path]]:
    folder = tmp_path_factory.mktemp("growth")
    made: dict[str, list[Path]] = {"one connection": [], "connections": []}
    for packets in PACKETS:
        for name, connections in (("one connection", 1), ("connections", packets // 12)):
            made[name].append(folder / f"{connections}-{packets}.pcap")
            many_connections(made[name][-1], packets, connections)
    return made


@pytest.mark.skipif(COMPILED, reason=UNCOUNTED)
@pytest.mark.parametrize("command", COMMANDS)
def test_work_grows_with_the_packets(command: str, captures: dict[str, list[Path]], tmp_path: Path) -> None:
    for name, paths in captures.items():
        calls: list[int] = []
        for path in (paths[0], *paths):  # once more: modules that are imported, tables that are made once
            out = tmp_path / f"out-{path.stem}-{len(calls)}"
            words = command.replace("OUT", str(out)).replace("IN", str(path)).split()
            calls.append(counted(words))
        _, few, more, most = calls
        assert most - more <= MOST * (more - few), f"{name}: {calls}"
