"""`s7dissect proxy`: a TCP relay in front of a PLC that reports the traffic."""

from __future__ import annotations

import errno
import os
import sys
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.formats import format_option, write_out
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.main import EXIT_DAMAGED, EXIT_OK, EXIT_OUTPUT
from dissect.cli.options.scd import scd_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import slow_option
from dissect.cli.second_pass import check_out
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
from dissect.wire.text import printable

if TYPE_CHECKING:
    from collections.abc import Callable

    from dissect.engine.exchange import PayloadDecoder
    from dissect.engine.transactions.naming import Naming
    from dissect.online.live.events import Event
    from dissect.online.live.session import Session
    from dissect.online.net.addresses import Address
    from dissect.online.proxy.capture_file import CaptureFile
    from dissect.online.proxy.process import RelayProcess, RelayThread
    from dissect.online.proxy.source import RelayReader
    from dissect.protocols.tls.key_log import KeyLog

#: How soon relayed data are read while other data are being dissected, in seconds; Python's own interval is 5 ms.
_TURN_S: Final = 0.000_1
#: How long the relay may take to end, in seconds.
_PATIENCE_S: Final = 10.0

_EXIT_CODES: Final = (
    "Exit code: 0 stopped by SIGINT or SIGTERM (with summary), 1 a finding that --fail-on names, 2 wrong use, or it cannot "
    "listen or write, 3 the relay or the dissection failed, 5 the output could not be written, 130 a second signal."
)


def _listen(ctx: click.Context, param: click.Parameter, value: str) -> Address:
    return _address(ctx, param, value, None)


def _to(ctx: click.Context, param: click.Parameter, value: str) -> Address:
    from dissect.online.net.addresses import PLC_PORT

    return _address(ctx, param, value, PLC_PORT)


def _address(ctx: click.Context, param: click.Parameter, value: str, port: int | None) -> Address:
    from dissect.online.net.addresses import AddressError, read_address

    try:
        return read_address(value, port)
    except AddressError as why:
        raise click.BadParameter(f"{why}.", ctx, param) from None


@click.command("proxy", epilog=_EXIT_CODES)
@click.option(
    "--listen",
    callback=_listen,
    default="127.0.0.1:10102",
    show_default=True,
    metavar="HOST:PORT",
    help="Address for clients; port 0 selects a free one.",
)
@click.option("--to", "to", callback=_to, required=True, metavar="HOST[:PORT]", help="The PLC (default port 102).")
@click.option("--allow-remote", is_flag=True, help="Allow a --listen address that other machines can reach.")
@click.option(
    "-w",
    "--write",
    "output",
    metavar="OUT",
    help="Write the traffic to this pcapng file; - is standard output, which then carries nothing else.",
)
@click.option("--force", is_flag=True, help="Overwrite OUT if it exists.")
@format_option(EVENTS)
@only_option
@slow_option
@overdue_option
@fail_on_option
@scd_options
@tag_options
@tls_option
def command(
    listen: Address,
    to: Address,
    allow_remote: bool,
    output: str | None,
    force: bool,
    format_: Format,
    topics: tuple[str, ...],
    slow_ns: int,
    overdue_ns: int,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
    naming: Naming | None,
    tls_keys: KeyLog | None,
) -> int:
    """Relay TCP between clients and a PLC and report what passes; capture privileges are not needed.

    Clients connect to --listen instead of the PLC; each gets its own connection to the PLC. Data, FIN and RST are relayed
    unchanged; a copy is dissected and cannot delay them. Stop it with Ctrl-C or SIGTERM.
    """
    from dissect.engine.pipeline import Options
    from dissect.online.live.lines import kinds_of
    from dissect.online.live.session import Session
    from dissect.online.net.addresses import places_to_connect, places_to_listen
    from dissect.online.proxy.process import RelayProcess, RelayThread, possible
    from dissect.online.proxy.relay import Relay
    from dissect.online.proxy.source import RelayReader
    from dissect.online.proxy.tap import Tap

    expect_scd(topics, decoder)
    if output == "-" and (format_ is not formats_for(EVENTS)[0] or topics):
        raise click.UsageError(
            f"-w - writes the capture to standard output, so -T {format_.name} and --only cannot be used."
        )
    if output is not None:
        check_out((), output, force)
    tap = Tap()
    relay = Relay(places_to_listen(listen, allow_remote), places_to_connect(to), tap)
    try:
        companions = [_capture_file(output, force)] if output is not None else []
    except OSError:
        relay.close()
        raise
    side: RelayThread | RelayProcess = RelayProcess(relay, tap) if possible() else RelayThread(relay, tap)
    reader = RelayReader(side)
    options = Options(slow_ns, decoder=decoder, overdue_ns=overdue_ns, tls_keys=tls_keys, naming=naming)
    session = Session(lambda: reader, options, companions=companions, name="proxy", kinds=kinds_of(topics))
    lines = _Lines(session, side, None if output == "-" else new_shower(format_, topics))
    code = _Proxy(side, reader, session, lines).run(to)
    return gate(session.run, fail_on, code)


