"""`s7dissect transactions`: one line for each request and its answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import click

from dissect.cli.formats import format_option
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.indexed import may_match
from dissect.cli.look import clock
from dissect.cli.nothing import Shown
from dissect.cli.options.jobs import check_jobs, indexed_option, separate_options
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    drive,
    files_argument,
    nanoseconds,
    places_of,
)
from dissect.cli.task import Task, current
from dissect.engine.exchange import PayloadDecoder
from dissect.engine.pipeline import Options
from dissect.report.formats import TRANSACTIONS, Format
from dissect.report.words import PROTOCOLS
from dissect.report.writer import Choice, TransactionFeed, Writer
from dissect.session import Run
from dissect.tls.key_log import KeyLog
from dissect.transactions.naming import Naming
from dissect.transactions.results import went_wrong
from dissect.transactions.transaction import Transaction

if TYPE_CHECKING:
    from dissect.cli.separate_rows import Total


@click.command("transactions", epilog=EXIT_CODES)
@files_argument
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
@select_options("transaction", results="transactions")
@checksums_option
@fail_on_option
@scd_options
@tag_options
@tls_option
@separate_options
@indexed_option
def command(
    files: tuple[str, ...],
    format_: Format,
    failed: bool,
    slow_ns: int | None,
    checksums: bool,
    fail_on: frozenset[str],
    decoder: PayloadDecoder | None,
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
    separate: bool,
    jobs: int,
) -> int:
    """List requests with their answers, one line each.

    A line gives the time of the request, the number and packets of the transaction, client and server, the answer time, the
    function, and each item with its value or the reason for its refusal. Unsolicited messages have a line too.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. A transaction stands where the
    packet that completed it stands in the capture, an unanswered request where the wait for its answer ended.
    """
    # What is slow is a finding as well.
    options = Options(decoder=decoder, checksums=checksums, tls_keys=tls_keys, naming=naming)
    if slow_ns is not None:
        options.slow_ns = slow_ns
    writer = chosen.writer(format_, TRANSACTIONS, clock())
    choice = chosen.choice("transaction", _choice(failed, slow_ns))
    separate = check_jobs(separate, jobs)
    of = current()
    if of is not None:
        return _task(of, writer, TransactionFeed(writer, choice), chosen, options, bool(fail_on))
    if separate:
        from dissect.cli.separate import refuse
        from dissect.cli.separate_rows import no_places, rows_separately

        refuse(chosen, [(decoder, "SCD is decoded over all files")])
        files = may_match(files, chosen)
        writer.begin(no_places(files))
        return rows_separately(files, jobs, writer, fail_on, _say_nothing_found)
    feed = TransactionFeed(writer, choice)
    run = Run(files, chosen.sieve(feed) if fail_on else feed, chosen.narrow(options))
    chosen.begin(run, files)
    writer.begin(places_of(run, files))
    shown = Shown("transaction", len(writer.lines))
    code = drive(
        run, files, lambda: shown.write(feed.take(int(run.pipeline.timers.oldest_held()))), lambda: chosen.full
    )
    complain(run, code)
    if not run.pipeline.exchange.dialogue.count and not run.pipeline.connections.left_out:
        pipeline = run.pipeline
        counts = pipeline.counters.packet_counts()
        said = _instead(pipeline.frames, counts, feed.protocols, pipeline.finding_counts)
        click.echo(f"s7dissect: no S7 transaction: {said}", err=True)
    else:
        shown.explain(
            run, chosen, [name for name, given in (("--failed", failed), ("--slow", slow_ns is not None)) if given]
        )
    return gate(run, fail_on, chosen.ended(code), chosen.findings)


def _task(of: Task, writer: Writer, feed: TransactionFeed, chosen: Chosen, options: Options, findings: bool) -> int:
    """Read the file of a task; ``findings`` tells whether a selection of these counts."""
    from dissect.cli.separate_rows import rows_task

    run = Run([of.file], chosen.sieve(feed) if findings else feed, chosen.narrow(options))
    writer.begin(places_of(run, of.files))
    return rows_task(
        of,
        run,
        chosen,
        writer,
        lambda: feed.take(int(run.pipeline.timers.oldest_held())),
        lambda: (feed.protocols, (), {}),
    )


def _say_nothing_found(total: Total) -> None:
    if not total.before.transactions and not total.left_out:
        said = _instead(total.before.packets, total.ignored, total.protocols, total.findings)
        click.echo(f"s7dissect: no S7 transaction: {said}", err=True)


def _instead(frames: int, ignored: Mapping[str, int], spoken: Mapping[str, int], findings: Mapping[str, int]) -> str:
    """Return what there was in captures without S7: packets, of which some were ignored, and connections by protocol."""
    parts = [f"{ignored[name]} {text}" for name, text in _NOT_S7.items() if ignored.get(name)]
    packets = f"{frames} packets" + (f" ({', '.join(parts)})" if parts else "")
    sealed = findings.get("capture.not_opened", 0)
    if sealed:
        packets += f"; {sealed} wrapped in something that is not opened (s7dissect analyze names it)"
    said = [f"{number} {PROTOCOLS.get(name, 'ISO-on-TCP')}" for name, number in sorted(spoken.items())]
    return f"{packets}; connections: {', '.join(said)}" if said else packets


_NOT_S7 = {
    "not_ip": "not IP",
    "not_tcp": "not TCP",
    "other_protocol": "of other protocols over TCP",
    "link_type": "of an unsupported link type",
}


def _choice(failed: bool, slow_ns: int | None) -> Choice | None:
    """Return what tells whether a transaction is wanted; None when all are."""
    if slow_ns is None:
        return went_wrong if failed else None

    def wanted(transaction: Transaction) -> bool:
        latency = transaction.latency_ns
        return (latency is not None and latency > slow_ns) or (failed and went_wrong(transaction))

    return wanted
