"""The seam of the engine: what reads the octets of a connection, or the messages that another protocol delivers.

A TCP connection begins with a protocol that only looks (`dissect.engine.connections`) and is given to the one that
recognises it. Some protocols frame a stream (ISO-on-TCP, IBH-NetLink); they deliver whole messages to others of the same
seam (S7comm, S7comm-plus). One object serves all connections (docs/decisions/0012); what belongs to one direction of one
connection is kept at its `Side`: `Side.kept` is for what a protocol needs that frames a stream by itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from mypy_extensions import i64

if TYPE_CHECKING:
    from dissect.transactions.accounts import OctetAccount
    from dissect.transactions.side import Side


class Kept:
    """What a protocol keeps of one direction of a stream: ``octets`` that make no whole message yet, and what became of others.

    ``framed`` counts octets of whole messages, ``skipped`` those given up. Derive from it what else the framing needs, put it
    at `Side.kept` in `Protocol.begin`, and bound ``octets``.
    """

    __slots__ = ("framed", "octets", "skipped")

    def __init__(self) -> None:
        self.octets: bytes = b""
        self.framed: i64 = 0
        self.skipped: i64 = 0


class Protocol:
    """What a protocol may do where a byte passes; this one takes everything and makes nothing of it.

    ``state`` is the value of `Connection.state` while a connection speaks it (`dissect.transactions.connection.FOLLOWED`); of
    no meaning for what takes messages.
    """

    def __init__(self, state: i64 = 0) -> None:
        self.state: i64 = state

    def probe(self, side: Side, octets: bytes, at_start: bool) -> bool:
        """Return whether ``octets``, the next of a connection not known yet, are its own; ``at_start``: its very first ones."""
        return False

    def begin(self, side: Side, at_start: bool) -> None:
        """A connection is given to it; ``at_start``: what comes next of ``side`` begins a message."""

    def feed(self, side: Side, buf: bytes, at: i64, size: i64, frame: i64, time_ns: i64) -> None:
        """Take the next ``size`` octets of a stream from ``at``, or a whole message that packet ``frame`` completed."""

    def cut(self, side: Side, octets: bytes, frame: i64, time_ns: i64) -> None:
        """Take the beginning of a message whose rest the capture cut off; ten octets of it or more are there."""

    def gap(self, side: Side, size: i64, cut: bool, frame: i64, time_ns: i64) -> None:
        """``size`` octets are missing here; ``cut``: the capture cut them off a packet (snaplen)."""
        side.framer.hole(size, cut)

    def finish(self, side: Side, frame: i64, time_ns: i64) -> None:
        """No more octets of ``side`` come: take what there is of an unfinished message."""

    def end(self, side: Side, frame: i64, time_ns: i64) -> None:
        """The connection is over and judged: report what of ``side`` stays unfinished. Called for either side."""

    def held(self, side: Side) -> i64:
        """Return how many octets are kept of ``side`` until a message is whole."""
        kept = side.kept
        return side.framer.buffered + (len(kept.octets) if kept is not None else 0)

    def add_up(self, side: Side, account: OctetAccount) -> None:
        """Add to the account what became of the octets that ``side`` delivered: framed, skipped, or still held."""
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
        """Return what it counted, as sections of the analysis (docs/json.md)."""
        return {}

    def counted(self) -> list[tuple[int, str]]:
        """Return how many messages of which kind passed, for the first lines of a report: ``[(6, "S7 PDU")]``."""
        return []
