"""`s7dissect replay`: plays the client side of a recorded session to a real server and checks every answer."""

from __future__ import annotations

import re
from itertools import islice
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.diff import SessionDifferences
from dissect.cli.display import write_text
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_GATE, EXIT_INTERRUPTED, EXIT_OK, EXIT_OUTPUT, EXIT_USAGE
from dissect.cli.options.scd import scd_options
from dissect.cli.second_pass import check_out
from dissect.cli.watching import LiveInterruption
from dissect.meaning.report import words
from dissect.meaning.report.formats import DIFFERENCES, Format, formats_for
from dissect.testing.golden.difference import DiffOptions
from dissect.testing.golden.model import GoldenError, Session
from dissect.wire.text import printable

if TYPE_CHECKING:
    from collections.abc import Sequence

    from dissect.engine.exchange import PayloadDecoder
    from dissect.online.net.addresses import Address
    from dissect.packets.source.pcapng_writer import PcapngWriter
    from dissect.testing.playback.client import Part, Permissions, ReplayOutcome, Settings

REPLAY_SCHEMA: Final = "s7dissect.replay/1"

_EXIT_CODES: Final = (
    "Exit code: 0 the answers match the recording, 1 they differ, 2 wrong use, an unreadable or damaged file, or a target that "
    "is not allowed or cannot be reached, 5 the output could not be written, 130 interrupted by SIGINT or SIGTERM (with "
    "results)."
)
_TSAP: Final = re.compile(r"[0-9A-Fa-f]{2}(?:\.?[0-9A-Fa-f]{2})*")
_MAX_TSAP: Final = 32


def _called(ctx: click.Context, param: click.Parameter, value: str | None) -> bytes | None:
    if value is None:
        return None
    octets = bytes.fromhex(value.replace(".", "")) if _TSAP.fullmatch(value) else value.encode("ascii", "replace")
    if not value.isascii() or not 0 < len(octets) <= _MAX_TSAP:
        raise click.BadParameter(f"expected a TSAP (bytes such as 01.02, or text), got {value!r}.", ctx, param)
    return octets


def _pace(ctx: click.Context, param: click.Parameter, value: str) -> float | None:
    if value == "asap":
        return None
    try:
        factor = 1.0 if value == "recorded" else float(value)
    except ValueError:
        factor = -1.0
    if not 0 <= factor <= 1000:
        raise click.BadParameter(f"expected asap, recorded or a factor such as 0.5, got {value!r}.", ctx, param)
    return factor


