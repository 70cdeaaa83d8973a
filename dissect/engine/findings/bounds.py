"""Which findings are reported in detail: as many as a person can read, and the first of each connection and pair of hosts.

A flood is usually one rule between two hosts. So the limit applies per rule and pair of hosts: the first finding of a rule
between two hosts, or on a connection, is always reported, whatever others there are. The others are only counted; their number
is reported once a minute of capture time (`Bounds.remind`).

Memory is bounded: if there are very many pairs, those without a finding for the longest time are forgotten. The next finding of
a forgotten pair counts as a first one again.
"""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.wire.text import count

#: This many findings of a rule are kept per pair of hosts, and in all; beyond that one for each connection or pair of hosts.
MAX_DETAILED: Final = 100
MAX_DETAILED_ALL: Final = 1000
#: For at most this many pairs of hosts one finding is kept.
MAX_FIRST: Final = 10_000
#: Maximum number of rules on pairs of hosts that are remembered. The half of them with the latest findings is never forgotten.
MAX_PLACES: Final = 16_384
#: The number of omitted findings is reported this often.
REMIND_NS: Final = 60_000_000_000

#: What happens to a finding: it is only counted; or it is reported; or it is reported, and kept for the final report.
COUNTED: Final = 0
TOLD: Final = 1
KEPT: Final = 2

#: Maximum number of pairs of hosts that a reminder names.
_NAMED: Final = 3


class _Place:
    """A rule between two hosts: how many of its findings are kept, and how many were only counted since the last reminder."""

    __slots__ = ("client", "frame", "kept", "left", "server", "slug", "time_ns")

    def __init__(self, slug: str, client: str, server: str) -> None:
        self.slug: str = slug
        self.client: str = client
        self.server: str = server
        self.kept: i64 = 0
        self.left: i64 = 0
        self.frame: i64 = 0  # packet of the latest one that was only counted
        self.time_ns: i64 = 0


class Reminder:
    """How many findings of a rule were only counted (``repeated``), as text (``detail``), with packet and time of the latest.

    ``client`` and ``server`` are the hosts if all were between the same two, else empty.
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
    """How many findings of a rule are kept, and for how many pairs of hosts one is kept beyond `MAX_DETAILED_ALL`."""

    __slots__ = ("findings", "pairs")

    def __init__(self) -> None:
        self.findings: i64 = 0
        self.pairs: i64 = 0


class Bounds:
    """Decides which findings are reported and kept, and remembers how many were counted only."""

    def __init__(self) -> None:
        # Two generations: places with a finding since the last change of generation, and places with one in the generation
        # before it. Keeping all places in the order of their latest findings would cost more than everything else here.
        self._places: dict[tuple[str, str, str], _Place] = {}
        self._older: dict[tuple[str, str, str], _Place] = {}
        self._latest: _Place = _Place("", "", "")  # the place of the latest finding
        self._kept: dict[str, _Kept] = {}  # by slug
        # by connection: the rules that already made a finding of it, mostly one or two
        self._told: dict[int, list[str]] = {}
        self._left: list[_Place] = []  # places with findings that the next reminder has to mention
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
        """Return whether this is the first finding of a rule on a connection, and remember it."""
        told = self._told.get(connection)
        if told is None:
            self._told[connection] = [slug]
            return True
        if slug in told:
            return False
        told.append(slug)
        return True

    def leave(self, frame: i64, time_ns: i64) -> None:
        """Remember that the latest finding is one that is only counted."""
        place = self._latest
        if place.left == 0:
            self._left.append(place)
        place.left += 1
        place.frame = frame
        place.time_ns = time_ns
        if self._due_ns == 0:
            self._due_ns = time_ns + REMIND_NS

    def due(self, now_ns: i64) -> bool:
        """Return whether a reminder is due; also True when the clock was set back."""
        return self._due_ns != 0 and not -2 * REMIND_NS <= now_ns - self._due_ns < 0

    def remind(self) -> list[Reminder]:
        """Return how many findings of each rule were only counted since the last reminder."""
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
        """Start again, but keep the numbers that are not reported yet."""
        self._places = {(place.slug, place.client, place.server): place for place in self._left}
        self._older = {}
        for place in self._left:
            place.kept = 0
        self._kept = {}
        self._told = {}


def _reminder(slug: str, places: list[_Place]) -> Reminder:
    """Sum up a rule; the pairs of hosts with most findings come first."""
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
