"""`Waiting`: a bounded queue by severity, in which the oldest of the most severe come first. `Complaints`: limited messages."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from contextlib import suppress
from typing import Final, Generic, TypeVar

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.online.alerts.actions import DeliveryError
from dissect.wire.text import printable

#: Seconds between two messages of the same kind on the same action.
COMPLAIN_S: Final = 60.0

#: The rank of each severity; 0 is the most severe.
RANKS: Final = {severity: rank for rank, severity in enumerate(SEVERITIES)}

Item = TypeVar("Item")


class Waiting(Generic[Item]):
    """A queue of at most ``most`` items with ranks from 0, the most severe. It is not thread-safe."""

    def __init__(self, most: int) -> None:
        self.most = most
        self._by_rank: tuple[deque[Item], ...] = tuple([deque() for _ in SEVERITIES])

    def __len__(self) -> int:
        return sum([len(items) for items in self._by_rank])

    def put(self, rank: int, item: Item) -> Item | None:
        """Queue an item. If there is no room, drop and return the oldest of the least severe, which may be this one."""
        self._by_rank[rank].append(item)
        return self.lightest() if len(self) > self.most else None

    def put_back(self, rank: int, item: Item) -> None:
        """Queue an item that was taken, before all others of its rank."""
        self._by_rank[rank].appendleft(item)

    def heaviest(self) -> Item | None:
        """Take the oldest of the most severe items; None if the queue is empty."""
        return next((items.popleft() for items in self._by_rank if items), None)

    def lightest(self) -> Item | None:
        """Take the oldest of the least severe items; None if the queue is empty."""
        return next((items.popleft() for items in reversed(self._by_rank) if items), None)

    def clear(self) -> int:
        """Drop all items; return how many there were."""
        count = len(self)
        for items in self._by_rank:
            items.clear()
        return count


class Complaints:
    """Messages on the deliveries of one action: the first of each kind at once, then one a minute with a count."""

    def __init__(self, action: str, tell: Callable[[str], None], clock: Callable[[], float]) -> None:
        self._action = printable(action)
        self._tell = tell
        self._clock = clock
        self._lock = threading.Lock()
        self._told: dict[str, float] = {}
        self._untold: dict[str, int] = {}

    def about(self, kind: str, trouble: str) -> None:
        """Report ``trouble``, or only count it if something of its kind was reported less than `COMPLAIN_S` ago."""
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
        """Report ``text`` at once."""
        with suppress(DeliveryError, OSError, ValueError):  # an error in reporting cannot be reported either
            self._tell(f"alerts: action {self._action}: {printable(text)}")
