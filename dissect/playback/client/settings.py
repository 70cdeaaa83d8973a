"""How a replay is done: what a user chooses, what its connections have in common, and what each of them waits for."""

from __future__ import annotations

from typing import NamedTuple

from dissect.playback.client.permissions import Permissions
from dissect.playback.client.plan import Step
from dissect.playback.client.record import Record
from dissect.playback.client.timeouts import Timeouts
from dissect.playback.client.watch import Watch


class Settings:
    """How it is played.

    ``pace`` multiplies the recorded pauses, None asks as soon as possible. ``timeout_s`` is for each answer, ``lost_s`` for one
    that the recording lost (`Timeouts`). ``pipelined`` sends requests before earlier ones are answered where the recording
    does, as many at once as the server grants. ``retries`` are attempts to connect after the first; no request is ever sent
    twice. ``one_by_one`` plays connections one after another that were open at the same time.
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
    """What the connections of one replay have in common. ``half_loaded`` tells that a download did not come to its end."""

    def __init__(
        self, permissions: Permissions, settings: Settings, record: Record, watch: Watch | None = None
    ) -> None:
        self.permissions = permissions
        self.settings = settings
        self.record = record
        self.half_loaded = False
        self.watch = watch if watch is not None else Watch()
        self.patience = Timeouts(settings.timeout_s, settings.lost_s)


class Asked(NamedTuple):
    """A request that is open: by when its answer is late; ``step`` is None for one of our own."""

    step: Step | None
    until: float

    def due(self, time_ns: int | None) -> bool:
        """Tell whether its answer was recorded before ``time_ns``, or nobody knows."""
        asked = self.step.transaction if self.step is not None else None
        if time_ns is None or asked is None or asked.time_ns is None or asked.latency_ns is None:
            return True
        return asked.time_ns + asked.latency_ns <= time_ns
