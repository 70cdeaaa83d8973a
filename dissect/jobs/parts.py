"""What a run of a share hands over, piece by piece: plain values, because objects of compiled classes cannot be sent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

from dissect.engine.observer import Observer
from dissect.engine.order import Order
from dissect.jobs.share import Share
from dissect.report.styled import Line
from dissect.report.words import Places
from dissect.session import Run
from dissect.transactions.connection import Connection


class Row(NamedTuple):
    """The lines of one result.

    ``stamp`` says when it was found (`dissect.engine.order`), ``packet`` where it stands in the capture. Each of ``lines`` is
    in pieces: the number of the transaction belongs between them. It counts those of the share only, as ``number`` says.
    """

    stamp: int
    number: int
    packet: int
    lines: list[list[str]]
    look: tuple[str, int] | None


class Piece(NamedTuple):
    """What a run of a share found in a stretch of packets; the stretches of all runs are the same.

    ``begun``, ``ended``, ``left`` as `dissect.engine.order.Order` has them, ``opened`` as `Share`. ``unshown`` are numbers of
    transactions without a row. ``held`` is the first packet that is held back. Of ``room``, ``requests``, ``variables`` and
    ``kept`` (octets of their values) all connections of a run share the bounds. ``plcs`` are the stations whose variables are
    known here. ``file`` is the one that is read, ``octets`` how far all of them.
    """

    begun: list[int]
    ended: list[int]
    left: list[int]
    opened: list[int]
    rows: list[Row]
    unshown: list[int]
    held: int
    room: int
    requests: int
    sessions: int
    variables: int
    kept: int
    plcs: list[str]
    tangled: bool
    file: str
    octets: int


class End(NamedTuple):
    """What a run of a share came to.

    ``files`` with what is wrong with each, ``unwanted`` the connections of the share that a selection ruled out, ``found`` the
    texts of the variables that were asked for and seen.
    """

    files: list[tuple[str, str]]
    transactions: int
    unwanted: int
    found: list[str]


class Rows(Observer):
    """Collects ``rows`` of results, and what else `Piece` and `End` want to know of an observer."""

    def __init__(self, share: Share) -> None:
        super().__init__()
        self.rows: list[Row] = []
        self.unshown: list[int] = []
        self.variables = 0
        self.kept = 0
        self.plcs: list[str] = []
        self.found: set[str] = set()
        self._share = share

    def connection_opened(self, connection: Connection) -> None:
        """Note a connection that took the place of another one."""
        self._share.note(connection)

    def begin(self, places: Places) -> None:
        """The run begins; its packets are named with ``places``."""

    def gather(self) -> None:
        """A stretch of packets is over."""


def row_of(stamp: int, number: int, packet: int, lines: list[str | Line], mark: str) -> Row:
    """Return a row of lines in which ``mark`` stands for the number of the transaction; empty for lines without one."""
    texts = [line.text if isinstance(line, Line) else line for line in lines]
    first = lines[0] if lines else ""
    look = (first.style, first.hang) if isinstance(first, Line) else None
    return Row(stamp, number, packet, [text.split(mark) if mark else [text] for text in texts], look)


def pieces(run: Run, rows: Rows, share: Share, order: Order) -> Iterator[Piece | End]:
    """Do a run; yield what it found, stretch by stretch, then how it ended. Raises `CaptureError` as `Run.step` does."""
    while run.step():
        yield _piece(run, rows, share, order)
    run.finish()
    yield _piece(run, rows, share, order)
    yield End(
        [(file.name, file.loss) for file in run.files],
        int(run.pipeline.exchange.dialogue.count),
        share.unwanted,
        sorted(rows.found),
    )


def _piece(run: Run, rows: Rows, share: Share, order: Order) -> Piece:
    rows.gather()
    pipeline = run.pipeline
    dialogue = pipeline.exchange.dialogue
    begun, ended, left = order.take(dialogue.count)
    piece: dict[str, Any] = {"rows": rows.rows, "unshown": rows.unshown, "plcs": rows.plcs}
    rows.rows, rows.unshown, rows.plcs = [], [], []
    return Piece(
        begun=begun,
        ended=ended,
        left=left,
        opened=share.take(),
        held=int(pipeline.timers.oldest_held()),
        room=int(order.room),
        requests=int(dialogue.open) + len(begun),
        sessions=int(pipeline.tls.sessions),
        variables=rows.variables,
        kept=rows.kept,
        tangled=order.tangled,
        file=run.files[-1].name if run.files else "",
        octets=sum([int(file.octets) for file in run.files]),
        **piece,
    )
