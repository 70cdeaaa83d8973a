"""The command ``s7dissect``: its subcommands by name, its exit codes, and no slow imports.

A subcommand is in ``dissect/cli/<name>.py`` as a click command called ``command`` and is imported when it runs or shows its own
help; the list of commands is printed from the table below.

Exit codes: 0 fine, 1 a gate failed, 2 usage or unreadable input, 3 finished on damaged input, 5 the output could not be
written, 130 interrupted. A command returns its code; ``None`` means 0.
"""

from __future__ import annotations

import errno
import importlib
import io
import os
import sys
from functools import partial
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

#: The list of commands: under each heading each command and its line.
HEADINGS: Final = {
    "Look": {
        "analyze": "Summarize a capture: connections, timing, errors, findings.",
        "transactions": "List requests with their answers, values and latency.",
        "values": "List values of variables: when, who, what before.",
        "operations": "List downloads, uploads, subscriptions, passwords.",
        "blocks": "Downloaded and uploaded blocks: list, extract, compare.",
        "devices": "List devices: what each is, and who talks to whom.",
        "show": "List S7 PDUs, or dissect them field by field.",
        "report": "Write an HTML page: verdict, plots, tables.",
        "sql": "Query the traffic in SQL.",
        "index": "Index a folder of captures: which can answer a question.",
    },
    "Hand on": {
        "open": "Open a capture in Wireshark, findings as comments.",
        "cut": "Extract part of a capture, findings as packet comments.",
        "evidence": "Compare evidence with its manifest.",
        "anonymize": "Replace addresses, names and values for sharing.",
        "export": "Tables and logs for other tools: Parquet, SQL, Zeek …",
        "browser": "Write the analyzer as one HTML file: no installation.",
    },
    "Compare": {
        "baseline": "Learn what is normal, or report what is not.",
        "golden": "Write a session as stable text to keep and compare.",
        "diff": "Report what changed between two sessions.",
        "verify": "Compare our dissection with Wireshark's.",
    },
    "Live": {
        "monitor": "Watch live S7 traffic.",
        "alerts": "Test the actions of alert rules.",
        "proxy": "TCP relay in front of a PLC that reports what passes.",
        "serve": "Fake PLC that answers like a recorded one.",
        "replay": "Play a recorded client to a server, check the answers.",
    },
    "Develop": {
        "scd": "SCD dictionaries: compile, check, decode, encode.",
        "tags": "Names for addresses: check, list, convert tags.",
    },
    "Reference": {
        "help": "Show the manual page of a command or topic.",
        "fields": "List the fields of -Y expressions and -T fields.",
        "schema": "JSON Schemas of the machine-readable outputs.",
        "completion": "Completion for bash, zsh or fish.",
        "interfaces": "List interfaces and what can capture on them.",
        "extcap": "Capture in Wireshark with findings as comments.",
        "cluster-check": "Check the workers of a Dask cluster before --cluster.",
    },
}
#: Each command and its line.
COMMANDS: Final = {name: line for commands in HEADINGS.values() for name, line in commands.items()}
#: Commands whose output shows times.
_TIMED: Final = frozenset(
    (
        "analyze",
        "transactions",
        "values",
        "operations",
        "devices",
        "blocks",
        "show",
        "report",
        "baseline",
        "index",
        "monitor",
        "proxy",
    )
)
#: Commands that take times but write none in a time zone.
_TAKES_TIMES: Final = frozenset(("cut", "open", "export", "sql", "golden", "diff"))
#: Parameters of options that many commands have; help lists them last.
_COMMON: Final = frozenset(
    (
        "numbers_of", "window", "where", "first_results", "columns", "checksums", "fail_on", "scd", "bind", "tags", "encoding",
        "numbers", "tls_keys", "separate", "jobs", "cluster", "indexed", "local_time", "color", "config",
    )
)  # fmt: skip
#: Words that people type as if they were commands, and the option that does it.
_WORDS: Final = {"version": "--version"}

#: Errors of the system for an output without room, whatever its name is.
FULL: Final = frozenset((errno.ENOSPC, errno.EDQUOT, errno.EFBIG))

#: Under this the context keeps the arguments of the whole command line.
ARGUMENTS: Final = "dissect.cli.main.arguments"

#: Set by the shell when it requests completions.
COMPLETION: Final = "_S7DISSECT_COMPLETE"


