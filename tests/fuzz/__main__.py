"""Fuzz with atheris: ``python -m tests.fuzz TARGET --seconds 60`` (docs/fuzzing.md).

libFuzzer ends its process as it likes, so it runs in a child, and the parent reports the result in one line.
"""

from __future__ import annotations

import argparse
import importlib
import importlib.util
import math
import os
import pkgutil
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tests.fuzz.failures import SUSPECT_SECONDS, Failures, failure_of, minimised

if TYPE_CHECKING:
    from tests.fuzz.targets import TargetRow

#: Promise G2.
RSS_MB: Final = 512
#: libFuzzer stops when one input takes this long.
HANG_SECONDS: Final = 20
NAMES: Final = ("container", "frames", "segments", "streams", "pdus", "plus", "blocks", "tls", "files", "inputs")
#: Every target, one after the other.
ALL: Final = "all"
#: Parts of a long run by executions: more for the targets that need less processor time.
SHARES: Final = {
    "container": 15, "frames": 10, "segments": 3, "streams": 15, "pdus": 20, "plus": 15, "blocks": 2, "tls": 10,
    "files": 1, "inputs": 9,
}  # fmt: skip
#: Rooms that are not imported as a whole, because that takes long or needs missing packages: targets import the parts that they
#: reach.
_LEFT_OUT: Final = (
    "cli",
    "layers",
    "online.live",
    "online.metrics",
    "online.monitor",
    "online.proxy",
    "testing.oracle",
    "testing.plugin",
    "__main__",
)
_HINT: Final = "fuzzing needs one more package: pip install atheris (or '.[fuzz]' in this folder); Linux on x86-64"
_STATUS: Final = re.compile(r"\bcov: (\d+) ft: (\d+)")
_FIGURE: Final = re.compile(r"stat::(\w+):\s+(\d+)")
_FAILURE: Final = re.compile(r"FAILURE |==\d+== ?ERROR")


def load_targets() -> None:
    """Import all of the package that targets reach, so that atheris sees which branches are taken."""
    import atheris

    with atheris.instrument_imports(include=["dissect"]):
        import dissect

        left_out = tuple([f"dissect.{room}" for room in _LEFT_OUT])
        for module in pkgutil.walk_packages(dissect.__path__, "dissect."):
            if not module.name.startswith(left_out):
                importlib.import_module(module.name)
        importlib.import_module("tests.fuzz.targets")


def targets() -> dict[str, TargetRow]:
    """Return the targets; imported late, because everything that must be instrumented is imported with them."""
    from tests.fuzz.targets import TARGETS

    return TARGETS


def run_child(options: argparse.Namespace) -> None:
    """Run libFuzzer until its time is up. Does not return."""
    import atheris

    load_targets()
    from tests.fuzz.seeds import every

    target, seeds, most = targets()[options.target]
    folder = Path(options.child)
    for number, octets in enumerate(seeds(every())):
        if len(octets) <= most:
            (folder / f"seed-{number}").write_bytes(octets)
    corpus = options.corpus / options.target if options.corpus else folder
    corpus.mkdir(parents=True, exist_ok=True)
    options.artifacts.mkdir(parents=True, exist_ok=True)
    arguments = [
        sys.argv[0], f"-max_total_time={options.seconds}", f"-max_len={most}", f"-rss_limit_mb={RSS_MB}",
        f"-timeout={HANG_SECONDS}", f"-artifact_prefix={options.artifacts}/{options.target}-", "-print_final_stats=1",
        *dict.fromkeys((str(corpus), str(folder))),
    ]  # fmt: skip
    atheris.Setup(arguments, Failures(options.target, target, options.artifacts))
    atheris.Fuzz()


class Account:
    """libFuzzer's output as figures; ``failed`` are the lines about failures."""

    def __init__(self) -> None:
        self.failed: list[str] = []
        self.last: list[str] = []
        self.coverage: list[int] = []
        self._figures: dict[str, int] = {}

    def read(self, lines: Iterable[str]) -> None:
        """Follow the output."""
        for line in lines:
            self.last = [*self.last[-14:], line.rstrip()]
            status = _STATUS.search(line)
            if status:
                self.coverage.append(int(status[1]))
            figure = _FIGURE.match(line)
            if figure:
                self._figures[figure[1]] = int(figure[2])
            if _FAILURE.match(line):
                self.failed.append(line.strip())
                print(line.rstrip(), file=sys.stderr, flush=True)

    def summary(self, name: str, seconds: int) -> str:
        """Return one line with the result."""
        runs = self._figures.get("number_of_executed_units", 0)
        first, last = (self.coverage[0], self.coverage[-1]) if self.coverage else (0, 0)
        return (
            f"{name}: {runs} executions in {seconds} s, {runs / seconds:.0f}/s; coverage {last} edges, {last - first} of them "
            f"new; {self._figures.get('new_units_added', 0)} inputs kept; RSS {self._figures.get('peak_rss_mb', 0)} MB; "
            f"{len(self.failed)} kinds of failure"
        )


