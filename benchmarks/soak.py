"""Measures the capacity of the monitor: how many packets it can follow, for how long, and with which delay.

``python -m benchmarks.soak``. Five tables. Rates: the highest packet rate without any loss, through our monitor by either
engine, Scapy's AsyncSniffer and pyshark's LiveCapture, on the same line with the same frames. Hold: our monitor for a minute at
its promised rates. Delay: from a packet on the wire to its line on the monitor's output. Silence: the cost of a silent line.
Day: memory over the equivalent of 24 hours, without a network card.

The line is a veth pair in a network namespace (Linux, root or CAP_SYS_ADMIN, CAP_NET_ADMIN and CAP_NET_RAW).
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any, Final

from benchmarks.compare import DATA, capture, say
from benchmarks.engines import ROOT, MissingError, absolute
from benchmarks.generate import parse_count
from benchmarks.measure import CommandFailedError, machine
from benchmarks.soak_line import FAR, NoLineError, enter, wait_for_watcher
from benchmarks.soak_trials import SenderProcess, attempt, delays_ms, search
from benchmarks.soak_watchers import MONITORS, NAMES, Watch, Watcher, cpu_s, everything, monitor, monitor_call, other
from benchmarks.tables import columns, piped

if TYPE_CHECKING:
    from collections.abc import Sequence

    from benchmarks.soak_trials import Trial

#: The promises: packets per second by engine, multiples of the rates of Scapy and pyshark, median delay at a low rate, growth
#: in a day.
HOLD: Final = {"ring": 150_000, "dumpcap": 75_000}
TIMES: Final = 10.0
DELAY_MS: Final = 200.0
SILENT_PERCENT: Final = 1.0
MOST_GROWTH: Final = 1.05
PARTS: Final = ("rates", "hold", "delay", "silence", "day")
#: Rates besides the marked transactions whose delay is measured (-1: as many as possible), and marks per second.
LOADS: Final = (0, 20_000, 75_000, -1)
_MARKS: Final = 20.0
#: Finds the package first and these benchmarks after it.
_DAY: Final = (
    "import sys, dissect.engine.pipeline; sys.path.append({root!r}); "
    "from benchmarks.soak_day import main; sys.exit(main())"
)

Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]


class Bench:
    """Shared by all parts: the line's sender, the monitor's call, the work folder; and the results for ``--json``."""

    def __init__(self, python: str, path: str, file: Path, work: Path) -> None:
        self.call, self.environment, self.build = monitor_call(python, path, work)
        self.python = python
        self.sender = SenderProcess(file)
        self.work = work
        self.figures: dict[str, Any] = {"build": self.build}
        self.kept = True
        self.everything = False  # the monitor writes and serves everything that it supports

    def own(self, engine: str, only: str = "findings") -> Watcher:
        """Return our monitor as a watcher."""
        beside = everything(self.work) if self.everything else []
        return monitor(self.call, self.environment, self.build, engine, FAR, only, beside)

    def verdict(self, kept: bool) -> str:
        """Return the text of the table for a promise, and remember a broken one."""
        self.kept = self.kept and kept
        return "kept" if kept else "BROKEN"


def rates(bench: Bench, names: Sequence[str], seconds: float, runs: int, most: int) -> Table:
    """Search, in turn, for the highest rate of each; return the median of ``runs`` searches."""
    heads = ("watcher", "held packets/s", "of runs", "µs CPU/packet", "ring / it", "dumpcap / it")
    found: dict[str, list[Trial]] = {}
    watchers: dict[str, Watcher] = {}
    for name in names:
        try:
            watchers[name] = bench.own(name) if name in MONITORS else other(name, FAR)
        except MissingError as error:
            say(f"not measured: {error}")
    for number in range(runs):
        for name, watcher in watchers.items():
            best = search(watcher, bench.sender, seconds, bench.work, most)
            say(f"run {number + 1}: {watcher.label}: {f'{best.rate:,.0f}/s' if best else 'nothing'} held")
            if best is not None:
                found.setdefault(name, []).append(best)
    held = {name: median([trial.rate for trial in trials]) for name, trials in found.items()}
    bench.figures["rates"] = {name: [trial.as_dict() for trial in trials] for name, trials in found.items()}
    lines: list[tuple[str, ...]] = []
    for name, rate in held.items():
        cost = median([trial.cpu_s / trial.seen * 1e6 for trial in found[name]])
        ratios = [f"{held[own] / rate:.1f}" if own in held else "-" for own in MONITORS]
        several = " ".join([f"{trial.rate:,.0f}" for trial in found[name]])
        lines.append((watchers[name].label, f"{rate:,.0f}", several, f"{cost:.1f}", *ratios))
        if name not in MONITORS:
            bench.verdict(all([held[own] >= TIMES * rate for own in MONITORS if own in held]))
    return f"Highest rate with nothing lost, {seconds:.0f} s each", heads, lines


@contextmanager
def beside(count: int) -> Iterator[None]:
    """Keep ``count`` processes in busy loops, at the priority of an ordinary process."""
    loops: list[subprocess.Popen[bytes]] = []
    try:
        for _ in range(count):
            loops.append(subprocess.Popen([sys.executable, "-c", "while True: pass"]))
            if os.getpriority(os.PRIO_PROCESS, 0) < 0:
                os.setpriority(os.PRIO_PROCESS, loops[-1].pid, 0)
        yield
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()


def hold_rate(text: str) -> tuple[str, int]:
    """Read ``ring=250k``. Raises argparse.ArgumentTypeError."""
    name, _, rate = text.partition("=")
    if name not in HOLD:
        raise argparse.ArgumentTypeError(
            f"{text}: expected one of {', '.join(HOLD)}, = and packets/s, such as ring=250k"
        )
    return name, parse_count(rate)


def hold(bench: Bench, names: Sequence[str], seconds: float, rates: dict[str, int]) -> Table:
    """Our monitor at the promised rates, or those in ``rates``, for longer."""
    heads = ("watcher", "packets/s", "seconds", "sent", "seen", "kernel drops", "CPU s", "verdict")
    lines: list[tuple[str, ...]] = []
    for name in names:
        if name in MONITORS:
            watcher = bench.own(name)
            # With everything enabled it also writes a page and its tables when it ends.
            patience = 20.0 if bench.everything else 1.0
            rate = rates.get(name, HOLD[name])
            trial = attempt(watcher, bench.sender, rate, seconds, bench.work, patience=patience)
            bench.figures.setdefault("hold", {})[name] = trial.as_dict()
            dropped = "?" if trial.kernel is None else f"{trial.kernel:,}"
            lines.append(
                (
                    watcher.label,
                    f"{trial.rate:,.0f}",
                    f"{trial.seconds:.0f}",
                    f"{trial.sent:,}",
                    f"{trial.seen:,}",
                    dropped,
                    f"{trial.cpu_s:.1f}",
                    bench.verdict(trial.held),
                )
            )
    return "The rates promised, held for longer", heads, lines


def delays(bench: Bench, names: Sequence[str], seconds: float) -> Table:
    """The time from a marked transaction to its line, alone and under load; the monitor writes every transaction."""
    heads = (
        "watcher",
        "packets/s beside",
        "marked",
        "told",
        "median ms",
        "95 % ms",
        "most ms",
        "events lost",
        "verdict",
    )
    lines: list[tuple[str, ...]] = []
    for name in names:
        for load in LOADS if name in MONITORS else ():
            watcher = bench.own(name, "transactions")
            trial = attempt(watcher, bench.sender, load, seconds, bench.work, _MARKS)
            found = sorted(delays_ms(trial)) or [float("inf")]
            middle, late = median(found), found[int(0.95 * (len(found) - 1))]
            bench.figures.setdefault("delay", []).append(
                {"engine": name, "load": load, "median_ms": middle, "p95_ms": late, "max_ms": found[-1],
                 "marked": len(trial.marks), "told": len(found), "trial": trial.as_dict()}
            )  # fmt: skip
            kept = bench.verdict(trial.held and middle < DELAY_MS) if load == 0 else "-"
            figures = [f"{value:,.0f}" for value in (middle, late, found[-1])]
            lines.append(
                (
                    watcher.label,
                    f"{trial.rate if load < 0 else load:,.0f}",
                    f"{len(trial.marks)}",
                    f"{len(found)}",
                    *figures,
                    f"{trial.lost_events:,}",
                    kept,
                )
            )
    return "From the wire to the line", heads, lines


def silence(bench: Bench, names: Sequence[str], seconds: float) -> Table:
    """The cost of the monitor, and dumpcap with it, while no packets come."""
    heads = ("watcher", "seconds", "CPU s", "% of a core", "verdict")
    lines: list[tuple[str, ...]] = []
    for name in names:
        if name in MONITORS:
            watcher = bench.own(name)
            watch = Watch(watcher, bench.work)
            try:
                if not wait_for_watcher(watcher.settle_s):
                    raise NoLineError(f"{watcher.label} did not begin")
                time.sleep(2)
                before, begun = cpu_s(watch.pid), time.monotonic()
                time.sleep(seconds)
                spent, took = cpu_s(watch.pid) - before, time.monotonic() - begun
            finally:
                watch.close()
            percent = 100 * spent / took
            bench.figures.setdefault("silence", {})[name] = percent
            verdict = bench.verdict(percent <= SILENT_PERCENT)
            lines.append((watcher.label, f"{took:.0f}", f"{spent:.2f}", f"{percent:.2f}", verdict))
    return "A silent line", heads, lines


def day(bench: Bench, hours: float, churn: int, busy_every: int) -> Table:
    """Memory over a day."""
    heads = (
        "build",
        "hours",
        "packets",
        "connections",
        "MB at 25 %",
        "50 %",
        "75 %",
        "100 %",
        "growth",
        "peak MB",
        "CPU s",
        "verdict",
    )
    code = _DAY.format(root=str(ROOT))
    words = ["--hours", str(hours), "--churn", str(churn), "--busy-every", str(busy_every)]
    done = subprocess.run(
        [bench.python, "-P", "-c", code, *words],
        stdout=subprocess.PIPE,
        text=True,
        env=bench.environment,
        cwd=bench.work,
        check=False,
    )
    if done.returncode:
        raise CommandFailedError("the day did not end well; what it said stands above")
    told = json.loads(done.stdout)
    bench.figures["day"] = told
    resident = told["resident_kb"]
    growth = resident[-1] / resident[0]
    figures = [f"{kib * 1024 / 1e6:.1f}" for kib in resident]
    verdict = bench.verdict(growth <= MOST_GROWTH and not told["failures"])
    line = (
        told["build"],
        f"{told['hours']:.0f}",
        f"{told['packets']:,}",
        f"{told['connections']:,}",
        *figures,
        f"{growth:.3f}",
        f"{told['peak_kb'] * 1024 / 1e6:.1f}",
        f"{told['cpu_s']:.0f}",
        verdict,
    )
    return "A day", heads, [line]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit 0: every promise kept; 1: not; 2: cannot be measured."""
    options = _options(arguments)
    with suppress(OSError):
        os.nice(options.nice)
    options.data.mkdir(parents=True, exist_ok=True)
    file, _ = capture(options.data, options.packets)
    tables: list[Table] = []
    with tempfile.TemporaryDirectory() as folder:
        try:
            enter()
            bench = Bench(options.python, options.path, file, Path(folder))
            bench.everything = options.everything
            try:
                offered = bench.sender.send(-1, 2.0)["rate"]
                say(f"the sender can offer {offered:,.0f} packets/s while nobody watches")
                bench.figures["offered"] = offered
                if "rates" in options.parts:
                    tables.append(rates(bench, options.watchers, options.seconds, options.runs, options.most))
                if "hold" in options.parts:
                    with beside(options.busy):
                        tables.append(hold(bench, options.watchers, options.hold, dict(options.hold_rate)))
                if "delay" in options.parts:
                    tables.append(delays(bench, options.watchers, options.seconds))
                if "silence" in options.parts:
                    tables.append(silence(bench, options.watchers, 2 * options.seconds))
            finally:
                bench.sender.close()
            if "day" in options.parts:
                tables.append(day(bench, options.hours, options.churn, options.busy_every))
        except (CommandFailedError, MissingError, NoLineError, OSError) as error:
            say(f"soak: {error}")
            return 2
    for title, heads, lines in tables:
        print(f"{title}\n{columns(heads, lines)}\n")
    print(f"The sender can offer {bench.figures['offered']:,.0f} packets/s while nobody watches")
    print(f"Machine: {machine()}")
    if options.markdown:
        told = "".join(f"### {title}\n\n{piped(heads, lines)}\n" for title, heads, lines in tables)
        options.markdown.write_text(f"{told}Machine: {machine()}\n", encoding="utf-8")
    if options.json:
        options.json.write_text(json.dumps(bench.figures, indent=1) + "\n", encoding="utf-8")
    return 0 if bench.kept else 1


