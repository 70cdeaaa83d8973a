"""Which findings are made in full: as many as a person can read, and the first of each pair of hosts and of each connection.

What may flood is one rule between two hosts. So the bound is theirs, and hides nothing of a different pair: the first finding
of a rule between two hosts, or on a connection, is always reported. The others are counted, and their number is reported once a
minute of the capture's time (`Bounds.remind`).

Memory is bounded: of very many pairs those that are silent for longest are forgotten. The next finding of one is a first one
again.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.text import count

#: This many findings of a rule are kept for two hosts, and in all; beyond those, one for each connection or pair of hosts.
MAX_DETAILED: Final = 100
MAX_DETAILED_ALL: Final = 1000
#: This many pairs of hosts have one that is kept.
MAX_FIRST: Final = 10_000
#: Rules on pairs of hosts that are remembered. Half of them, those with a finding least long ago, are never forgotten.
MAX_PLACES: Final = 16_384
#: How often the number of omitted ones is reported.
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


class _Kept:
    """How many findings of a rule are kept, and for how many pairs of hosts beyond `MAX_DETAILED_ALL` one is."""

    __slots__ = ("findings", "pairs")

    def __init__(self) -> None:
        self.findings: i64 = 0
        self.pairs: i64 = 0


class Bounds:
    """Decides which findings are reported and kept, and remembers how many were counted only."""

    def __init__(self) -> None:
        # Those with a finding since the last time that there were too many, and those with one in the time before that: to
        # keep all in the order of their latest findings would cost more than all else here.
        self._places: dict[tuple[str, str, str], _Place] = {}
        self._older: dict[tuple[str, str, str], _Place] = {}
        self._latest: _Place = _Place("", "", "")  # of the finding that was taken last
        self._kept: dict[str, _Kept] = {}  # by slug
        self._told: dict[int, list[str]] = {}  # by connection: the rules that made a finding of it, mostly one or two
        self._left: list[_Place] = []  # those with something to remind of
        self._due_ns: i64 = 0

    def take(self, slug: str, client: str, server: str, connection: i64) -> i64:
        """Return what happens to a finding of a rule: `KEPT`, `TOLD` or `COUNTED`."""
        key = (slug, client, server)
        place = self._places.get(key)
        first: bool = False
        if place is None:
            place = self._older.get(key) if self._older else None
            if place is None:
                first = True
                place = _Place(slug, client, server)
            self._remember(key, place)
        self._latest = place
        fresh: bool = connection > 0 and self._is_fresh(slug, connection)
        kept = self._kept.get(slug)
        if kept is None:
            kept = self._kept[slug] = _Kept()
        if (place.kept < MAX_DETAILED or fresh) and kept.findings < MAX_DETAILED_ALL:
            kept.findings += 1
        elif first and kept.pairs < MAX_FIRST:
            kept.pairs += 1
        else:
            return TOLD if first or fresh else COUNTED
        place.kept += 1
        return KEPT

    def _remember(self, key: tuple[str, str, str], place: _Place) -> None:
        if len(self._places) >= MAX_PLACES // 2:
            self._older = self._places
            self._places = {}
        self._places[key] = place

    def _is_fresh(self, slug: str, connection: i64) -> bool:
        """Return whether a rule made no finding of a connection so far; remember that it does."""
        told = self._told.get(connection)
        if told is None:
            self._told[connection] = [slug]
            return True
        if slug in told:
            return False
        told.append(slug)
        return True

    def leave(self, frame: i64, time_ns: i64) -> None:
        """Remember the finding that was taken last as one that is only counted."""
        place = self._latest
        if place.left == 0:
            self._left.append(place)
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
        left, self._left = self._left, []
        by_slug: dict[str, list[_Place]] = {}
        for place in left:
            by_slug.setdefault(place.slug, []).append(place)
        return [_reminder(slug, places) for slug, places in by_slug.items()]

    def over(self, connection: i64) -> None:
        """A connection is over."""
        if connection in self._told:
            del self._told[connection]

    def renew(self) -> None:
        """Start again, but keep what is not reported yet."""
        self._places = {(place.slug, place.client, place.server): place for place in self._left}
        self._older = {}
        for place in self._left:
            place.kept = 0
        self._kept = {}
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
