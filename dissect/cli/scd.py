"""`s7dissect scd`: dictionaries of SCD, and encoding and decoding with them. Each of its commands is imported when it runs."""

from __future__ import annotations

import importlib
from typing import Any, Final

import click

from dissect.cli.main import EXIT_USAGE, LazyGroup

#: Each command, the module and the name of its click command, and the line the list of commands shows for it.
_COMMANDS: Final = {
    "compile": ("dissect.cli.scd_files", "compile_command", "Compile a source or device description."),
    "dump": ("dissect.cli.scd_files", "dump_command", "Write a dictionary as TOML or JSON."),
    "check": ("dissect.cli.scd_files", "check_command", "Check dictionaries and list what they define."),
    "diff": ("dissect.cli.scd_files", "diff_command", "Compare two dictionaries: names, or decoding."),
    "decode": ("dissect.cli.scd_decode", "decode_command", "Bytes to values: PDO, struct, value, messages."),
    "encode": ("dissect.cli.scd_encode", "encode_command", "Values to bytes."),
}


class _ScdGroup(LazyGroup):
    """Lists its commands from the table, and reports errors in a dictionary or a value on one line."""

    prefix = "scd "

    def summaries(self) -> dict[str, str]:
        """Return each command and its line in the list of commands."""
        return {name: text for name, (_, _, text) in _COMMANDS.items()}

    def load(self, name: str) -> click.Command:
        """Import a command."""
        module, attribute, _ = _COMMANDS[name]
        command: click.Command = getattr(importlib.import_module(module), attribute)
        return command

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; errors of the library are the user's errors."""
        from dissect.scd.errors import Error
        from dissect.wire.text import printable

        try:
            return super().invoke(ctx)
        except Error as error:
            click.echo(f"s7dissect: {printable(str(error))}", err=True)
            return EXIT_USAGE


@click.command("scd", cls=_ScdGroup)
def command() -> None:
    """SCD dictionaries (Синхроком-Дата): compile, check and compare them, decode and encode with them.

    A dictionary is a compiled file, a TOML or JSON source, or an EDS, DCF, XDD or XDC file.
    """
