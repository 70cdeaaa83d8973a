"""`dissect.frames` compared with `dissect.values`: CPU in turn (A B A B), each in its own process, and peak memory.

`python -m benchmarks.library FILE [--python PYTHON] [--rounds N]`; CPU excludes the import of the package.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from statistics import median

from benchmarks.measure import run

_PROGRAMS = {
    "start": "import dissect, sys; import dissect.output.export.frames, dissect.output.variables.reading",
    "values": "import dissect, sys; [None for _ in dissect.values(sys.argv[1])]",
    "frames": "import dissect, sys; dissect.frames(sys.argv[1], library='arrow')",
}


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("file", type=Path, help="a capture, such as those of benchmarks.generate")
    parser.add_argument("--python", default=sys.executable, help="the python whose s7dissect is measured")
    parser.add_argument("--rounds", type=int, default=5)
    arguments = parser.parse_args()
    cpu: dict[str, list[float]] = {name: [] for name in _PROGRAMS}
    peak = dict.fromkeys(_PROGRAMS, 0.0)
    for _ in range(arguments.rounds):
        for name, program in _PROGRAMS.items():
            cost = run([arguments.python, "-c", program, str(arguments.file.resolve())])
            cpu[name].append(cost.cpu_s)
            peak[name] = max(peak[name], cost.peak_mb)
    start = median(cpu["start"])
    values, frames = (median(cpu[name]) - start for name in ("values", "frames"))
    print(f"values {values:.2f} s CPU, peak {peak['values']:.0f} MB")
    print(f"frames {frames:.2f} s CPU, peak {peak['frames']:.0f} MB: {frames / values:.1f} times the CPU of values")
    return 0


if __name__ == "__main__":
    sys.exit(main())
