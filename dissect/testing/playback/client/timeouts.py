"""How long to wait for an answer that is recorded, known to be missing, or unknown."""

from __future__ import annotations

from typing import Final

from dissect.testing.playback.client.plan import Step

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
