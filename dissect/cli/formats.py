"""The option ``-T`` of all commands, and how the output of a format is written."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import TYPE_CHECKING, Any, cast

import click

from dissect.cli.display import write_lines
from dissect.cli.run import write, write_octets
from dissect.meaning.report.formats import FORMATS, Format, formats_for
from dissect.wire.config.hints import close_names

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from dissect.meaning.report.outcome import Outcome
    from dissect.meaning.report.styled import Line, Written

    _ParamType = click.ParamType[Format]
else:
    _ParamType = click.ParamType  # older ones of click are not generic


class FormatType(_ParamType):
    """The name of a format that can write a kind of result.

    The table is looked up when the name is read, not when this module is imported.
    """

    name = "format"

    def __init__(self, kind: str) -> None:
        self.kind = kind

    def get_metavar(self, param: click.Parameter, ctx: click.Context | None = None) -> str:
        """Return the names for the help."""
        return f"[{'|'.join([row.name for row in formats_for(self.kind)])}]"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Format:
        """Return the format of a name; a wrong one is reported with the nearest."""
        if isinstance(value, Format):
            return value
        row = FORMATS.get(value)
        if row is not None and self.kind in row.writers:
            return row
        names = [row.name for row in formats_for(self.kind)]
        hint = f" {value} is for {', '.join(_commands_with(row))}." if row is not None else ""
        if row is None:
            near = close_names(value, names)
            hint = f" Did you mean {' or '.join(near)}?" if near else ""
        raise click.BadParameter(
            f"{value!r} is not one of {', '.join([repr(name) for name in names])}.{hint}", ctx, param
        )

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the names that begin with this text."""
        from click.shell_completion import CompletionItem

        return [
            CompletionItem(row.name, help=row.about)
            for row in formats_for(self.kind)
            if row.name.startswith(incomplete)
        ]


def _commands_with(row: Format) -> list[str]:
    """Return the commands that accept a format; all are imported to find out, which is acceptable after a mistake."""
    from dissect.cli.main import group

    names = []
    for name, command in _walk(group, ""):
        kinds = [parameter.type.kind for parameter in command.params if isinstance(parameter.type, FormatType)]
        if any([kind in row.writers for kind in kinds]):
            names.append(name)
    return names


def _walk(command: click.Command, name: str) -> Iterator[tuple[str, click.Command]]:
    """Yield each command that is not a group, with its full name."""
    if not isinstance(command, click.Group):
        yield name, command
        return
    context = click.Context(command)
    for one in command.list_commands(context):
        below = command.get_command(context, one)
        if below is not None:
            yield from _walk(below, f"{name} {one}".lstrip())


def format_option(kind: str, *, optional: bool = False, help: str = "") -> Callable[[Any], Any]:  # noqa: A002 - as click
    """Return the option ``-T`` of a command that writes results of a kind; the command gets a `Format` as ``format_``.

    The first format is the default; with ``optional`` the default is None, and ``help`` describes the behaviour without a
    format.
    """

    def listed() -> str:
        return ", ".join([f"{row.name} ({row.about})" for row in formats_for(kind)])

    return click.option(
        "-T",
        "--format",
        "format_",
        type=FormatType(kind),
        default=None if optional else formats_for(kind)[0].name,
        show_default=not optional,
        help=f"{help or 'Output format'}: {listed()}." if not optional else help,
    )


def write_out(lines: Iterable[Written]) -> None:
    """Write the output of a format: text unchanged, lines with a style as the terminal needs them."""
    source = iter(lines)
    first = next(source, None)
    if first is None:
        return
    whole = chain((first,), source)
    if isinstance(first, bytes):
        write_octets(cast("Iterable[bytes]", whole))
    elif isinstance(first, str):
        write(cast("Iterable[str]", whole))
    else:
        write_lines(cast("list[Line]", list(whole)))


def write_outcome(format_: Format, kind: str, outcome: Outcome) -> None:
    """Write a single result."""
    write_out(format_.lines(kind, outcome))
