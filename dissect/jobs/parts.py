"""What a run of a share hands over, piece by piece: plain values, because objects of compiled classes cannot be sent."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final, NamedTuple

from dissect.engine.observer import Observer
from dissect.engine.order import Order
from dissect.jobs.share import Share
from dissect.report.styled import Line
from dissect.report.words import Places
from dissect.session import Run
from dissect.transactions.connection import Connection

#: Styles as they were first seen: what is the same object is sent once.
_LOOKS: Final[dict[tuple[str, int], tuple[str, int]]] = {}


class Lines(NamedTuple):
    """Lines of results, a value for each of them in each list: what is sent is as flat as can be.

    ``stamps`` say when the result was found (`dissect.engine.order`), ``packets`` where it stands in the capture. In ``texts``
    the number of the transaction is ``mark``; ``numbers`` has it, counted in the share only. ``looks`` are the styles of lines
    that have one, and where they are continued.
    """

    stamps: list[int]
    numbers: list[int]
    packets: list[int]
    texts: list[str]
    looks: list[tuple[str, int]]
    mark: str


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
    lines: Lines
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
    """Collects lines of results, and what else `Piece` and `End` want to know of an observer."""

    def __init__(self, share: Share) -> None:
        super().__init__()
        self.mark = ""
        self._stamps: list[int] = []
        self._numbers: list[int] = []
        self._packets: list[int] = []
        self._texts: list[str] = []
        self._looks: list[tuple[str, int]] = []
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

    def add(self, stamp: int, number: int, packet: int, lines: list[str | Line]) -> None:
        """Take the lines of a result."""
        for line in lines:
            self._stamps.append(stamp)
            self._numbers.append(number)
            self._packets.append(packet)
            if isinstance(line, Line):
                self._texts.append(line.text)
                self._looks.append(_LOOKS.setdefault(line[1:], line[1:]))
            else:
                self._texts.append(line)

    def take(self) -> Lines:
        """Return the lines since the last call."""
        lines = Lines(self._stamps, self._numbers, self._packets, self._texts, self._looks, self.mark)
        self._stamps, self._numbers, self._packets, self._texts, self._looks = [], [], [], [], []
        return lines

    def gather(self) -> None:
        """A stretch of packets is over."""


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
    unshown, rows.unshown = rows.unshown, []
    plcs, rows.plcs = rows.plcs, []
    return Piece(
        begun=begun,
        ended=ended,
        left=left,
        opened=share.take(),
        lines=rows.take(),
        unshown=unshown,
        plcs=plcs,
        held=int(pipeline.timers.oldest_held()),
        room=int(order.room),
        requests=int(dialogue.open) + len(begun),
        sessions=int(pipeline.tls.sessions),
        variables=rows.variables,
        kept=rows.kept,
        tangled=order.tangled,
        file=run.files[-1].name if run.files else "",
        octets=sum([int(file.octets) for file in run.files]),
    )
