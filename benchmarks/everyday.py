"""The cost of everyday lines and of each command beside ``analyze``: ``python -m benchmarks.everyday --compiled PYTHON``.

Each row is a pair: a command on a capture, and the command that it is compared with (A B A B …); the ratio is that of the
medians. The start is the time of the same command for a few packets; it is subtracted if a row says so. With ``--instructions``
both are counted by valgrind, once, which does not depend on the load of the machine.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Final, NamedTuple

from benchmarks.compare import DATA, say
from benchmarks.engines import MissingError, absolute, installed
from benchmarks.generate import generate, parse_count
from benchmarks.links import KINDS, twin
from benchmarks.many_connections import many_connections
from benchmarks.measure import CommandFailedError, machine, run
from benchmarks.tables import columns, piped

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

#: Packets of the captures that show the cost of a start.
_FEW: Final = 50
#: Connections of the two captures of `many_connections`, as parts of their packets.
_MANY_OF, _FEW_OF = 20, 2000
_COUNTED: Final = re.compile(rb"I\s+refs:\s+([\d,]+)")


class Side(NamedTuple):
    """One command on one capture; ``{out}`` in its words is a file to write. ``few`` is the capture for its start, if any."""

    words: tuple[str, ...]
    path: Path
    few: Path | None = None


class Row(NamedTuple):
    """A pair with its highest permitted ratio."""

    label: str
    one: Side
    other: Side
    bar: float


def captures(folder: Path, packets: int) -> dict[str, Path]:
    """Return the captures by name; make those that are not in ``folder`` yet."""
    folder.mkdir(parents=True, exist_ok=True)
    made: dict[str, Path] = {}

    def keep(name: str, file: str, make: Callable[[Path], object]) -> None:
        made[name] = path = folder / file
        if not path.exists():
            say(f"making {path}")
            make(path)

    for name, count in (("many", packets), ("few", _FEW)):
        keep(name, f"{count}.pcap", partial(_generate, count))
        for kind in KINDS:
            keep(f"{name} {kind}", f"{count}.{kind}", partial(_twin, made[name], kind))
    for name, part in (("own blocks", _MANY_OF), ("few connections", _FEW_OF)):
        connections = max(1, packets // part)
        keep(name, f"{packets}-over-{connections}.pcap", partial(_connections, packets, connections))
    return made


def _generate(packets: int, path: Path) -> None:
    generate(path, packets)


def _twin(source: Path, kind: str, path: Path) -> None:
    twin(source, kind, path)


def _connections(packets: int, connections: int, path: Path) -> None:
    many_connections(path, packets, connections)


def rows(made: dict[str, Path], small: Path) -> list[Row]:
    """Return the pairs, those of the links first. ``small`` is a capture of a few packets, like one that a person looks at."""
    plain = Side(("analyze",), made["many plain"], made["few plain"])
    found = [
        Row(
            f"analyze, {kind}",
            Side(("analyze",), made[f"many {kind}"], made[f"few {kind}"]),
            plain,
            1.25,
        )
        for kind in KINDS
        if kind != "plain"
    ]
    own, few = Side(("analyze",), made["own blocks"]), Side(("analyze",), made["few connections"])
    found.append(Row("analyze, a connection of 20 packets with reads of its own, against one of 2,000", own, few, 3))
    found.append(Row(f"devices, {small.name}", Side(("devices",), small), Side(("analyze",), small), 1.5))
    analyze = Side(("analyze",), made["many"], made["few"])
    for label, words, bar in (
        ("values", ("values",), 4),
        ("golden", ("golden", "-o", "{out}"), 5),
        ("anonymize", ("anonymize", "-o", "{out}"), 6),
        ("cut", ("cut", "-Y", "function == read", "-o", "{out}"), 3),
        ("show", ("show",), 3),
        ("report", ("report", "-o", "{out}"), 3),
    ):
        found.append(Row(label, Side(words, made["many"], made["few"]), analyze, bar))
    found.append(
        Row("report, 20,000 connections for each 400,000 packets", Side(("report", "-o", "{out}"), own.path), own, 3)
    )
    return found


class Meter:
    """Measures commands: seconds of CPU, or instructions."""

    def __init__(self, call: Sequence[str], work: Path, *, instructions: bool) -> None:
        self._call = list(call)
        self._work = work
        self._instructions = instructions

    def cost(self, side: Side) -> float:
        """Return the cost of one run, minus its start if the side has a capture for it."""
        spent = self._once(side.words, side.path)
        return spent - self._once(side.words, side.few) if side.few is not None else spent

    def _once(self, words: Sequence[str], path: Path) -> float:
        out = self._work / "out"
        out.unlink(missing_ok=True)
        command = [*self._call, words[0], str(path), *(word.replace("{out}", str(out)) for word in words[1:])]
        if self._instructions:
            return self._counted(command)
        return run(command, directory=self._work, fine=(0, 3)).cpu_s

    def _counted(self, command: list[str]) -> float:
        valgrind = ["valgrind", "--tool=cachegrind", "--cache-sim=no", "--cachegrind-out-file=/dev/null"]
        done = subprocess.run(
            [*valgrind, *command], cwd=self._work, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, check=False
        )
        found = _COUNTED.search(done.stderr)
        if found is None or done.returncode not in (0, 3):
            raise CommandFailedError(f"{' '.join(command)}: {done.stderr[-500:].decode(errors='replace')}")
        return int(found[1].replace(b",", b"")) / 1e6


def measure(meter: Meter, row: Row, runs: int) -> tuple[float, float]:
    """Return the medians of both sides, measured in turn."""
    pairs = [(meter.cost(row.one), meter.cost(row.other)) for _ in range(runs)]
    return median(one for one, _ in pairs), median(other for _, other in pairs)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit 0: every row is within its limit; 1: one is not; 2: nothing could be measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.everyday", description=__doc__)
    parser.add_argument(
        "--compiled", type=absolute, default=sys.executable, metavar="PYTHON", help="where it is installed"
    )
    parser.add_argument(
        "--packets", type=parse_count, default=400_000, metavar="N", help="of each capture (default 400k)"
    )
    parser.add_argument("--runs", type=int, default=3, help="pairs of runs of each row (default 3)")
    parser.add_argument(
        "--instructions", action="store_true", help="count instructions, one run each; slow: take few packets"
    )
    parser.add_argument("--rows", default="", metavar="WORDS", help="only rows with these words in their label")
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder for the captures (default {DATA})")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown to this file too")
    options = parser.parse_args(arguments)
    small = Path(__file__).parents[1] / "captures/nodes7-poll-missing.pcapng"
    lines = []
    missed = False
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        try:
            meter = Meter(installed(options.compiled, work), work, instructions=options.instructions)
            for row in rows(captures(options.data, options.packets), small):
                if options.rows not in row.label:
                    continue
                one, other = measure(meter, row, 1 if options.instructions else options.runs)
                missed |= one > row.bar * other
                lines.append((row.label, f"{one:,.2f}", f"{other:,.2f}", f"{one / other:.2f}", f"{row.bar:g}"))
                say("  ".join(lines[-1]))
        except (CommandFailedError, MissingError, OSError) as error:
            say(f"everyday: {error}")
            return 2
    unit = "M instructions" if options.instructions else "CPU s"
    heads = (f"{options.packets:,} packets", unit, "beside", "ratio", "at most")
    print(columns(heads, lines))
    print(machine())
    if options.markdown:
        options.markdown.write_text(piped(heads, lines), encoding="utf-8")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
