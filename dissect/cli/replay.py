"""`s7dissect replay`: the client's side of a recorded session, played to a real server, every answer checked."""

from __future__ import annotations

import re
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.diff import json_lines, json_values, junit_lines, text_lines
from dissect.cli.main import EXIT_GATE, EXIT_OK, EXIT_OUTPUT, EXIT_USAGE
from dissect.cli.options.scd import scd_options
from dissect.cli.run import format_option, write
from dissect.golden.difference import DiffOptions
from dissect.golden.model import GoldenError
from dissect.report import words
from dissect.wire.text import printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dissect.engine.payload import PayloadDecoder
    from dissect.metrics.address import Address
    from dissect.playback.client import Outcome, Part, Permissions, Recorded, Settings
    from dissect.source.pcapng_writer import PcapngWriter

REPLAY_SCHEMA: Final = "s7dissect.replay/1"

_EXIT_CODES: Final = (
    "Exit code: 0 the server said what was recorded, 1 it did not, 2 wrong use, a file that cannot be read or is damaged, a "
    "target that is not allowed or cannot be reached, 5 the output failed, 130 interrupted."
)
_TSAP: Final = re.compile(r"[0-9A-Fa-f]{2}(?:\.?[0-9A-Fa-f]{2})*")
_MAX_TSAP: Final = 32


def _called(ctx: click.Context, param: click.Parameter, value: str | None) -> bytes | None:
    if value is None:
        return None
    octets = bytes.fromhex(value.replace(".", "")) if _TSAP.fullmatch(value) else value.encode("ascii", "replace")
    if not value.isascii() or not 0 < len(octets) <= _MAX_TSAP:
        raise click.BadParameter(f"{value!r} is no TSAP: octets such as 01.02, or a text.", ctx, param)
    return octets


def _pace(ctx: click.Context, param: click.Parameter, value: str) -> float | None:
    if value == "asap":
        return None
    try:
        factor = 1.0 if value == "recorded" else float(value)
    except ValueError:
        factor = -1.0
    if not 0 <= factor <= 1000:
        raise click.BadParameter(f"{value!r} is neither asap nor recorded nor a factor such as 0.5.", ctx, param)
    return factor


@click.command("replay", epilog=_EXIT_CODES)
@click.argument("file", metavar="FILE", type=click.Path())
@click.option("--to", "to", metavar="HOST[:PORT]", help="The server; port 102 unless said. Needed unless --dry-run.")
@click.option("--allow-remote", is_flag=True, help="Let --to be another machine.")
@click.option("--allow-write", is_flag=True, help="Send Write Var as well.")
@click.option(
    "--allow-control",
    is_flag=True,
    help="Send what controls the device as well: stop, start, PI services, downloads, clock, password, and all that does "
    "not surely only read.",
)
@click.option(
    "--dry-run", is_flag=True, help="Say what would be sent and what would not; nothing is opened or looked up."
)
@click.option(
    "--connection",
    "numbers",
    type=click.IntRange(min=1),
    multiple=True,
    metavar="N",
    help="Play this connection only, numbered as `s7dissect golden` does; may be given several times.",
)
@click.option(
    "--tsap", callback=_called, metavar="TSAP", help="Call this TSAP instead of the recorded one, such as 01.02."
)
@click.option("--rack", type=click.IntRange(0, 7), metavar="N", help="Call this rack …")
@click.option("--slot", type=click.IntRange(0, 31), metavar="N", help="… and slot instead of the recorded ones.")
@click.option(
    "--timing",
    "pace",
    callback=_pace,
    default="asap",
    show_default=True,
    metavar="WHEN",
    help="asap, recorded, or a factor for the recorded pauses.",
)
@click.option(
    "--pipelined", is_flag=True, help="Send requests before earlier ones are answered where that was recorded."
)
@click.option("--one-by-one", is_flag=True, help="Play connections one after another that were open at the same time.")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.01, 3600),
    default=5,
    show_default=True,
    metavar="S",
    help="For each answer.",
)
@click.option(
    "--retries", type=click.IntRange(0, 100), default=0, show_default=True, help="Attempts to connect after the first."
)
@click.option("-w", "--write", "output", metavar="OUT", help="Write what is exchanged to this pcapng file.")
@click.option("--force", is_flag=True, help="Overwrite OUT where it exists.")
@format_option("text", "json", "junit")
@click.option("--ignore", multiple=True, metavar="WHAT", help="Leave this unsaid, as in `s7dissect diff`.")
@click.option("--latency", metavar="TOLERANCE", help="Compare answer times as well, as in `s7dissect diff`.")
@click.option("--max", "most", type=click.IntRange(min=0), default=100, show_default=True, help="Differences to write.")
@scd_options
def command(
    file: str,
    to: str | None,
    allow_remote: bool,
    allow_write: bool,
    allow_control: bool,
    dry_run: bool,
    numbers: tuple[int, ...],
    tsap: bytes | None,
    rack: int | None,
    slot: int | None,
    pace: float | None,
    pipelined: bool,
    one_by_one: bool,
    timeout_s: float,
    retries: int,
    output: str | None,
    force: bool,
    format_: str,
    ignore: tuple[str, ...],
    latency: str | None,
    most: int,
    decoder: PayloadDecoder | None,
) -> int:
    """Play the client's side of a capture or golden to a real server, and say where its answers are not the recorded ones.

    Only reads are sent, and only to this machine, unless more is allowed. References, sequence numbers and upload ids are new,
    sizes are negotiated; each request is sent once, when what came before it in the recording is answered, on its own
    connection and on those that were open beside it. What was withheld, and why, is told at the end.
    """
    from dissect.playback.client import (
        Permissions,
        Settings,
        expect_few,
        load_recorded,
        make_plan,
        plan_lines,
        read_target,
    )
    from dissect.playback.client.target import expect_allowed

    try:
        options = DiffOptions([part for text in ignore for part in text.split(",") if part], latency)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    target = read_target(to) if to is not None else None
    if target is not None:
        expect_allowed(target, allow_remote)
    elif not dry_run:
        raise click.UsageError("--to HOST:PORT is missing: where the server is (or --dry-run).")
    if dry_run and format_ != "text":
        raise click.UsageError("--dry-run says what would be sent as text: -T is for what comes of it.")
    _check_output(file, output)
    recorded = load_recorded(file, decoder)
    plan = make_plan(recorded, numbers, _place(tsap, rack, slot))
    if not one_by_one:
        expect_few(plan)
    permissions = Permissions(allow_write, allow_control)
    for line in recorded.session.damage:
        _say(line)
    if pace is not None and not any([link.transactions and link.transactions[0].time_ns for link in recorded.links]):
        raise click.UsageError(f"{file} has no times, so --timing can only be asap.")
    if dry_run or target is None:
        write([printable(line) for line in plan_lines(plan, permissions)])
        return EXIT_OK
    settings = Settings(pace, timeout_s, pipelined, retries, one_by_one=one_by_one)
    outcome = _replayed(recorded, plan, (target, allow_remote), (permissions, settings), (output, force), decoder)
    outcome.expected.damage = recorded.session.damage
    return _report(outcome, options, format_, most)


