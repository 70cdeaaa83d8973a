"""Run the commands that a release should be fast at, so that gcc can count the paths taken: `python scripts/train.py`.

setup.py calls it between the two builds of a release. It reads the shipped captures and one from the benchmarks with another
seed, so that no measurement uses the capture that the build was trained with.
"""

from __future__ import annotations

import os
import sys
import tempfile
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path

from dissect.cli.main import main
from dissect.wire.build import COMPILED

ROOT = Path(__file__).resolve().parent.parent
sys.path.append(str(ROOT))  # after the package that is trained

from benchmarks.generate import generate  # noqa: E402 - it is found from here on

#: Enough for answer times to be counted in buckets, and findings to be packed.
PACKETS = 100_000
SEED = 20_001
#: Commands for each capture, and commands only for the shipped ones.
COMMANDS = (
    ["analyze"],
    ["analyze", "-T", "json"],
    ["transactions"],
    ["transactions", "-T", "jsonl"],
    ["transactions", "-T", "csv"],
    ["values"],
    ["golden"],
)
SHOWN = (["show", "-V"],)
#: Shipped captures that are larger would count for more than all the others.
LARGEST = 300_000


def run(arguments: list[str]) -> int:
    """Run a command in this process and return its exit code; counts are written when the process ends."""
    sys.argv[1:] = arguments
    try:
        with redirect_stderr(StringIO()):
            main()
    except SystemExit as end:
        sys.stdout.flush()
        return end.code if isinstance(end.code, int) else 1
    return 0


def shipped() -> list[Path]:
    """Return the captures that come with the source, except large ones and those that need another package."""
    return sorted(
        path
        for path in (ROOT / "captures").rglob("*.pcap*")
        if path.suffix != ".zst" and path.stat().st_size <= LARGEST
    )


def train() -> None:
    """Read everything. Raises RuntimeError where a command fails."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder, "made.pcap")
        generate(made, PACKETS, seed=SEED)
        calls = [[*command, str(made)] for command in COMMANDS]
        calls += [[*command, str(path)] for path in shipped() for command in (*COMMANDS, *SHOWN)]
        for call in calls:
            code = run(call)
            if code not in {0, 3}:  # 3: the capture is damaged, as some are on purpose
                message = f"s7dissect {' '.join(call)} ended with code {code}"
                raise RuntimeError(message)


if __name__ == "__main__":
    if not COMPILED:
        sys.exit("train: the package is not compiled, there is nothing to count")
    sys.stdout.flush()
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    train()
