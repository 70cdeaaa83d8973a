"""`s7dissect evidence`: whether the files of a ring are those that its manifest names."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import click

from dissect.cli.main import EXIT_OK, LazyGroup
from dissect.cli.run import write
from dissect.wire.text import printable, reason

EXIT_PROBLEMS: Final = 1


class _EvidenceGroup(LazyGroup):
    prefix = "evidence "

    def summaries(self) -> dict[str, str]:
        """Return each command and its line in the list of commands."""
        return {
            "verify": "Compare the files of a folder with its manifest.",
            "export": "Write one incident: its files, its part of the manifest, its packets and a report.",
        }

    def load(self, name: str) -> click.Command:
        """Return a command."""
        if name == "export":
            from dissect.cli.evidence_export import export_command

            return export_command
        return verify_command


@click.command("evidence", cls=_EvidenceGroup)
def command() -> None:
    """Evidence of `monitor --manifest`: see that it is what was written, export one incident."""


@click.command(
    "verify",
    epilog="Exit code: 0 all is as it was written, 1 something was changed, is missing or in no entry, 2 wrong use, or no "
    "manifest.",
)
@click.argument("directory", type=click.Path(readable=False), metavar="DIR")
@click.option(
    "--head",
    "heads",
    multiple=True,
    metavar="HASH",
    help="Hash of an entry that was noted elsewhere; it has to be in the chain. Repeatable.",
)
def verify_command(directory: str, heads: tuple[str, ...]) -> int:
    """Say of each file of DIR whether it is whole, changed, missing, or in no entry of the manifest.

    Without --head a chain proves only that it fits together: who can write the folder can write a new one.
    """
    from dissect.files.recording.manifest import ENDING, verified

    place = Path(directory)
    wrong = 0
    try:
        if not any([path.name.endswith(ENDING) for path in place.iterdir()]):
            raise click.ClickException(f"{printable(directory)}: no manifest (*{ENDING}) in this folder")
        for verdict in verified(place, heads):
            wrong += not verdict.well
            write([printable(f"{verdict.name}: {verdict.state}")])
    except OSError as error:
        raise click.ClickException(reason(error)) from None
    if not heads:
        click.echo(
            "s7dissect: without --head this proves only that manifest and files fit together; see `s7dissect help evidence`",
            err=True,
        )
    return EXIT_PROBLEMS if wrong else EXIT_OK
