"""`s7dissect monitor`: live S7 traffic, on screens or line by line."""

from __future__ import annotations

import importlib
import os
import sys
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.configuration import hosts
from dissect.cli.display import clock, coloured
from dissect.cli.formats import format_option, write_out
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.main import EXIT_DAMAGED, EXIT_INTERRUPTED, EXIT_OK, EXIT_OUTPUT
from dissect.cli.options.monitor import beside_options
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.options.variables import wanted_of
from dissect.cli.reloading import Reloading
from dissect.cli.rights import check_user, open_interface
from dissect.cli.run import checksums_option, slow_option
from dissect.cli.scrape import Scrape, allow_remote_option, metrics_option
from dissect.cli.watching import (
    POLL_MOST,
    POLL_S,
    LiveInterruption,
    LostEvents,
    Shower,
    expect_scd,
    new_shower,
    only_option,
    overdue_option,
    write_events,
)
from dissect.meaning.report.formats import EVENTS, Format, formats_for
from dissect.packets.source.live import BUFFER_MIB, MAX_BUFFER_MIB
from dissect.wire.text import printable, shortened

if TYPE_CHECKING:
    from collections.abc import Callable

    from dissect.cli.options.monitor import Beside
    from dissect.engine.exchange import PayloadDecoder
    from dissect.engine.transactions.naming import Naming
    from dissect.online.live.run import Companion
    from dissect.online.live.session import Session, Status
    from dissect.online.net.addresses import Address
    from dissect.output.variables.wanted import WantedSet
    from dissect.packets.source.packet import Reader
    from dissect.protocols.tls.key_log import KeyLog

_EXIT_CODES: Final = (
    "Exit code: 0 the source or --duration ended, 1 a finding that --fail-on names, 2 wrong use or a source that cannot be "
    "opened, 3 the source failed, 5 the output could not be written, 130 interrupted by SIGINT or SIGTERM (with summary)."
)


#: Maximum number of notes on a file that are reported at the end, and of characters of one.
_NOTES: Final = 5
_LONGEST: Final = 400


def _seconds(ctx: click.Context, param: click.Parameter, value: str | None) -> int:
    """Return the value of an option in seconds as nanoseconds, 0 if it was not given."""
    if value is None:
        return 0
    try:
        number = float(value)
    except ValueError:
        raise click.BadParameter(f"expected seconds, got {value!r}.", ctx, param) from None
    if not 0 < number <= 1e9:
        raise click.BadParameter(f"expected more than 0 and at most 1000000000 seconds, got {value!r}.", ctx, param)
    return int(number * 1e9)


def _each_once(ctx: click.Context, param: click.Parameter, values: tuple[str, ...]) -> str | tuple[str, ...] | None:
    """Return the interface, or all of several."""
    if len(set(values)) < len(values):
        raise click.BadParameter("name each interface once.", ctx, param)
    if len(values) > 1 and "-" in values:
        raise click.BadParameter("standard input is watched alone.", ctx, param)
    return values if len(values) > 1 else values[0] if values else None


