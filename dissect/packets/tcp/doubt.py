"""`Doubt`: a RST or FIN whose sequence number is not the one that its receiver expects next.

A receiver accepts a RST at exactly that number (RFC 5961 section 3.2), and a FIN once it has every octet before it (RFC 9293
section 3.10.7.4). In a capture, a RST or FIN with another number may be genuine and follow octets that the capture lost; or
someone else sent it and guessed the number. The packets that follow decide. The connection counts as ended until both sides
continue:

* the other side sent octets after the end, and then the side that apparently ended sent octets that acknowledge those; or
* the side that apparently ended sent octets from beyond the end.

A FIN that the other side acknowledges is genuine.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from mypy_extensions import i64

from dissect.wire.copies import leaves

if TYPE_CHECKING:
    from dissect.packets.tcp.stream import HalfStream

# What `Doubt.look` returns: undecided, genuine, or not an end.
OPEN: Final = 0
HOLDS: Final = 1
REFUTED: Final = 2


class Doubt:
    """An end in doubt: packet ``frame`` from the address of ``side``, with sequence number ``seq``.

    ``how`` is ``fin`` or ``reset``. ``distance`` is how far ``seq`` was ahead of the octet that was expected next (negative:
    behind); ``sender`` is the Ethernet address that the packet came from, empty for none. ``other`` is a certain end that came
    after it, with its side, packet and time; ``silent`` has a bit for each side that sends nothing more because of that one.
    ``due``: something was sent since the last `look`.
    """

    __slots__ = (
        "_mine",
        "_reach",
        "_theirs",
        "distance",
        "due",
        "frame",
        "how",
        "other",
        "other_frame",
        "other_ns",
        "other_side",
        "sender",
        "seq",
        "side",
        "silent",
        "time_ns",
    )

    def __init__(self, how: str, side: i64, seq: i64, frame: i64, time_ns: i64, streams: list[HalfStream]) -> None:
        mine, theirs = streams[side], streams[1 - side]
        self.how: str = how
        self.side: i64 = side
        self.seq: i64 = seq
        self.frame: i64 = frame
        self.time_ns: i64 = time_ns
        self.distance: i64 = mine.distance(seq)
        self.sender: bytes = b""
        self.due: bool = False
        self.other: str = ""
        self.other_side: i64 = -1
        self.other_frame: i64 = 0
        self.other_ns: i64 = 0
        self.silent: i64 = 0
        # Octets after `_reach` are from beyond the end. Those held now do not count: they were sent before the end.
        self._reach: i64 = seq
        held = mine.held
        if held is not None:
            last = held[-1]
            top: i64 = last.at + len(last.octets) - mine.position
            if top > self.distance:
                self._reach = mine.next_seq + top
        self._theirs: i64 = theirs.next_seq  # of the other side, at the end in doubt or when it first continued
        self._mine: i64 = -1  # the next octet of `side` when the other side continued, -1 before that

    def note_other(self, how: str, side: i64, frame: i64, time_ns: i64, silent: i64) -> None:
        """Take a certain end, which counts if the one in doubt does not."""
        if not self.other:
            self.other = how
            self.other_side = side
            self.other_frame = frame
            self.other_ns = time_ns
        self.silent |= silent

    def look(self, mine: HalfStream, theirs: HalfStream, my_ack: i64, their_ack: i64) -> i64:
        """Return the present state: OPEN, HOLDS or REFUTED.

        ``mine`` is the stream of ``side``, ``theirs`` that of the other side. ``my_ack`` and ``their_ack`` are what each
        acknowledged last, -1 for none.
        """
        if self.distance > 0:
            if mine.distance(self._reach) < 0:
                return REFUTED
            if self.how == "fin" and their_ack >= 0 and mine.distance(their_ack) == mine.distance(self.seq) + 1:
                return HOLDS
        if mine.held is not None or theirs.held is not None or theirs.next_seq < 0:
            return OPEN  # `next_seq` also moves when a gap is declared, which does not prove that a side continued
        if self._mine < 0:
            if theirs.next_seq != self._theirs:
                self._theirs = theirs.next_seq
                self._mine = mine.next_seq
            return OPEN
        if (
            mine.next_seq != self._mine
            and mine.next_seq != self.seq
            and my_ack >= 0
            and theirs.distance(my_ack) >= theirs.distance(self._theirs)
        ):
            return REFUTED
        return OPEN


def _taken(_doubt: Doubt) -> tuple[str, int, int, int, int, list[HalfStream]]:
    return "", 0, 0, 0, 0, [HalfStream(), HalfStream()]


leaves(Doubt, taken=_taken)
