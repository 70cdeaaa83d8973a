"""Failures, kept once for each kind: the input, where it was raised, and a smaller input with the same failure."""

from __future__ import annotations

import hashlib
import math
import sys
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Final

from tests.growth import lines

#: An input that needs more processor time than this is run again, and its work is counted.
SUSPECT_SECONDS: Final = 1.0
#: Maximum number of Python lines that an input may run, per octet and in all; more is a failure as well (promise G2).
MOST_LINES: Final = 2_000
LINES_AT_ALL: Final = 500_000

Target = Callable[[bytes], None]


def kind_of(error: Exception) -> str:
    """Return a key that distinguishes failures: the type of the exception, and the place of ours that raised it."""
    frames = [
        frame
        for frame in traceback.extract_tb(error.__traceback__)
        if "dissect" in frame.filename or "tests" in frame.filename
    ]
    last = frames[-1] if frames else None
    return f"{type(error).__name__} in {Path(last.filename).name}:{last.lineno}" if last else type(error).__name__


def failure_of(target: Target, octets: bytes, suspect_s: float = math.inf) -> tuple[str, str]:
    """Run one input; return the kind of failure and a report, or two empty texts.

    An input that takes longer than ``suspect_s`` is run again with its work counted, so that the speed of the machine does not
    matter.
    """
    begun = time.process_time()
    try:
        target(octets)
        if time.process_time() - begun < suspect_s:
            return "", ""
        count = lines(lambda: target(octets))
    except Exception as error:  # noqa: BLE001 - what else comes out is what is looked for
        return kind_of(error), "".join(traceback.format_exception(error))
    if count > LINES_AT_ALL + MOST_LINES * len(octets):
        return "slow", f"one input of {len(octets)} bytes runs {count} lines\n"
    return "", ""


class Failures:
    """Takes inputs from a fuzzer and keeps the first failing one of each kind in ``folder``; the fuzzer continues."""

    def __init__(self, name: str, target: Target, folder: Path) -> None:
        self.counts: Counter[str] = Counter()
        self._name = name
        self._target = target
        self._folder = folder

    def __call__(self, octets: bytes) -> None:
        """Run one input."""
        kind, report = failure_of(self._target, octets, SUSPECT_SECONDS)
        if not kind:
            return
        self.counts[kind] += 1
        if self.counts[kind] == 1:
            self._folder.mkdir(parents=True, exist_ok=True)
            path = self._folder / f"{self._name}-{hashlib.sha256(octets).hexdigest()[:12]}.bin"
            path.write_bytes(octets)
            path.with_suffix(".txt").write_text(report, encoding="utf-8", errors="backslashreplace")
            print(f"FAILURE {kind}: {path}", file=sys.stderr, flush=True)


def minimised(target: Target, octets: bytes) -> bytes:
    """Return the shortest input found that fails in the same way: pieces are removed, then octets made zero."""
    kind, _ = failure_of(target, octets)
    if not kind:
        raise ValueError("this input does not fail")

    def same(tried: bytes) -> bool:
        return failure_of(target, tried)[0] == kind

    size = len(octets) // 2
    while size:
        at = 0
        while at < len(octets):
            tried = octets[:at] + octets[at + size :]
            if same(tried):
                octets = tried
            else:
                at += size
        size //= 2
    for at in range(len(octets)):
        tried = octets[:at] + b"\0" + octets[at + 1 :]
        if octets[at] and same(tried):
            octets = tried
    return octets