@click.command("monitor", epilog=_EXIT_CODES)
@click.argument("file", required=False, type=click.Path(readable=False), metavar="[FILE]")
@click.option(
    "-i",
    "--interface",
    "interface",
    multiple=True,
    callback=_each_once,
    metavar="NAME",
    help="Interface to watch (see `s7dissect interfaces`); repeatable, then each line names its own.",
)
@click.option(
    "-f", "--filter", "expression", default="", metavar="FILTER", help="Capture filter, for example 'tcp port 102'."
)
@click.option(
    "--engine",
    type=click.Choice(("auto", "dumpcap", "ring")),
    default="auto",
    show_default=True,
    help="Capture engine; auto is dumpcap, or else the kernel's ring; for root the ring first.",
)
@click.option(
    "-Z",
    "user",
    default="",
    metavar="USER",
    help="As root: become USER once the interface is open (default: the user who called sudo, otherwise nobody); root keeps "
    "all privileges.",
)
@click.option(
    "--buffer",
    "buffer_mib",
    type=click.IntRange(1, MAX_BUFFER_MIB),
    metavar="MIB",
    help=f"Size of the kernel's capture buffer, 1 to {MAX_BUFFER_MIB} MiB (default {BUFFER_MIB}).",
)
@click.option("--plain", is_flag=True, help="One line per event, even on a terminal.")
@format_option(
    EVENTS, optional=True, help="Output format, one line per event. Without it, a terminal shows the screens."
)
@only_option
@slow_option
@overdue_option
@click.option("--duration", "duration_ns", callback=_seconds, metavar="S", help="Stop after this many seconds.")
@click.option(
    "-c", "--packets", type=click.IntRange(1), default=None, metavar="N", help="Stop after this many packets."
)
@click.option(
    "--watch",
    "watched",
    multiple=True,
    metavar="VARIABLE",
    help="On the screens (key v): watch this address or tag; repeatable. Default: every variable.",
)
@select_options(numbers=False)
@metrics_option
@allow_remote_option
@checksums_option
@fail_on_option
@scd_options
@tag_options
@tls_option
@beside_options
def command(
    file: str | None,
    interface: str | tuple[str, ...] | None,
    expression: str,
    engine: str,
    user: str,
    buffer_mib: int | None,
    plain: bool,
    format_: Format | None,
    topics: tuple[str, ...],
    slow_ns: int,
    overdue_ns: int,
    duration_ns: int,
    packets: int | None,
    watched: tuple[str, ...],
    metrics: Address | None,
    allow_remote: bool,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
    beside: Beside,
) -> int:
    """Watch live S7 traffic: connections, transactions and findings as they occur. Nothing is ever sent.

    The source is an interface (-i), a capture in progress on standard input (-), for example from `ssh gateway tcpdump -U -w -
    tcp port 102`, or a FILE.
    """
    from dissect.engine.pipeline import Options
    from dissect.online.live.lines import kinds_of
    from dissect.online.live.run import Limits
    from dissect.online.live.session import Session

    expect_scd(topics, decoder)
    if watched and (plain or format_ is not None):
        raise click.UsageError("--watch is for the screens; `s7dissect values FILE ADDRESS` lists values in lines.")
    wanted = wanted_of(watched, naming, decoder)
    on_screens = not plain and format_ is None and sys.stdout.isatty() and _screens_will_do()
    if on_screens and topics:
        raise click.UsageError("--only is for lines, and the screens show everything: add --plain, or leave it out.")
    opener = _opener(file, interface, expression, (engine, user, buffer_mib), beside, on_screens)
    name = _name(file, interface)
    with Scrape(metrics, allow_remote) as scrape:
        session = Session(
            lambda: _opened(opener, scrape),
            Options(
                slow_ns, decoder=decoder, overdue_ns=overdue_ns, checksums=checksums, tls_keys=tls_keys, naming=naming
            ),
            companions=[
                *beside.companions(name),
                *scrape.companions,
                *_watchdog(),
            ],
            limits=Limits(duration_ns, packets or 0),
            name=name,
            # The screens, and an expression, need all events.
            kinds=kinds_of(() if on_screens or chosen.where is not None else topics),
        )
        scrape.watch(session)
        beside.watch(session, on_screens)
        if on_screens:
            code = _on_screens(session, slow_ns, chosen, wanted, beside)
        else:
            code = _in_lines(session, format_ or formats_for(EVENTS)[0], topics, chosen, beside)
    return gate(session.run, fail_on, code)


def _name(file: str | None, interface: str | tuple[str, ...] | None) -> str:
    """Return the name of the source."""
    if isinstance(interface, tuple):
        return ", ".join(interface)
    return interface or ("stdin" if file == "-" else file or "")


def _opener(
    file: str | None,
    interface: str | tuple[str, ...] | None,
    expression: str,
    how: tuple[str, str, int | None],
    beside: Beside,
    on_screens: bool,
) -> Callable[[], Reader]:
    """Return a function that opens the source in the arguments; ``how``: the engine, the user to become, the buffer size."""
    engine, user, buffer_mib = how
    if file is not None and interface is not None:
        raise click.UsageError("-i and FILE cannot be combined.")
    if file is None and interface is None:
        raise click.UsageError("Nothing to watch: give -i INTERFACE, a FILE, or - for standard input.")
    if interface is None and (expression or engine != "auto" or user or buffer_mib is not None):
        raise click.UsageError("-f, --engine, -Z and --buffer need an interface (-i).")
    if user:
        check_user(user, engine)

    def opened() -> Reader:
        from dissect.packets.source.files import open_capture
        from dissect.packets.source.live.opening import open_live

        if interface is not None:
            return open_interface(interface, expression, engine, user, beside, on_screens, buffer_mib or BUFFER_MIB)
        return open_live("-") if file == "-" else open_capture(file or "")

    return opened