def _place(tsap: bytes | None, rack: int | None, slot: int | None) -> bytes | tuple[int, int] | None:
    if rack is None and slot is None:
        return tsap
    if tsap is not None or rack is None or slot is None:
        raise click.UsageError("--rack and --slot belong together, and --tsap stands alone.")
    return rack, slot


def _check_output(file: str, output: str | None) -> None:
    if output == "-":
        raise click.UsageError("-w takes a file: standard output is for the differences.")
    if output is not None and Path(output).exists() and Path(file).exists() and Path(output).samefile(file):
        raise click.UsageError("-w would overwrite the recording.")


def _replayed(
    recorded: Recorded,
    plan: Sequence[Part],
    where: tuple[Address, bool],
    how: tuple[Permissions, Settings],
    out: tuple[str | None, bool],
    decoder: PayloadDecoder | None,
) -> Outcome:
    from dissect.playback.client import places_of, replay

    places = places_of(*where)
    writer = _writer(*out) if out[0] is not None else None
    try:
        return replay(recorded, plan, places, where[0], *how, writer, decoder)
    except GoldenError as error:
        raise click.ClickException(printable(str(error))) from None


def _writer(output: str | None, force: bool) -> PcapngWriter:
    from dissect import __version__
    from dissect.source.pcapng_writer import PcapngWriter

    return PcapngWriter(str(output), application=f"s7dissect {__version__} replay", overwrite=force)


def _report(outcome: Outcome, options: DiffOptions, format_: str, most: int) -> int:
    found = outcome.differences(options)
    shown = list(islice(found, most))
    rest = sum([1 for _ in found])
    sides = (outcome.expected, outcome.came)
    if format_ == "json":
        values = {"schema": REPLAY_SCHEMA, **json_values(*sides, shown, rest), "replay": outcome.as_dict()}
        write(json_lines(values))
    elif format_ == "junit":
        unreachable = words.count(outcome.unreachable, "connection")
        errors = [("unreachable", f"{unreachable} could not be made")] if outcome.unreachable else []
        write(junit_lines(*sides, shown, rest, errors))
    else:
        write(text_lines(*sides, shown, rest))
    for line in outcome.summary():
        _say(line)
    if outcome.file_trouble:
        _say(f"the capture file is not whole: {outcome.file_trouble}")
        return EXIT_OUTPUT
    if outcome.unreachable or outcome.expected.damage:
        return EXIT_USAGE
    return EXIT_GATE if shown or rest else EXIT_OK


def _say(text: str) -> None:
    click.echo(f"s7dissect: {printable(text)}", err=True)
