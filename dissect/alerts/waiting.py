"""Alerts that wait, by weight: errors before warnings before notes, the oldest of a weight first, and never more than fit."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Generic, TypeVar

from dissect.alerts.actions import DeliveryError
from dissect.findings.catalogue import SEVERITIES
from dissect.wire.text import printable

#: Seconds between two complaints of the same kind about the same action.
COMPLAIN_S: Final = 60.0

#: Severity -> rank, 0 the heaviest.
RANKS: Final = {severity: rank for rank, severity in enumerate(SEVERITIES)}

Item = TypeVar("Item")


class Waiting(Generic[Item]):
    """A queue of ``most`` items in ranks from 0, the heaviest. Not for several threads at once."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._by_rank: tuple[deque[Item], ...] = tuple([deque() for _ in SEVERITIES])

    def __len__(self) -> int:
        return sum([len(items) for items in self._by_rank])

    def put(self, rank: int, item: Item) -> Item | None:
        """Queue an item; return the one that has to go where there is no room: the oldest of the lightest, perhaps this one."""
        self._by_rank[rank].append(item)
        return self.lightest() if len(self) > self.most else None

    def put_back(self, rank: int, item: Item) -> None:
        """Queue an item that was taken, before all others of its rank."""
        self._by_rank[rank].appendleft(item)

    def heaviest(self) -> Item | None:
        """Take the oldest of the heaviest; None when nothing waits."""
        return next((items.popleft() for items in self._by_rank if items), None)

    def lightest(self) -> Item | None:
        """Take the oldest of the lightest; None when nothing waits."""
        return next((items.popleft() for items in reversed(self._by_rank) if items), None)

    def clear(self) -> int:
        """Drop all; return how many there were."""
        count = len(self)
        for items in self._by_rank:
            items.clear()
        return count


class Complaints:
    """What there is to say about the deliveries of one action: of each kind at once, and then once a minute with a count."""

    def __init__(self, action: str, tell: Callable[[str], None], clock: Callable[[], float]) -> None:
        self._action = printable(action)
        self._tell = tell
        self._clock = clock
        self._lock = threading.Lock()
        self._told: dict[str, float] = {}
        self._untold: dict[str, int] = {}

    def about(self, kind: str, trouble: str) -> None:
        """Say ``trouble``, or count it when something of its kind was said a moment ago."""
        with self._lock:
            now = self._clock()
            before = self._told.get(kind)
            if before is not None and now - before < COMPLAIN_S:
                self._untold[kind] = self._untold.get(kind, 0) + 1
                return
            self._told[kind] = now
            count = self._untold.pop(kind, 0)
        self.say(f"{trouble} (and {count} more times since the last report)" if count else trouble)

    def say(self, text: str) -> None:
        """Say something at once."""
        with suppress(DeliveryError, OSError, ValueError):  # no one is there to hear that no one hears
            self._tell(f"alerts: action {self._action}: {printable(text)}")