class LazyGroup(click.Group):
    """A group that lists its commands from a table and imports one only to use it.

    Every command gets ``--color``, those that show times ``--local-time``, and its help the examples it has.
    """

    #: Prefix of the names of the commands in `dissect.cli.examples`.
    prefix = ""

    def summaries(self) -> dict[str, str]:
        """Return each command and its line in the list of commands."""
        return COMMANDS

    def load(self, name: str) -> click.Command:
        """Import a command."""
        module = name.replace("-", "_")
        command: click.Command = importlib.import_module(f"dissect.cli.{module}").command
        return command

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of the table."""
        return list(self.summaries())

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import and return the command, None if there is none of that name."""
        if cmd_name not in self.summaries():
            return None
        return _equipped(self.load(cmd_name), self.prefix + cmd_name)

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; for a wrong name, suggest similar ones."""
        name = args[0]
        if name in self.summaries() or name.startswith("-") or ctx.resilient_parsing:
            return super().resolve_command(ctx, args)
        raise click.UsageError(f"No such command {name!r}.{self.hint(name)}", ctx)

    def hint(self, name: str) -> str:
        """Return a further sentence for a name that no command has: what may have been meant."""
        import difflib  # late: a run without this mistake does not need it

        names = list(self.summaries())
        near = [each for each in names if each.startswith(name)] or difflib.get_close_matches(name, names, n=2)
        return f" Did you mean {' or '.join(near)}?" if near else ""

    def headings(self) -> dict[str, dict[str, str]]:
        """Return the list of commands under headings."""
        return {"Commands": self.summaries()}

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the list of commands, aligned in one column, without importing any."""
        listed = self.headings()
        width = max([len(name) for names in listed.values() for name in names])
        for heading, names in listed.items():
            with formatter.section(heading):
                formatter.write_dl([(name.ljust(width), line) for name, line in names.items()])


class _Main(LazyGroup):
    """The whole command line: words that replace options, and a file in place of a command."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Take ``s7dissect version`` for ``--version``, and a file, or ``-r FILE`` as tshark has it, for ``analyze FILE``."""
        if args and args[0] == "-r":
            args = ["analyze", *args[1:]]
        elif args and args[0] not in COMMANDS and os.path.isfile(args[0]):  # noqa: PTH113 - any text may be asked for
            args = ["analyze", *args]
        args = [_WORDS.get(args[0], args[0]), *args[1:]] if args else args
        ctx.meta[ARGUMENTS] = list(args)
        return super().parse_args(ctx, args)

    def headings(self) -> dict[str, dict[str, str]]:
        """Return the list of commands under headings; commands without a heading come last."""
        named = {name for names in HEADINGS.values() for name in names}
        rest = {name: line for name, line in COMMANDS.items() if name not in named}
        return {**HEADINGS, "More": rest} if rest else dict(HEADINGS)

    def hint(self, name: str) -> str:
        """Return what may have been meant; a folder is probably meant for `index`."""
        if os.path.isdir(name):  # noqa: PTH112 - a name that no path can have is simply not there
            return f" It is a folder: s7dissect index {printable(name)}"
        return super().hint(name) or (" There is no such file either." if "." in name and "://" not in name else "")


def _equipped(command: click.Command, path: str) -> click.Command:
    """Give a command, once, the options and examples that all commands have."""
    from dissect.cli.configuration import config_option, wants_config
    from dissect.cli.display import color_option, local_time_option
    from dissect.cli.examples import examples_of

    if any([parameter.name == "color" for parameter in command.params]):
        return command
    if path in _TIMED:
        command.params.append(local_time_option(shows=True))
    elif path in _TAKES_TIMES:
        command.params.append(local_time_option(shows=False))
    command.params.append(color_option())
    if wants_config(command):
        command.params.append(config_option())
    command.format_options = partial(_write_options, command)  # type: ignore[method-assign]  # for any class of command
    command.epilog = "\n\n".join([text for text in (examples_of(path), command.epilog) if text])
    return command


def _write_options(command: click.Command, ctx: click.Context, formatter: click.HelpFormatter) -> None:
    """Write the options of a command in help: its own first, those of many commands under a heading of their own."""
    own: list[tuple[str, str]] = []
    common: list[tuple[str, str]] = []
    for parameter in command.get_params(ctx):
        record = parameter.get_help_record(ctx) if isinstance(parameter, click.Option) else None
        if record is not None:
            (common if parameter.name in _COMMON or "--help" in parameter.opts else own).append(record)
    for heading, records in (("Options", own), ("Common options" if own else "Options", common)):
        if records:
            with formatter.section(heading):
                formatter.write_dl(records)
    if isinstance(command, click.Group):
        command.format_commands(ctx, formatter)


@click.command(
    cls=_Main,
    context_settings={"help_option_names": ["-h", "--help"]},
    epilog="\b\nTo begin with:\n  s7dissect analyze trace.pcapng\n  s7dissect monitor -i eth0\n\n"
    "s7dissect COMMAND --help shows the options of a command, s7dissect help COMMAND its manual page.",
)
@click.version_option(
    __version__, prog_name="s7dissect", message=f"%(prog)s %(version)s ({'compiled' if COMPILED else 'interpreted'})"
)
def group() -> None:
    """Dissect and analyze Siemens S7 communication."""


