"""`s7dissect proxy`: a TCP relay that tells what passes it."""

from __future__ import annotations

import errno
import os
import sys
import threading
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.gate import fail_on_option, gate
from dissect.cli.main import EXIT_DAMAGED, EXIT_OK, EXIT_OUTPUT
from dissect.cli.options.scd import scd_options
from dissect.cli.run import format_option, write
from dissect.cli.watching import Interruption, LostEvents, Shower, only_option, overdue_option, slow_option
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.payload import PayloadDecoder
    from dissect.live.session import Event, Session
    from dissect.metrics.address import Address
    from dissect.proxy.capture_file import CaptureFile
    from dissect.proxy.relay import Relay
    from dissect.proxy.source import RelayReader

#: How long a poll waits for something to happen, in seconds, and how much it takes.
_WAIT_S: Final = 0.2
_MOST: Final = 512
#: How soon the relay gets its turn while something is dissected, in seconds; Python's own is 5 ms.
_TURN_S: Final = 0.000_1

_EXIT_CODES: Final = (
    "Exit code: 0 ended by SIGINT or SIGTERM (the summary is given), 1 a finding that --fail-on names, 2 wrong use, or it "
    "cannot listen or write, 3 the relay or the dissection broke off, 5 the output failed, 130 broken off by a second signal."
)


def _listen(ctx: click.Context, param: click.Parameter, value: str) -> Address:
    return _address(ctx, param, value, None)


def _to(ctx: click.Context, param: click.Parameter, value: str) -> Address:
    from dissect.net.addresses import PLC_PORT

    return _address(ctx, param, value, PLC_PORT)


def _address(ctx: click.Context, param: click.Parameter, value: str, port: int | None) -> Address:
    from dissect.metrics.address import AddressError
    from dissect.net.addresses import read_address

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
    help="Where clients connect to; port 0 lets the system choose one.",
)
@click.option("--to", "to", callback=_to, required=True, metavar="HOST[:PORT]", help="The PLC; port 102 unless said.")
@click.option("--allow-remote", is_flag=True, help="Let --listen be an address that other machines can reach.")
@click.option(
    "-w",
    "--write",
    "output",
    metavar="OUT",
    help="Write what passes to this pcapng file; - is standard output, and nothing else is written there then.",
)
@click.option("--force", is_flag=True, help="Overwrite OUT where it exists.")
@format_option("text", "jsonl")
@only_option
@slow_option
@overdue_option
@fail_on_option
@scd_options
def command(
    listen: Address,
    to: Address,
    allow_remote: bool,
    output: str | None,
    force: bool,
    format_: str,
    topics: tuple[str, ...],
    slow_ns: int,
    overdue_ns: int,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
) -> int:
    """Stand between a client and a PLC and tell what passes: for those who may not capture.

    Clients connect to --listen instead of the PLC, and for each of them a connection to the PLC is made. What either sends is
    passed on as it is, its end and its resets too; the dissection is made of a copy and cannot hold it up. It ends with
    Ctrl-C or SIGTERM.
    """
    from dissect.engine.observer import Options
    from dissect.live.session import Session
    from dissect.net.addresses import places_to_connect, places_to_listen
    from dissect.proxy.relay import Relay
    from dissect.proxy.source import RelayReader
    from dissect.proxy.tap import Tap

    if output == "-" and (format_ != "text" or topics):
        raise click.UsageError("-w - writes the capture to standard output: there is no room for lines (-T, --only).")
    tap = Tap()
    relay = Relay(places_to_listen(listen, allow_remote), places_to_connect(to), tap)
    try:
        companions = [_capture_file(output, force)] if output is not None else []
    except OSError:
        relay.close()
        raise
    reader = RelayReader(tap)
    options = Options(slow_ns, decoder=decoder, overdue_ns=overdue_ns)
    session = Session(lambda: reader, options, companions=companions, name="proxy")
    lines = _Lines(session, relay, None if output == "-" else _shower(format_ == "jsonl", topics))
    code = _Proxy(relay, reader, session, lines).run(to)
    return gate(session.run, fail_on, code)


def _capture_file(output: str, force: bool) -> CaptureFile:
    from dissect import __version__
    from dissect.proxy.capture_file import CaptureFile
    from dissect.source.pcapng_writer import PcapngWriter

    return CaptureFile(PcapngWriter(output, application=f"s7dissect {__version__} proxy", overwrite=force))


