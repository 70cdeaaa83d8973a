"""Live runs: packets from a live source go through the pipeline, and produce events for display.

`run.LiveRun` reads packets, advances the clock and reports lost packets. `session.Session` runs it in a thread of its own and
keeps events in a bounded queue, from which the plain lines of `s7dissect monitor` and its screens take them. `iterating.live`
gives events to a program; the module itself is called as that function.
"""

from __future__ import annotations

import sys
from types import ModuleType
from typing import Any


class _Room(ModuleType):
    """The room, called as the function that it is known by: ``dissect.live("eth0")``."""

    def __call__(self, *given: Any, **named: Any) -> Any:
        """Return the events of an interface (`dissect.online.live.iterating.live`)."""
        from dissect.online.live.iterating import live

        return live(*given, **named)


sys.modules[__name__].__class__ = _Room
