"""`s7dissect transactions`: one line for each request and its answer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import click

from dissect.cli.configuration import hosts
from dissect.cli.formats import format_option
from dissect.cli.gate import fail_on_option, gate
from dissect.cli.indexed import may_match
from dissect.cli.look import clock
from dissect.cli.options.jobs import check_cluster, indexed_option, separate_options
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import (
    EXIT_CODES,
    checksums_option,
    complain,
    complain_of,
    drive,
    files_argument,
    nanoseconds,
    places_of,
)
from dissect.cli.separate import refuse
from dissect.cli.separate_rows import Total, no_places, rows_separately, rows_task
from dissect.cli.task import Task, current
from dissect.cli.together import Output, alone, alone_because, together, working
from dissect.engine.exchange import PayloadDecoder
from dissect.engine.pipeline import Options
from dissect.jobs.merging import Merger
from dissect.jobs.rows import TransactionRows
from dissect.jobs.share import by_pair
from dissect.report.formats import TRANSACTIONS, Format
from dissect.report.words import PROTOCOLS, Places
from dissect.report.writer import Choice, TransactionFeed, Writer
from dissect.session import Run
from dissect.tls.key_log import KeyLog
from dissect.transactions.naming import Naming
from dissect.transactions.transaction import Transaction

if TYPE_CHECKING:
    from dissect.report.styled import Line


@click.command("transactions", epilog=EXIT_CODES)
@files_argument
@format_option(TRANSACTIONS)
@click.option("--failed", is_flag=True, help="Only transactions with errors or without an answer.")
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
    check_cluster(separate, jobs)
    of = current()
    if of is not None:
        return _task(of, writer, TransactionFeed(writer, choice), chosen, options, bool(fail_on))
    if separate:
        refuse(chosen, [(decoder, "SCD is decoded over all files")])
        files = may_match(files, chosen)
        writer.begin(no_places(files))
        return rows_separately(files, jobs, writer, fail_on, _say_nothing_found)
    worker = working()
    if worker is not None:
        return worker.rows(options, chosen, by_pair, lambda share, order: TransactionRows(share, order, writer, choice))
    output = Output()
    if jobs > 1:
        why = alone_because(files, chosen, [(fail_on, "--fail-on counts findings"), (decoder, "--scd")])
        if why:
            alone(why)
        elif (code := _together(files, writer, jobs, output)) is not None:
            return code
        writer = chosen.writer(format_, TRANSACTIONS, clock())
    feed = TransactionFeed(writer, choice)
    run = Run(files, chosen.sieve(feed) if fail_on else feed, chosen.narrow(options))
    chosen.begin(run, files)
    writer.begin(places_of(run, files))
    code = drive(
        run, files, lambda: output.write(feed.take(int(run.pipeline.timers.oldest_held()))), lambda: chosen.full
    )
    complain(run, code)
    if not run.pipeline.exchange.dialogue.count and not run.pipeline.connections.left_out:
        pipeline = run.pipeline
        said = _instead(pipeline.frames, pipeline.counters.packet_counts(), feed.protocols)
        click.echo(f"s7dissect: no S7 transaction: {said}", err=True)
    return gate(run, fail_on, code, chosen.findings)


def _together(files: Sequence[str], writer: Writer, jobs: int, output: Output) -> int | None:
    """Have ``jobs`` processes do it; return the exit code, None when one process has to begin anew."""
    feed = TransactionFeed(writer)
    writer.begin(Places([], len(files) > 1, hosts()))

    def merged(lines: list[str | Line], packets: list[int], held: int) -> None:
        feed.add(lines, packets)
        output.write(feed.take(held))

    done = together(files, Merger(jobs, writer.number_width), jobs, merged)
    # What there is in the place of transactions can only be counted where all packets are looked at.
    if done is None or (done[1] and not any([end.transactions or end.unwanted for end in done[1]])):
        output.again()
        return None
    code, ends = done
    output.write(feed.take(0))
    complain_of(ends[0].files if ends else [], code)
    return code


def _task(of: Task, writer: Writer, feed: TransactionFeed, chosen: Chosen, options: Options, findings: bool) -> int:
    """Read the file of a task; ``findings`` tells whether a selection of these counts."""
    run = Run([of.file], chosen.sieve(feed) if findings else feed, chosen.narrow(options))
    writer.begin(places_of(run, of.files))
    return rows_task(
        of,
        run,
        chosen,
        writer,
        lambda: feed.take(int(run.pipeline.timers.oldest_held())),
        lambda: (feed.protocols, ()),
    )


def _say_nothing_found(total: Total) -> None:
    if not total.before.transactions and not total.left_out:
        said = _instead(total.before.packets, total.ignored, total.protocols)
        click.echo(f"s7dissect: no S7 transaction: {said}", err=True)


def _instead(frames: int, ignored: Mapping[str, int], spoken: Mapping[str, int]) -> str:
    """Return what there was in captures without S7: packets, of which some were ignored, and connections by protocol."""
    parts = [f"{ignored[name]} {text}" for name, text in _NOT_S7.items() if ignored.get(name)]
    packets = f"{frames} packets" + (f" ({', '.join(parts)})" if parts else "")
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
        return (lambda transaction: transaction.failed) if failed else None

    def wanted(transaction: Transaction) -> bool:
        latency = transaction.latency_ns
        return (latency is not None and latency > slow_ns) or (failed and transaction.failed)

    return wanted