def _shower(as_json: bool, topics: tuple[str, ...]) -> Shower:
    from dissect.live.json_lines import JsonLines
    from dissect.live.lines import PlainLines, kinds_of

    kinds = kinds_of(topics)
    return JsonLines(kinds) if as_json else PlainLines(kinds)


class _Lines:
    """What is written: to standard output while that can be, and nothing that fails there stops the relay."""

    def __init__(self, session: Session, relay: Relay, shower: Shower | None) -> None:
        self.code = EXIT_OK
        self._session = session
        self._relay = relay
        self._shower = shower
        self._lost = LostEvents(session, shower) if shower is not None else None

    def show(self, events: list[Event]) -> None:
        """Write events, and what else went wrong."""
        from dissect.live.session import PROBLEM, Event

        problems = self._relay.problems
        events = events + [Event(PROBLEM, *problems.popleft()) for _ in range(len(problems))]
        if self._shower is None or self._lost is None:
            for event in events:
                if isinstance(event.what, str):
                    _say(event.what)
        elif events:
            self._write(self._shower.lines(events) + self._lost.lines())

    def summarise(self) -> None:
        """Write what it all came to."""
        from dissect.live.json_lines import JsonLines
        from dissect.live.lines import summary_lines
        from dissect.report import words

        status, relay = self._session.status(), self._relay
        if isinstance(self._shower, JsonLines):
            self._write([self._shower.summary(status)])
        sent = " and ".join(
            [f"{octets} octets from {who}" for octets, who in zip(relay.octets, ("clients", "the PLC"), strict=True)]
        )
        unreached = f", {relay.failed} more could not be connected" if relay.failed else ""
        _say(f"{words.count(relay.connections, 'connection')} relayed{unreached}; {sent}")
        for line in summary_lines(status, "file"):
            _say(line)
        if status.drops.kernel:
            _say(f"relayed but not dissected, because that was not fast enough: {status.drops.kernel} pieces")
        for failure in self._session.run.failures:
            _say(failure)

    def _write(self, lines: list[str]) -> None:
        if self.code != EXIT_OK or self._shower is None:
            return
        try:
            write(lines)
        except OSError as why:
            # Whatever is buffered goes nowhere either.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            self._shower = None
            if why.errno != errno.EPIPE:
                self.code = EXIT_OUTPUT
            _say(f"nothing is written any more ({why.strerror or why}), what passes is still relayed")


class _Proxy:
    """Relay, dissection and output side by side, each in a thread of its own, until a signal."""

    def __init__(self, relay: Relay, reader: RelayReader, session: Session, lines: _Lines) -> None:
        self._relay = relay
        self._reader = reader
        self._session = session
        self._lines = lines
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._work, name="s7dissect-relay", daemon=True)

    def run(self, to: Address) -> int:
        """Relay and tell until a signal; return the exit code."""
        turn = sys.getswitchinterval()
        sys.setswitchinterval(_TURN_S)
        try:
            with Interruption(self._relay.stop):
                self._session.start()
                self._thread.start()
                where = ", ".join([str(place) for place in self._relay.listening])
                _say(f"listening on {where}, relaying to {to}")
                self._follow()
                self._lines.summarise()
        finally:
            self._relay.stop()
            self._session.close()
            self._thread.join()
            sys.setswitchinterval(turn)
        return self._code()

    def _work(self) -> None:
        try:
            self._relay.run()
        except Exception as error:  # noqa: BLE001 - a thread has nobody else who would hear it
            self._error = error
        self._reader.stop()

    def _follow(self) -> None:
        """Show what happens until nothing more does: the relay has ended, and all that passed is told."""
        told = False
        while True:
            running, relaying = self._session.running, self._thread.is_alive()  # asked before: what comes last is taken
            self._lines.show(self._session.poll(_WAIT_S, _MOST))
            if running or self._session.waiting:
                continue
            if not relaying:
                return
            if not told:
                told = True
                _say(f"the dissection broke off: {self._session.error!r}; what passes is still relayed")
            self._thread.join(_WAIT_S)

    def _code(self) -> int:
        if self._error is not None:
            _say(f"the relay broke off: {self._error!r}")
            return EXIT_DAMAGED
        if self._session.error is not None:
            return EXIT_DAMAGED
        return self._lines.code


def _say(text: str) -> None:
    click.echo(f"s7dissect: {printable(text)}", err=True)
