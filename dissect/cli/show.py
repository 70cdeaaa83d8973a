"""`s7dissect show`: one line for each PDU, or its field tree and octets."""

from __future__ import annotations

import click
from mypy_extensions import i64

from dissect.cli.drive import complain, drive, files_argument, format_option, write
from dissect.conversation import Observer
from dissect.iso.cotp import parse_tpdu
from dissect.iso.tables import DT
from dissect.report.jsonl import PduLines
from dissect.report.lines import pdu_line, tpdu_line
from dissect.report.tree import tree_lines
from dissect.s7.message import parse_pdu
from dissect.transactions.table import Side
from dissect.wire.clock import Clock
from dissect.wire.text import printable


@click.command("show")
@files_argument
@format_option("text", "jsonl")
@click.option("--frame", type=click.IntRange(min=1), metavar="N", help="Only what packet N completes.")
@click.option("-V", "--verbose", is_flag=True, help="The field tree with octet ranges, and a hex view.")
def command(files: tuple[str, ...], format_: str, frame: int | None, verbose: bool) -> int:
    """Write one line for each S7 PDU of FILE..., numbered by the packet that completed it.

    As text, COTP connects, disconnects and errors are shown too; -T jsonl writes S7 PDUs only.
    """
    from dissect.session import Run

    shown = _Pdus(format_ == "jsonl", frame, verbose)
    run = Run(files, shown)

    def flush() -> None:
        write(shown.lines)
        shown.lines = []

    code = drive(run, files, flush)
    if frame is not None and frame > run.pipeline.frames:
        click.echo(f"s7dissect: there is no packet {frame}, {run.pipeline.frames} were read", err=True)
    complain(run, code)
    return code


class _Pdus(Observer):
    def __init__(self, jsonl: bool, frame: int | None, verbose: bool) -> None:
        super().__init__()
        self.wants_pdus = True
        self.wants_tpdus = not jsonl
        self._jsonl = jsonl
        self._frame = frame
        self._verbose = verbose
        self._clock = Clock()
        self._pdus = PduLines()
        self._packet = b""  # the TPKT at hand
        self.lines: list[str] = []

    def comment(self, frame: i64, text: str) -> None:
        if not self._jsonl and self._wanted(frame):
            self.lines.append(f"{frame:>6}  comment: {printable(text)}")

    def tpdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes) -> None:
        self._packet = octets
        if octets[5] >> 4 == DT or not self._wanted(frame):
            return
        self.lines.append(tpdu_line(parse_tpdu(octets[4:]), frame, time_ns, side.connection, side.index, self._clock))

    def pdu(self, frame: i64, time_ns: i64, side: Side, octets: bytes, cut: bool) -> None:
        if not self._wanted(frame):
            return
        connection = side.connection
        pdu = parse_pdu(octets, frame, time_ns, connection.number, side.index, cut)
        if self._jsonl:
            self.lines.append(self._pdus.line(pdu, connection))
            return
        self.lines.append(pdu_line(pdu, connection, self._clock))
        if self._verbose:
            whole = self._packet if self._packet.endswith(octets) and not cut else b""
            self.lines.extend(tree_lines(pdu, whole))

    def _wanted(self, frame: int) -> bool:
        return self._frame is None or frame == self._frame
