"""Feed an endless stream to the engine in this process and measure memory and time from within; prints one JSON object.

Run as a child by `benchmarks.growth` and by the tests: whichever package ``dissect`` is found first is measured. The stream is
made in batches outside the measured time, in constant memory, so growth is the engine's.
"""

from __future__ import annotations

import argparse
import gc
import json
import os
import sys
from itertools import islice
from pathlib import Path
from time import perf_counter_ns, thread_time_ns
from typing import TYPE_CHECKING

from benchmarks.streams import NAMES, SMALL, stream
from dissect.engine.pipeline import Pipeline
from dissect.meaning.report.analysis import Analysis
from dissect.wire.build import COMPILED

if TYPE_CHECKING:
    from collections.abc import Sequence

_ETHERNET = 1
_BATCH = 256
_QUARTERS = 4


def resident_kb() -> int:
    """Return the resident memory of this process in KiB."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") // 1024


def peak_kb() -> int:
    """Return the peak of it since this program was loaded."""
    for line in Path("/proc/self/status").read_text(encoding="ascii").splitlines():
        if line.startswith("VmHWM:"):
            return int(line.split()[1])
    return 0


def feed(name: str, packets: int, size: int = SMALL) -> dict[str, object]:
    """Feed ``packets`` packets of the stream ``name`` to everything that `analyze` uses, and return the cost.

    ``resident_kb`` after each quarter and ``peak_kb``; ``cpu_ns`` of the engine for the first half, for all, and for the end;
    ``worst_ns``, the longest single packet (never more than the CPU time of its batch: the machine may have paused us).
    """
    analysis = Analysis()
    pipeline = Pipeline(analysis)
    frames = stream(name, size)
    resident: list[int] = []
    spent = half = worst = done = octets = 0
    for quarter in range(1, _QUARTERS + 1):
        goal = packets * quarter // _QUARTERS
        while done < goal:
            batch = list(islice(frames, min(_BATCH, goal - done)))
            longest = 0
            begun = thread_time_ns()
            before = perf_counter_ns()
            for time_ns, frame in batch:
                pipeline.frame(time_ns, frame, 0, len(frame), len(frame), _ETHERNET)
                after = perf_counter_ns()
                longest = max(longest, after - before)
                before = after
            taken = thread_time_ns() - begun
            spent += taken
            worst = max(worst, min(longest, taken))
            done += len(batch)
            octets += sum(len(frame) for _, frame in batch)
        resident.append(resident_kb())
        if quarter == _QUARTERS // 2:
            half = spent
    begun = thread_time_ns()
    pipeline.finish()
    end = thread_time_ns() - begun
    counts = pipeline.counters.packet_counts()
    return {
        "profile": name,
        "build": "compiled" if COMPILED else "interpreted",
        "packets": done,
        "octets": octets,
        "accounted": sum(counts.values()),
        "resident_kb": resident,
        "peak_kb": peak_kb(),
        "cpu_ns": {"half": half, "all": spent, "finish": end},
        "worst_ns": worst,
        "transactions": analysis.total,
        "findings": sum(pipeline.finding_counts.values()),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.feed", description=__doc__)
    parser.add_argument("profile", choices=NAMES)
    parser.add_argument("packets", type=int)
    parser.add_argument("--size", type=int, default=SMALL, help="user data of a hostile segment")
    options = parser.parse_args(arguments)
    # as in the commands that read captures: the collector's walks would cause most of the growth, and the longest pauses
    gc.disable()
    json.dump(feed(options.profile, options.packets, options.size), sys.stdout)
    sys.stdout.write("\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
