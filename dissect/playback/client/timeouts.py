"""How long an answer is waited for: what the recording has, what it shows to have stayed away, what it does not tell."""

from __future__ import annotations

from typing import Final

from dissect.playback.client.plan import Step

#: How long to wait for an answer that stayed away when nobody knows how long the client waited for it, in seconds.
SILENCE_S: Final = 0.25
#: The least that an answer is waited for which the recording lost.
SHORTEST_S: Final = 0.02


class Timeouts:
    """What one server is granted in one replay, on all connections together.

    An answer that was recorded may take ``timeout_s``. One that the server did not give may take as long as the recorded client
    left it for, and no longer than that. One that the recording lost is waited for ``lost_s`` and, each time that none comes,
    half as long; once one came, all of them may take ``timeout_s``: so a real server is heard out, and a fake PLC that has no
    such answers does not cost more than twice ``lost_s``.
    """

    def __init__(self, timeout_s: float, lost_s: float) -> None:
        self._timeout_s = timeout_s
        self._lost_s = min(lost_s, timeout_s)
        self._least_s = min(SHORTEST_S, self._lost_s)

    def seconds(self, step: Step | None) -> float:
        """Return how long to wait for the answer to a step; None stands for a request of our own."""
        if step is None or step.expected:
            return self._timeout_s
        if step.lost:
            return self._lost_s
        return min(step.gap_ns / 1e9 if step.gap_ns is not None else SILENCE_S, self._timeout_s)

    def came(self, step: Step | None) -> None:
        """An answer came, in time or not."""
        if step is not None and step.lost:
            self._lost_s = self._timeout_s

    def missed(self, step: Step | None) -> None:
        """No answer came in time."""
        if step is not None and step.lost:
            self._lost_s = max(self._lost_s / 2, self._least_s)
