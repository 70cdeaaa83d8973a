"""The interface of the engine to protocols: they read the octets of a connection, or messages that another protocol delivers.

A TCP connection begins with a protocol that only recognises others (`dissect.engine.connections`), and is then given to the
recognised one. Some protocols frame a stream (ISO-on-TCP, IBH-NetLink); they deliver whole messages to others with the same
interface (S7comm, S7comm-plus). One object serves all connections (docs/decisions/0012-engine-by-composition.md). The state of
one direction of a connection is in its `Side`; a new protocol that frames a stream stores its own state in `Side.kept`.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mypy_extensions import i64

if TYPE_CHECKING:
    from dissect.engine.transactions.accounts import OctetAccount
    from dissect.engine.transactions.side import Side


class Kept:
    """The state of a protocol that frames one direction of a stream.

    ``octets`` are the beginning of an incomplete message. ``framed`` counts octets of whole messages, ``skipped`` those that
    were dropped. A protocol derives a class from it for other state that its framing needs, puts an object into `Side.kept` in
    `Protocol.begin`, and limits ``octets``.
    """

    __slots__ = ("framed", "octets", "skipped")

    def __init__(self) -> None:
        self.octets: bytes = b""
        self.framed: i64 = 0
        self.skipped: i64 = 0


class Protocol:
    """The interface of a protocol; this base class accepts everything and ignores it.

    ``state`` is the value of `Connection.state` while a connection speaks it (`dissect.engine.transactions.connection`:
    PROBING, ISO …); it is meaningless for a protocol inside another protocol.
    """

    def __init__(self, state: i64 = 0) -> None:
        self.state: i64 = state

    def probe(self, side: Side, octets: bytes, at_start: bool) -> bool:
        """Return whether ``octets`` of an unrecognised connection are of this protocol.

        ``at_start``: they are the first octets that their side sent.
        """
        return False

    def begin(self, side: Side, at_start: bool) -> None:
        """A connection is given to this protocol; ``at_start``: the next octets of ``side`` begin a message."""

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take ``buf[at:at + size]``: the next octets of a stream, or a whole message, which packet ``frame`` completed.

        ``time_ns`` is the time of that packet, nanoseconds since 1970.
        """

    def cut(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the beginning of a message whose rest the capture cut off; it has ten octets or more."""

    def behind(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take a whole message behind a malformed header of the protocol below (`dissect.engine.transactions.behind`)."""

    def gap(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """``size`` octets of the stream are missing here; ``cut``: the capture cut them off a packet (snaplen)."""
        side.framer.hole(size, cut)

    def finish(self, side: Side, frame: i64, time_ns: i64) -> None:
        """Nothing more comes from ``side``: use what there is of an unfinished message."""

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """The connection is over and judged: report what remains unfinished on ``side``. Called once for each side."""

    def held(self, side: Side) -> i64:
        """Return how many octets of ``side`` are kept because their message is incomplete."""
        kept = side.kept
        return side.framer.buffered + (len(kept.octets) if kept is not None else 0)

    def add_up(self, side: Side, account: OctetAccount) -> None:
        """Add to ``account`` the treatment of the octets of ``side``: framed, skipped, or still held."""
        framer = side.framer
        account.framed += framer.framed
        account.skipped += framer.skipped
        account.buffered += framer.buffered
        kept = side.kept
        if kept is not None:
            account.framed += kept.framed
            account.skipped += kept.skipped
            account.buffered += len(kept.octets)

    def describe(self) -> dict[str, object]:
        """Return its counts, as sections of the analysis (docs/json.md)."""
        return {}

    def counted(self) -> list[tuple[int, str]]:
        """Return the number and kind of its messages, for the first lines of a report: ``[(6, "S7 PDU")]``."""
        return []
