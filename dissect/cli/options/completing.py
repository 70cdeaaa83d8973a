"""Completions in the shell besides choices: names from a table, and the connections of a capture."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Final

import click

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

#: A larger capture is not read to complete a number.
_LARGEST: Final = 20_000_000
#: Connections that are offered.
_MOST: Final = 50

#: Functions that click calls for completions.
Completer = Callable[[click.Context, click.Parameter, str], "list[CompletionItem]"]


def from_table(table: Callable[[], Mapping[str, str]], several: bool = False) -> Completer:
    """Return a completion function for the names of a table; with ``several``, for the last of a comma-separated list."""

    def complete(_ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        from click.shell_completion import CompletionItem

        before, comma, last = incomplete.rpartition(",") if several else ("", "", incomplete)
        return [
            CompletionItem(f"{before}{comma}{name}", help=sentence)
            for name, sentence in table().items()
            if name.startswith(last)
        ]

    return complete


def _findings() -> Mapping[str, str]:
    from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES

    severities = dict.fromkeys(SEVERITIES, "findings of this severity, or a worse one")
    return {**severities, **{slug: rule.sentence for slug, rule in CATALOGUE.items()}}


#: Completes slugs of findings, and severities.
findings: Final = from_table(_findings)


def connections(ctx: click.Context, _param: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the numbers of the connections of the typed captures, with their ends; none if that would take long."""
    from pathlib import Path

    from click.shell_completion import CompletionItem

    # If the value of an option is missing, click leaves the arguments as they were typed.
    words = ctx.params.get("files") or ctx.args
    try:
        files = [path for path in map(Path, words) if path.is_file()]  # others are an SQL query, or an address
        files = (
            files[:1] if ctx.command.name == "diff" else files
        )  # a second file would have connection numbers of its own
        if not files or sum([path.stat().st_size for path in files]) > _LARGEST:
            return []
        from dissect.files.session import analyze
        from dissect.packets.source.packet import CaptureError

        try:
            read = analyze(*files).connections
        except CaptureError:
            return []
    except OSError:
        return []
    named = [(str(one.number), f"{one.tcp.ends[0]} {one.tcp.ends[1]}") for one in read]
    return [CompletionItem(number, help=ends) for number, ends in named if number.startswith(incomplete)][:_MOST]
