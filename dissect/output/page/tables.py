"""The tables of the page: their columns and rows, the number of all rows, and the command that lists them all."""

from __future__ import annotations

from shlex import quote
from typing import Any, Final

from dissect.meaning.inventory.rows import device_row
from dissect.meaning.select.getters import function_names
from dissect.output.page.bins import Bins
from dissect.output.page.gathered import Gathered
from dissect.output.page.ordered import Ordered
from dissect.output.page.rows import Station, host_filter, selecting, station_of
from dissect.wire.text import printable, shortened, some

#: Greatest number of rows.
_VARIABLES: Final = 1000
_REQUESTS: Final = 500
_DEVICES: Final = 1000
#: Columns of the table of devices, by key of a row of `dissect.meaning.inventory.rows`.
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
_TEXT: Final = 160

#: Kinds of cells, which decide how a cell is shown and sorted.
TEXT, SHORT, NUMBER, SECONDS, DURATION, SIZE = "text", "short", "number", "seconds", "duration", "size"
#: A number that is mostly 0: a column with only zeros is left out.
RARE: Final = "rare"
#: The number of a connection, transaction or operation, shown without thousands separators.
ID: Final = "id"


def timed(gathered: Gathered) -> int:
    """Return the number of answers with an answer time: all except those of pairs that are only likely."""
    return int(gathered.analysis.answered) - sum(gathered.analysis.likely.values())


