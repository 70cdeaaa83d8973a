"""`s7dissect devices`: the devices, their kinds, and their communication partners."""

from __future__ import annotations

from typing import TYPE_CHECKING

import click

from dissect.cli.configuration import hosts
from dissect.cli.display import clock
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.run import EXIT_CODES
from dissect.meaning.report.formats import DEVICES, Format

if TYPE_CHECKING:
    from dissect.engine.options import Options
    from dissect.files.jobs.inventories import Inventories


@click.command("devices", epilog=EXIT_CODES)
@format_option(DEVICES)
@reading_options(fails=True, scd=False, separate=True)
def command(reading: Reading, format_: Format) -> int:
    """List devices: what each is, and who talks to whom.

    A card for each station gives its role with the packets that show it, order number, versions, serial number, names,
    operating mode, protection, what was negotiated, its clock, its blocks, who reads and writes what there, and how fast it
    answers.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input. Several files are one inventory;
    --separate reads each of them on its own.
    """
    from dissect.meaning.inventory.collector import Inventory
    from dissect.meaning.inventory.outcome import Devices

    inventory = reading.sum(Inventory, _inventories)
    write_outcome(format_, DEVICES, Devices(inventory, reading.interrupted, clock(), hosts()))
    return reading.ended()


def _inventories(options: Options) -> Inventories:
    from dissect.files.jobs.inventories import Inventories  # imported late: most runs do not need it

    return Inventories(options)
