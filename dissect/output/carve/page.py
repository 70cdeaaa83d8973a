"""A list of blocks, or a comparison, as one HTML page without scripts, for reading, printing and sending."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Iterator
from html import escape
from typing import Final

from dissect.engine.program.compare import BlockChange
from dissect.meaning.report.outcome import Outcome
from dissect.meaning.report.styled import Line
from dissect.output.carve.listing import BlockChanges, change_line
from dissect.protocols.mc7.changes import NETWORK, Change
from dissect.wire.text import printable

_STYLE: Final = (
    "body{font:14px system-ui,sans-serif;margin:2em;max-width:75em}"
    "pre,td{font:13px ui-monospace,monospace;white-space:pre-wrap}"
    "table{border-collapse:collapse;margin:.5em 0 2em}td,th{border:1px solid #bbb;padding:.2em .6em;text-align:left;"
    "vertical-align:top}th{background:#eee}.was{background:#fde8e8}.now{background:#e6f4e6}h2{font-size:1.1em}"
)


def html_outcome(outcome: Outcome) -> Iterator[str]:
    """Yield the lines of a page. Text from the wire is escaped; the page loads and runs nothing."""
    digest = base64.b64encode(hashlib.sha256(_STYLE.encode("ascii")).digest()).decode("ascii")
    yield '<!DOCTYPE html>\n<html lang="en"><head><meta charset="utf-8">'
    policy = f"default-src 'none'; style-src 'sha256-{digest}'"
    yield f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
    yield f"<title>s7dissect blocks</title><style>{_STYLE}</style></head><body>"
    if isinstance(outcome, BlockChanges):
        yield from _changes(outcome)
    else:
        yield "<pre>"
        for line in outcome.text():
            yield escape(line.text if isinstance(line, Line) else line)
        yield "</pre>"
    yield "</body></html>"


def _changes(told: BlockChanges) -> Iterator[str]:
    yield f"<h1>Blocks: {_text(told.first)} → {_text(told.second)}</h1>"
    if not told.changes:
        yield "<p>No differences.</p>"
    for change in told.changes:
        yield f"<h2>{escape(change_line(change))}</h2>"
        rows = list(_rows(change, told.details(change)))
        if rows:
            yield "<table><tr><th></th><th>was</th><th>is</th></tr>"
            yield from rows
            yield "</table>"


def _rows(change: BlockChange, details: list[Change]) -> Iterator[str]:
    """Yield a row for each change in a block; changes of the header only if there are no others."""
    for one in details:
        where = f"network {one.network}" if one.about == NETWORK else one.about
        if one.before or one.after:
            yield _row(where, one.before, one.after)
        else:
            yield f'<tr><td>{_text(where)}</td><td colspan="2">{_text(one.text.strip())}</td></tr>'
    for called, was, now in change.facts if not details or change.block.plus is not None else ():
        yield _row(called, was, now)


def _row(where: str, was: str, now: str) -> str:
    return f'<tr><td>{_text(where)}</td><td class="was">{_lines(was)}</td><td class="now">{_lines(now)}</td></tr>'


def _lines(text: str) -> str:
    return "<br>".join([_text(line) for line in text.split("\n")])


def _text(text: str) -> str:
    return escape(printable(text))
