"""Parquet of transactions and items: packets a second, and peak memory, which must not grow with the capture.

`python -m benchmarks.export FILE… [--python PYTHON]` runs `s7dissect export` on each FILE in its own process, and compares the
written rows with the counts of `analyze`.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.measure import run


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("files", nargs="+", metavar="FILE", help="captures, such as those of benchmarks.generate")
    parser.add_argument("--python", default=sys.executable, help="the python whose s7dissect is measured")
    arguments = parser.parse_args()
    wrong = 0
    for file in arguments.files:
        command = [arguments.python, "-m", "dissect"]
        told = subprocess.run([*command, "analyze", "-T", "json", file], capture_output=True, check=True)
        analysis = json.loads(told.stdout)
        packets = analysis["packets"]["read"]
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder, "out.parquet")
            cost = run([*command, "export", file, "-o", str(out), "--only", "transactions", "--only", "items"])
            rows = json.loads((out / "s7dissect.json").read_text(encoding="utf-8"))["rows"]
            size = sum(path.stat().st_size for path in out.iterdir())
        wrong += rows["transactions"] != analysis["transactions"]["total"]
        print(
            f"{file}: {packets} packets, {rows['transactions']} transactions, {rows['items']} items, {size / 1e6:.1f} MB, "
            f"{cost.cpu_s:.2f} s CPU, {packets / cost.cpu_s / 1e3:.0f} k packets/s, peak {cost.peak_mb:.0f} MB"
        )
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
