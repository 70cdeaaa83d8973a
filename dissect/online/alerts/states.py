"""Measures lasting states: rates, answer times, silence, errors. Each state rule has one watch, which is checked regularly."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Mapping
from functools import partial
from typing import Final, Generic, TypeVar

from dissect.engine.findings.catalogue import WARNING
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import (
    CONNECTION_CLOSED,
    REFERENCE_REUSED,
    UNANSWERED,
    Transaction,
)
from dissect.meaning.report import words
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.cooldown import Make
from dissect.online.alerts.rules import LATENCY, OUTCOME, PER_ALL, PER_CONNECTION, RATE, Rule
from dissect.output.baseline.measures import RateWindow, RecentAnswers
from dissect.output.baseline.norms import Baseline, PairNorm
from dissect.output.baseline.subjects import Pair, moment
from dissect.packets.tcp.stream import address_text

#: Greatest number of pairs or connections that one rule measures; a new one replaces the one that was silent for longest.
MAX_MEASURED: Final = 4096
#: A learned rate is raised to at least this number per window: three instead of one is not worth an alert.
LEAST_RATE: Final = 10
#: The same minimum for a learned silence and for learned answer times.
LEAST_SILENCE_NS: Final = 1_000_000_000
LEAST_ANSWER_NS: Final = 10_000_000

# Quantities that a rule can measure (`Rule.of`).
TRANSACTIONS: Final = "transactions"
MESSAGES: Final = "messages"
#: All captured packets, including those of no connection.
INTERFACE: Final = "interface"
PACKETS: Final = "packets"
MEDIAN: Final = "median"
MAX: Final = "max"
ERRORS: Final = "errors"
NO_ANSWER: Final = "unanswered"
FAILED: Final = "failed"

_S: Final = 1_000_000_000
_MINUTE: Final = 60 * _S
#: Reasons that mean that no answer came; with the others, the capture may just not show it.
_LOST: Final = frozenset((CONNECTION_CLOSED, REFERENCE_REUSED))

#: The result of a check for one pair or connection: its identity, and a function that makes the alert if the rule's state
#: holds.
Found = tuple[Hashable, Make | None]
#: The measured values of a rule are kept by pair, by number of the connection, or together.
_About = Pair | int | None
_Kept = TypeVar("_Kept")


class _Measured(Generic[_Kept]):
    """Measures by pair or connection. ``forgotten`` counts those that were replaced."""

    def __init__(self, make: Callable[[], _Kept]) -> None:
        self.forgotten = 0
        self.kept: OrderedDict[_About, _Kept] = OrderedDict()
        self._make = make

    def of(self, about: _About) -> _Kept:
        """Return the measure of a pair or connection, and mark it as the most recent one."""
        known = self.kept.get(about)
        if known is None:
            known = self.kept[about] = self._make()
            if len(self.kept) > MAX_MEASURED:
                self.kept.popitem(last=False)
                self.forgotten += 1
        else:
            self.kept.move_to_end(about)
        return known


class StateWatch:
    """Measures for one rule. ``connections`` are the open ones, by number."""

    def __init__(self, rule: Rule, baseline: Baseline | None) -> None:
        self.rule = rule
        self.norms: Mapping[Pair, PairNorm] = baseline.pairs if baseline is not None else {}
        self.connections: dict[int, tuple[Connection, Pair]] = {}

    @property
    def forgotten(self) -> int:
        """The number of pairs and connections that were dropped because too many were measured."""
        return 0

    def opened(self, connection: Connection, pair: Pair, now_ns: int) -> None:
        """Take a new connection to which the rule applies."""
        self.connections[int(connection.number)] = (connection, pair)

    def closed(self, connection: Connection) -> None:
        """Forget a connection that is over."""
        self.connections.pop(int(connection.number), None)

    def take(self, pair: Pair, transaction: Transaction, now_ns: int) -> None:
        """Take a transaction of a pair to which the rule applies."""

    def captured(self, now_ns: int) -> None:
        """Note that packets were captured."""

    def ends(self, pair: Pair, connection: Connection, now_ns: int) -> bool:
        """Return whether the next transaction ends the state that the rule looks for, so that it must be checked before."""
        return False

    def look(self, now_ns: int) -> Iterator[Found]:
        """Yield the present results."""
        yield from ()

    def restart(self, now_ns: int) -> None:
        """Start over: the clock went back."""

    def about(self, pair: Pair, connection: Connection) -> _About:
        """Return the key under which a transaction of this pair and connection counts, by `Rule.per`."""
        if self.rule.per == PER_ALL:
            return None
        return int(connection.number) if self.rule.per == PER_CONNECTION else pair

    def told(self, about: _About, text: str, measured: dict[str, object]) -> Make:
        """Return a function that makes the alert."""
        pair: Pair | None = None
        number = 0
        if isinstance(about, tuple):
            pair = about
        elif about is not None:
            number = about
            known = self.connections.get(number)
            pair = known[1] if known is not None else None
        who = [f"{pair[0]} → {pair[1]}"] if pair is not None else []
        if number:
            who.append(f"connection {number}")
        return partial(_alert, self.rule, pair, number, f"{', '.join(who) or 'all together'}: {text}", measured)


def _alert(rule: Rule, pair: Pair | None, number: int, text: str, measured: dict[str, object], now_ns: int) -> Alert:
    return Alert(rule, now_ns, rule.severity or WARNING, pair, text, {"measured": measured}, number)


class _Counter:
    """Events in a window, and the greatest number since the last look."""

    __slots__ = ("peak", "started_ns", "window")

    def __init__(self, window_ns: int) -> None:
        self.window = RateWindow(window_ns)
        self.peak = 0
        self.started_ns = -1

    def add(self, time_ns: int, now_ns: int, count: int) -> None:
        if self.started_ns < 0:
            self.started_ns = now_ns
        self.peak = max(self.peak, self.window.add(time_ns, count))

    def look(self, now_ns: int) -> int:
        """Return the greatest number in a window since the last look."""
        most = max(self.peak, self.window.total(now_ns))
        self.peak = 0
        return most


class _Counting(StateWatch):
    """The base of the watches for rates and outcomes: a counter for each pair."""

    def __init__(self, rule: Rule, baseline: Baseline | None) -> None:
        super().__init__(rule, baseline)
        self._counters = _Measured(partial(_Counter, rule.window_ns))

    @property
    def forgotten(self) -> int:
        """The number of replaced pairs and connections."""
        return self._counters.forgotten

    def restart(self, now_ns: int) -> None:
        """Start over: the clock went back."""
        self._counters.kept.clear()


class RateWatch(_Counting):
    """Transactions or messages a second over a window, above or below."""

    def take(self, pair: Pair, transaction: Transaction, now_ns: int) -> None:
        """Count a transaction, or its messages."""
        count = 1
        if self.rule.of == MESSAGES:
            count = (transaction.request_size > 0) + (transaction.response_size > 0)
        self._counters.of(self.about(pair, transaction.connection)).add(moment(transaction), now_ns, count)

    def look(self, now_ns: int) -> Iterator[Found]:
        """Yield the results for all rates."""
        for about, counter in list(self._counters.kept.items()):
            yield about, self._judged(about, counter, now_ns)

    def _judged(self, about: _About, counter: _Counter, now_ns: int) -> Make | None:
        rule = self.rule
        seconds = rule.window_ns / _S
        most = counter.look(now_ns)
        highest = self._highest(about)
        if highest is not None and most > highest:
            said = f"{most} {rule.of} in {seconds:g} s; {rule.learned:g} times the baseline is {highest:g}"
            return self.told(about, said, self._values(most / seconds, highest / seconds))
        if rule.above is not None and most / seconds > rule.above:
            said = f"{most} {rule.of} in {seconds:g} s, {most / seconds:.4g} a second; more than {rule.above:g}"
            return self.told(about, said, self._values(most / seconds, rule.above))
        if rule.below is not None and now_ns - counter.started_ns >= rule.window_ns:
            least = counter.window.total(now_ns)
            if least / seconds < rule.below:
                said = f"{least} {rule.of} in {seconds:g} s, {least / seconds:.4g} a second; less than {rule.below:g}"
                return self.told(about, said, self._values(least / seconds, rule.below))
        return None

    def _highest(self, about: _About) -> float | None:
        """Return how many events the baseline allows in a window, None if it does not say."""
        norm = self.norms.get(about) if isinstance(about, tuple) else None
        if not self.rule.learned or norm is None:
            return None
        learned = norm.highest_1s if self.rule.window_ns == _S else norm.highest_10s
        return None if learned is None else self.rule.learned * max(learned, LEAST_RATE)

    def _values(self, value: float, limit: float) -> dict[str, object]:
        return {"of": self.rule.of, "per_second": value, "limit": limit}


class OutcomeWatch(_Counting):
    """Errors or missing answers a minute over a window."""

    def take(self, pair: Pair, transaction: Transaction, now_ns: int) -> None:
        """Count a transaction that failed in the way that the rule looks for."""
        lost = transaction._outcome == UNANSWERED and transaction.reason in _LOST
        wrong = transaction.has_errors
        counts = {ERRORS: wrong, NO_ANSWER: lost, FAILED: wrong or lost}[self.rule.of]
        if counts:
            # A missing answer is only certain now, however long ago the request was.
            time_ns = now_ns if lost else moment(transaction)
            self._counters.of(self.about(pair, transaction.connection)).add(time_ns, now_ns, 1)

    def look(self, now_ns: int) -> Iterator[Found]:
        """Yield the results for all counts of outcomes."""
        rule = self.rule
        above = rule.above or 0.0
        for about, counter in list(self._counters.kept.items()):
            most = counter.look(now_ns)
            a_minute = most * _MINUTE / rule.window_ns
            if a_minute <= above:
                yield about, None
                continue
            said = f"{most} {rule.of} in {rule.window_ns / _S:g} s, {a_minute:.4g} a minute; more than {above:g}"
            yield about, self.told(about, said, {"of": rule.of, "per_minute": a_minute, "limit": above})


class LatencyWatch(StateWatch):
    """Median or longest answer time over a window."""

    def __init__(self, rule: Rule, baseline: Baseline | None) -> None:
        super().__init__(rule, baseline)
        self._answers = _Measured(partial(RecentAnswers, rule.window_ns))

    @property
    def forgotten(self) -> int:
        """The number of replaced pairs and connections."""
        return self._answers.forgotten

    def restart(self, now_ns: int) -> None:
        """Start over: the clock went back."""
        self._answers.kept.clear()

    def take(self, pair: Pair, transaction: Transaction, now_ns: int) -> None:
        """Take the answer time of a transaction, if it has one: that of a likely pair is not known."""
        latency_ns = transaction.latency_ns
        if latency_ns is not None:
            self._answers.of(self.about(pair, transaction.connection)).add(moment(transaction), latency_ns)

    def look(self, now_ns: int) -> Iterator[Found]:
        """Yield the results for all answer times."""
        rule = self.rule
        for about, recent in list(self._answers.kept.items()):
            answers = recent.all(now_ns)
            value = answers.quantile(0.5) if rule.of == MEDIAN else answers.longest
            limit = self._limit(about)
            if value is None or not answers.count or limit is None or value <= limit:
                yield about, None
                continue
            said = f"{rule.of} answer time {words.duration(value)} in {rule.window_ns / _S:g} s"
            said = f"{said} ({words.count(answers.count, 'answer')}); more than {words.duration(int(limit))}"
            yield about, self.told(about, said, {"of": rule.of, "ns": value, "limit": int(limit)})

    def _limit(self, about: _About) -> float | None:
        if not self.rule.learned:
            return self.rule.above
        norm = self.norms.get(about) if isinstance(about, tuple) else None
        learned = None if norm is None else norm.median_ms if self.rule.of == MEDIAN else norm.p99_ms
        return None if learned is None else self.rule.learned * max(learned * 1e6, LEAST_ANSWER_NS)


class SilenceWatch(StateWatch):
    """No traffic of a pair or connection for too long. For pairs that are known beforehand, silence counts from the start."""

    def __init__(self, rule: Rule, baseline: Baseline | None) -> None:
        super().__init__(rule, baseline)
        self._last: OrderedDict[_About, int] = OrderedDict()
        self._gone = 0
        self._waiting = True

    @property
    def forgotten(self) -> int:
        """The number of replaced pairs and connections."""
        return self._gone

    def restart(self, now_ns: int) -> None:
        """Start over: the clock went back."""
        for about in self._last:
            self._last[about] = now_ns

    def opened(self, connection: Connection, pair: Pair, now_ns: int) -> None:
        """Begin to wait for traffic on a connection."""
        super().opened(connection, pair, now_ns)
        self._heard(self.about(pair, connection), now_ns)

    def closed(self, connection: Connection) -> None:
        """Remember the last packet of a connection, and stop waiting for its traffic."""
        known = self.connections.get(int(connection.number))
        if known is not None and self.rule.of == PACKETS:
            self._heard(self.about(known[1], connection), int(connection.tcp.last_ns))
        super().closed(connection)
        if self.rule.per == PER_CONNECTION:
            self._last.pop(int(connection.number), None)

    def ends(self, pair: Pair, connection: Connection, now_ns: int) -> bool:
        """Return whether there was silence until now: by the next regular check, it might not be visible any more."""
        about = self.about(pair, connection)
        last_ns = self._last.get(about)
        limit = self._limit(about)
        return last_ns is not None and limit is not None and now_ns - last_ns > limit

    def captured(self, now_ns: int) -> None:
        """Note that packets of any kind were captured."""
        if self.rule.of == INTERFACE:
            self._heard(None, now_ns)

    def take(self, pair: Pair, transaction: Transaction, now_ns: int) -> None:
        """Note a transaction."""
        self._heard(self.about(pair, transaction.connection), now_ns)

    def look(self, now_ns: int) -> Iterator[Found]:
        """Yield the results for all pairs or connections: silent or not."""
        if self._waiting:
            self._waiting = False
            self._wait(now_ns)
        if self.rule.of == PACKETS:
            for connection, pair in self.connections.values():
                self._heard(self.about(pair, connection), int(connection.tcp.last_ns))
        for about, last_ns in list(self._last.items()):
            limit = self._limit(about)
            if limit is None or now_ns - last_ns <= limit:
                yield about, None
                continue
            what = "packets on the interface" if self.rule.of == INTERFACE else self.rule.of
            said = f"no {what} for {words.duration(now_ns - last_ns)}; more than {words.duration(limit)}"
            yield about, self.told(about, said, {"of": self.rule.of, "ns": now_ns - last_ns, "limit": limit})

    def _wait(self, now_ns: int) -> None:
        """Start the wait for the pairs that are known beforehand."""
        rule = self.rule
        if rule.per == PER_ALL:
            self._heard(None, now_ns)
        if rule.per in {PER_ALL, PER_CONNECTION}:
            return
        for pair in self.norms:
            if rule.covers(pair):
                self._heard(pair, now_ns)
        client, server = rule.client, rule.server
        if client is not None and server is not None and client.num_addresses == server.num_addresses == 1:
            self._heard(
                (address_text(client.network_address.packed), address_text(server.network_address.packed)), now_ns
            )

    def _heard(self, about: _About, time_ns: int) -> None:
        known = self._last.get(about)
        if known is None:
            self._last[about] = time_ns
            if len(self._last) > MAX_MEASURED:
                self._last.popitem(last=False)
                self._gone += 1
        elif time_ns > known:
            self._last[about] = time_ns
            self._last.move_to_end(about)

    def _limit(self, about: _About) -> int | None:
        if not self.rule.learned:
            return self.rule.longer_ns
        norm = self.norms.get(about) if isinstance(about, tuple) else None
        if norm is None or norm.longest_silence is None:
            return None
        return max(int(self.rule.learned * norm.longest_silence * _S), LEAST_SILENCE_NS)


def state_watch(rule: Rule, baseline: Baseline | None) -> StateWatch:
    """Return the watch of a state rule."""
    kind = {RATE: RateWatch, OUTCOME: OutcomeWatch, LATENCY: LatencyWatch}.get(rule.when, SilenceWatch)
    return kind(rule, baseline)
