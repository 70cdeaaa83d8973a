"""The data of the page, plots and tables of one session, as values for JSON.

Times are seconds after the start of the session, which JavaScript can hold exactly; durations are nanoseconds.
"""

from __future__ import annotations

import time
from typing import Any, Final

from dissect.meaning.report.happened import by_gravity
from dissect.meaning.report.operations import NAMES as KINDS
from dissect.output.page.bins import WIDTHS, cells_of, lower_end
from dissect.output.page.cards import cards
from dissect.output.page.gaps import Gap
from dissect.output.page.gathered import BANDS, Gathered, Span
from dissect.output.page.ordered import Ordered
from dissect.output.page.rows import OUTCOME_NAMES, Station, selecting, station_of
from dissect.output.page.tables import Tables
from dissect.output.page.tag_steps import TagSteps
from dissect.wire.text import printable, shortened

#: Bins of time in a plot.
_BINS: Final = 480
#: Bins of time on the card of a PLC.
_CARD_BINS: Final = 60
#: Greatest number of rows in plots with a row for each thing.
_SPREADS: Final = 24
_POLLS: Final = 24
_LANES: Final = 24
#: Maximum number of hosts on each side of the table of who talks to whom, and of pairs of them.
_HOSTS: Final = 48
_PAIRS: Final = 600
_TAGS: Final = 12
#: Greatest number of marks for findings on the plot of rates.
_MARKS: Final = 400
_TEXT: Final = 160
_DAY: Final = 86_400
#: Greatest number of changes of the time zone.
_ZONES: Final = 100


