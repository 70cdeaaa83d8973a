"""`s7dissect devices`: which devices there are, what each is, and who talks to whom."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.configuration import hosts
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.gate import fail_on_option, gate, gate_of
from dissect.cli.indexed import may_match
from dissect.cli.look import clock
from dissect.cli.main import EXIT_INTERRUPTED
from dissect.cli.nothing import complain_impossible
from dissect.cli.options.jobs import check_jobs, indexed_option, separate_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.run import EXIT_CODES, checksums_option, complain, drive, files_argument
from dissect.cli.task import current
from dissect.report.formats import DEVICES, Format

if TYPE_CHECKING:
    from dissect.tls.key_log import KeyLog
    from dissect.transactions.naming import Naming


@click.command("devices", epilog=EXIT_CODES)
@files_argument
@format_option(DEVICES)
@select_options()
@checksums_option
@fail_on_option
@tag_options
@tls_option
@separate_options
@indexed_option
def command(
    files: tuple[str, ...],
    format_: Format,
    checksums: bool,
    fail_on: frozenset[str],
    chosen: Chosen,
    naming: Naming | None,
    tls_keys: KeyLog | None,
    separate: bool,
    jobs: int,
) -> int:
    """List devices: what each is, and who talks to whom.

    A card for each station gives its role with the packets that show it, order number, versions, serial number, names,
    operating mode, protection, what was negotiated, its clock, its blocks, who reads and writes what there, and how fast it
    answers.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. Several files are one inventory;
    --separate reads each of them on its own.
    """
    from dissect.engine.pipeline import Options
    from dissect.inventory.collector import Inventory
    from dissect.inventory.outcome import Devices
    from dissect.session import Run

    separate = check_jobs(separate, jobs)
    inventory = Inventory()
    observer = chosen.sieve(inventory)
    options = Options(checksums=checksums, tls_keys=tls_keys, naming=naming)
    of = current()
    if of is not None:
        from dissect.cli.separate import found_task

        return found_task(of, inventory, observer, options, chosen)
    if separate:
        from dissect.cli.separate import add_separately, refuse
        from dissect.jobs.inventories import Inventories

        refuse(chosen)
        files = may_match(files, chosen)
        sums = Inventories(options)
        code = add_separately(files, jobs, sums, Inventory)
        sums.finish()
        write_outcome(format_, DEVICES, Devices(sums.found, code == EXIT_INTERRUPTED, clock(), hosts()))
        return gate_of(sums.found.finding_counts, fail_on, code)
    run = Run(files, observer, chosen.narrow(options))
    chosen.begin(run, files)
    code = drive(run, files)
    inventory.take(run.pipeline, run.files)
    inventory.part = chosen.part(run)
    write_outcome(format_, DEVICES, Devices(inventory, code == EXIT_INTERRUPTED, clock(), hosts()))
    complain(run, code)
    complain_impossible(run, chosen)
    return gate(run, fail_on, chosen.ended(code), chosen.findings)
