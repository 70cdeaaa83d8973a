"""`s7dissect scd`: dictionaries of SCD, and values by them. Each of its commands is imported when it runs."""

from __future__ import annotations

import importlib
from typing import Any, Final

import click

from dissect.cli.main import EXIT_USAGE

#: Each command, the module and the name of its click command, and the line the list of commands shows for it.
_COMMANDS: Final = {
    "compile": (
        "dissect.cli.scd_files",
        "compile_command",
        "A source or device description into a compiled dictionary.",
    ),
    "dump": ("dissect.cli.scd_files", "dump_command", "A dictionary as TOML or JSON that compiles to the same octets."),
    "check": ("dissect.cli.scd_files", "check_command", "Whether dictionaries keep the rules, and what is in them."),
    "diff": ("dissect.cli.scd_files", "diff_command", "What two dictionaries differ in: names, or decoding."),
    "decode": ("dissect.cli.scd_decode", "decode_command", "Octets into values: a PDO, a struct, a value, messages."),
    "encode": ("dissect.cli.scd_encode", "encode_command", "Values into octets."),
}


class _ScdGroup(click.Group):
    """Lists its commands from the table, and says on one line what is wrong with a dictionary or a value."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        return list(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return the command, None when there is none of that name."""
        if cmd_name not in _COMMANDS:
            return None
        module, name, _ = _COMMANDS[cmd_name]
        command: click.Command = getattr(importlib.import_module(module), name)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing one."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, _, text) in _COMMANDS.items()])

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; what the library refuses is the user's error."""
        from dissect.scd.errors import Error
        from dissect.wire.text import printable

        try:
            return super().invoke(ctx)
        except Error as error:
            click.echo(f"s7dissect: {printable(str(error))}", err=True)
            return EXIT_USAGE


@click.command("scd", cls=_ScdGroup)
def command() -> None:
    """Dictionaries of SCD (Синхроком-Дата): compile, check and compare them, decode and encode by them.

    Wherever a dictionary is asked for, the compiled file does, a TOML or JSON source, or an EDS, DCF, XDD or XDC file.
    """