def _options(arguments: Sequence[str] | None) -> argparse.Namespace:
    from benchmarks.soak_day import BUSY_EVERY, CHURN

    parser = argparse.ArgumentParser(prog="python -m benchmarks.soak", description=__doc__)
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS), help="which tables (all)")
    parser.add_argument(
        "--watchers", nargs="+", choices=NAMES, default=list(NAMES), metavar="NAME", help=", ".join(NAMES)
    )
    parser.add_argument("--seconds", type=float, default=10.0, help="of each trial (default 10; silence: twice that)")
    parser.add_argument("--hold", type=float, default=60.0, help="seconds at the promised rates (default 60)")
    parser.add_argument("--hold-rate", type=hold_rate, nargs="+", default=[], metavar="NAME=RATE",
                        help="hold these instead of the rates promised, such as ring=250k dumpcap=150k")  # fmt: skip
    parser.add_argument("--everything", action="store_true", help="with evidence, tables, pages, alerts and metrics")
    parser.add_argument("--busy", type=int, default=0, metavar="N", help="busy loops beside what is held (default 0)")
    parser.add_argument("--runs", type=int, default=3, help="searches for each watcher (default 3)")
    parser.add_argument("--most", type=parse_count, default=400_000, metavar="N", help="no rate above this (400k)")
    parser.add_argument("--packets", type=parse_count, default=500_000, metavar="N", help="size of the made capture")
    parser.add_argument(
        "--python", type=absolute, default=sys.executable, help="python of the monitor (where s7dissect is installed)"
    )
    parser.add_argument("--path", default="", help="folder with the package, instead of the one installed for --python")
    parser.add_argument("--nice", type=int, default=-10, help="priority of all that is measured (default -10)")
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--churn", type=int, default=CHURN, help="connections opened and closed in a busy minute")
    parser.add_argument("--busy-every", type=int, default=BUSY_EVERY, help="every which minute is busy (1: all)")
    parser.add_argument("--data", type=Path, default=DATA, help=f"folder for the capture (default {DATA})")
    parser.add_argument("--markdown", type=Path, help="write the tables as Markdown to this file too")
    parser.add_argument("--json", type=Path, help="write all figures to this file too")
    return parser.parse_args(arguments)


if __name__ == "__main__":
    sys.exit(main())
