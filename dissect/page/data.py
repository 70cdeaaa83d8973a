"""The data of the page, plots and tables of one session, as values for JSON.

Times are seconds after the start of the session, which JavaScript can hold exactly; durations are nanoseconds.
"""

from __future__ import annotations

import time
from shlex import quote
from typing import Any, Final

from dissect.findings.catalogue import CATALOGUE
from dissect.inventory.rows import device_row
from dissect.page.bins import lower_end
from dissect.page.gathered import BANDS, Gap, Gathered, SpreadOf
from dissect.page.numbers import how_often
from dissect.page.rows import OUTCOME_NAMES, Station, host_filter, selecting, station_of
from dissect.page.tag_steps import TagSteps
from dissect.page.verdict import by_weight
from dissect.report import words
from dissect.report.happened import facts_of, times_of
from dissect.report.operations import NAMES as KINDS
from dissect.select.getters import function_names
from dissect.wire.text import cut_inside, printable, shortened

#: Bins of time in a plot.
_BINS: Final = 480
#: The slowest answers are drawn as points: one in `_ONE_IN` of all answers, but at least `_LEAST_POINTS`.
_ONE_IN: Final = 20
_LEAST_POINTS: Final = 5
#: Greatest number of rows in plots with a row for each thing.
_SPREADS: Final = 24
_POLLS: Final = 24
_HOSTS: Final = 24
_TAGS: Final = 12
#: Greatest number of rows in tables.
_VARIABLES: Final = 1000
_REQUESTS: Final = 500
#: Columns of the table of devices, by key of a row of `dissect.inventory.rows`.
_DEVICE_TEXTS: Final = {
    "role": "role",
    "order_number": "order number",
    "firmware": "firmware",
    "station_name": "station name",
    "module_name": "module name",
    "operating_mode": "operating mode",
    "vendor": "vendor",
    "asks": "sends requests to",
}
#: Beginnings of the names of functions that Wireshark does not decode: a filter for `s7comm` would hide them.
_NOT_READ: Final = ("S7comm-plus ", "SCD ")
#: Greatest number of marks for findings on the plot of rates.
_MARKS: Final = 400
_TEXT: Final = 160

#: Kinds of cells, which decide how a cell is shown and sorted.
TEXT, SHORT, NUMBER, SECONDS, DURATION, SIZE = "text", "short", "number", "seconds", "duration", "size"
#: A number that is mostly 0: a column with only zeros is left out.
RARE: Final = "rare"
#: The number of a connection, transaction or operation, shown without thousands separators.
ID: Final = "id"


