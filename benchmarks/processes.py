"""The gain of --separate -j: one process and several over the same captures, and whether they write the same.

`python -m benchmarks.processes FILE FILE… [--jobs N] [--python PYTHON]`. On a busy machine only the CPU seconds are meaningful:
those of all processes together are the cost of sharing; its gain is elapsed time, to be measured on an idle machine.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

from benchmarks.measure import machine, run

#: The measured commands, each followed by the files.
COMMANDS = (("analyze", "-T", "json"), ("transactions", "-T", "jsonl"), ("values", "-T", "jsonl"))


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("files", nargs="+", metavar="FILE", help="captures, such as those of benchmarks.generate")
    parser.add_argument("--jobs", default="2", metavar="N", help="processes (2)")
    parser.add_argument("--python", default=sys.executable, help="the python whose s7dissect is measured")
    arguments = parser.parse_args()
    print(machine())
    wrong = 0
    for words in COMMANDS:
        command = [arguments.python, "-P", "-m", "dissect", *words, "--separate", *arguments.files]
        costs = [run([*command, "-j", jobs]) for jobs in ("1", arguments.jobs)]
        wrong += _written(command, "1") != _written(command, arguments.jobs)
        one, several = costs
        print(
            f"{' '.join(words)}: elapsed {one.wall_s:.2f} s, with -j {arguments.jobs} {several.wall_s:.2f} s "
            f"({one.wall_s / several.wall_s:.2f} times as fast); CPU {one.cpu_s:.2f} s and {several.cpu_s:.2f} s"
        )
    if wrong:
        print("THEY DO NOT WRITE THE SAME")
    return 1 if wrong else 0


def _written(command: list[str], jobs: str) -> str:
    """Return a checksum of what a command writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "out")
        with path.open("wb") as out:
            subprocess.run([*command, "-j", jobs], stdout=out, check=True)
        with path.open("rb") as written:
            return hashlib.file_digest(written, "sha256").hexdigest()


if __name__ == "__main__":
    sys.exit(main())
