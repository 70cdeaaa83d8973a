"""Values over time of the tags to be plotted, and the clients that wrote them."""

from __future__ import annotations

from typing import Final

from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.certainty import values_left_out
from dissect.output.page.bins import WIDTHS
from dissect.output.page.rows import Station
from dissect.output.variables.collector import ValueCollector
from dissect.output.variables.wanted import WantedSet

#: Up to this many values are kept one by one; more are joined in bins of time.
_EXACT: Final = 2000
#: Greatest number of writes kept for each tag.
_WRITES: Final = 300
#: Maximum number of variables whose values are kept: a structure may have thousands of elements.
_TAGS: Final = 64


class Step:
    """One value, or the values in one bin of time: time of the first; first, smallest, largest and last value; count.

    ``broken``: bytes are missing before this step, so the value up to it is unknown.
    """

    __slots__ = ("broken", "count", "first", "largest", "last", "smallest", "time_ns")

    def __init__(self, time_ns: int, value: float, broken: bool) -> None:
        self.time_ns = time_ns
        self.first = self.smallest = self.largest = self.last = value
        self.count = 1
        self.broken = broken

    def join(self, other: Step) -> None:
        """Add the values of a later step."""
        self.smallest = min(self.smallest, other.smallest)
        self.largest = max(self.largest, other.largest)
        self.last = other.last
        self.count += other.count


class Write:
    """One write of a tag: its client and its packet."""

    __slots__ = ("frame", "time_ns", "value", "writer")

    def __init__(self, time_ns: int, value: float, writer: str, frame: int) -> None:
        self.time_ns = time_ns
        self.value = value
        self.writer = writer
        self.frame = frame


class TagSteps:
    """The values of one tag on one PLC. Equal values in a row are one step."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self.writes: list[Write] = []
        self.writes_not_kept = 0
        self.not_a_number = 0
        self.width_ns = 0
        self._step = 0
        self.unit = ""
        self.last_ns = 0
        self.values = 0
        self.connections: set[int] = set()
        self._broken = False

    def take(self, time_ns: int, value: object, write: Write | None) -> None:
        """Add a value that was read or written."""
        self.last_ns = max(self.last_ns, time_ns)
        number = _number(value)
        if number is None:
            self.not_a_number += 1
            return
        self.values += 1
        if write is not None:
            write.value = number
            if len(self.writes) < _WRITES:
                self.writes.append(write)
            else:
                self.writes_not_kept += 1
        last = self.steps[-1] if self.steps else None
        step = Step(time_ns, number, self._broken)
        if last is not None and not self._broken:
            if last.last == number and last.count == 1 and not self.width_ns:
                return
            if self.width_ns and last.time_ns // self.width_ns == time_ns // self.width_ns:
                last.join(step)
                return
        self._broken = False
        self.steps.append(step)
        if len(self.steps) > _EXACT:
            self._gather()

    def gap(self) -> None:
        """Bytes are missing: no line connects the next value with the one before."""
        self._broken = True

    def _gather(self) -> None:
        """Join steps in bins of time, wide enough that at most half of `_EXACT` steps remain."""
        while len(self.steps) > _EXACT // 2 and self._step + 1 < len(WIDTHS):
            self._step += 1
            self.width_ns = WIDTHS[self._step]
            joined: list[Step] = []
            for step in self.steps:
                if joined and not step.broken and joined[-1].time_ns // self.width_ns == step.time_ns // self.width_ns:
                    joined[-1].join(step)
                else:
                    joined.append(step)
            self.steps = joined
        if len(self.steps) > _EXACT:  # many gaps, across which steps are not joined: drop the oldest
            del self.steps[: len(self.steps) - _EXACT]


def _number(value: object) -> float | None:
    """Return a value as a number for a plot; None for texts, lists, NaN and infinities."""
    if isinstance(value, bool):
        return float(value)
    if isinstance(value, (int, float)) and -1e300 < value < 1e300:
        return float(value)
    return None


class Tags:
    """The values of the variables that are to be plotted, by name and PLC."""

    def __init__(self, wanted: WantedSet | None) -> None:
        self._wanted = wanted
        self._collector = ValueCollector(wanted) if wanted is not None else None
        self.found: dict[tuple[str, Station], TagSteps] = {}
        self.not_followed = 0

    def take(self, transaction: Transaction) -> None:
        """Take the values of a transaction."""
        if self._collector is None:
            return
        self._collector.transaction(transaction)
        for row in self._collector.take():
            key = (row.name, (str(row.plc.host), int(row.variable.vlan)))
            steps = self.found.get(key)
            if steps is None:
                if len(self.found) >= _TAGS:
                    self.not_followed += 1
                    continue
                steps = self.found.setdefault(key, TagSteps())
                steps.unit = row.unit
            steps.connections.add(int(row.connection))
            write = Write(int(row.time_ns), 0.0, row.host, int(row.frame)) if row.writes else None
            steps.take(int(row.time_ns), row.value, write)

    def closed(self, connection: Connection) -> None:
        """Forget a connection that is over."""
        if self._collector is not None:
            self._collector.connection_closed(connection)

    def gap(self, connection: int) -> None:
        """Bytes of a connection (0: of all) are missing."""
        for steps in self.found.values():
            if connection == 0 or connection in steps.connections:
                steps.gap()

    def missing(self) -> list[str]:
        """Return the chosen names for which neither a value nor a refusal was seen."""
        if self._wanted is None or self._collector is None:
            return []
        return [one.text for one in self._wanted.all if one.text not in self._collector.found]

    def left_out(self) -> str:
        """Return the sentence about values that are not drawn because they only probably belong to a tag; empty for none."""
        return values_left_out(self._collector.doubts, "the plots of values") if self._collector is not None else ""

    def refused(self) -> list[str]:
        """Return the names of variables for which a read or write was refused."""
        if self._collector is None:
            return []
        return [one.name for one in self._collector.variables if one.refused_reads or one.refused_writes]
