"""The options of commands that export their counters to Prometheus."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, Self

import click

if TYPE_CHECKING:
    from dissect.online.live.run import Companion
    from dissect.online.live.session import Session
    from dissect.online.metrics.counters import Metrics
    from dissect.online.metrics.keeper import MetricsKeeper
    from dissect.online.net.addresses import Address


def metrics_address(ctx: click.Context, param: click.Parameter, text: str | None) -> Address | None:
    """Return the value of ``--metrics HOST:PORT``, None if it was not given."""
    if text is None:
        return None
    from dissect.online.net.addresses import AddressError, parse_address

    try:
        return parse_address(text)
    except AddressError as why:
        raise click.BadParameter(f"{why}.", ctx, param) from None


#: ``--metrics HOST:PORT``; the command's argument is called ``metrics``.
metrics_option: Final[Callable[[Any], Any]] = click.option(
    "--metrics",
    metavar="HOST:PORT",
    callback=metrics_address,
    help="Serve Prometheus metrics at http://HOST:PORT/metrics, for example 127.0.0.1:9102.",
)
#: ``--allow-remote``; the command's argument is called ``allow_remote``.
allow_remote_option: Final[Callable[[Any], Any]] = click.option(
    "--allow-remote", is_flag=True, help="Allow a --metrics address that other machines can reach."
)


class Scrape:
    """Metrics during a ``with`` block: a companion of the session counts, and ``address`` serves them.

    It listens from the beginning, and answers from `start` on: until then this process has no other thread, so that it can
    still drop its privileges. Without a terminal, an address in use does not end the command: it is reported, and retried.
    Without an address there is no server and no cost.
    """

    def __init__(self, address: Address | None, allow_remote: bool) -> None:
        if allow_remote and address is None:
            raise click.UsageError("--allow-remote needs --metrics HOST:PORT, the address that others may reach.")
        self._metrics: Metrics | None = None
        self._keeper: MetricsKeeper | None = None
        if address is not None:
            self._listen(address, allow_remote)

    def _listen(self, address: Address, allow_remote: bool) -> None:
        """Listen, or end the command with one line that gives the reason."""
        from dissect.online.metrics.counters import Metrics
        from dissect.online.metrics.keeper import MetricsKeeper
        from dissect.online.metrics.server import MissingLibraryError, door_of
        from dissect.online.net.addresses import AddressError

        self._metrics = Metrics()
        try:
            self._keeper = MetricsKeeper(door_of(self._metrics, address, allow_remote))
        except (AddressError, MissingLibraryError) as why:
            raise click.ClickException(str(why)) from None
        try:
            click.echo(f"s7dissect: metrics at {self._keeper.open().url}", err=True)
        except AddressError as why:
            if sys.stderr.isatty():
                raise click.ClickException(str(why)) from None
            click.echo(f"s7dissect: {why}; it will be tried again", err=True)
            self._keeper.missed(str(why))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._keeper is not None:
            self._keeper.close()

    def start(self) -> None:
        """Answer requests from now on. May be called twice."""
        if self._keeper is not None:
            self._keeper.start()

    @property
    def companions(self) -> list[Companion]:
        """The companions that metrics need."""
        return [one for one in (self._metrics, self._keeper) if one is not None]

    def watch(self, session: Session) -> None:
        """Also export the number of events that wait in ``session``."""
        if self._metrics is not None:
            self._metrics.watch_queue(lambda: (session.waiting, sum(session.lost.copy().values())))
