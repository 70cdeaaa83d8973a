"""`s7dissect verify`: our dissection of a capture beside Wireshark's, field by field."""

from __future__ import annotations

from pathlib import Path

import click

from dissect.cli.look import write_text
from dissect.cli.main import EXIT_DAMAGED, EXIT_GATE, EXIT_OK, EXIT_USAGE
from dissect.cli.run import files_argument, format_option, write
from dissect.wire.text import printable

_EXIT_CODES = (
    "Exit code: 0 all differences explained, 1 unexplained differences, 2 wrong use, an unreadable file, or tshark or pyshark "
    "is missing, 3 a damaged or truncated file (what could be read was compared), 5 the output could not be written, "
    "130 interrupted."
)


@click.command("verify", epilog=_EXIT_CODES)
@files_argument
@format_option("text", "json")
@click.option("--known", "every", is_flag=True, help="Text: also list known differences, not only their number.")
@click.option("--reorder", is_flag=True, help="Let Wireshark reassemble out-of-order TCP segments first.")
@click.option("--pyshark", is_flag=True, help="Run tshark through pyshark instead of directly.")
def command(files: tuple[str, ...], format_: str, every: bool, reorder: bool, pyshark: bool) -> int:
    """Compare our dissection of captures with Wireshark's, field by field: TPKT, COTP, S7comm.

    Each difference gives the packet, the field, our value and Wireshark's. Known faults of Wireshark are recognized by their
    bytes, counted and explained; any other difference is a bug, ours or theirs.

    Needs tshark (apt install tshark), and for --pyshark pyshark (pip install 's7dissect[tshark]'). FILE is a pcap or pcapng
    file; it is read several times, so it cannot be standard input.
    """
    from dissect.oracle.compare import compare
    from dissect.oracle.pyshark_reader import read_pyshark
    from dissect.oracle.tshark import OracleError, read_tshark, version
    from dissect.oracle.verification import Verification

    for file in files:
        if file == "-" or (Path(file).exists() and not Path(file).is_file()):
            raise click.UsageError(f"{printable(file)}: a regular file is needed, because it is read several times.")
    try:
        verification = Verification(version(), every)
        for file in files:
            comparison = compare(file, read_pyshark if pyshark else read_tshark, reorder)
            if comparison.loss:
                click.echo(f"s7dissect: {printable(file)}: {printable(comparison.loss)}", err=True)
            lines = verification.take(file, comparison)
            if format_ == "text":
                write_text(lines)
    except OracleError as error:
        click.echo(f"s7dissect: {printable(str(error))}", err=True)
        return EXIT_USAGE
    if format_ == "json":
        write([verification.as_json()])
    else:
        write_text(verification.summary())
    if verification.unexplained:
        return EXIT_GATE
    return EXIT_DAMAGED if any([comparison.loss for _, comparison in verification.files]) else EXIT_OK