def main(arguments: list[str] | None = None) -> NoReturn:
    """Run the command line on ``arguments`` (default: those of the process) and end the process with its exit code."""
    sys.exit(run(arguments))


def run(arguments: list[str] | None = None) -> int:
    """Run one command and return its exit code; every expected failure becomes a code and at most one line on stderr."""
    if sys.stdout is None:
        click.echo("s7dissect: standard output is closed", err=True)
        return EXIT_OUTPUT
    _write_utf8()
    try:
        result = group.main(arguments, prog_name="s7dissect", complete_var=COMPLETION, standalone_mode=False)
        sys.stdout.flush()
    except click.ClickException as exc:
        _show(exc, sys.argv[1:] if arguments is None else arguments)
        return EXIT_USAGE
    except (click.Abort, KeyboardInterrupt):
        click.echo("s7dissect: interrupted", err=True)
        return EXIT_INTERRUPTED
    except SystemExit:
        if COMPLETION in os.environ:
            raise
        # In this mode click ends the process itself only for a closed pipe, and with the code of a failed gate.
        return _system_refused(BrokenPipeError(errno.EPIPE, "Broken pipe"))
    except Exception as exc:
        from dissect.packets.source.packet import CaptureError

        if not isinstance(exc, CaptureError):  # a missing file is both
            if isinstance(exc, OSError):
                return _system_refused(exc)
            raise
        _say(str(exc))
        for line in getattr(exc, "advice", ()):
            click.echo(f"    {printable(line)}", err=True)
        return EXIT_USAGE
    return result if isinstance(result, int) else EXIT_OK


def _write_utf8() -> None:
    """Let help and messages on stdout be UTF-8, like results, whatever the locale or ``PYTHONIOENCODING`` says.

    A code page of Windows lacks some of their characters, and parts of one stream would have different encodings. On stderr,
    Python escapes characters that its code page lacks.
    """
    stream = sys.stdout
    if isinstance(stream, io.TextIOWrapper) and stream.encoding.lower() not in {"utf-8", "utf8"}:
        stream.reconfigure(encoding="utf-8", errors="backslashreplace")


def _say(text: str) -> None:
    """Write one line to stderr. It is escaped here, because it contains file names and words of the command line."""
    click.echo(f"s7dissect: {printable(text)}", err=True)


def _show(exc: click.ClickException, arguments: list[str]) -> None:
    """Write click's error about wrong use, with names escaped for the terminal."""
    vars(exc)["message"] = exc.message + _meant(exc, arguments)
    for word in arguments:
        if not word.isprintable():  # click breaks its own lines; a name must not
            vars(exc)["message"] = exc.message.replace(word, printable(word))
    output = io.StringIO()
    exc.show(file=output)
    # click separates choices by tabs; tabs in names were escaped above, so these are click's own
    lines = output.getvalue().rstrip("\n").replace("\n\t", "\n    ").split("\n")
    click.echo("\n".join([printable(line) for line in lines]), err=True)


def _meant(exc: click.ClickException, arguments: list[str]) -> str:
    """Return what may have been meant if click does not say it: a value of a list, an option before its command."""
    if isinstance(exc, click.BadParameter) and exc.param is not None and isinstance(exc.param.type, click.Choice):
        from dissect.wire.config.hints import close_names

        words = [word.rpartition("=")[2] for word in arguments]
        near = [close_names(word, list(exc.param.type.choices)) for word in words if repr(word) in exc.message]
        return f" Did you mean {' or '.join(near[0])}?" if near and near[0] else ""
    if isinstance(exc, click.NoSuchOption) and exc.ctx is not None and exc.ctx.parent is None and not exc.possibilities:
        command = next((word for word in arguments if word in COMMANDS), None)
        return f" Options follow their command: s7dissect {command} {exc.option_name}" if command else ""
    return ""


def _system_refused(exc: OSError) -> int:
    """Return the exit code for an error of the system: about a file that the user named, or else about the output.

    A closed pipe is not our error: its reader has read enough.
    """
    if exc.filename is not None:
        full = exc.errno in FULL
        name, why = os.fsdecode(exc.filename), exc.strerror or type(exc).__name__
        why += "; choose another name" if exc.errno == errno.EEXIST else ""
        _say(f"cannot write {name}: {why}" if full else f"{name}: {why}")
        return EXIT_OUTPUT if full else EXIT_USAGE
    # Whatever is still buffered cannot be written either: let the interpreter flush it into nothing.
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    if exc.errno == errno.EPIPE:
        return EXIT_OK
    _say(f"cannot write the results: {reason(exc)}")
    return EXIT_OUTPUT
