"""Checks whether time per packet and memory stay constant. ``python -m benchmarks.growth``.

Three tables. Files: made captures of growing size through the command. Streams: the eight endless streams, fed to the engine in
a child process that samples its own memory after each quarter; memory may grow by 5 % from the first quarter to the end and
must stay under 256 MB, twice the packets may take 2.3 times the time, and no packet more than 50 ms. Flood: malformed PDUs
through the command, whose report must stay under 10 MB.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from benchmarks.compare import DATA, capture, say
from benchmarks.engines import ROOT, MissingError, absolute, installed, interpreted
from benchmarks.generate import parse_count
from benchmarks.measure import CommandFailedError, machine, middle, run
from benchmarks.profiles import GIB, Extent, write_profile
from benchmarks.streams import ENDLESS, FLOOD_FAULTS, MTU, SMALL, flood_packets, stream
from benchmarks.tables import columns, piped

if TYPE_CHECKING:
    from collections.abc import Sequence

#: The promises (octets are 10**6 for MB).
MOST_GROWTH = 1.05
MOST_MB = 256
MOST_TIME = 2.3
MOST_PACKET_MS = 50
MOST_REPORT_MB = 10

#: Finds the package first and these benchmarks after it, so that an installed package is not shadowed by the tree.
_CHILD = (
    "import sys, dissect.engine.pipeline; sys.path.append({root!r}); from benchmarks.feed import main; sys.exit(main())"
)

Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]


def packets_of(name: str, gib: float, size: int) -> int:
    """Return the number of packets of a stream that make ``gib`` GiB of capture file."""
    sample = [len(frame) + 16 for _, frame in islice(stream(name, size), 5000)]
    return int(gib * GIB / (sum(sample) / len(sample)))


def feed(
    call: list[str], environment: dict[str, str] | None, name: str, packets: int, size: int, work: Path
) -> dict[str, Any]:
    """Feed a stream in a child process of the python ``call`` and return what it measured (see `benchmarks.feed`)."""
    command = [*call, "-P", "-c", _CHILD.format(root=str(ROOT)), name, str(packets), "--size", str(size)]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=work, check=False)
    if done.returncode:
        raise CommandFailedError(f"{name}: {done.stderr.strip()[-2000:]}")
    told: dict[str, Any] = json.loads(done.stdout)
    return told


def faults(half: dict[str, Any], whole: dict[str, Any]) -> list[str]:
    """Return the promises that a stream broke, from a run of N packets and one of 2 N."""
    first, *_, last = whole["resident_kb"]
    broken = []
    if last > MOST_GROWTH * first:
        broken.append(f"memory grew {last / first:.2f} times")
    if whole["peak_kb"] * 1024 > MOST_MB * 1e6:
        broken.append(f"peak {whole['peak_kb'] * 1024 / 1e6:.0f} MB")
    if cpu(whole) > MOST_TIME * cpu(half):
        broken.append(f"twice the packets took {cpu(whole) / cpu(half):.2f} times the time")
    if whole["worst_ns"] > MOST_PACKET_MS * 1e6:
        broken.append(f"one packet took {whole['worst_ns'] / 1e6:.0f} ms")
    if whole["accounted"] != whole["packets"]:
        broken.append(f"{whole['packets'] - whole['accounted']} packets not accounted for")
    return broken


def cpu(told: dict[str, Any]) -> int:
    """Return the engine's CPU time for a whole stream, its end included, in ns."""
    return int(told["cpu_ns"]["all"] + told["cpu_ns"]["finish"])


