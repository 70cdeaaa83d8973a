"""How a replay is done: the user's settings, the state that its connections share, and the requests they wait for."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.testing.playback.client.permissions import Permissions
from dissect.testing.playback.client.plan import Step
from dissect.testing.playback.client.record import Record
from dissect.testing.playback.client.watch import Watch

#: How long to wait for an answer known to be missing if the client's own waiting time is unknown, in seconds.
SILENCE_S: Final = 0.25
#: Shortest wait for an answer that the recording lost, in seconds.
SHORTEST_S: Final = 0.02


class Timeouts:
    """The time limits for one server in one replay, over all connections.

    A recorded answer may take ``timeout_s``. For a request that the server left unanswered, the limit is as long as the
    recorded client waited. For an answer that the recording lost, the limit is ``lost_s``, and half as long after each missing
    answer; once one arrives, all of them may take ``timeout_s``. So a real server gets enough time, and a fake PLC without such
    answers costs at most twice ``lost_s``.
    """

    def __init__(self, timeout_s: float, lost_s: float) -> None:
        self._timeout_s = timeout_s
        self._lost_s = min(lost_s, timeout_s)
        self._least_s = min(SHORTEST_S, self._lost_s)

    def seconds(self, step: Step | None) -> float:
        """Return how long to wait for the answer to a step; None is a request of our own."""
        if step is None or step.expected:
            return self._timeout_s
        if step.lost:
            return self._lost_s
        return min(step.gap_ns / 1e9 if step.gap_ns is not None else SILENCE_S, self._timeout_s)

    def came(self, step: Step | None) -> None:
        """Note an answer, in time or late."""
        if step is not None and step.lost:
            self._lost_s = self._timeout_s

    def missed(self, step: Step | None) -> None:
        """Note that no answer came in time."""
        if step is not None and step.lost:
            self._lost_s = max(self._lost_s / 2, self._least_s)


class Settings:
    """The settings of a replay.

    ``pace`` multiplies the recorded pauses, None sends as soon as possible. ``timeout_s`` is the limit for each answer,
    ``lost_s`` for one that the recording lost (`Timeouts`). ``pipelined`` sends requests before earlier ones are answered if
    the recording does, up to the number that the server grants. ``retries`` are attempts to connect after the first; no request
    is ever sent twice. ``one_by_one`` plays connections one after another that were open at the same time.
    """

    def __init__(
        self,
        pace: float | None = None,
        timeout_s: float = 5.0,
        pipelined: bool = False,
        retries: int = 0,
        lost_s: float = 1.0,
        one_by_one: bool = False,
    ) -> None:
        self.pace = pace
        self.timeout_s = timeout_s
        self.pipelined = pipelined
        self.retries = retries
        self.lost_s = lost_s
        self.one_by_one = one_by_one


class Shared:
    """The state that the connections of one replay share. ``half_loaded``: a download did not reach its end."""

    def __init__(
        self, permissions: Permissions, settings: Settings, record: Record, watch: Watch | None = None
    ) -> None:
        self.permissions = permissions
        self.settings = settings
        self.record = record
        self.half_loaded = False
        self.watch = watch if watch is not None else Watch()
        self.patience = Timeouts(settings.timeout_s, settings.lost_s)


class PendingRequest(NamedTuple):
    """An open request: the time limit for its answer; ``step`` is None for a request of our own."""

    step: Step | None
    until: float

    def due(self, time_ns: int | None) -> bool:
        """Return whether its answer was recorded before ``time_ns``, or at an unknown time."""
        recorded = self.step.transaction if self.step is not None else None
        if time_ns is None or recorded is None or recorded.time_ns is None or recorded.latency_ns is None:
            return True
        return recorded.time_ns + recorded.latency_ns <= time_ns
