"""Run a command and report its cost: CPU seconds, wall time, peak memory."""

from __future__ import annotations

import os
import subprocess
import time
from pathlib import Path
from statistics import median


class Cost:
    """The cost of one run: ``cpu_s`` user and system seconds, ``wall_s``, ``peak_mb`` (10**6 octets resident), ``code``.

    CPU time includes that of the children for which the command waited.
    """

    __slots__ = ("code", "cpu_s", "peak_mb", "wall_s")

    def __init__(self, cpu_s: float, wall_s: float, peak_mb: float, code: int) -> None:
        self.cpu_s = cpu_s
        self.wall_s = wall_s
        self.peak_mb = peak_mb
        self.code = code


class CommandFailedError(Exception):
    """A measured command ended with an unexpected exit code; the message has the end of its output."""


def run(
    command: list[str],
    *,
    environment: dict[str, str] | None = None,
    directory: Path | None = None,
    output: Path | None = None,
    fine: tuple[int, ...] = (0,),
) -> Cost:
    """Run ``command`` to its end with standard output to a file, or discarded.

    Peak memory comes from the kernel (``ru_maxrss``), which never reports less than this process had when it started the child:
    so a measuring process must stay small. Raises CommandFailedError when the exit code is not in ``fine``.
    """
    target = output if output is not None else Path(os.devnull)
    with (
        target.open("wb") as out,
        subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=out, stderr=subprocess.PIPE, env=environment, cwd=directory
        ) as child,
    ):
        begun = time.perf_counter()
        assert child.stderr is not None
        said = child.stderr.read()
        _, status, usage = os.wait4(child.pid, 0)
        wall_s = time.perf_counter() - begun
        child.returncode = os.waitstatus_to_exitcode(status)
    if child.returncode not in fine:
        words = said.decode("utf-8", "replace").strip()[-2000:]
        raise CommandFailedError(f"{' '.join(command)} ended with {child.returncode}: {words}")
    return Cost(usage.ru_utime + usage.ru_stime, wall_s, usage.ru_maxrss * 1024 / 1e6, child.returncode)


def middle(costs: list[Cost]) -> Cost:
    """Return the medians of several runs."""
    return Cost(
        median(cost.cpu_s for cost in costs),
        median(cost.wall_s for cost in costs),
        median(cost.peak_mb for cost in costs),
        max(cost.code for cost in costs),
    )


def machine() -> str:
    """Return one line on this machine: processor, cores, load, kernel, so that figures can be judged."""
    model = "unknown processor"
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                model = line.split(":", 1)[1].strip()
                break
    except OSError:
        pass
    system = os.uname()
    load = " ".join(f"{value:.2f}" for value in os.getloadavg())
    return f"{model}, {os.cpu_count()} cores, {system.sysname} {system.release}, load {load}"
