"""The schedule: beginnings, steps and ends of all connections in the order in which they were recorded."""

from __future__ import annotations

import heapq
import time
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Final, NamedTuple

from dissect.online.net.addresses import Place
from dissect.testing.playback.client.plan import ASK, Part, playable
from dissect.testing.playback.client.player import PartPlayer
from dissect.testing.playback.client.recorded import ReplayError
from dissect.testing.playback.client.settings import Shared

#: Maximum number of open connections: a system allows a process about 1,000 files, some as few as 256.
MAX_OPEN: Final = 200
#: Marks the beginning of a connection instead of the number of a step; the end has the number after the last step.
CONNECT: Final = -1


class Moment(NamedTuple):
    """When a connection (``part`` in the plan) begins, takes the step ``at``, or ends. ``time_ns`` is None if unknown."""

    frame: int
    part: int
    at: int
    time_ns: int | None


def moments(parts: Sequence[Part], one_by_one: bool) -> Iterator[Moment]:
    """Return what is to be done: in recorded order, or ``one_by_one``; the latter also if recorded times are unknown."""
    lanes = [_lane(index, part) for index, part in enumerate(parts)]
    if one_by_one or not _known(parts):
        return chain.from_iterable(lanes)
    return heapq.merge(*lanes)


def _known(parts: Sequence[Part]) -> bool:
    return all([part.span is not None for part in parts])


def _lane(index: int, part: Part) -> Iterator[Moment]:
    """Return the moments of one connection, each no earlier than its predecessor."""
    span = part.span
    frame = span.first_frame if span is not None else 0
    yield Moment(frame, index, CONNECT, span.first_ns if span is not None else None)
    for at, step in enumerate(part.steps):
        frame = max(frame, step.transaction.frame)
        yield Moment(frame, index, at, step.transaction.time_ns)
    if span is not None:
        frame = max(frame, span.last_frame)
    yield Moment(frame, index, len(part.steps), span.last_ns if span is not None else None)


def open_at_once(plan: Sequence[Part]) -> int:
    """Return how many connections of a plan were open at the same time, 1 if unknown."""
    parts = playable(plan)
    if not _known(parts):
        return min(len(parts), 1)
    count = most = 0
    for moment in moments(parts, False):
        if moment.at == CONNECT:
            count += 1
            most = max(most, count)
        elif moment.at == len(parts[moment.part].steps):
            count -= 1
    return most


def expect_few(plan: Sequence[Part]) -> None:
    """Raise `ReplayError` if more connections are open at once than there may be sockets."""
    most = open_at_once(plan)
    if most > MAX_OPEN:
        raise ReplayError(
            f"{most} connections were open at once in the recording, at most {MAX_OPEN} can be replayed together: "
            f"nothing was sent; add --one-by-one (one_by_one=True), or choose some with --connection"
        )


class Clock:
    """The recording's time during a replay: ``pace`` multiplies its pauses, None leaves them out."""

    def __init__(self, pace: float | None) -> None:
        self._pace = pace
        self._first_ns: int | None = None
        self._began = 0.0

    def turn(self, time_ns: int | None) -> float:
        """Return the time (monotonic, seconds) for an event recorded at ``time_ns``. The first call starts the clock."""
        if self._pace is None or time_ns is None:
            return 0.0
        if self._first_ns is None:
            self._first_ns = time_ns
            self._began = time.monotonic()
        return self._began + (time_ns - self._first_ns) / 1e9 * self._pace


def perform(players: Sequence[PartPlayer], places: Sequence[Place], shared: Shared) -> None:
    """Play connections. One that fails does not stop the others; all are closed at the end."""
    settings = shared.settings
    parts = [player.part for player in players]
    clock = Clock(settings.pace)
    waiting: dict[int, PartPlayer] = {}
    try:
        for moment in moments(parts, settings.one_by_one):
            player = players[moment.part]
            if player.over:
                continue
            if moment.at == CONNECT and settings.one_by_one:
                clock = Clock(settings.pace)
            if _is_paced(player, moment.at):
                shared.watch.sleep(clock.turn(moment.time_ns), lambda: player.broken)  # noqa: B023 - called at once
            # Answers that came before this in the recording must come before it now.
            for other in waiting.values():
                if other is not player:
                    other.settle(moment.time_ns)
            if shared.watch.halted:
                player.interrupt(moment.at)
                continue
            _take_moment(player, moment.at, places)
            waiting[moment.part] = player
            waiting = {index: one for index, one in waiting.items() if one.waits}
    finally:
        for player in players:
            player.drop()
        shared.watch.close()


def _is_paced(player: PartPlayer, at: int) -> bool:
    """Return whether the client decides when this is done; messages of the server are awaited instead."""
    steps = player.part.steps
    return steps[at].kind == ASK if 0 <= at < len(steps) else at == CONNECT or player.part.by_client


def _take_moment(player: PartPlayer, at: int, places: Sequence[Place]) -> None:
    if at == CONNECT:
        player.begin(places)
    elif at == len(player.part.steps):
        player.end()
    else:
        player.step(at)
