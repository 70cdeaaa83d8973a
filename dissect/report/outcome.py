"""What a command came to, in the forms that formats ask for: lines for a person, values for a program, cases of a test."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple, Protocol

from dissect.report.styled import PLAIN, Line
from dissect.wire.json_page import JsonPage
from dissect.wire.text import json_text

#: Arguments of `json.dumps`. The layout is part of what users compare, so each command keeps its own.
PAGE: Final[Mapping[str, Any]] = {"indent": 1}
WIDE_PAGE: Final[Mapping[str, Any]] = {"indent": 2}
LINE: Final[Mapping[str, Any]] = {"separators": (",", ":")}
SPACED_LINE: Final[Mapping[str, Any]] = {}


def plain(lines: Iterable[str], hang: int = 4) -> Iterator[Line]:
    """Yield lines without a style; what is continued on a terminal begins in column ``hang``."""
    for line in lines:
        yield Line(line, PLAIN, hang)


class Case(NamedTuple):
    """One test and what became of it, in pairs of kind and text; it passed when there are none.

    ``errors`` are why it could not be tried. ``listed``: the failures are many lines, not one sentence.
    """

    name: str
    failures: tuple[tuple[str, str], ...] = ()
    errors: tuple[tuple[str, str], ...] = ()
    listed: bool = True


class Outcome(ABC):
    """One result of a command. Lines are safe to show; values are as they are, in ASCII."""

    #: How its JSON is laid out.
    layout: Mapping[str, Any] = PAGE

    @abstractmethod
    def text(self) -> Iterable[str | Line]:
        """Return it as lines for a person."""

    @abstractmethod
    def as_dict(self) -> Mapping[str, object]:
        """Return it as JSON-ready values."""

    def sections(self) -> Iterable[tuple[str, object]]:
        """Return the names and values of `as_dict`; what is a long list there may be an iterator here."""
        return self.as_dict().items()


class Tested(Protocol):
    """An outcome that formats of tests take."""

    def cases(self) -> tuple[str, str, list[Case]]:
        """Return it as tests: the name of the suite, what it is of, and the tests."""


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
    """Yield an outcome as JSON: ASCII without control characters but the line feeds of its layout.

    What a long report is made of is never there all at once: each part is a piece, and each object of a long list.
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