def streams(
    names: Sequence[str], gib: float, size: int, call: list[str], environment: dict[str, str] | None, work: Path
) -> Table:
    """Measure the endless streams."""
    heads = (
        "stream",
        "packets",
        "MB at 25 %",
        "MB at 100 %",
        "growth",
        "peak MB",
        "µs/packet",
        "time 2N/N",
        "worst ms",
        "verdict",
    )
    lines: list[tuple[str, ...]] = []
    for name in names:
        packets = packets_of(name, gib, size)
        half = feed(call, environment, name, packets // 2, size, work)
        whole = feed(call, environment, name, packets, size, work)
        first, *_, last = whole["resident_kb"]
        broken = faults(half, whole)
        lines.append(
            (
                name,
                f"{packets:,}",
                f"{first * 1024 / 1e6:.1f}",
                f"{last * 1024 / 1e6:.1f}",
                f"{last / first:.2f}",
                f"{whole['peak_kb'] * 1024 / 1e6:.1f}",
                f"{cpu(whole) / packets / 1000:.2f}",
                f"{cpu(whole) / cpu(half):.2f}",
                f"{whole['worst_ns'] / 1e6:.1f}",
                "; ".join(broken) or "kept",
            )
        )
        say(f"{name}: {lines[-1][-1]}")
    return f"Endless streams, {gib} GiB each, {size} octets of data", heads, lines


def files(
    sizes: Sequence[int], call: list[str], environment: dict[str, str] | None, runs: int, data: Path, work: Path
) -> Table:
    """Measure the commands on made captures of growing size."""
    heads = ("command", "packets", "CPU s", "µs/packet", "peak MB")
    lines: list[tuple[str, ...]] = []
    for words in (["analyze", "-T", "json"], ["transactions", "-T", "jsonl"]):
        for packets in sizes:
            path, _ = capture(data, packets)
            costs = [run([*call, *words, str(path)], environment=environment, directory=work) for _ in range(runs)]
            cost = middle(costs)
            lines.append(
                (
                    " ".join(words),
                    f"{packets:,}",
                    f"{cost.cpu_s:.2f}",
                    f"{cost.cpu_s / packets * 1e6:.3f}",
                    f"{cost.peak_mb:.1f}",
                )
            )
            say(" ".join(lines[-1]))
    return f"Made captures, median of {runs} runs", heads, lines


def flood(sizes: Sequence[int], call: list[str], environment: dict[str, str] | None, work: Path) -> Table:
    """Measure the commands on a flood of malformed PDUs."""
    heads = ("command", "malformed PDUs", "CPU s", "µs/packet", "peak MB", "report MB", "verdict")
    lines: list[tuple[str, ...]] = []
    path, report = work / "badpdu.pcap", work / "report"
    for faulty in sizes:
        packets = flood_packets(-(-faulty // FLOOD_FAULTS))
        with path.open("wb") as file:
            write_profile(file, "badpdu", Extent(packets=packets))
        for kind in ("text", "json"):
            cost = run(
                [*call, "analyze", "-T", kind, str(path)], environment=environment, directory=work, output=report
            )
            told_mb = report.stat().st_size / 1e6
            lines.append(
                (
                    f"analyze -T {kind}",
                    f"{faulty:,}",
                    f"{cost.cpu_s:.2f}",
                    f"{cost.cpu_s / packets * 1e6:.2f}",
                    f"{cost.peak_mb:.1f}",
                    f"{told_mb:.3f}",
                    "kept" if told_mb <= MOST_REPORT_MB else "report too long",
                )
            )
            say(" ".join(lines[-1]))
    return "Flood of malformed PDUs", heads, lines


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit 0: every promise kept; 1: not; 2: cannot be measured."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.growth", description=__doc__)
    parser.add_argument(
        "--parts", nargs="+", choices=("files", "streams", "flood"), default=["files", "streams", "flood"]
    )
    parser.add_argument("--sizes", nargs="+", type=parse_count, default=[100_000, 1_000_000, 5_000_000], metavar="N")
    parser.add_argument("--gib", type=float, default=0.05, help="size of each stream (before a release: 1)")
    parser.add_argument(
        "--streams", nargs="+", choices=ENDLESS, default=list(ENDLESS), metavar="NAME", help=", ".join(ENDLESS)
    )
    parser.add_argument("--mtu", action="store_true", help="frames that fill the MTU instead of small ones")
    parser.add_argument("--flood", nargs="+", type=parse_count, default=[100_000, 1_000_000], metavar="N")
    parser.add_argument("--runs", type=int, default=3, help="runs of each command on each made capture")
    parser.add_argument(
        "--compiled", type=absolute, default=sys.executable, metavar="PYTHON", help="python where it is installed"
    )
    parser.add_argument("--interpreted", action="store_true", help="measure the source here, interpreted, instead")
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder for the captures (default {DATA})")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown to this file too")
    options = parser.parse_args(arguments)
    options.data.mkdir(parents=True, exist_ok=True)
    tables: list[Table] = []
    with tempfile.TemporaryDirectory() as folder:
        work = Path(folder)
        try:
            environment: dict[str, str] | None = {
                key: value for key, value in os.environ.items() if key != "PYTHONPATH"
            }
            if options.interpreted:
                call, environment = interpreted(sys.executable, work)
                python = sys.executable
            else:
                call, python = installed(options.compiled, work), options.compiled
            if "files" in options.parts:
                tables.append(files(options.sizes, call, environment, options.runs, options.data, work))
            if "streams" in options.parts:
                size = MTU if options.mtu else SMALL
                tables.append(streams(options.streams, options.gib, size, [python], environment, work))
            if "flood" in options.parts:
                tables.append(flood(options.flood, call, environment, work))
        except (CommandFailedError, MissingError, OSError) as error:
            say(f"growth: {error}")
            return 2
    told = "".join(f"### {title}\n\n{piped(heads, lines)}\n" for title, heads, lines in tables)
    for title, heads, lines in tables:
        print(f"{title}\n{columns(heads, lines)}\n")
    print(f"Machine: {machine()}")
    if options.markdown:
        options.markdown.write_text(f"{told}Machine: {machine()}\n", encoding="utf-8")
    kept = all(line[-1] == "kept" for _, heads, lines in tables if heads[-1] == "verdict" for line in lines)
    return 0 if kept else 1


if __name__ == "__main__":
    sys.exit(main())
