"""The options of commands that let Prometheus fetch what they count."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from dissect.metrics.address import Address
    from dissect.metrics.counters import Metrics
    from dissect.metrics.server import Server


def metrics_address(ctx: click.Context, param: click.Parameter, text: str | None) -> Address | None:
    """Return what ``--metrics HOST:PORT`` says, None when it was not given."""
    if text is None:
        return None
    from dissect.metrics.address import AddressError, parse_address

    try:
        return parse_address(text)
    except AddressError as why:
        raise click.BadParameter(f"{why}.", ctx, param) from None


#: ``--metrics HOST:PORT``; the command's argument is called ``metrics``.
metrics_option = click.option(
    "--metrics",
    metavar="HOST:PORT",
    callback=metrics_address,
    help="Let Prometheus fetch counters from http://HOST:PORT/metrics, for example 127.0.0.1:9102.",
)


def start_metrics(metrics: Metrics, address: Address, allow_remote: bool) -> Server:
    """Listen, or end the command with one line that says why not. Call it before anything is captured."""
    from dissect.metrics.address import AddressError
    from dissect.metrics.server import MissingLibraryError, serve

    try:
        return serve(metrics, address, allow_remote)
    except (AddressError, MissingLibraryError) as why:
        raise click.ClickException(str(why)) from None