class Data:
    """The data of one session, made from `Gathered`."""

    def __init__(self, gathered: Gathered, name: str) -> None:
        self._of = gathered
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
        local = of.rows.clock.local
        return {
            "name": self._name,
            "start_ms": self._start / 1e6,
            "offset_s": time.localtime(self._start // 10**9).tm_gmtoff if local else 0,
            "zone": of.rows.clock.zone(self._start),
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
            "tables": self._tables(),
        }

    def _seconds(self, time_ns: int) -> float:
        return round((time_ns - self._start) / 1e9, 6)

    # ---- plots ------------------------------------------------------------------------------------------------------

    def _rates(self) -> dict[str, Any]:
        bins = self._of.rates
        rows = [
            [self._seconds(number * bins.width), *[row.get(column, 0) for column in range(len(OUTCOME_NAMES))]]
            for number, row in sorted(bins.rows.items())
        ]
        return {"width": bins.width / 1e9, "names": OUTCOME_NAMES, "bins": rows}

    def _times(self) -> dict[str, Any]:
        """Return answer times over time: cells of (seconds, lower and upper end in nanoseconds, count)."""
        bins = self._of.answer_times
        step = 32 // BANDS
        cells = [
            [self._seconds(number * bins.width), lower_end(band * step), lower_end((band + 1) * step), count]
            for number, row in sorted(bins.rows.items())
            for band, count in sorted(row.items())
        ]
        return {"width": bins.width / 1e9, "cells": cells}

    def _points(self) -> list[list[Any]]:
        """Return the slowest answers one by one: (seconds, nanoseconds, key of the row, description)."""
        return [
            [self._seconds(row["cells"][1]), row["cells"][4], row["key"], f"#{row['cells'][0]} {row['cells'][5]}"]
            for row in self._of.slowest()[: max(_LEAST_POINTS, self._timed() // _ONE_IN)]
        ]

    def _timed(self) -> int:
        """Return how many answers have an answer time: all but those of pairs that are only likely."""
        return int(self._of.analysis.answered) - sum(self._of.analysis.likely.values())

    def _spreads(self) -> dict[str, Any]:
        answered = [entry for entry in self._of.spreads.items() if entry[1].times.count]
        found = sorted(answered, key=lambda entry: (-entry[1].times.count, entry[0]))
        rows = []
        keys = {name: f"f{number}" for number, (name, _) in enumerate(self._all_functions(), 1)}
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
        found = self._of.requests.polls()
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
        for (client, server, vlan), pair in pairs:
            if len(clients | {(client, vlan)}) > _HOSTS or len(servers | {(server, vlan)}) > _HOSTS:
                continue
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
        return {"pairs": shown, "total": len(pairs), "not_told_apart": self._of.talks.not_told_apart}

    def _lanes(self) -> dict[str, Any]:
        """Return operations and operating modes, a lane for each PLC."""
        of = self._of
        hosts = dict.fromkeys([mode.host for mode in of.modes] + [span.host for span in of.spans])
        lanes = [self._lane(host) for host in list(hosts)[:_HOSTS]]
        return {"lanes": lanes, "total": len(hosts), "not_drawn": of.operations_not_listed + of.modes_not_drawn}

    def _lane(self, host: Station) -> dict[str, Any]:
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
                for span in of.spans
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
                [self._seconds(gap.begin_ns), self._seconds(gap.end_ns)]
                for gap in self._of.gaps
                if not gap.connection or gap.connection in steps.connections
            ],
        }

    def _gap(self, gap: Gap) -> list[Any]:
        where = f"connection {gap.connection}: " if gap.connection else ""
        return [self._seconds(gap.begin_ns), self._seconds(gap.end_ns), f"{where}{gap.why}"]

    def _marks(self) -> dict[str, Any]:
        """Return the times of findings: (seconds, severity, slug, detail).

        If there are too many, one of each severity is kept for each interval, so that no interval with findings looks empty.
        """
        rules = by_weight(self._of.analysis)
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

    # ---- tables -----------------------------------------------------------------------------------------------------

    def _tables(self) -> list[dict[str, Any]]:
        of = self._of
        transactions = [
            ("number", ID), ("time", SECONDS), ("packets", TEXT if of.rows.places.several else SHORT), ("from → to", TEXT),
            ("answer", DURATION), ("function", TEXT), ("what", TEXT),
        ]  # fmt: skip
        listed = len(of.connections)
        return [
            self._table("failed", "Failed transactions", transactions, of.failed, of.failed_in_all),
            self._table("slowest", "Slowest transactions", transactions, of.slowest(), self._timed()),
            self._table(
                "connections",
                "Connections",
                [
                    ("number", ID), ("time", SECONDS), ("client", SHORT), ("server", SHORT), ("protocol", TEXT),
                    ("TSAPs", TEXT),
                    ("PDUs", NUMBER), ("answered", NUMBER), ("with errors", NUMBER), ("no answer", NUMBER),
                    ("still open", RARE), ("bytes", SIZE), ("end", TEXT),
                ],
                of.connections,
                listed + int(of.analysis.connections_not_listed),
            ),
            self._table(
                "operations",
                "Operations",
                [
                    ("number", ID), ("time", SECONDS), ("took", DURATION), ("kind", TEXT), ("what", TEXT),
                    ("from → to", TEXT), ("bytes", SIZE), ("result", TEXT),
                ],
                of.operations,
                len(of.operations) + of.operations_not_listed,
            ),
            self._table(
                "blocks",
                "Downloaded and uploaded blocks",
                [
                    ("block", TEXT), ("name", TEXT), ("time", SECONDS), ("direction", TEXT), ("from → to", TEXT),
                    ("bytes", SIZE),
                    ("state", TEXT), ("language", TEXT), ("author", TEXT), ("version", TEXT), ("code changed", TEXT),
                ],
                of.blocks,
                of.blocks_in_all,
            ),
            self._devices(),
            self._functions(),
            self._requests(),
            self._variables(),
        ]  # fmt: skip

    def _table(
        self, name: str, title: str, columns: list[tuple[str, str]], rows: list[dict[str, Any]], total: int
    ) -> dict[str, Any]:
        """Return a table; times become seconds after the start. A column without values is left out."""
        times = [number for number, (_, kind) in enumerate(columns) if kind == SECONDS]
        made = []
        for row in rows:
            cells = list(row["cells"])
            for number in times:
                cells[number] = self._seconds(cells[number])
            made.append({**row, "cells": cells})
        empty = {
            number
            for number, (_, kind) in enumerate(columns)
            if kind in {TEXT, RARE} and made and not any([row["cells"][number] for row in made])
        }
        for row in made:
            row["cells"] = [cell for number, cell in enumerate(row["cells"]) if number not in empty]
        shown = [
            (title, NUMBER if kind == RARE else kind)
            for number, (title, kind) in enumerate(columns)
            if number not in empty
        ]
        return {"name": name, "title": title, "columns": shown, "rows": made, "total": max(total, len(rows))}

    def _devices(self) -> dict[str, Any]:
        inventory = self._of.inventory
        rows = []
        for number, device in enumerate(inventory.devices, 1):
            told = device_row(device, self._of.rows.places)
            told["asks"] = ", ".join([self._of.rows.host(talk.server) for talk in device.asks])
            said = [shortened(told[column], _TEXT) for column in _DEVICE_TEXTS]
            rows.append(
                {
                    "key": f"d{number}",
                    "cells": [
                        self._of.rows.station((device.address, device.vlan)), *said,
                        int(told["connections"]), int(told["transactions"]),
                        int(told["median_ns"]) if told["median_ns"] else None, device.first_ns,
                    ],
                    "show": self._of.rows.command(f"devices -Y '{selecting('host', (device.address, device.vlan))}'"),
                    "filter": host_filter(device.address),
                }
            )  # fmt: skip
        columns = [
            ("device", TEXT), *[(heading, TEXT) for heading in _DEVICE_TEXTS.values()], ("connections", NUMBER),
            ("transactions", NUMBER), ("median answer", DURATION), ("first seen", SECONDS),
        ]  # fmt: skip
        return self._table("devices", "Devices", columns, rows, len(rows) + inventory.devices_not_listed)

    def _s7comm(self, host: Station) -> str:
        """Return the Wireshark filter for what a machine says in S7comm; for all it says where Wireshark may not know that."""
        return host_filter(host[0]) if host in self._of.unusual else f"s7comm && {host_filter(host[0])}"

    def _all_functions(self) -> list[tuple[tuple[Station, str], SpreadOf]]:
        """Return the rows of the table of functions: PLC and function, the most frequent first."""
        return sorted(self._of.spreads.items(), key=lambda entry: (-entry[1].total, entry[0]))

    def _functions(self) -> dict[str, Any]:
        rows: list[dict[str, Any]] = []
        known = frozenset(function_names())  # names that -Y takes; other functions have only a number, or are SCD's
        for (host, function), spread in self._all_functions():
            times = spread.times
            where = selecting("answered_by", host) + (f' and function == "{function}"' if function in known else "")
            rows.append(
                {
                    "key": f"f{len(rows) + 1}",
                    "cells": [
                        self._of.rows.station(host), function, spread.total, times.count + spread.likely, spread.errors,
                        spread.missed, spread.still_open, spread.not_captured, spread.likely, spread.orphans, spread.alone,
                        spread.latencies.quantile(0.5), spread.latencies.quantile(0.95),
                        times.largest if times.count else None,
                    ],
                    "show": self._of.rows.command("transactions -Y " + quote(where)),
                    "filter": self._s7comm(host) if not function.startswith(_NOT_READ) else host_filter(host[0]),
                }
            )  # fmt: skip
        columns = [
            ("answered by", TEXT), ("function", TEXT), ("count", NUMBER), ("answered", NUMBER), ("with errors", NUMBER),
            ("no answer", NUMBER), ("still open", RARE), ("not captured", RARE), ("only likely", RARE), ("no request", RARE),
            ("push or one-way", RARE),
            ("median", DURATION), ("95 %", DURATION), ("longest", DURATION),
        ]  # fmt: skip
        return self._table("functions", "Functions by device", columns, rows, len(rows) + len(self._of.further))

    def _requests(self) -> dict[str, Any]:
        found = self._of.requests.polls()
        rows = [
            {
                "key": f"p{number}",
                "cells": [
                    int(known.connection.number),
                    self._of.rows.station(station_of(known.connection)),
                    shortened(known.subject, _TEXT),
                    known.count,
                    known.errors,
                    known.missed,
                    known.periods.quantile(0.5),
                    known.periods.smallest,
                    known.periods.largest,
                    known.periods.deviation,
                ],
                "show": self._of.rows.command(f"transactions --connection {known.connection.number}"),
                "filter": host_filter(known.connection.client.host, known.connection.server.host),
            }
            for number, known in enumerate(found[:_REQUESTS], 1)
        ]
        columns = [
            ("connection", ID), ("PLC", TEXT), ("request", TEXT), ("times", NUMBER), ("with errors", NUMBER),
            ("no answer", NUMBER), ("period", DURATION), ("shortest", DURATION), ("longest", DURATION), ("jitter", DURATION),
        ]  # fmt: skip
        return self._table("polls", "Repeated requests", columns, rows, len(found))

    def _variables(self) -> dict[str, Any]:
        found = self._of.requests.variables()
        order = sorted(
            found.items(), key=lambda entry: (-entry[1].refused, -entry[1].read - entry[1].written, entry[0])
        )
        rows = [
            {
                "key": f"v{number}",
                "cells": [
                    self._of.rows.station(host),
                    shortened(address, _TEXT),
                    variable.read,
                    variable.written,
                    variable.refused,
                    variable.why,
                    ", ".join([self._of.rows.host(client) for client in sorted(variable.clients)[:3]])
                    + (f" and {len(variable.clients) - 3} more" if len(variable.clients) > 3 else ""),
                ],
                "show": self._of.rows.command(
                    f"transactions -Y '{selecting('server', host)} and address == \"{address}\"'"
                )
                if printable(address) == address
                else "",
                "filter": self._s7comm(host),
            }
            for number, ((host, address), variable) in enumerate(order[:_VARIABLES], 1)
        ]
        columns = [
            ("PLC", TEXT), ("address", TEXT), ("reads", NUMBER), ("writes", NUMBER), ("refused", NUMBER), ("why", TEXT),
            ("clients", TEXT),
        ]  # fmt: skip
        return self._table("variables", "Variables", columns, rows, len(found))


def findings_of(gathered: Gathered) -> list[dict[str, Any]]:
    """Return the findings, the most severe first, for the part of the page that works without a script."""
    counts = gathered.analysis.finding_counts
    explained = gathered.analysis.by_cause()
    details: dict[str, list[Any]] = {}
    for finding in gathered.analysis.findings:
        details.setdefault(finding.slug, []).append(finding)
    told = []
    facts = facts_of(gathered.analysis, gathered.rows.clock)
    for rule in by_weight(gathered.analysis):
        times = times_of(rule.slug, counts[rule.slug], facts.ledger)
        shown = sorted(details.get(rule.slug, []), key=lambda one: int(one.time_ns))[:_DETAILS]
        rows = []
        for one in shown:
            show, display = gathered.rows.packets(list(one.frames))
            rows.append(
                {
                    "time": gathered.rows.clock.moment(int(one.time_ns)),
                    "connection": int(one.connection),
                    "packets": gathered.rows.places.phrase(one.frames),
                    "detail": cut_inside(gathered.rows.places.named(one.detail), _DETAIL),
                    "show": show,
                    "filter": display,
                }
            )
        told.append(
            {
                "rule": CATALOGUE[rule.slug],
                "count": times,
                "times": how_often(times),
                "facts": facts.phrase(rule) if times > 1 else "",
                "rows": rows,
                "explains": words.explained(explained.get(rule.slug, {})),
                "techniques": ", ".join([str(technique) for technique in rule.techniques]),
            }
        )
    return told


#: At most so many findings of a kind are shown one by one, with so many characters each.
_DETAILS: Final = 25
_DETAIL: Final = 400