class Tables:
    """The tables of one session from ``start_ns`` to ``end_ns``; ``most`` bins of time show when omitted rows were."""

    def __init__(self, ordered: Ordered, start_ns: int, end_ns: int, most: int) -> None:
        self._of = ordered.of
        self._ordered = ordered
        self._start = start_ns
        self._end = end_ns
        self._most = most

    def _seconds(self, time_ns: int) -> float:
        return round((time_ns - self._start) / 1e9, 6)

    def as_list(self) -> list[dict[str, Any]]:
        """Return the tables in the order of the page."""
        of = self._of
        transactions = [
            ("number", ID), ("time", SECONDS), ("packets", TEXT if of.rows.places.several else SHORT), ("from → to", TEXT),
            ("answer", DURATION), ("function", TEXT), ("what", TEXT),
        ]  # fmt: skip
        failed, slowest, operations = of.failed.rows(), of.slowest(), [row for row, _ in of.operations.rows()]
        return [
            self._table("failed", "Failed transactions", transactions, failed, of.failed.total)
            | {
                "note": "Failed: answered with errors, or without the answer that was due.",
                **self._then("transactions", "failed", of.failed.total > len(failed), of.failed.counts),
            },
            self._table("slowest", "Slowest transactions", transactions, slowest, timed(of))
            | self._then("transactions", "latency >= 0s", timed(of) > len(slowest), of.answer_times),
            self._connections(),
            self._table(
                "operations",
                "Operations",
                [
                    ("number", ID), ("time", SECONDS), ("took", DURATION), ("kind", TEXT), ("what", TEXT),
                    ("from → to", TEXT), ("bytes", SIZE), ("result", TEXT),
                ],
                operations,
                of.operations.total,
            )
            | self._then("operations", "kind != connect", of.operations.total > len(operations), of.operations.counts),
            self._table(
                "blocks",
                "Downloaded and uploaded blocks",
                [
                    ("block", TEXT), ("name", TEXT), ("time", SECONDS), ("direction", TEXT), ("from → to", TEXT),
                    ("bytes", SIZE),
                    ("state", TEXT), ("language", TEXT), ("author", TEXT), ("version", TEXT), ("code changed", TEXT),
                ],
                of.blocks.rows(),
                of.blocks.total,
            )
            | self._then("blocks", "", of.blocks.total > len(of.blocks), of.blocks.counts),
            self._devices(),
            self._functions(),
            self._requests(),
            self._variables(),
        ]  # fmt: skip

    def _then(self, command: str, where: str, left_out: bool, counts: Bins | None) -> dict[str, Any]:
        """Return the command that lists all rows of a table, and, if rows are left out, their numbers by time.

        The report may be about a selection; the command is empty if it could not repeat that.
        """
        part = self._of.analysis.part
        if part is not None:
            where = f"({part.where}) and {where}" if where else part.where
            if self._of.rows.clock.local or printable(where) != where:  # its times are in the zone of this machine
                command = ""
        found: dict[str, Any] = {"all": f"{command} -Y {quote(where)}" if command and where else command}
        if left_out and counts is not None:
            found["counts"] = self._counts(counts)
        return found

    def _counts(self, bins: Bins) -> dict[str, Any]:
        bins.settle(self._start, self._end, self._most)
        return {
            "width": bins.width / 1e9,
            "bins": [
                [self._seconds(number * bins.width), sum(row.values())] for number, row in sorted(bins.rows.items())
            ],
        }

    def _connections(self) -> dict[str, Any]:
        """Return the table of connections: those with the gravest findings first, then most errors, then most traffic."""
        of = self._of
        columns = [
            ("number", ID), ("time", SECONDS), ("client", SHORT), ("server", SHORT), ("protocol", TEXT), ("TSAPs", TEXT),
            ("PDUs", NUMBER), ("answered", NUMBER), ("with errors", NUMBER), ("no answer", NUMBER), ("still open", RARE),
            ("bytes", SIZE), ("end", TEXT), ("gravest finding", TEXT),
        ]  # fmt: skip
        rows = [{**row, "until": self._seconds(row["until"])} for row, _ in of.connections.rows()]
        table = self._table("connections", "Connections", columns, rows, of.connections.total)
        table["all"] = "sql 'SELECT * FROM connections'" if of.analysis.part is None else ""
        if of.connections.total > len(rows):
            table["note"] = "The gravest findings come first, then most failed requests, then most bytes."
            table["counts"] = self._counts(of.opened)
            table["ended"] = self._counts(of.ended)
        return table

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
        for number, device in enumerate(inventory.devices[:_DEVICES], 1):
            told = device_row(device, self._of.rows.places)
            told["asks"] = ", ".join([self._of.rows.host(talk.server) for talk in device.asks])
            said = [shortened(told[column], _TEXT) for column in _DEVICE_TEXTS]
            rows.append(
                {
                    "key": f"d{number}",
                    "cells": [
                        self._of.rows.station((device.address, device.vlan)), *said,
                        sum([talk.connections for talk in (*device.asked_by, *device.asks)]),
                        sum([talk.transactions for talk in device.asked_by]),
                        sum([talk.transactions for talk in device.asks]),
                        int(told["median_ns"]) if told["median_ns"] else None, device.first_ns,
                    ],
                    **self._of.rows.how(
                        f"devices -Y '{selecting('host', (device.address, device.vlan))}'", 0, host_filter(device.address)
                    ),
                }
            )  # fmt: skip
        columns = [
            ("device", TEXT), *[(heading, TEXT) for heading in _DEVICE_TEXTS.values()], ("connections", NUMBER),
            ("transactions as server", NUMBER), ("as client", NUMBER), ("median answer", DURATION), ("first seen", SECONDS),
        ]  # fmt: skip
        return self._table("devices", "Devices", columns, rows, len(inventory.devices) + inventory.devices_not_listed)

    def _s7comm(self, host: Station) -> str:
        """Return the Wireshark filter for a machine's S7comm; for all its traffic if Wireshark may not recognise S7comm."""
        return host_filter(host[0]) if host in self._of.unusual else f"s7comm && {host_filter(host[0])}"

    def _functions(self) -> dict[str, Any]:
        rows: list[dict[str, Any]] = []
        # names that -Y accepts; other functions only have a number, or belong to SCD
        known = frozenset(function_names())
        for (host, function), spread in self._ordered.functions:
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
                    **self._of.rows.how(
                        "transactions -Y " + quote(where), 0,
                        self._s7comm(host) if not function.startswith(_NOT_READ) else host_filter(host[0]),
                    ),
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
        found = self._ordered.polls
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
                **self._of.rows.how(
                    f"transactions --connection {known.connection.number}",
                    0,
                    host_filter(known.connection.client.host, known.connection.server.host),
                ),
            }
            for number, known in enumerate(found[:_REQUESTS], 1)
        ]
        columns = [
            ("connection", ID), ("PLC", TEXT), ("request", TEXT), ("times", NUMBER), ("with errors", NUMBER),
            ("no answer", NUMBER), ("period", DURATION), ("shortest", DURATION), ("longest", DURATION), ("jitter", DURATION),
        ]  # fmt: skip
        return self._table("polls", "Repeated requests", columns, rows, len(found))

    def _variables(self) -> dict[str, Any]:
        found = self._ordered.variables
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
                    some([self._of.rows.host(client) for client in sorted(variable.clients)], 3),
                ],
                **self._of.rows.how(
                    f"transactions -Y '{selecting('server', host)} and address == \"{address}\"'"
                    if printable(address) == address
                    else "",
                    0,
                    self._s7comm(host),
                ),
            }
            for number, ((host, address), variable) in enumerate(found[:_VARIABLES], 1)
        ]
        columns = [
            ("PLC", TEXT), ("address", TEXT), ("reads", NUMBER), ("writes", NUMBER), ("refused", NUMBER), ("why", TEXT),
            ("clients", TEXT),
        ]  # fmt: skip
        return self._table("variables", "Variables", columns, rows, len(found))
