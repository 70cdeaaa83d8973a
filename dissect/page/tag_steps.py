"""The values of chosen tags over time, and who wrote them."""

from __future__ import annotations

from typing import Final

from dissect.page.bins import WIDTHS
from dissect.page.rows import time_of
from dissect.s7.parameters import Parameters
from dissect.s7.tables import READ_VAR, WRITE_VAR
from dissect.s7.values import Value
from dissect.s7plus.tables import SET_MULTI_VARIABLES, SET_VARIABLE
from dissect.transactions.naming import named_values, plain
from dissect.transactions.transaction import Transaction

#: Values kept one by one; when there are more they are gathered in bins of time.
_EXACT: Final = 2000
#: Writes kept for each tag.
_WRITES: Final = 300
#: Parameter blocks of which is known whether they hold a wanted address.
_BLOCKS: Final = 8192
_WRITING: Final = frozenset((WRITE_VAR, SET_VARIABLE, SET_MULTI_VARIABLES))


class Step:
    """Values in one bin of time, or one value: when the first came, the first, smallest, largest and last, and how many.

    ``broken``: bytes are missing before it, so that nothing is known of the time up to it.
    """

    __slots__ = ("broken", "count", "first", "largest", "last", "smallest", "time_ns")

    def __init__(self, time_ns: int, value: float, broken: bool) -> None:
        self.time_ns = time_ns
        self.first = self.smallest = self.largest = self.last = value
        self.count = 1
        self.broken = broken

    def join(self, other: Step) -> None:
        """Take the values of a later step."""
        self.smallest = min(self.smallest, other.smallest)
        self.largest = max(self.largest, other.largest)
        self.last = other.last
        self.count += other.count


class Write:
    """One write of a tag: by whom, and whether it was refused."""

    __slots__ = ("number", "refused", "time_ns", "value", "writer")

    def __init__(self, time_ns: int, value: float, writer: str, refused: bool, number: int) -> None:
        self.time_ns = time_ns
        self.value = value
        self.writer = writer
        self.refused = refused
        self.number = number


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

    def take(self, time_ns: int, value: Value, write: Write | None) -> None:
        """Take a value that was read or written."""
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
            if write.refused:
                return
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
        """Bytes are missing: what follows is not joined with what was."""
        self._broken = True

    def _gather(self) -> None:
        """Join steps in bins of time that are wide enough to leave at most half of them."""
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
        if len(self.steps) > _EXACT:  # gaps without end: the oldest values give way
            del self.steps[: len(self.steps) - _EXACT]


def _number(value: Value) -> float | None:
    """Return a value as a number to be drawn; None for texts, lists and what is not finite."""
    if isinstance(value, bool):
        return float(value)
    if isinstance(value, (int, float)) and -1e300 < value < 1e300:
        return float(value)
    return None


class Tags:
    """The tags that are to be plotted, by name or address, without regard to case."""

    def __init__(self, wanted: list[str]) -> None:
        self._wanted = {name.casefold(): name for name in wanted}
        self._holds: dict[bytes, bool] = {}
        #: By name as it was asked for, and host of the PLC.
        self.found: dict[tuple[str, str], TagSteps] = {}

    def take(self, transaction: Transaction) -> None:
        """Take the values of a transaction."""
        if not self._wanted:
            return
        parameters = transaction.parameters
        if parameters.function in {READ_VAR, WRITE_VAR}:
            named = transaction.connection.naming is not None
            if not named and not self._may_hold(parameters):
                return
        elif parameters.userdata is None and not transaction.is_plus and not transaction.is_scd:
            return
        if transaction.is_plus:
            for item in transaction.plus_items():
                if item.value is not None:
                    self._one(transaction, (item.label,), plain(item.value.content), "", item.return_code > 0)
            return
        results = transaction.results()
        told: set[str] = set()
        for number, value in named_values(transaction):
            refused = number > 0 and results[number - 1].refused
            self._one(transaction, (value.name, value.address), value.value, value.unit, refused)
            told.add(value.address)
        for result in results:
            asked = result.item
            if asked is not None and result.data is not None and asked.address not in told:
                self._one(transaction, (asked.label, asked.address), result.value, "", result.refused)

    def gap(self, connection: int) -> None:
        """Bytes of a connection are missing; 0: of all."""
        for steps in self.found.values():
            if connection == 0 or connection in steps.connections:
                steps.gap()

    def missing(self) -> list[str]:
        """Return the tags of which no value was seen."""
        seen = {name for (name, _), steps in self.found.items() if steps.values}
        return [name for name in self._wanted.values() if name not in seen]

    def _may_hold(self, parameters: Parameters) -> bool:
        known = self._holds.get(parameters.octets)
        if known is None:
            if len(self._holds) >= _BLOCKS:
                self._holds.clear()
            known = any(
                [
                    item.address.casefold() in self._wanted or item.label.casefold() in self._wanted
                    for item in parameters.items
                ]
            )
            self._holds[parameters.octets] = known
        return known

    def _one(self, transaction: Transaction, names: tuple[str, ...], value: Value, unit: str, refused: bool) -> None:
        for name in dict.fromkeys([self._wanted.get(name.casefold(), "") for name in names]):
            if not name:
                continue
            connection = transaction.connection
            ends = connection.tcp.ends
            steps = self.found.setdefault((name, connection.server.host), TagSteps())
            steps.connections.add(int(connection.number))
            steps.unit = unit or steps.unit
            write = None
            if transaction.function in _WRITING:
                writer = ends[transaction.asked_by].host
                write = Write(time_of(transaction), 0.0, writer, refused, int(transaction.number))
            steps.take(time_of(transaction), value, write)
