"""`s7dissect evidence export`: one incident, to be handed on: files, manifest, packets, report."""

from __future__ import annotations

import contextlib
import shutil
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.evidence import EXIT_PROBLEMS
from dissect.cli.main import EXIT_INTERRUPTED, EXIT_OK
from dissect.cli.options.given import was_given
from dissect.cli.options.select import read_time, time_option
from dissect.wire.text import Clock, count, printable, reason

if TYPE_CHECKING:
    from dissect.files.recording.incident import Chosen

_SECOND: Final = 1_000_000_000
_MOST: Final = 1 << 20


@click.command(
    "export",
    epilog="Exit code: 0 exported, 1 exported, but a file of that time is missing, changed, or in no entry, 2 wrong use, or "
    "nothing of that time, 130 interrupted (nothing is left).",
)
@click.argument("directory", type=click.Path(readable=False), metavar="DIR")
@click.option("-o", "--output", required=True, metavar="OUT", help="Folder to make; it must not exist.")
@time_option("Export this time, both ends with date:")
@click.option(
    "--alert",
    "alert",
    metavar="FILE",
    help="Export the time of this alert (its JSON as a webhook or command got it; - is standard input).",
)
@click.option(
    "--around",
    "around_s",
    type=click.IntRange(0, 86_400),
    default=60,
    show_default=True,
    metavar="SECONDS",
    help="With --alert: export so much before and after it.",
)
def export_command(directory: str, output: str, window: str | None, alert: str | None, around_s: int) -> int:
    """Write one incident of the evidence in DIR to the new folder OUT.

    OUT gets the files of the ring that hold that time, unchanged, with the part of the manifest that proves them; the packets
    of that time as incident.pcapng; a report of them as incident.html; and a manifest of what was made. Check it with
    `s7dissect evidence verify OUT --head HASH`, with a hash that was noted elsewhere.
    """
    from dissect.files.recording import incident

    if (window is None) == (alert is None):
        raise click.UsageError("give either --time or --alert.")
    if alert is None and was_given("around_s"):
        raise click.UsageError("--around needs --alert.")
    begin_ns, end_ns = _range(window, alert, around_s)
    place, out = Path(directory), Path(output)
    try:
        chosen = incident.choose(place, begin_ns, end_ns)
        if not chosen.files:
            raise click.ClickException(
                f"{printable(directory)}: no file in a manifest holds that time; nothing was written."
            )
        out.mkdir(mode=0o750)
        head = _filled(out, chosen, place, begin_ns, end_ns)
    except OSError as error:
        raise click.ClickException(reason(error)) from None
    for problem in chosen.problems:
        click.echo(f"s7dissect: {printable(problem)}", err=True)
    text = f"{count(len(chosen.files), 'file')} exported to {printable(output)}"
    click.echo(f"s7dissect: {text}; head {head}", err=True)
    return EXIT_PROBLEMS if chosen.problems else EXIT_OK


def _filled(out: Path, chosen: Chosen, place: Path, begin_ns: int, end_ns: int) -> str:
    """Fill the folder ``out`` and return the hash of the last entry about it; remove the folder if that fails.

    Raises OSError.
    """
    from dissect.files.recording import incident

    try:
        incident.copy_into(chosen, out)
        made = _made(out, [out / path.name for path in chosen.files], begin_ns, end_ns)
        clock = Clock()
        facts: dict[str, Any] = {
            "source": str(place.resolve()),
            "from": clock.iso(begin_ns),
            "to": clock.iso(end_ns),
            "files": [path.name for path in chosen.files],
            "problems": chosen.problems,
        }
        return incident.account(out, clock.iso(time.time_ns()), made, **facts)
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise


def _range(window: str | None, alert: str | None, around_s: int) -> tuple[int, int]:
    """Return the requested time range."""
    from dissect.files.recording.incident import resolved, window_of

    try:
        if alert is not None:
            begin, end = _alert_times(alert)
            return window_of(begin, around_s * _SECOND)[0], window_of(end, around_s * _SECOND)[1]
        times = read_time(window)
        assert times is not None
        return resolved(times.window)
    except ValueError as error:
        hint = "'--alert'" if alert is not None else "'--time'"
        raise click.BadParameter(f"{error}.", param_hint=hint) from None


def _alert_times(alert: str) -> tuple[str, str]:
    """Return when the events of an alert began, and the time of the alert. Raises ValueError for an invalid alert."""
    from dissect.wire.config.hostile import ContentError, read_json

    try:
        parsed = read_json(_content(alert))
    except OSError as error:
        raise ValueError(reason(error)) from None
    except ContentError as error:
        raise ValueError(str(error)) from None
    times = [parsed.get(key) for key in ("since", "time")] if isinstance(parsed, dict) else [None, None]
    since, at = [one if isinstance(one, str) else "" for one in times]
    if not at:
        raise ValueError("invalid alert: it has no time")
    return since or at, at


def _content(alert: str) -> bytes:
    with contextlib.nullcontext(sys.stdin.buffer) if alert == "-" else Path(alert).open("rb") as file:
        content = file.read(_MOST + 1)
    if len(content) > _MOST:
        raise ValueError(f"invalid alert: it has more than {_MOST >> 20} MiB")
    return content


def _made(out: Path, files: list[Path], begin_ns: int, end_ns: int) -> list[Path]:
    """Write the packets of that time, and a report of them; return the files."""
    from dissect.cli.cut import command as cut
    from dissect.cli.report import command as report

    packets, page = out / "incident.pcapng", out / "incident.html"
    clock = Clock()
    context = click.get_current_context()
    window = f"{clock.iso(begin_ns)}..{clock.iso(end_ns)}"
    names = [str(path) for path in files]
    made = []
    for command, path, given in (
        (cut, packets, [*names, "-o", str(packets), "--time", window]),
        (report, page, [str(packets), "-o", str(page)]),
    ):
        try:
            code = command.main(given, command.name, standalone_mode=False, parent=context)
        except click.ClickException as error:  # no packet of that time, or no library that makes pages
            click.echo(f"s7dissect: no {path.name}: {error.format_message()}", err=True)
            break
        if code == EXIT_INTERRUPTED:
            raise click.exceptions.Exit(code)
        made.append(path)
    return made
