"""`s7dissect transactions`: one line for each request and its answer."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from dissect.cli.display import clock
from dissect.cli.formats import format_option
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.rows import Left, Rows, Total
from dissect.cli.run import EXIT_CODES, nanoseconds
from dissect.engine.transactions.results import went_wrong
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.formats import TRANSACTIONS, Format
from dissect.meaning.report.words import PROTOCOLS
from dissect.meaning.report.writer import Choice, TransactionFeed

if TYPE_CHECKING:
    from dissect.files.session import Run
    from dissect.meaning.report.styled import Written


@click.command("transactions", epilog=EXIT_CODES)
@format_option(TRANSACTIONS)
@click.option(
    "--failed",
    is_flag=True,
    help="Only transactions with errors, without an answer, or with one that does not fit the request.",
)
@click.option(
    "--slow",
    "slow_ns",
    callback=nanoseconds,
    metavar="MS",
    help="Only transactions answered later than this many milliseconds; with --failed, these as well.",
)
@reading_options("transaction", results="transactions", fails=True, separate=True)
def command(reading: Reading, format_: Format, failed: bool) -> int:
    """List requests with their answers, one line each.

    A line gives the time of the request, the number and packets of the transaction, client and server, the answer time, the
    function, and each item with its value or the reason for its refusal. Unsolicited messages have a line too.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. A transaction stands where the
    packet that completed it stands in the capture, an unanswered request where the wait for its answer ended.
    """
    slow_ns = reading.slow_ns  # slow ones are findings as well
    writer = reading.chosen.writer(format_, TRANSACTIONS, clock())
    feed = TransactionFeed(writer, reading.chosen.choice("transaction", _choice(failed, slow_ns)))
    total = reading.rows(_TransactionRows(writer, feed), "transaction")
    reading.complain()
    if not total.transactions and not total.left_out:
        click.echo(f"s7dissect: no S7 transaction: {_instead(total)}", err=True)
    else:
        reading.explain([name for name, given in (("--failed", failed), ("--slow", slow_ns is not None)) if given])
    return reading.gated()


class _TransactionRows(Rows):
    """Transactions in the order of the capture: delayed ones come as soon as they are complete."""

    observer: TransactionFeed

    def take(self, run: Run) -> Sequence[Written]:
        """Return the rows before which none can come."""
        return self.observer.take(int(run.pipeline.timers.oldest_held()))

    def left(self) -> Left:
        """Return the connections by protocol."""
        return Left(self.observer.protocols)


def _instead(total: Total) -> str:
    """Return the content of captures without S7: packets, ignored ones among them, and connections by protocol."""
    parts = [f"{total.ignored[name]} {text}" for name, text in _NOT_S7.items() if total.ignored[name]]
    packets = f"{total.packets} packets" + (f" ({', '.join(parts)})" if parts else "")
    if total.sealed:
        packets += f"; {total.sealed} wrapped in something that is not opened (s7dissect analyze names it)"
    counts = [f"{number} {PROTOCOLS.get(name, 'ISO-on-TCP')}" for name, number in sorted(total.protocols.items())]
    return f"{packets}; connections: {', '.join(counts)}" if counts else packets


_NOT_S7 = {
    "not_ip": "not IP",
    "not_tcp": "not TCP",
    "other_protocol": "of other protocols over TCP",
    "link_type": "of an unsupported link type",
}


def _choice(failed: bool, slow_ns: int | None) -> Choice | None:
    """Return a function that selects transactions; None for all."""
    if slow_ns is None:
        return went_wrong if failed else None

    def wanted(transaction: Transaction) -> bool:
        latency = transaction.latency_ns
        return (latency is not None and latency > slow_ns) or (failed and went_wrong(transaction))

    return wanted
