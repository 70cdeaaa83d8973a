"""Rows of files that are read separately (option --separate): transactions and values.

If a process runs the tasks itself, it writes rows at once. Rows of other processes come through files
(`dissect.files.jobs.spool`), with marks in place of the numbers that count over all files; if a format defines their order in a
line, with an index of them (`dissect.files.jobs.spots`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final, NamedTuple, cast

from dissect.cli.configuration import hosts
from dissect.cli.formats import write_out
from dissect.cli.rows import Counts, Rows, Total, counts_of
from dissect.cli.run import PIECE, places_of, write_bytes, write_pieces
from dissect.cli.separate import about, read_file
from dissect.files.jobs.numbers import Marks, Offsets, count_from
from dissect.files.jobs.spool import Spool, Spooled, indexed, opened, whole_lines
from dissect.files.jobs.spots import pieces
from dissect.files.jobs.tasks import About, Done, FileError
from dissect.meaning.report.styled import Line, Written
from dissect.meaning.report.words import Places

if TYPE_CHECKING:
    from dissect.cli.reading import Reading
    from dissect.cli.task import Task
    from dissect.engine.pipeline import Pipeline

#: Separates the parts of a line with a style in a file of rows, and replaces the line feed.
_PART: Final = "\x1f"
_BREAK: Final = "\x1e"
#: The encoding of rows, the same as in `dissect.cli.run.write`.
_ENCODING: Final = ("utf-8", "backslashreplace")


class RowsPart(NamedTuple):
    """The results of a file's task: ``rows``, with the ``marks`` in them, unless they were written; ``styled`` as `Line` is.

    ``joint`` is that of the `Writer`, None if the rows have no index; ``counts`` is for the summary of all files.
    """

    about: About
    rows: Spooled | None
    marks: Marks
    styled: bool
    joint: bytes | None
    counts: Counts


class _Direct:
    """Writes the rows of a task of this process; ``total`` has the counters of the files before it."""

    def __init__(self, total: Total) -> None:
        self._total = total

    def begin(self, pipeline: Pipeline) -> None:
        count_from(pipeline, _before(self._total))

    def write(self, lines: Sequence[Written]) -> None:
        if lines:
            write_out(lines)


class _Spooler:
    """Stores the rows of a task where `write_rows` finds them. ``joint`` is that of the `Writer`."""

    def __init__(self, of: Task, joint: bytes | None) -> None:
        self.styled = False
        self.joint = joint
        self.marks = Marks()
        self.spool = Spool(of.folder, f"rows-{of.place}")
        self._spots = None if joint is None else self.marks.spots(joint)

    def begin(self, pipeline: Pipeline) -> None:
        self.marks.begin(pipeline)

    def write(self, lines: Sequence[Written]) -> None:
        if not lines:
            return
        if isinstance(lines[0], bytes):
            rows = [row for octets in cast("Sequence[bytes]", lines) for row in octets.split(b"\n")]
            for at in range(0, len(rows), PIECE):
                piece = rows[at : at + PIECE]
                self._keep(b"\n".join([*piece, b""]), [len(row) for row in piece])
            return
        self.styled = isinstance(lines[0], Line)
        if self.styled:
            lines = [_flat(line) for line in cast("Sequence[Line]", lines)]
        texts = cast("Sequence[str]", lines)
        for at in range(0, len(texts), PIECE):
            self._write(texts[at : at + PIECE])

    def _write(self, texts: Sequence[str]) -> None:
        text = "\n".join([*texts, ""])
        octets = text.encode(*_ENCODING)
        wide = len(octets) > len(text)
        self._keep(octets, [len(line.encode(*_ENCODING)) if wide else len(line) for line in texts])

    def _keep(self, octets: bytes, lengths: list[int]) -> None:
        """Keep rows with these lengths."""
        if self._spots is None:
            self.spool.write(octets)
        else:
            self.spool.write_indexed(octets, self._spots.index(octets, lengths))


def _flat(line: Line) -> str:
    return f"{line.style}{_PART}{line.hang}{_PART}{line.text.replace(chr(10), _BREAK)}"


def _line(text: str) -> Line:
    style, hang, rest = text.split(_PART, 2)
    return Line(rest.replace(_BREAK, "\n"), style, int(hang))


def rows_task(of: Task, reading: Reading, rows: Rows) -> None:
    """Read the file of a task and pass on its rows.

    The beginning of the output is dropped: the process that joins the rows writes it once.
    """
    run = reading.prepared(rows.observer, reading.sieves(rows))
    rows.begin(places_of(run, of.files))
    rows.writer.take()
    pipeline = run.pipeline
    spooler = None if of.direct is not None else _Spooler(of, rows.writer.joint)
    sink: _Direct | _Spooler = of.direct if spooler is None else spooler
    sink.begin(pipeline)
    began = int(pipeline.connections.count), int(pipeline.exchange.dialogue.count)
    written = 0

    def write() -> None:
        nonlocal written
        lines = rows.take(run)
        written += len(lines)
        sink.write(lines)

    try:
        read_file(run, write)
        if spooler is not None:
            spooler.marks.over(pipeline)
        of.result = RowsPart(
            about=about(run),
            rows=None if spooler is None else spooler.spool.done(),
            marks=Marks() if spooler is None else spooler.marks,
            styled=spooler is not None and spooler.styled,
            joint=None if spooler is None else spooler.joint,
            counts=counts_of(pipeline, reading.findings, rows.left(), began)._replace(rows=written),
        )
    except OverflowError as error:
        raise FileError(str(error)) from None
    finally:
        if spooler is not None and of.result is None:
            spooler.spool.abandon()


def rows_separately(reading: Reading, rows: Rows, total: Total) -> None:
    """Run the present command for each file, and write the rows in the order of the files; ``total`` gets the counts."""
    writer = rows.writer
    rows.begin(Places([], len(reading.files) > 1, hosts()))
    write_out(writer.take())

    def take(done: Done) -> None:
        part: RowsPart | None = done.result
        if part is None:
            return
        if part.rows is not None:
            write_rows(part, _before(total), writer.number_width)
        total.add(part.counts)

    reading.apart(take, _Direct(total))


def _before(total: Total) -> Offsets:
    return Offsets(total.packets, total.connections, total.transactions)


def write_rows(part: RowsPart, before: Offsets, width: int) -> None:
    """Write the rows of a file; ``before`` are the counters of the files before it."""
    assert part.rows is not None
    with opened(part.rows, spare=True) as file:  # in a separate folder (`dissect.cli.separate`)
        if part.joint is not None:
            for octets, index in indexed(file):
                write_pieces(pieces(octets, index, before.transactions, before.connections, part.joint))
            return
        for rows in whole_lines(file):
            numbered = part.marks.numbered(rows, before, width)
            if part.styled:
                write_out([_line(text) for text in numbered.decode("utf-8").split("\n")[:-1]])
            else:
                write_bytes(numbered)
