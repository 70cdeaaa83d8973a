"""Conditions for all output, whatever the input was."""

from __future__ import annotations

import json
from collections.abc import Iterable

from tests.meaning.report.support import UNSAFE


def check_line(line: str) -> None:
    """A line of output: it can be written as UTF-8, and contains nothing that controls a terminal or misleads a reader."""
    assert not UNSAFE.search(line), ascii(line)
    line.encode("utf-8")


def check_lines(lines: Iterable[str]) -> int:
    """Check every line; return their number. All at once, which is much faster; each one separately only if one fails."""
    given = list(lines)
    text = " ".join(given)
    if UNSAFE.search(text):
        for line in given:
            check_line(line)
    text.encode("utf-8")
    return len(given)


def _only_numbers(name: str) -> float:
    raise AssertionError(f"{name} is no JSON")


def check_json(text: str) -> object:
    """A JSON text (RFC 8259, without NaN and Infinity) that is safe to show, apart from its line ends; return its value."""
    check_lines(text.split("\n"))
    found: object = json.loads(text, parse_constant=_only_numbers)
    return found
