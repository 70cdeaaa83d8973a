"""Compare captures from the command line: ``python -m dissect.oracle FILE…``.

Prints what was compared and every difference nothing explains, and at the end how often each known one was met. Exit code 1
when something is not explained, 2 when a file or tshark cannot be used.
"""

from __future__ import annotations

import sys
from collections import Counter

import click

from dissect.oracle.compare import compare
from dissect.oracle.pyshark_reader import read_pyshark
from dissect.oracle.tshark import OracleError, read_tshark
from dissect.source.packet import CaptureError


@click.command(context_settings={"help_option_names": ["-h", "--help"]})
@click.argument("paths", nargs=-1, required=True, metavar="FILE…")
@click.option("--reorder", is_flag=True, help="Let Wireshark put TCP segments in order before it looks at them.")
@click.option("--pyshark", is_flag=True, help="Ask Wireshark through pyshark.")
def main(paths: tuple[str, ...], reorder: bool, pyshark: bool) -> None:
    """Compare what s7dissect and Wireshark make of captures, field by field."""
    compared: Counter[str] = Counter()
    known: Counter[str] = Counter()
    unexplained = fields = 0
    for path in paths:
        try:
            comparison = compare(path, read_pyshark if pyshark else read_tshark, reorder)
        except (CaptureError, OracleError) as error:
            click.echo(f"s7dissect: {error}", err=True)
            sys.exit(2)
        compared += comparison.compared
        known += comparison.known
        fields += comparison.fields
        unexplained += len(comparison.unexplained)
        click.echo(f"{path}: {_counts(comparison.compared)}, {comparison.fields} fields")
        for difference in comparison.unexplained:
            click.echo(f"  {difference}")
    click.echo(f"{len(paths)} captures, {_counts(compared)}, {fields} fields; {unexplained} differences not explained")
    for name, count in known.most_common():
        click.echo(f"  {count:6} {name}")
    sys.exit(1 if unexplained else 0)


def _counts(compared: Counter[str]) -> str:
    return ", ".join(f"{compared[kind]} {kind}s" for kind in ("TPDU", "PDU"))


if __name__ == "__main__":
    main()