class Data:
    """The data of one session, made from `Gathered`."""

    def __init__(self, gathered: Gathered, name: str) -> None:
        self._of = gathered
        self._ordered = Ordered(gathered)
        self._name = name
        self._start = gathered.start_ns
        self._end = max(gathered.end_ns, gathered.start_ns + 1)
        gathered.rates.settle(self._start, self._end, _BINS)
        gathered.answer_times.settle(self._start, self._end, _BINS // 2)

    def match(self, other: Data) -> None:
        """Make bins as wide as those of another session, so that the plots of both can be compared."""
        self._of.rates.widen(other._of.rates.width)
        self._of.answer_times.widen(other._of.answer_times.width)

    def as_dict(self) -> dict[str, Any]:
        """Return all data of the session."""
        of = self._of
        return {
            "name": self._name,
            "start_ms": self._start / 1e6,
            "zones": self._zones(),
            "command": of.rows.commands(),
            "span": self._seconds(self._end),
            "rates": self._rates(),
            "times": self._times(),
            "points": self._points(),
            "spreads": self._spreads(),
            "polls": self._polls(),
            "talks": self._talks(),
            "lanes": self._lanes(),
            "tags": self._tags(),
            "gaps": [self._gap(gap) for gap in [*of.gaps, *of.between_files()]],
            "gaps_not_drawn": of.gaps_not_drawn,
            "marks": self._marks(),
            "plcs": cards(self._ordered, self._seconds, self._width(_CARD_BINS)),
            "tables": Tables(self._ordered, self._start, self._end, _BINS).as_list(),
        }

    def _seconds(self, time_ns: int) -> float:
        return round((time_ns - self._start) / 1e9, 6)

    def _zones(self) -> list[list[Any]]:
        """Return how far the times are from UTC: (seconds after the start, seconds ahead of UTC, name), one for each change."""
        clock = self._of.rows.clock
        if not clock.local:
            return [[0, 0, clock.zone(self._start)]]
        found = [[0, time.localtime(self._start // 10**9).tm_gmtoff, clock.zone(self._start)]]
        at, end = self._start // 10**9, self._end // 10**9
        while at < end:
            later = min(at + _DAY, end)
            if time.localtime(later).tm_gmtoff != time.localtime(at).tm_gmtoff:
                low, high = at, later
                while high - low > 1:
                    middle = (low + high) // 2
                    same = time.localtime(middle).tm_gmtoff == time.localtime(at).tm_gmtoff
                    low, high = (middle, high) if same else (low, middle)
                ahead = time.localtime(high).tm_gmtoff
                found.append([self._seconds(high * 10**9), ahead, clock.zone(high * 10**9)])
            at = later
        return found[:_ZONES]

    def _width(self, most: int) -> int:
        """Return the width of bins in nanoseconds, so that at most ``most`` bins cover the session."""
        return next((width for width in WIDTHS if (self._end - self._start) // width <= most), WIDTHS[-1])

    # ---- plots ------------------------------------------------------------------------------------------------------

    def _rates(self) -> dict[str, Any]:
        bins = self._of.rates
        rows = [
            [self._seconds(number * bins.width), *[row.get(column, 0) for column in range(len(OUTCOME_NAMES))]]
            for number, row in sorted(bins.rows.items())
        ]
        return {"width": bins.width / 1e9, "names": OUTCOME_NAMES, "bins": rows}

    def _times(self) -> dict[str, Any]:
        """Return answer times over time: `cells_of` their bins."""
        return cells_of(self._of.answer_times, 32 // BANDS, self._seconds)

    def _points(self) -> list[list[Any]]:
        """Return slow answers, the slowest first: (seconds, nanoseconds, key of the row, description).

        The page draws as many of them as are slow among the answers that it shows.
        """
        return [
            [self._seconds(row["cells"][1]), row["cells"][4], row["key"], f"#{row['cells'][0]} {row['cells'][5]}"]
            for row in self._of.slowest()
        ]

    def _spreads(self) -> dict[str, Any]:
        answered = [entry for entry in self._of.spreads.items() if entry[1].times.count]
        found = sorted(answered, key=lambda entry: (-entry[1].times.count, entry[0]))
        rows = []
        keys = {name: f"f{number}" for number, (name, _) in enumerate(self._ordered.functions, 1)}
        for (host, function), spread in found[:_SPREADS]:
            times = spread.times
            bands: dict[int, int] = {}
            for number, count in times.buckets.items():
                bands[number // 8] = bands.get(number // 8, 0) + count
            rows.append(
                {
                    "key": keys[host, function],
                    "host": self._of.rows.station(host),
                    "function": function,
                    "count": times.count,
                    "errors": spread.errors,
                    "missed": spread.missed,
                    "min": max(0, times.smallest),
                    "median": max(0, spread.latencies.quantile(0.5) or 0),
                    "p95": max(0, spread.latencies.quantile(0.95) or 0),
                    "max": max(0, times.largest),
                    "bands": [
                        [max(lower_end(band * 8), times.smallest), min(lower_end(band * 8 + 8), times.largest), count]
                        for band, count in sorted(bands.items())
                    ],
                }
            )
        return {"rows": rows, "total": len(found), "not_told_apart": self._of.spreads_not_told_apart}

    def _polls(self) -> dict[str, Any]:
        found = self._ordered.polls
        rows = [
            {
                "host": self._of.rows.station(station_of(known.connection)),
                "key": f"p{number}",
                "subject": shortened(known.subject, _TEXT),
                "count": known.count,
                "p5": known.periods.quantile(0.05),
                "median": known.periods.quantile(0.5),
                "p95": known.periods.quantile(0.95),
                "min": known.periods.smallest,
                "max": known.periods.largest,
                "jitter": known.periods.deviation,
            }
            for number, known in enumerate(found[:_POLLS], 1)
        ]
        return {"rows": rows, "total": len(found), "not_followed": self._of.requests.not_followed}

    def _talks(self) -> dict[str, Any]:
        pairs = sorted(self._of.talks.pairs.items(), key=lambda entry: (-entry[1].octets, entry[0]))
        shown: list[dict[str, Any]] = []
        clients: set[Station] = set()
        servers: set[Station] = set()
        listed = self._of.listed_pairs
        for (client, server, vlan), pair in pairs:
            if len(clients | {(client, vlan)}) > _HOSTS or len(servers | {(server, vlan)}) > _HOSTS:
                continue
            if len(shown) == _PAIRS:
                break
            clients.add((client, vlan))
            servers.add((server, vlan))
            shown.append(
                {
                    "client": self._of.rows.station((client, vlan)),
                    "server": self._of.rows.station((server, vlan)),
                    "search": self._of.rows.searched(client, server, vlan),
                    "connections": pair.connections,
                    "pdus": pair.pdus,
                    "octets": pair.octets,
                    "errors": pair.errors,
                    "missed": pair.missed,
                    "worst": pair.worst,
                }
            )
            if (client, server, vlan) not in listed:  # the link would lead nowhere
                where = f"{selecting('client', (client, vlan))} and server == {server}"
                shown[-1] |= self._of.rows.how(f"transactions -Y '{where}'")
        return {"pairs": shown, "total": len(pairs), "not_told_apart": self._of.talks.not_told_apart}

    def _lanes(self) -> dict[str, Any]:
        """Return operations and operating modes, a lane for each PLC."""
        of = self._of
        spans = of.spans
        hosts = dict.fromkeys([mode.host for mode in of.modes] + [span.host for span in spans])
        lanes = [self._lane(host, spans) for host in list(hosts)[:_LANES]]
        return {
            "lanes": lanes,
            "total": len(hosts),
            "not_drawn": of.operations.total - len(of.operations) + of.modes_not_drawn,
        }

    def _lane(self, host: Station, spans: list[Span]) -> dict[str, Any]:
        of = self._of
        return {
            "host": of.rows.station(host),
            "spans": [
                [
                    self._seconds(span.begin_ns),
                    self._seconds(span.end_ns),
                    span.kind,
                    f"o{span.number}",
                    f"{KINDS[span.kind]}, {span.result.replace('_', ' ')}",
                ]
                for span in spans
                if span.host == host
            ],
            "modes": [
                [self._seconds(mode.time_ns), printable(mode.text), of.rows.places.number(mode.frame)]
                for mode in of.modes
                if mode.host == host
            ],
        }

    def _tags(self) -> dict[str, Any]:
        found = sorted(self._of.tags.found.items())
        return {
            "series": [self._tag(name, host, steps) for (name, host), steps in found[:_TAGS] if steps.values],
            "missing": [printable(name) for name in self._of.tags.missing()],
            "not_numbers": [printable(name) for (name, _), steps in found if steps.not_a_number],
            "refused": [printable(name) for name in self._of.tags.refused()],
            "likely": self._of.tags.left_out(),
            "total": len(found),
        }

    def _tag(self, name: str, host: Station, steps: TagSteps) -> dict[str, Any]:
        rows = self._of.rows
        return {
            "name": printable(name),
            "host": rows.station(host),
            "unit": printable(steps.unit),
            "width": steps.width_ns / 1e9,
            "end": self._seconds(steps.last_ns),
            "values": steps.values,
            "steps": [
                [self._seconds(step.time_ns), step.first, step.smallest, step.largest, step.last, int(step.broken)]
                for step in steps.steps
            ],
            "writes": [
                [self._seconds(write.time_ns), write.value, rows.host(write.writer), rows.places.number(write.frame)]
                for write in steps.writes
            ],
            "writes_not_kept": steps.writes_not_kept,
            "gaps": [
                self._gap(gap) for gap in self._of.gaps if not gap.connection or gap.connection in steps.connections
            ],
        }

    def _gap(self, gap: Gap) -> list[Any]:
        where = f"connection {gap.connection}: " if gap.connection else ""
        return [self._seconds(gap.begin_ns), self._seconds(gap.end_ns), f"{where}{gap.why}", int(gap.idle)]

    def _marks(self) -> dict[str, Any]:
        """Return the times of findings: (seconds, severity, slug, detail).

        If there are too many, one of each severity is kept for each interval, so that no interval with findings looks empty.
        """
        rules = by_gravity(self._of.analysis.finding_counts, self._of.analysis.ledger)
        order = {rule.slug: number for number, rule in enumerate(rules)}
        found = sorted(self._of.analysis.findings, key=lambda finding: (order[finding.slug], int(finding.time_ns)))
        for stretches in (_MARKS, _MARKS // 2, _MARKS // 4):
            if len(found) <= _MARKS:
                break
            kept: dict[tuple[str, int], Any] = {}
            for one in found:
                stretch = (int(one.time_ns) - self._start) * stretches // (self._end - self._start + 1)
                kept.setdefault((one.severity, stretch), one)
            found = list(kept.values())
        named = self._of.rows.places.named
        marks = [
            [
                self._seconds(int(one.time_ns)),
                one.severity,
                one.slug,
                shortened(named(one.detail) or one.rule.sentence, _TEXT),
            ]
            for one in found
        ]
        return {
            "marks": sorted(marks, key=lambda mark: mark[0]),
            "total": sum(self._of.analysis.finding_counts.values()),
        }
