"""Events of a live run as lines of JSON (docs/json.md).

Transactions, operations and SCD messages have the same lines as in `s7dissect transactions`, `operations` and `show`. These
commands have no lines for connections, findings and problems, which have the schema ``s7dissect.event/1``.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable
from typing import Final

from dissect.engine.findings.reporter import Finding
from dissect.engine.stations.facts import Fact
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.operation import Operation
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.contract import connection_as_dict, finding_as_dict
from dissect.meaning.report.operations import operation_json
from dissect.meaning.report.pdu_json import PduLines
from dissect.meaning.report.styled import Line
from dissect.meaning.report.words import Places
from dissect.meaning.report.writers.jsonl import TransactionLines
from dissect.online.live.events import Event
from dissect.online.live.session import Status
from dissect.packets.tcp.link import vlan_ids
from dissect.wire.text import Clock, encodable

EVENT_SCHEMA: Final = "s7dissect.event/1"


class JsonLines:
    """Makes JSON lines of events of the wanted ``kinds``. Times are in UTC, also if ``clock`` shows another time zone."""

    def __init__(self, kinds: Collection[str], clock: Clock | None = None) -> None:
        self._kinds = kinds
        self._clock = clock or Clock()
        self._places = Places([], False)
        self._transactions = TransactionLines()
        self._pdus = PduLines()

    def lines(self, events: Iterable[Event]) -> list[str]:
        """Return the lines of events, in their order."""
        return [self.line(event) for event in events if event.kind in self._kinds]

    def written(self, events: Iterable[Event], lost: Iterable[str] = ()) -> list[str | Line]:
        """Return the lines of events, in their order, then ``lost``: lines that `lost` returned."""
        return [*self.lines(events), *lost]

    def end(self, status: Status) -> list[str | Line]:
        """Return the counts of the whole run."""
        return [self.summary(status)]

    def line(self, event: Event) -> str:
        """Return the line of an event of any kind; if there are several interfaces, it names its own as `interface`."""
        line = self._line(event)
        return f'{{"interface":{json.dumps(encodable(event.interface))},{line[1:]}' if event.interface else line

    def _line(self, event: Event) -> str:
        what = event.what
        if isinstance(what, Transaction):
            return self._transactions.line(what)
        if isinstance(what, Operation):
            return operation_json(what, self._clock, self._places)
        if isinstance(what, tuple):
            return self._pdus.scd_line(what[0], what[1])
        if isinstance(what, Connection):
            facts = event.facts or connection_as_dict(what, self._places)
            return self._event(event.kind, event.time_ns, "connection", facts)
        if isinstance(what, Finding):
            facts = finding_as_dict(what, self._places)
            return self._event(event.kind, event.time_ns, "finding", facts, int(what.repeated))
        if isinstance(what, Fact):
            return self._event(event.kind, event.time_ns, "device", _stated(what))
        return self._event(event.kind, event.time_ns, "text", encodable(what))

    def lost(self, now_ns: int, counts: dict[str, int]) -> str:
        """Return the line on how many events, by kind, were left out because the output was read too slowly."""
        return self._event("events_lost", now_ns, "counts", dict(sorted(counts.items())))

    def summary(self, status: Status) -> str:
        """Return the last line: the counts of the whole run."""
        told = {
            "packets": status.packets,
            "octets": status.octets,
            "dropped": {"kernel": status.drops.kernel, "interface": status.drops.interface},
            "connections": status.connections,
            "transactions": status.transactions,
            "unanswered": status.unanswered,
            "with_errors": status.with_errors,
            "findings": status.findings,
            "events_lost": status.lost_events,
        }
        return self._event("summary", status.now_ns, "summary", told)

    def _event(self, kind: str, time_ns: int, key: str, value: object, repeated: int = 0) -> str:
        told = {"schema": EVENT_SCHEMA, "event": kind, "time": self._clock.iso(time_ns), key: value}
        if repeated:
            told["repeated"] = repeated
        return json.dumps(told, separators=(",", ":")).replace("\x7f", "\\u007f")


def _stated(fact: Fact) -> dict[str, object]:
    return {
        "address": fact.host,
        "vlan": vlan_ids(fact.vlan),
        "module": fact.module or None,
        "kind": encodable(fact.key),
        "value": encodable(fact.value),
        "before": encodable(fact.before) or None,
        "source": fact.source,
        "connection": fact.connection,
        "frames": fact.frames,
    }