def _capture_file(output: str, force: bool) -> CaptureFile:
    from dissect import __version__
    from dissect.online.proxy.capture_file import CaptureFile
    from dissect.packets.source.pcapng_writer import PcapngWriter

    return CaptureFile(PcapngWriter(output, application=f"s7dissect {__version__} proxy", overwrite=force))


class _Lines:
    """Writes to standard output while that is possible; an error there does not stop the relay."""

    def __init__(self, session: Session, relay: RelayProcess | RelayThread, shower: Shower | None) -> None:
        self.code = EXIT_OK
        self._session = session
        self._relay = relay
        self._shower = shower
        self._lost = LostEvents(session, shower) if shower is not None else None

    def show(self, events: list[Event]) -> None:
        """Write events, and other problems."""
        from dissect.online.live.events import PROBLEM, Event

        problems = self._relay.problems
        events = events + [Event(PROBLEM, *problems.popleft()) for _ in range(len(problems))]
        if self._shower is None or self._lost is None:
            for event in events:
                if isinstance(event.what, str):
                    _say(event.what)
        elif events:
            shower, lost = self._shower, self._lost.lines()
            self._write(lambda: write_events(shower, events, lost))

    def summarise(self) -> None:
        """Write the summary."""
        from dissect.meaning.report import words
        from dissect.online.live.lines import summary_lines

        status, relay = self._session.status(), self._relay
        if self._shower is not None and (lines := self._shower.end(status)):
            self._write(lambda: write_out(lines))
        sent = " and ".join(
            [f"{octets} bytes from {who}" for octets, who in zip(relay.octets, ("clients", "the PLC"), strict=True)]
        )
        unreached = f", {relay.failed} failed to connect" if relay.failed else ""
        _say(f"{words.count(relay.connections, 'connection')} relayed{unreached}; {sent}")
        for line in summary_lines(status, "file"):
            _say(line)
        if status.drops.kernel:
            _say(f"relayed but not dissected, because that was not fast enough: {status.drops.kernel} pieces")
        for told in (*self._session.run.failures, *self._session.run.remarks):
            _say(told)

    def _write(self, write: Callable[[], None]) -> None:
        if self.code != EXIT_OK or self._shower is None:
            return
        try:
            write()
        except OSError as why:
            # Discard the buffered output, too.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            self._shower = None
            if why.errno != errno.EPIPE:
                self.code = EXIT_OUTPUT
            _say(f"output failed ({why.strerror or why}); traffic is still relayed")


class _Proxy:
    """Relay, dissection and output side by side until a signal."""

    def __init__(self, relay: RelayProcess | RelayThread, reader: RelayReader, session: Session, lines: _Lines) -> None:
        self._relay = relay
        self._reader = reader
        self._session = session
        self._lines = lines

    def run(self, to: Address) -> int:
        """Relay and report until a signal; return the exit code."""
        turn = sys.getswitchinterval()
        sys.setswitchinterval(_TURN_S)
        try:
            with LiveInterruption(self._relay.stop):
                self._relay.start()  # before there is any other thread
                self._session.start()
                where = ", ".join([str(place) for place in self._relay.listening])
                _say(f"listening on {where}, relaying to {to}")
                self._follow()
                self._lines.summarise()
        finally:
            self._relay.stop()
            self._session.close()
            self._relay.join(_PATIENCE_S)
            sys.setswitchinterval(turn)
        return self._code()

    def _follow(self) -> None:
        """Show events until the relay has ended and all traffic is reported."""
        reported = False
        while True:
            # checked before reading, so that the last events are still read
            running, relaying = self._session.running, self._relay.is_alive()
            if not relaying:
                self._reader.stop()
            self._lines.show(self._session.poll(POLL_S, POLL_MOST))
            if running or self._session.waiting:
                continue
            if not reported and self._session.error is not None:
                reported = True
                _say(
                    f"the dissection failed: {self._session.error!r}{'; traffic is still relayed' if relaying else ''}"
                )
            if not relaying:
                return
            self._relay.join(POLL_S)

    def _code(self) -> int:
        if self._relay.error:
            _say(f"the relay failed: {self._relay.error}")
            return EXIT_DAMAGED
        if self._session.error is not None:
            return EXIT_DAMAGED
        return self._lines.code or (EXIT_OUTPUT if self._session.run.failures else EXIT_OK)


def _say(text: str) -> None:
    click.echo(f"s7dissect: {printable(text)}", err=True)