def fuzz(options: argparse.Namespace) -> int:
    """Run the child and report the result in one line; return 1 if anything failed."""
    arguments = [sys.executable, "-m", "tests.fuzz", options.target, "--seconds", str(options.seconds)]
    arguments += ["--artifacts", str(options.artifacts)]
    if options.corpus:
        arguments += ["--corpus", str(options.corpus)]
    account = Account()
    with tempfile.TemporaryDirectory(prefix="s7dissect-seeds-") as folder:
        arguments += ["--child", folder]
        with subprocess.Popen(arguments, stderr=subprocess.PIPE, text=True, errors="replace") as process:
            assert process.stderr is not None
            account.read(process.stderr)
    print(account.summary(options.target, options.seconds), flush=True)
    if process.returncode and not account.failed:
        print(f"the fuzzer ended with {process.returncode}:", *account.last, sep="\n", file=sys.stderr)
    return 1 if account.failed or process.returncode else 0


def dice(options: argparse.Namespace) -> int:
    """Run a target, or each for its share, on the installed package, without a fuzzer; return 1 if anything failed."""
    names = NAMES if options.target == ALL else (options.target,)
    return max([_dice(options, name) for name in names])


def _dice(options: argparse.Namespace, name: str) -> int:
    # The folder of the tests last: what is installed must be found before the package of the tree.
    begin = "import sys; sys.path.append('.'); from tests.fuzz.dice import main; sys.exit(main(sys.argv[1:]))"
    arguments = [sys.executable, "-P", "-c", begin, name, "--seed", str(options.seed), "--jobs", str(options.jobs)]
    if options.executions:
        share = SHARES[name] / sum(SHARES.values()) if options.target == ALL else 1
        arguments += ["--executions", str(math.ceil(options.executions * share))]
    else:
        arguments += ["--seconds", str(options.seconds)]
    for option, path in (("--artifacts", options.artifacts), ("--corpus", options.corpus), ("--done", options.done)):
        arguments += [option, str(path.absolute())] if path else []
    others = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(arguments, cwd=Path(__file__).parents[2], env=others, check=False).returncode


def again(options: argparse.Namespace) -> int:
    """Run single inputs without a fuzzer, or make one of them smaller; return 1 if any fails."""
    target = targets()[options.target][0]
    failed = 0
    for path in options.run:
        octets = path.read_bytes()
        kind, report = failure_of(target, octets, SUSPECT_SECONDS)
        failed += bool(kind)
        print(f"{path}: {kind or 'good'}\n{report}", end="")
        if kind and options.minimise:
            small = minimised(target, octets)
            print(f"{len(small)} bytes do the same: {small!r}")
    return 1 if failed else 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one target."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("target", choices=(*NAMES, ALL), help=f"what is fed; {ALL}: every one, with --installed")
    parser.add_argument("--seconds", type=int, default=60, help="how long (default 60)")
    parser.add_argument("--corpus", type=Path, help="folder that keeps what raised the coverage, for the next time")
    parser.add_argument("--artifacts", type=Path, default=Path(tempfile.gettempdir()) / "s7dissect-fuzz",
                        help="folder for inputs that fail (default: in the folder for temporary files)")  # fmt: skip
    parser.add_argument("--run", type=Path, nargs="+", help="run these inputs instead, without atheris")
    parser.add_argument("--minimise", action="store_true", help="with --run: make those that fail smaller")
    parser.add_argument("--installed", action="store_true", help="the installed package, compiled: damaged seeds and inputs "
                        "of --corpus without atheris, for --seconds of CPU time")  # fmt: skip
    parser.add_argument("--seed", type=int, default=0, help="with --installed: which damage is done (default 0)")
    parser.add_argument("--executions", type=int, default=0, help="with --installed: so many inputs instead of --seconds, in "
                        "rounds that each have dice of their own")  # fmt: skip
    parser.add_argument("--jobs", type=int, default=1, help="with --executions: processes side by side (default 1)")
    parser.add_argument("--done", type=Path, help="with --executions: file that notes the rounds that are done, so that the "
                        "run goes on after them when it is started again")  # fmt: skip
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args(arguments)
    if options.run:
        return again(options)
    if options.installed:
        return dice(options)
    if options.target == ALL or options.executions or options.done:
        parser.error(f"{ALL}, --executions and --done are for --installed")
    if importlib.util.find_spec("atheris") is None:
        print(_HINT, file=sys.stderr)
        return 2
    if options.child:
        run_child(options)
    return fuzz(options)


if __name__ == "__main__":
    sys.exit(main())
