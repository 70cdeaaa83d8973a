"""What waits for time to pass, and the end: the part of the pipeline that is driven by the clock of the capture.

Segments wait for those before them, answers for their requests, closed connections for packets out of order, and, where
`Options.overdue_ns` asks for it, open requests for their answers. `Waiting.frame` is not here: packets move the clock, and on
a silent line `Waiting.tick` does.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.engine.ibh import Gateway
from dissect.engine.observer import Observer, Options
from dissect.engine.overdue import OverdueWatch
from dissect.engine.udp import Datagrams
from dissect.transactions.connection import CARRIED, FOREIGN, IBH, PROBING
from dissect.transactions.dialogue import Dialogue
from dissect.transactions.table import MAX_CONNECTIONS, Side
from dissect.transactions.transaction import CAPTURE_ENDED, CONNECTION_CLOSED

#: How often (capture time) what waits is looked at.
TICK_NS: Final = 50_000_000
#: Sides that wait are sought out of those whose connection is over when the list has grown to this.
_MANY_WAITING: Final = 4 * MAX_CONNECTIONS
#: The deadline while nothing waits.
FAR_FUTURE: Final = 0x7FFFFFFFFFFFFFFF


class Waiting(Datagrams):
    """Octets in order to those who take them, at once or when it is time; connections until their end."""

    def __init__(self, observer: Observer, options: Options) -> None:
        super().__init__(observer, Gateway(observer, options))
        self._dialogue: Dialogue = self.conversation.dialogue
        self._strict: bool = options.strict
        self._checksums = options.checksums
        self._waiting: list[Side] = []  # sides with held segments or held answers
        self._overdue: OverdueWatch | None = None
        self._rest_ns: i64 = FAR_FUTURE  # the deadline while nothing waits
        if options.overdue_ns:
            self._overdue = OverdueWatch(self._judge, self._dialogue, options.overdue_ns)
            self._rest_ns = 0
        self._deadline_ns: i64 = self._rest_ns

    # ---- octets in order, and holes ---------------------------------------------------------------------------------

    def _chunks(self, side: Side, cut: bool = False) -> None:
        """Pass on what a stream has ready: octets and holes, in order. ``cut``: the capture cut the frame there."""
        half = side.stream
        ready = half.ready
        half.ready = []
        if half.outside:
            self._note_outside(side)
        for chunk in ready:
            if not chunk.hole and side.at_rest:
                # What is whole in these octets was so when they came, whatever had to come before them.
                chunk.frame = chunk.own_frame
                chunk.time_ns = chunk.own_ns
            side.end_seq = chunk.end_seq
            side.last_ack = chunk.ack
            if chunk.hole:
                if side.connection.followed:
                    self.octets.holes += 1
                    self.octets.missing += chunk.hole
                self.conversation.hole(side, chunk.hole, cut, chunk.frame, chunk.time_ns)
            elif side.connection.state == PROBING:
                self.conversation.probe(side, chunk.octets, chunk.frame, chunk.time_ns)
            elif side.connection.state == FOREIGN:
                side.framer.skipped += len(chunk.octets)
            elif side.connection.state == IBH:
                self.conversation.ibh_octets(side, chunk.octets, chunk.frame, chunk.time_ns)
            elif side.connection.state == CARRIED:
                self.conversation.carried_octets(side, chunk.octets, chunk.frame, chunk.time_ns)
            else:
                self.conversation.octets(side, chunk.octets, chunk.frame, chunk.time_ns)

    def _note_outside(self, side: Side) -> None:
        if side.connection.followed:
            detail = f"{side.stream.outside} octets from {side.tcp.ends[side.index]}"
            self._note("stream.outside_window", detail, side.connection.number)
        side.stream.outside = 0

    # ---- what waits for time to pass --------------------------------------------------------------------------------

    def _wait(self, side: Side) -> None:
        """Look at ``side`` again when time passes or its connection shows another packet."""
        if not side.waiting:
            side.waiting = True
            self._waiting.append(side)
            if len(self._waiting) > _MANY_WAITING:
                self._waiting = [one for one in self._waiting if one.waiting]
        if self._deadline_ns == FAR_FUTURE:
            self._deadline_ns = self.now_ns + TICK_NS

    def _expire_answers(self, side: Side) -> None:
        self._dialogue.expire(side, self.now_ns)
        if self._dialogue.also:
            self.conversation.beside(self.frames, self.now_ns)

    def tick(self, now_ns: i64) -> None:
        """Time passes on a silent line: it is ``now_ns`` by the clock of the capture, and no packet came since the last one.

        What waited too long is given up, as the next packet would do it. That packet may be a little older than ``now_ns``:
        it was on its way. A clock that is behind the last packet does nothing.
        """
        packet_ns: i64 = self.now_ns
        if self.frames == 0 or now_ns <= packet_ns:
            return
        self.now_ns = now_ns
        self._tick()
        self.now_ns = packet_ns
        if self._deadline_ns != FAR_FUTURE:
            self._deadline_ns = packet_ns + TICK_NS
        if self._judge.fresh:
            self.conversation.tell_findings()

    def _tick(self) -> None:
        """Time has passed: give up what waited too long, forget connections that are over."""
        self._deadline_ns = self.now_ns + TICK_NS
        try:
            self._give_up_waiting()
            self._forget_closed()
            if self._overdue is not None:
                self._overdue.look(self.now_ns)
        except Exception as bug:
            if self._strict:
                raise
            self.conversation.note_bug(bug, self.frames, self.now_ns)
        self._waiting = [side for side in self._waiting if side.waiting]
        if self._overdue is None and not self._waiting and not self.table.lingering:
            self._deadline_ns = FAR_FUTURE

    def _give_up_waiting(self) -> None:
        waiting = list(self._waiting)
        for side in waiting:
            side.stream.expire(self.now_ns)
            if side.stream.ready:
                self._chunks(side)
        for side in waiting:  # only then the answers: the request one of them waits for may just have come out
            self._expire_answers(side)
            asked = side.connection.open_requests[1 - side.index]
            side.waiting = side.stream.time_bound or asked.orphans is not None

    def _forget_closed(self) -> None:
        for side in self.table.closed(self.now_ns):
            self._finish(side, CONNECTION_CLOSED)

    # ---- the end ----------------------------------------------------------------------------------------------------

    def _finish(self, side: Side, reason: str) -> None:
        """A connection is over: pass on what is held, close what is open, add up its octets."""
        peer = side.peer
        if peer is None:
            return  # finished before
        try:
            self._end(side, peer, reason)
        except Exception as bug:
            if self._strict:
                raise
            self.conversation.note_bug(bug, self.frames, self.now_ns)
        # What never was ISO-on-TCP, nor ought to have been, is not our loss.
        if side.connection.number or self.conversation.on_102(side):
            for end in (side, peer):
                self._add_up(end)
        self.table.remove(side)

    def _end(self, side: Side, peer: Side, reason: str) -> None:
        for end in (side, peer):
            end.stream.finish()
            if end.stream.ready or end.stream.outside:
                self._chunks(end)
            end.waiting = False
        connection = side.connection
        if connection.number:
            if side.tcp.ended and reason == CAPTURE_ENDED:
                reason = CONNECTION_CLOSED
            self.conversation.end(side, reason, self.frames, self.now_ns)
        elif connection.state == PROBING and connection.probed:
            self.conversation.end_unrecognised(side, self.frames, self.now_ns)
        elif connection.state == PROBING and (side.probes or peer.probes) and self.conversation.on_102(side):
            first, second = side.tcp.ends
            self._note("session.idle", f"{first} and {second}, {int(side.tcp.packets)} packets")

    def finish(self) -> None:
        """The capture ends: every connection still open is closed, everything held is told."""
        for side in self.table.closed(self.now_ns, True):
            self._finish(side, CONNECTION_CLOSED)
        for side in self.table.all_open():
            self._finish(side, CAPTURE_ENDED)
        self.finish_flows()
        self._waiting = []
        self._deadline_ns = self._rest_ns
        self.conversation.tell_findings()
