"""Which findings are made in full: as many as a person can read, and the first of each pair of hosts and of each connection.

What may flood is one rule between two hosts. So the bound is theirs, and what another pair does is not hidden behind it: the
first finding of a rule between two hosts, or on a connection, is always reported. The others are counted, and their number is
reported once a minute of the capture's time (`Bounds.remind`).

Memory is bounded: of very many pairs the one that is silent for longest is forgotten. Its next finding is a first one again.
"""

from __future__ import annotations

from collections import OrderedDict
from typing import Final

from mypy_extensions import i64

from dissect.wire.text import count

#: So many findings of a rule are kept for two hosts, and in all; beyond those, one for each connection or pair of hosts.
MAX_DETAILED: Final = 100
MAX_DETAILED_ALL: Final = 1000
#: So many pairs of hosts have one that is kept.
MAX_FIRST: Final = 10_000
#: Rules on pairs of hosts that are remembered.
MAX_PLACES: Final = 16_384
#: How often it is said how many were not made.
REMIND_NS: Final = 60_000_000_000

#: What happens to a finding: it is counted only; it is reported; it is reported, and kept for the final report.
COUNTED: Final = 0
TOLD: Final = 1
KEPT: Final = 2

#: Pairs of hosts that a reminder names.
_NAMED: Final = 3


class _Place:
    """A rule between two hosts: how many of its findings are kept, and how many were not made since the last reminder."""

    __slots__ = ("client", "frame", "kept", "left", "server", "slug", "time_ns")

    def __init__(self, slug: str, client: str, server: str) -> None:
        self.slug: str = slug
        self.client: str = client
        self.server: str = server
        self.kept: i64 = 0
        self.left: i64 = 0
        self.frame: i64 = 0  # of the latest that was not made
        self.time_ns: i64 = 0


class Reminder:
    """How many findings of a rule were not made: ``repeated``, in words ``detail``; the packet and time of the latest.

    ``client`` and ``server`` are the hosts where there are no others, else empty.
    """

    __slots__ = ("client", "detail", "frame", "repeated", "server", "slug", "time_ns")

    def __init__(self, slug: str) -> None:
        self.slug: str = slug
        self.repeated: i64 = 0
        self.detail: str = ""
        self.client: str = ""
        self.server: str = ""
        self.frame: i64 = 0
        self.time_ns: i64 = 0


class Bounds:
    """Decides which findings are reported and kept, and remembers how many were counted only."""

    def __init__(self) -> None:
        self._places: OrderedDict[tuple[str, str, str], _Place] = OrderedDict()
        self._kept: dict[str, int] = {}  # by slug
        self._first: dict[str, int] = {}  # by slug: pairs of hosts
        self._told: dict[int, set[str]] = {}  # by connection: rules that made a finding of it
        self._left: dict[tuple[str, str, str], _Place] = {}  # those with something to remind of
        self._due_ns: i64 = 0

    def take(self, slug: str, client: str, server: str, connection: i64) -> i64:
        """Return what happens to a finding of a rule: `KEPT`, `TOLD` or `COUNTED`."""
        key = (slug, client, server)
        place = self._places.get(key)
        first: bool = place is None
        if place is None:
            place = self._places[key] = _Place(slug, client, server)
            if len(self._places) > MAX_PLACES:
                self._places.popitem(last=False)
        else:
            self._places.move_to_end(key)
        fresh: bool = connection > 0 and self._is_fresh(slug, connection)
        kept: int = self._kept.get(slug, 0)
        if (place.kept < MAX_DETAILED or fresh) and kept < MAX_DETAILED_ALL:
            self._kept[slug] = kept + 1
        elif first and self._first.get(slug, 0) < MAX_FIRST:
            self._first[slug] = self._first.get(slug, 0) + 1
        else:
            return TOLD if first or fresh else COUNTED
        place.kept += 1
        return KEPT

    def _is_fresh(self, slug: str, connection: i64) -> bool:
        """Return whether a rule made no finding of a connection so far; remember that it does."""
        told = self._told.get(connection)
        if told is None:
            self._told[connection] = {slug}
            return True
        if slug in told:
            return False
        told.add(slug)
        return True

    def leave(self, slug: str, client: str, server: str, frame: i64, time_ns: i64) -> None:
        """Remember a finding that is only counted."""
        key = (slug, client, server)
        place = self._left.get(key)
        if place is None:
            place = self._left[key] = self._places[key]
        place.left += 1
        place.frame = frame
        place.time_ns = time_ns
        if self._due_ns == 0:
            self._due_ns = time_ns + REMIND_NS

    def due(self, now_ns: i64) -> bool:
        """Return whether it is time to say how many were only counted; also where the clock was set back."""
        return self._due_ns != 0 and not -2 * REMIND_NS <= now_ns - self._due_ns < 0

    def remind(self) -> list[Reminder]:
        """Return how many findings of each rule were only counted since the last time."""
        self._due_ns = 0
        left, self._left = self._left, {}
        by_slug: dict[str, list[_Place]] = {}
        for place in left.values():
            by_slug.setdefault(place.slug, []).append(place)
        return [_reminder(slug, places) for slug, places in by_slug.items()]

    def over(self, connection: i64) -> None:
        """A connection is over."""
        if self._told:
            self._told.pop(connection, None)

    def renew(self) -> None:
        """Begin anew, but for what is not said yet."""
        self._places = OrderedDict(self._left)
        for place in self._places.values():
            place.kept = 0
        self._kept = {}
        self._first = {}
        self._told = {}


def _reminder(slug: str, places: list[_Place]) -> Reminder:
    """Sum up a rule, the pairs of hosts with most of it first."""
    made = Reminder(slug)
    by_number: list[tuple[int, str, str]] = []
    for place in places:
        made.repeated += place.left
        if place.time_ns >= made.time_ns:
            made.time_ns = place.time_ns
            made.frame = place.frame
        by_number.append((-int(place.left), place.client, place.server))
        place.left = 0
    made.detail = f"{made.repeated} more"
    if len(places) == 1:
        made.client, made.server = places[0].client, places[0].server
        if made.client:
            made.detail += f", between {made.client} and {made.server}"
        return made
    by_number.sort()
    named = [f"{client} and {server} ({-number})" for number, client, server in by_number[:_NAMED]]
    if len(by_number) > _NAMED:
        named.append(f"{count(len(by_number) - _NAMED, 'further pair')} of hosts")
    made.detail += f", between {', '.join(named)}"
    return made
