"""`Outcome`: the single result of a command, as text, values for JSON, rows of a table or test cases."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol

from dissect.meaning.report.json_page import JsonPage
from dissect.meaning.report.styled import PLAIN, Line
from dissect.wire.text import json_text

#: Arguments of `json.dumps`. Users compare files of these outputs, so the layout of each command must not change.
PAGE: Final[Mapping[str, Any]] = {"indent": 1}
WIDE_PAGE: Final[Mapping[str, Any]] = {"indent": 2}
LINE: Final[Mapping[str, Any]] = {"separators": (",", ":")}
SPACED_LINE: Final[Mapping[str, Any]] = {}


def plain(lines: Iterable[str], hang: int = 4) -> Iterator[Line]:
    """Yield lines without a style; if a terminal wraps them, they continue in column ``hang``."""
    for line in lines:
        yield Line(line, PLAIN, hang)


class Case(NamedTuple):
    """One test case. ``failures`` and ``errors`` are pairs of kind and text; the test passed if there are none.

    ``errors`` say why the test could not be run. ``listed``: each failure has many lines, not one sentence.
    """

    name: str
    failures: tuple[tuple[str, str], ...] = ()
    errors: tuple[tuple[str, str], ...] = ()
    listed: bool = True


class Outcome(ABC):
    """The result of a command. Lines for a person are escaped; values for JSON are not."""

    #: The layout of its JSON.
    layout: Mapping[str, Any] = PAGE

    @abstractmethod
    def text(self) -> Iterable[str | Line]:
        """Return the result as lines for a person."""

    @abstractmethod
    def as_dict(self) -> Mapping[str, object]:
        """Return the result as values that `json.dumps` accepts."""

    def sections(self) -> Iterable[tuple[str, object]]:
        """Return the names and values of `as_dict`; a long list may be an iterator here."""
        return self.as_dict().items()


class Tested(Protocol):
    """An outcome that can be written in a format for test results (JUnit)."""

    def cases(self) -> tuple[str, str, list[Case]]:
        """Return (name of the suite, what was tested, its test cases)."""


class Table(Protocol):
    """An outcome that is a table."""

    def rows(self) -> Iterable[Sequence[str]]:
        """Return its rows, the heading first; cells are safe for spreadsheets."""


def csv_outcome(outcome: Table) -> Iterator[str]:
    """Yield the rows of an outcome as CSV."""
    import csv
    import io

    for row in outcome.rows():
        line = io.StringIO()
        csv.writer(line, lineterminator="").writerow(row)
        yield line.getvalue()


def text_outcome(outcome: Outcome) -> Iterable[str | Line]:
    """Return an outcome as lines for a person."""
    return outcome.text()


def json_outcome(outcome: Outcome) -> Iterator[str | Line]:
    """Yield an outcome as JSON: ASCII, without control characters except the line feeds of its layout.

    A long report is never in memory as a whole: each section, and each object of a long list, is a piece that is yielded.
    """
    layout = outcome.layout
    if "indent" not in layout:
        yield json.dumps(outcome.as_dict(), **layout).replace("\x7f", "\\u007f")
        return
    indent: int = layout["indent"]
    page = JsonPage(indent)
    pad = " " * indent
    piece, behind = "{", ""
    for name, value in outcome.sections():
        yield piece + behind
        behind = ","
        piece = f"{pad}{json_text(name)}: "
        if not isinstance(value, Iterator):
            piece += page.text(value, pad)
            continue
        piece += "["
        between = ""
        for one in value:
            yield piece + between
            between = ","
            piece = pad * 2 + page.text(one, pad * 2)
        if between:
            yield piece
            piece = pad
        piece += "]"
    yield piece
    yield "}"
