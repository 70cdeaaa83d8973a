"""Measures the greatest amount of work that one packet causes. ``python -m benchmarks.work``.

Work is counted, not timed: the lines of Python that the interpreted engine runs for each packet of the streams that `growth`
feeds to it, with everything that `analyze` keeps. So the figures are the same on every machine, busy or idle. The work inside a
builtin (a slice, a search in octets) counts as one line: `growth` measures its time.
"""

from __future__ import annotations

import argparse
import sys
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from benchmarks.generate import parse_count
from benchmarks.streams import MTU, NAMES, SMALL, stream
from benchmarks.tables import columns, piped
from dissect.engine.pipeline import Pipeline
from dissect.meaning.report.analysis import Analysis
from dissect.wire.build import COMPILED

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import FrameType

_ETHERNET = 1
#: The promise: lines for one packet.
MOST_LINES: Final = 25_000


class Work(NamedTuple):
    """Lines per packet of a stream: the median, all but one in a thousand, the worst and its number; and at the end."""

    middle: int
    most: int
    worst: int
    worst_at: int
    finish: int


class _Lines:
    """Counts the lines that run between `begin` and `end`."""

    def __init__(self) -> None:
        self._count = 0

    def _trace(self, frame: FrameType, event: str, argument: Any) -> Any:
        if event == "line":
            self._count += 1
        return self._trace

    def begin(self) -> None:
        """Count from here on."""
        self._count = 0
        sys.settrace(self._trace)

    def end(self) -> int:
        """Stop counting; return the number of lines."""
        sys.settrace(None)
        return self._count


def work(name: str, packets: int, size: int = SMALL) -> Work:
    """Count the lines for each of ``packets`` packets of the stream ``name``."""
    pipeline = Pipeline(Analysis())
    lines = _Lines()
    counts: list[int] = []
    for time_ns, frame in islice(stream(name, size), packets):
        octets = len(frame)
        lines.begin()
        pipeline.frame(time_ns, frame, 0, octets, octets, _ETHERNET)
        counts.append(lines.end())
    lines.begin()
    pipeline.finish()
    finish = lines.end()
    worst = max(counts)
    ordered = sorted(counts)
    return Work(
        ordered[packets // 2], ordered[packets * 999 // 1000], worst, counts.index(worst) + 1, finish
    )  # fmt: skip


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command. Exit 0: the promise is kept; 1: it is not; 2: nothing could be counted."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.work", description=__doc__)
    parser.add_argument("--packets", type=parse_count, default=300_000, metavar="N", help="of each stream")
    parser.add_argument(
        "--streams", nargs="+", choices=NAMES, default=list(NAMES), metavar="NAME", help=", ".join(NAMES)
    )
    parser.add_argument("--mtu", action="store_true", help="frames that fill the MTU instead of small ones")
    parser.add_argument("--markdown", type=Path, help="write the table as Markdown to this file too")
    options = parser.parse_args(arguments)
    if COMPILED:
        print(
            "work: lines of compiled code cannot be counted: run it from the source tree, PYTHONPATH=.", file=sys.stderr
        )
        return 2
    heads = ("stream", "packets", "middle", "99.9 %", "worst", "at packet", "at the end", "verdict")
    rows: list[tuple[str, ...]] = []
    for name in options.streams:
        told = work(name, options.packets, MTU if options.mtu else SMALL)
        figures = (options.packets, told.middle, told.most, told.worst, told.worst_at, told.finish)
        verdict = "kept" if told.worst <= MOST_LINES else f"more than {MOST_LINES:,}"
        rows.append((name, *[f"{number:,}" for number in figures], verdict))
        print(" ".join(rows[-1]), file=sys.stderr, flush=True)
    print(columns(heads, rows))
    if options.markdown:
        options.markdown.write_text(piped(heads, rows), encoding="utf-8")
    return 0 if all(row[-1] == "kept" for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main())
