"""Try an installed s7dissect: ``python scripts/try_install.py compiled`` (or ``interpreted``).

It must be the named build, it must give the known results for every shipped capture, and the tests of the wire formats must
pass on it. Prints one line per step; the exit code is 1 if a step failed.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).resolve().parent.parent
#: Tests that only need pytest and hypothesis, and that run anywhere.
TESTS: Final = ("tests/wire", "tests/protocols/iso", "tests/protocols/s7/test_message.py", "tests/packets/tcp")


def command(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """Run the installed command away from this tree."""
    return subprocess.run(
        [sys.executable, "-m", "dissect", *map(str, arguments)],
        cwd=Path(sys.prefix),
        env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"},
        capture_output=True,
        encoding="utf-8",
        check=False,
    )


def tell(ok: bool, what: str) -> bool:
    """Print the result of a step."""
    print(f"{'ok    ' if ok else 'FAILED'}  {what}", flush=True)
    return ok


def try_build(wanted: str) -> bool:
    """Ask the command which build it is."""
    told = command("--version").stdout.strip()
    return tell(told.endswith(f"({wanted})"), f"s7dissect --version: {told}")


def try_analyze() -> bool:
    """Analyze the capture of `make demo`."""
    ran = command("analyze", ROOT / "captures" / "nodes7-poll-missing.pcapng")
    good = ran.returncode == 0 and "transaction.item_error" in ran.stdout
    return tell(good, f"analyze of a shipped capture: exit code {ran.returncode} {ran.stderr.strip()}")


def try_captures() -> bool:
    """Compare the golden session of every capture with the one beside it."""
    folder = ROOT / "captures" / "golden"
    # SCD needs a dictionary, zstd and TLS an extra, and captures that are cut off are not compared.
    unfit = re.compile("^(scd/|crafted/cut-|crafted/plain-zstd|s7plus/s7commplus-tls)")
    goldens = [
        golden for golden in sorted(folder.rglob("*.s7.txt")) if not unfit.match(golden.relative_to(folder).as_posix())
    ]
    wrong = []
    for golden in goldens:
        name = golden.relative_to(folder).as_posix().removesuffix(".s7.txt")
        captures = [path for path in (ROOT / "captures").glob(f"{name}.*") if ".pcap" in path.name]
        if len(captures) != 1 or command("diff", golden, captures[0]).returncode:
            wrong.append(name)
    return tell(bool(goldens) and not wrong, f"{len(goldens)} captures give their known sessions {' '.join(wrong[:5])}")


def try_tests(wanted: str) -> bool:
    """Run a selection of the tests against what is installed."""
    ran = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *(ROOT / test for test in TESTS)],
        cwd=ROOT,
        env={**os.environ, "S7DISSECT_EXPECT": wanted, "PYTHONSAFEPATH": "1", "PYTHONDONTWRITEBYTECODE": "1"},
        check=False,
    )
    return tell(ran.returncode == 0, f"tests: exit code {ran.returncode}")


def main() -> int:
    """Run every step, also after one that failed."""
    if sys.argv[1:] not in (["compiled"], ["interpreted"]):
        print(__doc__, file=sys.stderr)
        return 2
    wanted = sys.argv[1]
    steps = [try_build(wanted), try_analyze(), try_captures(), try_tests(wanted)]
    return 0 if all(steps) else 1


if __name__ == "__main__":
    sys.exit(main())
