"""`s7dissect cut`: a part of a capture as a pcapng file, with the results as comments of its packets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Any

import click

from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.options.completing import connections, findings
from dissect.cli.options.reading import reading_options
from dissect.cli.options.select import read_time, time_option, where_option
from dissect.cli.reading import Reading
from dissect.cli.run import complain
from dissect.cli.second_pass import around_option, check_files, name_of, read_again, read_first, tell_cut, written_whole
from dissect.meaning.report.slugs import slugs_of

if TYPE_CHECKING:
    from dissect.files.recording.cutter import Around
    from dissect.meaning.select.selection import Choice

_EXIT_CODES = (
    "Exit code: 0 success, 2 wrong use, an unreadable or unwritable file, or nothing to write, 3 a damaged or truncated file "
    "(what could be read was written), 5 the output could not be written (disk full), 130 interrupted (nothing written)."
)


def _findings(
    ctx: click.Context, param: click.Parameter, values: Iterable[str]
) -> tuple[frozenset[int], frozenset[str]]:
    """Return (numbers, slugs) that the values of ``--finding`` mean."""
    numbers: set[int] = set()
    slugs: set[str] = set()
    for value in values:
        if value.isascii() and value.isdigit() and 0 < len(value) < 10 and int(value):
            numbers.add(int(value))
            continue
        try:
            slugs |= slugs_of(value)
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from None
    return frozenset(numbers), frozenset(slugs)


def _numbers(name: str, what: str) -> Callable[[Any], Any]:
    complete = connections if name == "--connection" else None
    return click.option(
        name, multiple=True, type=click.IntRange(min=1), metavar="N", help=what, shell_complete=complete
    )


@click.command("cut", epilog=_EXIT_CODES)
@click.option(
    "-o", "--output", "output", required=True, metavar="OUT", help="The pcapng file to write; - is standard output."
)
@where_option(
    "packet",
    "transaction",
    "finding",
    help="Only packets that this expression selects by their own fields, or by those of the transactions they carry (see "
    "`s7dissect help select`); narrows what other options select.",
)
@_numbers("--connection", "Packets of connection N of the analyze report, including its TCP handshake and end.")
@_numbers(
    "--transaction",
    "Packets that carried the request or answer of transaction N; if unanswered, also those that ended its connection; of a "
    "push, also the requests of its subscription.",
)
@click.option(
    "--finding",
    "findings",
    multiple=True,
    callback=_findings,
    shell_complete=findings,
    metavar="WHAT",
    help="Packets of a finding: its slug, a pattern ('security.*'), a severity (or worse), or its number as "
    "analyze -T json gives it.",
)
@time_option("Only packets within this time range:")
@around_option
@click.option(
    "--context",
    is_flag=True,
    help="With --transaction: also the packets that open and close its connection, and its Setup communication (TSAPs, PDU "
    "length).",
)
@click.option(
    "--no-comments", "plain", is_flag=True, help="Do not add findings as comments; existing comments are kept."
)
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists (never a FILE).")
@reading_options(selects=False, checksums=False)
def command(
    reading: Reading,
    output: str,
    where: str | None,
    connection: tuple[int, ...],
    transaction: tuple[int, ...],
    findings: tuple[frozenset[int], frozenset[str]],
    window: str | None,
    around: Around,
    context: bool,
    plain: bool,
    force: bool,
) -> int:
    """Extract part of a capture to a pcapng file, with findings as comments on their packets.

    --connection, --transaction and --finding may be repeated and combined: a packet that any of them selects is written. --time
    narrows the selection. Without any of them, all packets are written. Packets keep their order, times (nanoseconds), link
    types, interface names and comments.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd. It is read twice, so it cannot be standard input.
    Several files are read as one capture and written to one OUT.
    """
    from dissect.meaning.select.selection import Selection, Wanted

    times = read_time(window)
    files = reading.files
    check_files(files, output, force)
    wanted = Wanted(connection, transaction, *findings)
    if context and not transaction:
        raise click.UsageError("--context needs --transaction.")
    chosen = any((where, connection, transaction, *findings, times))
    if not chosen and (around.packets or around.ns):
        raise click.UsageError(
            "--around needs -Y, --connection, --transaction, --finding or --time: all packets are written."
        )
    selection = Selection(wanted, comments=not plain, context=context)
    run, code, packets = read_first(files, selection, where, reading.options())
    if code == EXIT_INTERRUPTED:
        click.echo(f"s7dissect: interrupted; {name_of(output)} was not written", err=True)
        return code
    complain(run, code)
    if selection.missing:
        raise click.ClickException(f"{selection.missing} in the capture; nothing was written.")
    first_ns, last_ns = int(run.pipeline.first_ns), int(run.pipeline.now_ns)
    within = times.window.resolve(first_ns, last_ns) if times is not None else (-(2**63), 2**63)
    if selection.uncertain:
        click.echo(
            f"s7dissect: of {selection.uncertain} messages only the last packet is known; earlier ones may be missing from OUT",
            err=True,
        )
    choice = selection.choice(*within)
    if packets is not None:
        choice.narrow(packets.test())
    return _write(files, output, choice, around) or code


def _write(files: Sequence[str], output: str, choice: Choice, around: Around) -> int:
    """Read the files again, write the selected packets, and report how many there were."""
    from dissect.files.recording.cutter import Cutter

    with written_whole(output) as writer:
        cutter = Cutter(choice, writer, around)
        read_again(files, cutter)
        if not cutter.chosen:
            raise click.ClickException("no packet matches; nothing was written.")
    tell_cut(cutter, output, choice.context)
    return 0
