"""`s7dissect serve`: a fake PLC made from a capture."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

import click

from dissect.cli.main import EXIT_DAMAGED, EXIT_GATE, EXIT_OK
from dissect.cli.run import files_argument
from dissect.cli.second_pass import check_out
from dissect.cli.watching import LiveInterruption
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.online.net.addresses import Address
    from dissect.packets.source.pcapng_writer import PcapngWriter
    from dissect.testing.playback.server.faults import Fault
    from dissect.testing.playback.server.service import Server

#: How often problems are checked, in seconds.
_LOOK_S: Final = 0.1

_EXIT_CODES: Final = (
    "Exit code: 0 stopped by SIGINT or SIGTERM, 1 a request had no recorded match, 2 wrong use, a file that cannot be served, "
    "or it cannot listen or write, 3 the server failed, 130 a second signal."
)


def _listen(ctx: click.Context, param: click.Parameter, value: str) -> Address:
    from dissect.online.net.addresses import AddressError, read_address

    try:
        return read_address(value)
    except AddressError as why:
        raise click.BadParameter(f"{why}.", ctx, param) from None


def _latency(ctx: click.Context, param: click.Parameter, value: str) -> float | None:
    from dissect.testing.playback.server.service import MAX_LATENCY_MS

    if value in {"none", "recorded"}:
        return 0 if value == "none" else None
    try:
        ms = float(value)
    except ValueError:
        ms = -1
    if not 0 <= ms <= MAX_LATENCY_MS:
        expected = f"recorded, none, or milliseconds up to {MAX_LATENCY_MS}"
        raise click.BadParameter(f"expected {expected}, got {value!r}.", ctx, param)
    return ms


def _faults(ctx: click.Context, param: click.Parameter, values: tuple[str, ...]) -> list[Fault]:
    from dissect.testing.playback.server.faults import parse_fault

    try:
        return [parse_fault(value) for value in values]
    except ValueError as why:
        raise click.BadParameter(f"{why}.", ctx, param) from None


@click.command("serve", epilog=_EXIT_CODES)
@files_argument
@click.option(
    "--listen",
    callback=_listen,
    default="127.0.0.1:10102",
    show_default=True,
    metavar="HOST:PORT",
    help="Address for clients; port 0 selects a free one.",
)
@click.option("--allow-remote", is_flag=True, help="Allow a --listen address that other machines can reach.")
@click.option(
    "--repeat",
    type=click.Choice(("last", "cycle")),
    default="last",
    show_default=True,
    help="After all recorded answers to a request: repeat the last one, or start over.",
)
@click.option("--memory", is_flag=True, help="Let writes change what later reads return.")
@click.option(
    "--latency",
    "latency_ms",
    callback=_latency,
    default="none",
    show_default=True,
    metavar="recorded|none|MS",
    help="Delay of answers.",
)
@click.option(
    "--fault",
    "faults",
    callback=_faults,
    multiple=True,
    metavar="KIND:WHERE",
    help="Inject a fault: drop:N, delay:N:MS, refuse:N[:0xCODE], cut:N, wrong-ref:N, split:N; N is the number of a "
    "request, from 1, or a pattern for a function or an address, such as 'DB10.*'. Repeatable.",
)
@click.option("-w", "--write", "output", metavar="OUT", help="Write the traffic to this pcapng file.")
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists.")
def command(
    files: tuple[str, ...],
    listen: Address,
    allow_remote: bool,
    repeat: str,
    memory: bool,
    latency_ms: float | None,
    faults: list[Fault],
    output: str | None,
    force: bool,
) -> int:
    """Act as the PLC of a recording: answer clients as it did.

    A request that matches a recorded one gets its recorded answer: the first time the first, then the second, and so on. A
    request without a match is refused and reported, and makes the exit code 1. Stop it with Ctrl-C or SIGTERM.
    """
    from dissect.testing.playback.server import Server, load_recording
    from dissect.testing.playback.server.service import places_to_serve

    # Checked before the file is read, which may take a while.
    places_to_serve(listen, allow_remote)
    if output == "-":
        raise click.UsageError("-w needs a file: standard output is used for messages.")
    if output is not None:
        check_out(files, output, force)
    recording = load_recording(*files)
    for note in recording.notes:
        _say(note)
    server = Server(
        recording,
        listen.port,
        listen.host,
        allow_remote=allow_remote,
        repeat=repeat,
        memory=memory,
        latency_ms=latency_ms,
        faults=faults,
        writer=_writer(output, force) if output is not None else None,
    )
    return _serve(server)


def _writer(output: str, force: bool) -> PcapngWriter:
    from dissect import __version__
    from dissect.packets.source.pcapng_writer import PcapngWriter

    return PcapngWriter(output, application=f"s7dissect {__version__} serve", overwrite=force)


def _serve(server: Server) -> int:
    """Serve until a signal; return the exit code."""
    from dissect.meaning.report.words import count

    with LiveInterruption(server.stop):
        server.start()
        recording = server.recording
        recorded = f"{count(recording.steps, 'request')} on {count(len(recording.scripts), 'connection')}"
        click.echo(f"listening on {', '.join([str(place) for place in server.listening])}")
        _say(f"{recorded} recorded")
        while not server.wait(_LOOK_S):
            _tell(server)
    _tell(server)
    log = server.log
    heard = f"{count(int(server.connections), 'connection')}, {count(log.total, 'request')}"
    _say(f"{heard}, {log.unmatched_total} unmatched")
    if server.error is not None:
        _say(f"the server failed: {server.error!r}")
        return EXIT_DAMAGED
    return EXIT_GATE if log.unmatched_total else EXIT_OK


def _tell(server: Server) -> None:
    problems = server.problems
    for _ in range(len(problems)):
        _say(problems.popleft())


def _say(text: str) -> None:
    click.echo(f"s7dissect: {printable(text)}", err=True)