def _watchdog() -> list[Companion]:
    """Return the heartbeat, if systemd requests one."""
    from dissect.online.live.watchdog import of_environment

    watchdog = of_environment()
    return [watchdog] if watchdog is not None else []


def _opened(opener: Callable[[], Reader], scrape: Scrape) -> Reader:
    """Open the source; other threads may be started only afterwards."""
    reader = opener()
    scrape.start()
    return reader


# ---- the plain form -------------------------------------------------------------------------------------------------


def _in_lines(session: Session, format_: Format, topics: tuple[str, ...], chosen: Chosen, beside: Beside) -> int:
    """Write one line per event until the end; return the exit code."""
    shower = new_shower(format_, topics)
    with LiveInterruption(session.stop) as interruption, Reloading(session, beside) as reloading:
        try:
            session.start()
            _show(session, shower, chosen, reloading)
        finally:
            session.close()
        if session.error is not None:
            raise session.error
        status = session.status()
        if lines := shower.end(status):
            write_out(lines)
        _summarise(session, status)
    return _code(session, interruption.asked)


def _show(session: Session, shower: Shower, chosen: Chosen, reloading: Reloading) -> None:
    lost = LostEvents(session, shower)
    selected = chosen.events(session)
    while True:
        reloading.check()
        running = session.running  # read before: the last values are taken then
        events = session.poll(POLL_S, POLL_MOST)
        write_events(shower, selected.of(events) if selected is not None else events, lost.lines())
        if not events and not running:
            return


def _summarise(session: Session, status: Status) -> None:
    from dissect.online.live.lines import summary_lines

    for line in summary_lines(status, session.engine):
        click.echo(f"s7dissect: {line}", err=True)
    for told in (*session.run.failures, *session.run.remarks):
        click.echo(f"s7dissect: {printable(told)}", err=True)
    file = session.run.file
    if session.engine == "file":  # messages of a live source are written among the lines
        for note in file.notes[:_NOTES]:
            click.echo(f"s7dissect: {printable(file.name)}: {shortened(note, _LONGEST)}", err=True)
        if len(file.notes) > _NOTES:
            click.echo(f"s7dissect: and {len(file.notes) - _NOTES} more notes; analyze -T json lists them", err=True)
    if file.loss:
        click.echo(f"s7dissect: {printable(file.name)}: {printable(file.loss)}", err=True)


def _code(session: Session, interrupted: bool) -> int:
    if interrupted:
        return EXIT_INTERRUPTED
    if session.run.file.loss:
        return EXIT_DAMAGED
    return EXIT_OUTPUT if session.run.failures else EXIT_OK


# ---- the screens ----------------------------------------------------------------------------------------------------


def _screens_will_do() -> bool:
    """Return whether the terminal can show screens; otherwise lines are written."""
    from dissect.online.monitor.terminal import will_do

    return will_do()


def _on_screens(session: Session, slow_ns: int, chosen: Chosen, wanted: WantedSet | None, beside: Beside) -> int:
    """Show the screens until the user leaves them; return the exit code."""
    from dissect.meaning.report.words import Places
    from dissect.online.monitor.terminal import NoKeyboardError, keyboard

    if not coloured(True):
        os.environ["NO_COLOR"] = "1"  # the library for the screens reads it when it is imported
    try:
        run_app = importlib.import_module("dissect.online.monitor.app").run_app
    except ImportError as error:
        if (error.name or "").split(".")[0] not in {"textual", "dissect"}:
            raise
        raise click.ClickException(
            "the screens need textual: pip install 's7dissect[monitor]', or use --plain"
        ) from None
    try:
        with keyboard():
            session.start()
            try:
                interrupted = run_app(session, slow_ns, clock(), chosen.where, Places([], False, hosts()), wanted)
            finally:
                beside.watch(session, False)  # messages from now on would not be seen there
                session.close()
    except NoKeyboardError as error:
        raise click.ClickException(f"the screens need a terminal for the keys ({error}); use --plain") from None
    if session.error is not None:
        raise session.error
    _summarise(session, session.status())
    return _code(session, interrupted)