@click.command("replay", epilog=_EXIT_CODES)
@click.argument("file", metavar="FILE", type=click.Path(readable=False))
@click.option("--to", "to", metavar="HOST[:PORT]", help="The server (default port 102). Required unless --dry-run.")
@click.option("--allow-remote", is_flag=True, help="Allow a --to address on another machine.")
@click.option("--allow-write", is_flag=True, help="Also send Write Var.")
@click.option(
    "--allow-control",
    is_flag=True,
    help="Also send control requests: stop, start, PI services, downloads, clock, password, and any request that is not "
    "known to only read.",
)
@click.option(
    "--dry-run",
    is_flag=True,
    help="Report what would be sent and what would be withheld; nothing is opened or resolved.",
)
@click.option(
    "--connection",
    "numbers",
    type=click.IntRange(min=1),
    multiple=True,
    metavar="N",
    help="Only this connection, numbered as by `s7dissect golden`. Repeatable.",
)
@click.option(
    "--tsap", callback=_called, metavar="TSAP", help="Called TSAP to use instead of the recorded one, such as 01.02."
)
@click.option(
    "--rack", type=click.IntRange(0, 7), metavar="N", help="Rack to use instead of the recorded one; needs --slot."
)
@click.option(
    "--slot", type=click.IntRange(0, 31), metavar="N", help="Slot to use instead of the recorded one; needs --rack."
)
@click.option(
    "--timing",
    "pace",
    callback=_pace,
    default="asap",
    show_default=True,
    metavar="WHEN",
    help="Pacing: asap, recorded, or a multiple of the recorded delays.",
)
@click.option("--pipelined", is_flag=True, help="Send requests before earlier ones are answered, as recorded.")
@click.option("--one-by-one", is_flag=True, help="Play connections that were open at the same time one after another.")
@click.option(
    "--timeout",
    "timeout_s",
    type=click.FloatRange(0.01, 3600),
    default=5,
    show_default=True,
    metavar="S",
    help="Maximum wait for each answer, in seconds.",
)
@click.option(
    "--retries",
    type=click.IntRange(0, 100),
    default=0,
    show_default=True,
    metavar="N",
    help="Further attempts to connect.",
)
@click.option("-w", "--write", "output", metavar="OUT", help="Write the traffic to this pcapng file.")
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists.")
@format_option(DIFFERENCES)
@click.option("--ignore", multiple=True, metavar="WHAT", help="Ignore this kind of difference, as in `s7dissect diff`.")
@click.option("--latency", metavar="TOLERANCE", help="Also compare answer times, as in `s7dissect diff`.")
@click.option(
    "--max",
    "most",
    type=click.IntRange(min=0),
    default=100,
    show_default=True,
    metavar="N",
    help="Maximum number of differences to print.",
)
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
    format_: Format,
    ignore: tuple[str, ...],
    latency: str | None,
    most: int,
    decoder: PayloadDecoder | None,
) -> int:
    """Play the client side of a capture or golden to a real server, and report where its answers differ from the recording.

    By default only reads are sent, and only to this machine. References, sequence numbers and upload ids are new, sizes are
    negotiated. Each request is sent once, after everything before it in the recording was answered, on its own connection and
    on those open at the same time. The withheld requests are reported at the end, with the reasons.
    """
    from dissect.testing.playback.client import (
        Permissions,
        Settings,
        expect_few,
        load_recorded,
        make_plan,
        plan_lines,
        read_target,
    )
    from dissect.testing.playback.client.target import expect_allowed

    try:
        options = DiffOptions([part for text in ignore for part in text.split(",") if part], latency)
    except ValueError as error:
        raise click.UsageError(str(error)) from None
    target = read_target(to) if to is not None else None
    if target is not None:
        expect_allowed(target, allow_remote)
    elif not dry_run:
        raise click.UsageError("missing --to HOST:PORT, the server (or --dry-run).")
    if dry_run and format_ is not formats_for(DIFFERENCES)[0]:
        raise click.UsageError("--dry-run writes text only; -T applies to the result of a replay.")
    if output == "-":
        raise click.UsageError("-w needs a file: standard output is used for the differences.")
    if output is not None and not dry_run:
        check_out((file,), output, force)
    recorded = load_recorded(file, decoder)
    plan = make_plan(recorded, numbers, _place(tsap, rack, slot))
    if not one_by_one:
        expect_few(plan)
    permissions = Permissions(allow_write, allow_control)
    for line in recorded.damage:
        _say(line)
    if pace is not None and not any([link.transactions and link.transactions[0].time_ns for link in recorded.links]):
        raise click.UsageError(f"{printable(file)} has no times, so --timing must be asap.")
    if dry_run or target is None:
        write_text([printable(line) for line in plan_lines(plan, permissions)])
        return EXIT_OK
    settings = Settings(pace, timeout_s, pipelined, retries, one_by_one=one_by_one)
    outcome = _replayed(recorded, plan, (target, allow_remote), (permissions, settings), (output, force), decoder)
    outcome.expected.damage = recorded.damage
    return _report(outcome, options, format_, most)


def _place(tsap: bytes | None, rack: int | None, slot: int | None) -> bytes | tuple[int, int] | None:
    if rack is None and slot is None:
        return tsap
    if tsap is not None or rack is None or slot is None:
        raise click.UsageError("--rack and --slot must be given together, and without --tsap.")
    return rack, slot


def _replayed(
    recorded: Session,
    plan: Sequence[Part],
    where: tuple[Address, bool],
    how: tuple[Permissions, Settings],
    out: tuple[str | None, bool],
    decoder: PayloadDecoder | None,
) -> ReplayOutcome:
    from dissect.testing.playback.client import places_of, replay
    from dissect.testing.playback.client.watch import Watch

    places = places_of(*where)
    writer = _writer(*out) if out[0] is not None else None
    watch = Watch()
    try:
        with LiveInterruption(watch.halt):
            return replay(recorded, plan, places, where[0], *how, writer, decoder, watch)
    except GoldenError as error:
        raise click.ClickException(printable(str(error))) from None


def _writer(output: str | None, force: bool) -> PcapngWriter:
    from dissect import __version__
    from dissect.packets.source.pcapng_writer import PcapngWriter

    return PcapngWriter(str(output), application=f"s7dissect {__version__} replay", overwrite=force)


def _report(outcome: ReplayOutcome, options: DiffOptions, format_: Format, most: int) -> int:
    differing = outcome.differences(options)
    shown = list(islice(differing, most))
    rest = sum([1 for _ in differing])
    compared = SessionDifferences(outcome.expected, outcome.came, shown, rest)
    compared.schema = REPLAY_SCHEMA
    compared.more["replay"] = outcome.as_dict()
    if outcome.unreachable:
        compared.errors.append(("unreachable", f"{words.count(outcome.unreachable, 'connection')} failed"))
    write_outcome(format_, DIFFERENCES, compared)
    for line in outcome.summary():
        _say(line)
    if outcome.file_trouble:
        _say(f"the capture file is incomplete: {outcome.file_trouble}")
        return EXIT_OUTPUT
    if outcome.interrupted:
        _say("interrupted")
        return EXIT_INTERRUPTED
    if outcome.unreachable or outcome.expected.damage:
        return EXIT_USAGE
    return EXIT_GATE if shown or rest else EXIT_OK


def _say(text: str) -> None:
    click.echo(f"s7dissect: {printable(text)}", err=True)
