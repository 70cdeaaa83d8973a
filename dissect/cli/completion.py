"""`s7dissect completion`: scripts that a shell loads to complete commands, options, fields and files."""

from __future__ import annotations

import click
from click.shell_completion import ShellComplete, get_completion_class

from dissect.cli.main import COMPLETION, EXIT_OK, group
from dissect.cli.run import write

_SHELLS = ("bash", "zsh", "fish")


@click.command(
    "completion",
    epilog="Exit code: 0 success, 2 wrong use, 5 the output could not be written.",
)
@click.argument("shell", type=click.Choice(_SHELLS), metavar="[bash|zsh|fish]")
def command(shell: str) -> int:
    """Write the completion script of a shell, to be loaded where the shell starts.

    It completes commands, options, values of options, the fields of -Y expressions, questions of sql, topics of help, tables of
    export --only, and the connections of a capture.
    """
    kind = get_completion_class(shell)
    assert kind is not None
    # Not the class's own `source`, which starts bash to find out its version.
    write(ShellComplete.source(kind(group, {}, "s7dissect", COMPLETION)).strip("\n").split("\n"))
    return EXIT_OK
