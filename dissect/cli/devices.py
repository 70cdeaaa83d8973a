"""`s7dissect devices`: which devices there are, what each is, and who talks to whom."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.configuration import hosts
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.gate import fail_on_option
from dissect.cli.look import clock
from dissect.cli.options.jobs import indexed_option, separate_options
from dissect.cli.options.select import Chosen, select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.reading import Reading
from dissect.cli.run import EXIT_CODES, checksums_option, files_argument
from dissect.report.formats import DEVICES, Format

if TYPE_CHECKING:
    from dissect.engine.options import Options
    from dissect.jobs.inventories import Inventories
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

    options = Options(checksums=checksums, tls_keys=tls_keys, naming=naming)
    reading = Reading(files, options, chosen, separate, jobs)
    inventory = reading.sum(Inventory, _inventories)
    write_outcome(format_, DEVICES, Devices(inventory, reading.interrupted, clock(), hosts()))
    return reading.ended(fail_on)


def _inventories(options: Options) -> Inventories:
    from dissect.jobs.inventories import Inventories  # late: most runs need none of it

    return Inventories(options)
