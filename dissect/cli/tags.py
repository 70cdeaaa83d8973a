"""`s7dissect tags`: check files of tags, list and convert their contents, and compare them with a capture."""

from __future__ import annotations

import importlib
from typing import Final

import click

from dissect.cli.main import LazyGroup

#: Each command, the name of its click command in `dissect.cli.tags_files`, and the line the list of commands shows for it.
_COMMANDS: Final = {
    "check": ("check_command", "Check tag files and list every mistake."),
    "list": ("list_command", "List the tags with addresses and types."),
    "convert": ("convert_command", "Write the tags as one CSV table."),
}


class _TagsGroup(LazyGroup):
    """Lists its commands from the table."""

    prefix = "tags "

    def summaries(self) -> dict[str, str]:
        """Return each command and its line in the list of commands."""
        return {name: text for name, (_, text) in _COMMANDS.items()}

    def load(self, name: str) -> click.Command:
        """Import a command."""
        command: click.Command = getattr(importlib.import_module("dissect.cli.tags_files"), _COMMANDS[name][0])
        return command


@click.command("tags", cls=_TagsGroup)
def command() -> None:
    """Tag files (names, types and units for addresses): check, list and convert them.

    A file is a CSV, a TIA Portal tag table (XLSX, XML, SDF), an Openness export, a STEP 7 symbol table (ASC, SDF, SEQ, DIF), a
    source of blocks (AWL, SCL, DB, UDT) or a list of a different program; the content tells them apart.
    """
