"""Measure the engines side by side in one run: ``python -m benchmarks.compare``.

Makes the captures (kept in the folder for the next run), checks the engines' results against the truth, runs the engines in
turn, and prints medians: CPU seconds (user and system) of the whole process, packets a second, peak memory, and the ratio to
``tshark -T fields`` with the same facts.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.check import check_analysis, check_transactions, count_tshark
from benchmarks.engines import NAMES, YARDSTICK, Engine, MissingError, absolute, engines, installed
from benchmarks.generate import generate, parse_count, truth_path
from benchmarks.measure import CommandFailedError, Cost, machine, middle, run
from benchmarks.tables import Row, markdown, text

if TYPE_CHECKING:
    from collections.abc import Sequence

DATA = Path(tempfile.gettempdir()) / "s7dissect-benchmarks"
#: 3: finished on damaged input. Synthetic captures are complete, but a truth of our own may be measured on captures that are
#: not.
_FINE = (0, 3)


class Options:
    """The options of the command line."""

    def __init__(self, arguments: Sequence[str] | None) -> None:
        parser = argparse.ArgumentParser(prog="python -m benchmarks.compare", description=__doc__)
        parser.add_argument("--sizes", nargs="+", type=parse_count, default=[100_000, 1_000_000], metavar="N")
        parser.add_argument(
            "--engines", nargs="+", choices=NAMES, default=list(NAMES), metavar="NAME", help=", ".join(NAMES)
        )
        parser.add_argument("--runs", type=int, default=3, help="runs of each engine on each file (default 3)")
        parser.add_argument(
            "--compiled", type=absolute, default=sys.executable, metavar="PYTHON", help="python where it is installed"
        )
        parser.add_argument(
            "--interpreted", type=absolute, default=sys.executable, metavar="PYTHON", help="python to run the source"
        )
        parser.add_argument("--data", type=Path, default=DATA, help=f"folder for the captures (default {DATA})")
        parser.add_argument("--markdown", type=Path, help="write the table as Markdown to this file too")
        parser.add_argument("--json", type=Path, help="write all figures to this file too")
        parser.add_argument("--no-check", action="store_true", help="do not hold the results against the truth")
        found = parser.parse_args(arguments)
        self.sizes: list[int] = sorted(found.sizes)
        self.engines: list[str] = found.engines
        self.runs: int = found.runs
        self.compiled: str = found.compiled
        self.interpreted: str = found.interpreted
        self.data: Path = found.data
        self.markdown: Path | None = found.markdown
        self.json: Path | None = found.json
        self.check: bool = not found.no_check
        if self.runs < 1:
            parser.error("--runs: at least 1")


def capture(folder: Path, packets: int) -> tuple[Path, dict[str, Any]]:
    """Return the synthetic capture of ``packets`` packets and its truth; make them unless they exist already."""
    path = folder / f"{packets}.pcap"
    truth = truth_path(path)
    if not path.exists() or not truth.exists():
        say(f"making {path}")
        generate(path, packets)
    told: dict[str, Any] = json.loads(truth.read_text(encoding="ascii"))
    return path, told


def say(words: str) -> None:
    """Report progress on standard error."""
    print(words, file=sys.stderr, flush=True)


def verify(engine: Engine, path: Path, truth: dict[str, Any], work: Path) -> list[str]:
    """Run an engine once for its results; return a sentence for each wrong one."""
    out = work / "told"
    run(engine.command(path), environment=engine.environment, directory=work, output=out, fine=_FINE)
    try:
        if engine.name.startswith("analyze"):
            return check_analysis(json.loads(out.read_bytes()), truth)
        if engine.name.startswith("transactions"):
            return check_transactions(out, truth)
        seen, true = count_tshark(out), truth["s7"]["pdus"]
        return [] if seen == true else [f"S7 PDUs: told {seen}, true {true} ({seen - true:+d})"]
    except (KeyError, TypeError, ValueError) as error:
        return [f"what it told cannot be read: {error!r}"]
    finally:
        out.unlink()


def measure(chosen: list[Engine], path: Path, packets: int, runs: int, work: Path) -> dict[str, Cost]:
    """Run the engines in turn, ``runs`` times; return the medians by name. The output is discarded."""
    costs: dict[str, list[Cost]] = {}
    for number in range(runs):
        for engine in chosen:
            if engine.most and packets > engine.most:
                continue
            cost = run(engine.command(path), environment=engine.environment, directory=work, fine=_FINE)
            costs.setdefault(engine.name, []).append(cost)
            say(f"run {number + 1}: {engine.label}: {cost.cpu_s:.2f} s CPU, {cost.wall_s:.2f} s, {cost.peak_mb:.0f} MB")
    return {name: middle(several) for name, several in costs.items()}


def start_up(python: str, work: Path, runs: int) -> float:
    """Return the median wall time in seconds of ``s7dissect --version``."""
    call = installed(python, work)
    return middle([run([*call, "--version"], directory=work) for _ in range(max(runs, 5))]).wall_s


def rows(chosen: list[Engine], costs: dict[str, Cost], packets: int) -> list[Row]:
    """Return the lines of the table for one file."""
    yardstick = costs.get(YARDSTICK)
    made: list[Row] = []
    for engine in chosen:
        cost = costs.get(engine.name)
        if cost is not None:
            ratio = yardstick.cpu_s / cost.cpu_s if yardstick else 0.0
            made.append(Row(engine.label, packets, cost, ratio))
    return made


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command.

    Exit 0: all results were right (tshark apart); 1: those of an own engine were not; 2: an engine was not measured.
    """
    options = Options(arguments)
    options.data.mkdir(parents=True, exist_ok=True)
    table: list[Row] = []
    notes = [f"Machine: {machine()}; median of {options.runs} runs, turn by turn"]
    wrong = 0
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        chosen, lacking = engines(options.engines, options.compiled, options.interpreted, work)
        notes += [f"Not measured: {words}" for words in lacking]
        try:
            for packets in options.sizes:
                path, truth = capture(options.data, packets)
                for engine in chosen:
                    if options.check and engine.name.startswith(("analyze", "transactions", YARDSTICK)):
                        faults = verify(engine, path, truth, work)
                        wrong += bool(faults) and engine.name != YARDSTICK
                        notes.append(f"Truth, {packets} packets, {engine.label}: {'; '.join(faults) or 'all as made'}")
                        say(notes[-1])
                table += rows(chosen, measure(chosen, path, packets, options.runs, work), packets)
            if any(engine.name.endswith("-compiled") for engine in chosen):
                seconds = start_up(options.compiled, work, options.runs)
                notes.append(f"s7dissect --version: {seconds:.3f} s wall time")
        except (CommandFailedError, MissingError, OSError) as error:
            say(f"compare: {error}")
            return 2
    print(text(table))
    print("\n".join(notes))
    if options.markdown:
        options.markdown.write_text(markdown(table) + "\n" + "".join(f"* {note}\n" for note in notes), encoding="utf-8")
    if options.json:
        told = {"rows": [row.as_dict() for row in table], "notes": notes}
        options.json.write_text(json.dumps(told, indent=1) + "\n", encoding="utf-8")
    if lacking:
        return 2
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
