"""`s7dissect verify`: our dissection of a capture beside Wireshark's, field by field."""

from __future__ import annotations

from pathlib import Path

import click

from dissect.cli.main import EXIT_DAMAGED, EXIT_GATE, EXIT_OK, EXIT_USAGE
from dissect.cli.run import files_argument, format_option, write
from dissect.wire.text import printable

_EXIT_CODES = (
    "Exit code: 0 every difference is explained, 1 some is not, 2 wrong use, a file that cannot be read, or tshark or "
    "pyshark is missing, 3 a file is damaged or cut off (what could be read is explained), 5 the output failed, "
    "130 interrupted."
)


@click.command("verify", epilog=_EXIT_CODES)
@files_argument
@format_option("text", "json")
@click.option(
    "--known", "every", is_flag=True, help="Text: a line for each known difference too, not only their number."
)
@click.option("--reorder", is_flag=True, help="Let Wireshark put TCP segments in order before it looks at them.")
@click.option("--pyshark", is_flag=True, help="Ask Wireshark through pyshark, not tshark directly.")
def command(files: tuple[str, ...], format_: str, every: bool, reorder: bool, pyshark: bool) -> int:
    """Compare our dissection of captures with Wireshark's, field by field: TPKT, COTP, S7comm.

    A line for each difference says the packet, the field, what we read and what Wireshark shows. Known faults of Wireshark are
    recognised by the octets, counted and explained; whatever else differs is a bug, ours or theirs.

    It needs tshark (apt install tshark), and with --pyshark pyshark (pip install 's7dissect[tshark]'). FILE is a pcap or
    pcapng file; it is read several times, so it cannot be standard input.
    """
    from dissect.oracle.compare import compare
    from dissect.oracle.pyshark_reader import read_pyshark
    from dissect.oracle.tshark import OracleError, read_tshark, version
    from dissect.oracle.verification import Verification

    for file in files:
        if file == "-" or (Path(file).exists() and not Path(file).is_file()):
            raise click.UsageError(f"{printable(file)}: a capture is read several times here, so it has to be a file.")
    try:
        verification = Verification(version(), every)
        for file in files:
            comparison = compare(file, read_pyshark if pyshark else read_tshark, reorder)
            if comparison.loss:
                click.echo(f"s7dissect: {printable(file)}: {printable(comparison.loss)}", err=True)
            lines = verification.take(file, comparison)
            if format_ == "text":
                write(lines)
    except OracleError as error:
        click.echo(f"s7dissect: {printable(str(error))}", err=True)
        return EXIT_USAGE
    write([verification.as_json()] if format_ == "json" else verification.summary())
    if verification.unexplained:
        return EXIT_GATE
    return EXIT_DAMAGED if any([comparison.loss for _, comparison in verification.files]) else EXIT_OK
