"""The command ``s7dissect``: its subcommands by name, its exit codes, and nothing that takes time to import.

A subcommand lives in ``dissect/cli/<name>.py`` as a click command called ``command`` and is imported when it runs or when
its own help is asked for; the list of commands is printed from the table below.

Exit codes: 0 fine, 1 a gate failed, 2 usage or unreadable input, 3 finished on damaged input, 5 the output could not be
written, 130 interrupted. A command returns its code; ``None`` means 0.
"""

from __future__ import annotations

import errno
import importlib
import io
import os
import sys
from typing import Final, NoReturn

import click

from dissect import __version__
from dissect.wire.build import COMPILED
from dissect.wire.text import printable, reason

EXIT_OK: Final = 0
EXIT_GATE: Final = 1
EXIT_USAGE: Final = 2
EXIT_DAMAGED: Final = 3
EXIT_OUTPUT: Final = 5
EXIT_INTERRUPTED: Final = 130

#: Each command and the line that the list of commands shows for it, in the order of that list.
COMMANDS: Final = {
    "analyze": "What a capture holds, how fast it went, what failed and why.",
    "transactions": "One line per request and answer, with items and latency.",
    "operations": "One line per download, upload, subscription, password.",
    "show": "One line per S7 PDU, or the fields and octets of one.",
    "cut": "A part of a capture as pcapng, findings as comments.",
    "anonymize": "A capture to be shown: addresses, names, values replaced.",
    "baseline": "Learn what is normal, or tell what is not.",
    "golden": "A capture as stable text, to be kept and compared.",
    "diff": "What changed from one session to another, in words.",
    "verify": "Our dissection beside Wireshark's, field by field.",
    "monitor": "What happens on a line, while it happens.",
    "interfaces": "What can be captured live here, and by whom.",
    "proxy": "A TCP relay before a PLC that tells what passes.",
    "serve": "A fake PLC that answers as a recorded one did.",
    "replay": "The client's side of a session, to a real server.",
    "scd": "Dictionaries of SCD, and values by them.",
    "schema": "JSON Schemas of what these write for programs.",
}


#: What the system says when an output has no room, whatever its name is.
_FULL: Final = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))

#: Set by the shell when it asks for completions.
_COMPLETION: Final = "_S7DISSECT_COMPLETE"


class LazyGroup(click.Group):
    """A group that lists its commands from `COMMANDS` and imports one only to use it."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return the command, None when there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = importlib.import_module(f"dissect.cli.{cmd_name}").command
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands without importing one."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))


@click.command(cls=LazyGroup, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(
    __version__, prog_name="s7dissect", message=f"%(prog)s %(version)s ({'compiled' if COMPILED else 'interpreted'})"
)
def group() -> None:
    """Dissect and analyze Siemens S7 communication."""


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line on ``arguments`` (default: those of the process) and end the process with its exit code."""
    sys.exit(_run(arguments))


def _run(arguments: list[str] | None) -> int:
    """Run one command and turn every expected end of it into an exit code and at most one line on stderr."""
    if sys.stdout is None:
        click.echo("s7dissect: there is no standard output to write to", err=True)
        return EXIT_OUTPUT
    try:
        result = group.main(arguments, prog_name="s7dissect", complete_var=_COMPLETION, standalone_mode=False)
        sys.stdout.flush()
    except click.ClickException as exc:
        _show(exc, sys.argv[1:] if arguments is None else arguments)
        return EXIT_USAGE
    except (click.Abort, KeyboardInterrupt):
        click.echo("s7dissect: interrupted", err=True)
        return EXIT_INTERRUPTED
    except OSError as exc:
        return _system_refused(exc)
    except SystemExit:
        if _COMPLETION in os.environ:
            raise
        # In this mode click ends the process by itself for a closed pipe only, and with the code of a failed gate.
        return _system_refused(BrokenPipeError(errno.EPIPE, "Broken pipe"))
    except Exception as exc:
        from dissect.source.packet import CaptureError

        if not isinstance(exc, CaptureError):
            raise
        _say(str(exc))
        for line in getattr(exc, "advice", ()):
            click.echo(f"    {printable(line)}", err=True)
        return EXIT_USAGE
    return result if isinstance(result, int) else EXIT_OK


def _say(text: str) -> None:
    """Write one line to stderr. Names of files and words of the command line are in it, so it is escaped here."""
    click.echo(f"s7dissect: {printable(text)}", err=True)


def _show(exc: click.ClickException, arguments: list[str]) -> None:
    """Write what click says of wrong use, with nothing in it that a name could do to a terminal."""
    for word in arguments:
        if not word.isprintable():  # click breaks its own lines; a name must not
            vars(exc)["message"] = exc.message.replace(word, printable(word))
    said = io.StringIO()
    exc.show(file=said)
    click.echo("\n".join([printable(line) for line in said.getvalue().rstrip("\n").split("\n")]), err=True)


def _system_refused(exc: OSError) -> int:
    """Return the exit code for what the system refused: a file the user named, or else the output.

    A closed pipe is no fault of ours: whoever read it has seen enough.
    """
    if exc.filename is not None:
        full = exc.errno in _FULL
        name, why = os.fsdecode(exc.filename), exc.strerror or type(exc).__name__
        _say(f"cannot write {name}: {why}" if full else f"{name}: {why}")
        return EXIT_OUTPUT if full else EXIT_USAGE
    # Whatever is still buffered cannot be written either: let the interpreter flush it into nothing.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if exc.errno == errno.EPIPE:
        return EXIT_OK
    _say(f"cannot write the results: {reason(exc)}")
    return EXIT_OUTPUT
