"""Rows of files that stand for themselves (option --separate): transactions and values.

A process that does the tasks itself writes rows at once. Those of other processes come through files (`dissect.jobs.spool`),
with marks in the place of the numbers that count over all files; where a format says how these stand in a line, with an index
of them (`dissect.jobs.spots`).
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple, cast

from dissect.cli.configuration import hosts
from dissect.cli.formats import write_out
from dissect.cli.gate import gate_of
from dissect.cli.run import PIECE, write_bytes, write_pieces
from dissect.cli.separate import about, read_file, separately
from dissect.jobs.numbers import Marks, Offsets, count_from
from dissect.jobs.spool import Spool, Spooled, indexed, opened, whole_lines
from dissect.jobs.spots import pieces
from dissect.jobs.tasks import About, Done, FileError
from dissect.report.styled import Line, Written
from dissect.report.words import Places

if TYPE_CHECKING:
    from dissect.cli.options.select import Chosen
    from dissect.cli.task import Task
    from dissect.engine.pipeline import Pipeline
    from dissect.report.writer import Writer
    from dissect.session import Run

#: What stands between the parts of a line with a style in a file of rows, and in the place of a line feed.
_PART: Final = "\x1f"
_BREAK: Final = "\x1e"
#: How rows are written, as `dissect.cli.run.write` does it.
_ENCODING: Final = ("utf-8", "backslashreplace")


class RowsPart(NamedTuple):
    """What the task of a file found: ``rows``, with the ``marks`` in them, unless they were written; ``styled`` as `Line` is.

    ``joint`` is that of the `Writer`, None where the rows have no index.
    The others are what is said of all files in the end: numbers of connections, those left out, transactions and packets,
    packets without S7 by their kind, connections by protocol, findings by slug, which variables asked for were seen, and pairs
    left out because they are only likely, by doubt.
    """

    about: About
    rows: Spooled | None
    marks: Marks
    styled: bool
    joint: bytes | None
    connections: int
    left_out: int
    transactions: int
    packets: int
    ignored: Mapping[str, int]
    protocols: Mapping[str, int]
    findings: Mapping[str, int]
    seen: frozenset[str]
    doubts: Mapping[str, int]


class Total:
    """What all files came to: `RowsPart`, added up."""

    def __init__(self) -> None:
        self.before = Offsets()
        self.left_out = 0
        self.ignored: Counter[str] = Counter()
        self.protocols: Counter[str] = Counter()
        self.findings: Counter[str] = Counter()
        self.seen: set[str] = set()
        self.doubts: Counter[str] = Counter()

    def add(self, part: RowsPart) -> None:
        """Add the part of a file."""
        before = self.before
        self.before = Offsets(
            before.packets + part.packets,
            before.connections + part.connections,
            before.transactions + part.transactions,
        )
        self.left_out += part.left_out
        self.ignored.update(part.ignored)
        self.protocols.update(part.protocols)
        self.findings.update(part.findings)
        self.seen |= part.seen
        self.doubts.update(part.doubts)


class _Direct:
    """Writes the rows of a task of this process; ``total`` knows what came before it."""

    def __init__(self, total: Total) -> None:
        self._total = total

    def begin(self, pipeline: Pipeline) -> None:
        count_from(pipeline, self._total.before)

    def write(self, lines: Sequence[Written]) -> None:
        if lines:
            write_out(lines)


class _Spooler:
    """Puts the rows of a task where `write_rows` finds them. ``joint`` is that of the `Writer`."""

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
        """Keep rows, of which each is so long."""
        if self._spots is None:
            self.spool.write(octets)
        else:
            self.spool.write_indexed(octets, self._spots.index(octets, lengths))


def _flat(line: Line) -> str:
    return f"{line.style}{_PART}{line.hang}{_PART}{line.text.replace(chr(10), _BREAK)}"


def _line(text: str) -> Line:
    style, hang, rest = text.split(_PART, 2)
    return Line(rest.replace(_BREAK, "\n"), style, int(hang))


def rows_task(
    of: Task,
    run: Run,
    chosen: Chosen,
    writer: Writer,
    take: Callable[[], Sequence[Written]],
    left: Callable[[], tuple[Mapping[str, int], Iterable[str], Mapping[str, int]]],
) -> int:
    """Read the file of a task and hand on its rows: those that ``take`` returns, again and again.

    ``left`` returns in the end the connections by protocol, the variables that were seen, and the pairs that were left out.
    ``writer`` has to have written what the output begins with, which is written once, by whoever puts the rows together.
    """
    writer.take()
    chosen.begin(run, of.files)
    pipeline = run.pipeline
    spooler = None if of.direct is not None else _Spooler(of, writer.joint)
    sink: _Direct | _Spooler = of.direct if spooler is None else spooler
    sink.begin(pipeline)
    connections, transactions = int(pipeline.connections.count), int(pipeline.exchange.dialogue.count)
    try:
        read_file(run, lambda: sink.write(take()))
        if spooler is not None:
            spooler.marks.over(pipeline)
        protocols, seen, doubts = left()
        of.found = RowsPart(
            about=about(run),
            rows=None if spooler is None else spooler.spool.done(),
            marks=Marks() if spooler is None else spooler.marks,
            styled=spooler is not None and spooler.styled,
            joint=None if spooler is None else spooler.joint,
            connections=int(pipeline.connections.count) - connections,
            left_out=int(pipeline.connections.left_out),
            transactions=int(pipeline.exchange.dialogue.count) - transactions,
            packets=pipeline.frames,
            ignored=dict(pipeline.counters.packet_counts()),
            protocols=dict(protocols),
            findings=dict(chosen.findings if chosen.findings is not None else pipeline.finding_counts),
            seen=frozenset(seen),
            doubts=dict(doubts),
        )
    except OverflowError as error:
        raise FileError(str(error)) from None
    finally:
        if spooler is not None and of.found is None:
            spooler.spool.abandon()
    return 0


def rows_separately(
    files: Sequence[str], jobs: int, writer: Writer, fail_on: frozenset[str], say: Callable[[Total], None]
) -> int:
    """Have the command at hand done for each file, and write the rows in the order of the files; return the exit code.

    ``writer`` has to have written what the output begins with. ``say`` has the last word.
    """
    write_out(writer.take())
    total = Total()

    def take(done: Done) -> None:
        part: RowsPart | None = done.result
        if part is None:
            return
        if part.rows is not None:
            write_rows(part, total.before, writer.number_width)
        total.add(part)

    code = separately(files, jobs, take, _Direct(total))
    say(total)
    return gate_of(total.findings, fail_on, code)


def write_rows(part: RowsPart, before: Offsets, width: int) -> None:
    """Write the rows of a file; ``before`` is what the files before it came to."""
    assert part.rows is not None
    with opened(part.rows, spare=True) as file:  # in a folder of its own (`dissect.cli.separate`)
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


def no_places(files: Sequence[str]) -> Places:
    """Return how packets are named in what an output begins with, before there is one."""
    return Places([], len(files) > 1, hosts())
