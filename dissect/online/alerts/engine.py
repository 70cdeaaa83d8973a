"""`AlertEngine`: an observer that applies rules to the traffic and gives alerts. Its only clock is that of the capture."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Final

from mypy_extensions import i64

from dissect.engine.acts.act import Act
from dissect.engine.findings.catalogue import NOTE, WARNING
from dissect.engine.findings.reporter import Finding
from dissect.engine.observer import Observer
from dissect.engine.transactions.connection import Connection
from dissect.engine.transactions.transaction import Transaction
from dissect.meaning.report.contract import finding_as_dict
from dissect.meaning.report.words import Places
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.cooldown import Cooldown
from dissect.online.alerts.loading import AlertRules, RuleError
from dissect.online.alerts.rules import EVENTS, FINDING, NEW, PROBLEM, Rule
from dissect.online.alerts.states import StateWatch, state_watch
from dissect.output.baseline.norms import Baseline
from dissect.output.baseline.subjects import Pair, Pairs, moment, pair_of
from dissect.output.baseline.watch import BaselineWatch, Deviation

#: Interval (capture time) of the checks of states; it grows with every this many connections and measures.
LOOK_NS: Final = 200_000_000
_MANY: Final = 512
#: After this long, a connection without a transaction is judged by the facts known so far.
_JUDGE_NS: Final = 1_000_000_000
#: A tick that is earlier than the one before by more than this means that the clock was set back.
_SET_BACK_NS: Final = 1_000_000_000


class AlertEngine(Observer):
    """Applies ``rules`` to all events, and calls ``tell`` with each alert: `Dispatcher.submit`, or a list's ``append``.

    `tick` must be called while there is no traffic, and may be called at any rate. ``count`` is the number of alerts given.
    Raises `RuleError` when a rule needs a baseline and there is none.
    """

    def __init__(
        self, rules: AlertRules, baseline: Baseline | None = None, tell: Callable[[Alert], None] | None = None
    ) -> None:
        super().__init__()
        for number, rule in enumerate(rules.rules, 1):
            if rule.needs_baseline and baseline is None:
                where = f"[[rule]] {number}, when"
                raise RuleError(rules.path, 0, where, f'"{rule.when}" of {rule.name!r} needs a baseline: give one')
        self.now_ns = 0
        self.count = 0
        self._tell = tell
        self._cooldown = Cooldown(self._pass_on)
        self._finding_rules = [rule for rule in rules.rules if rule.when == FINDING]
        self._new_rules = [rule for rule in rules.rules if rule.when == NEW]
        self._problem_rules = [rule for rule in rules.rules if rule.when == PROBLEM]
        self._states = [state_watch(rule, baseline) for rule in rules.rules if rule.when not in EVENTS]
        self._watch = BaselineWatch(baseline) if baseline is not None and self._new_rules else None
        self._pairs = Pairs()
        self._open: dict[int, Connection] = {}
        self._unjudged: dict[int, Connection] = {}
        self._covered: dict[tuple[Rule, Pair], bool] = {}
        self._look_ns = 0
        self._places = Places([], False)

    @property
    def crowded(self) -> int:
        """The number of alerts that were forgotten because there were too many different ones; they may be given again."""
        return self._cooldown.crowded

    @property
    def forgotten(self) -> int:
        """The number of pairs and connections that are no longer measured because there were too many."""
        return sum(watch.forgotten for watch in self._states)

    # ---- observer ---------------------------------------------------------------------------------------------------

    def connection_opened(self, connection: Connection) -> None:
        """Watch a connection."""
        number = int(connection.number)
        self._open[number] = connection
        self._pairs.of(connection)
        if self._watch is not None:
            self._unjudged[number] = connection

    def connection_closed(self, connection: Connection) -> None:
        """Judge a connection without transactions; stop watching it."""
        number = int(connection.number)
        if self._unjudged.pop(number, None) is not None:
            self._judge(connection)
        self._open.pop(number, None)
        for watch in self._states:
            watch.closed(connection)

    def transaction(self, transaction: Transaction) -> None:
        """Apply the rules to a transaction."""
        time_ns = moment(transaction)
        if time_ns > self.now_ns:
            self._advance(time_ns)
        connection = transaction.connection
        pair = self._pairs.of(connection)
        if self._watch is not None:
            if self._unjudged.pop(int(connection.number), None) is not None:
                self._judge(connection)
            for deviation in self._watch.transaction(pair, transaction):
                self._deviates(deviation, connection)
        for watch in self._states:
            if self._covers(watch.rule, pair):
                if int(connection.number) not in watch.connections:
                    watch.opened(connection, pair, self.now_ns)
                if watch.ends(pair, connection, self.now_ns):
                    self._cooldown.state(watch.rule, watch.about(pair, connection), self.now_ns, None)
                watch.take(pair, transaction, self.now_ns)

    def act(self, act: Act) -> None:
        """Apply the rules to an act."""
        if self._watch is not None:
            for deviation in self._watch.act(self._pairs.of(act.connection), act):
                self._deviates(deviation, act.connection)

    def finding(self, finding: Finding) -> None:
        """Apply the rules to a finding that has no other finding as its cause."""
        if finding.because:
            return
        if finding.time_ns > self.now_ns:
            self._advance(int(finding.time_ns))
        pair = self._pairs.numbered(int(finding.connection))
        for rule in self._finding_rules:
            if finding.slug in rule.slugs and rule.covers(pair):
                make = partial(self._found, rule, finding, pair)
                self._cooldown.event(rule, (finding.slug, pair), self.now_ns, make)

    def repeated(self, finding: Finding) -> None:
        """Count findings that were counted but not made in detail."""
        if finding.time_ns > self.now_ns:
            self._advance(int(finding.time_ns))
        pair = pair_of(finding.client, finding.server)
        for rule in self._finding_rules:
            if finding.slug in rule.slugs and rule.covers(pair):
                make = partial(self._found, rule, finding, pair)
                self._cooldown.more(rule, (finding.slug, pair), int(finding.repeated), self.now_ns, make)

    def problem(self, kind: str, text: str, over: bool) -> None:
        """Apply the rules to a problem of this program itself, or to its end."""
        for rule in self._problem_rules:
            if kind in rule.kinds:
                make = partial(_troubled, rule, kind, text, over)
                self._cooldown.event(rule, (kind, over), self.now_ns, make)

    def captured(self, now_ns: int) -> None:
        """Note that packets of any kind were captured until now."""
        for watch in self._states:
            watch.captured(now_ns)

    # ---- time -------------------------------------------------------------------------------------------------------

    def tick(self, now_ns: i64) -> None:
        """Advance the time to ``now_ns`` by the clock of the capture, with or without traffic."""
        now = int(now_ns)
        if now < self.now_ns - _SET_BACK_NS:
            self.restart(now)
        elif now > self.now_ns:
            self._advance(now)

    def restart(self, now_ns: int) -> None:
        """The clock was set back, or another capture begins: begin to measure anew."""
        self.now_ns = now_ns
        self._look_ns = now_ns
        self._cooldown.rewind(now_ns)
        for watch in self._states:
            watch.restart(now_ns)

    def take_over(self, before: AlertEngine) -> None:
        """Go on where an engine with other rules stopped: with its open connections, and its time.

        It now gives the alerts that ``before`` held back. States and cooldowns begin anew, because they are those of its rules.
        """
        before.finish()
        self.now_ns = self._look_ns = before.now_ns
        self._pairs = before._pairs
        self._open = before._open
        if self._watch is not None:
            self._unjudged = dict(self._open)
        for watch in self._states:
            watch.restart(self.now_ns)

    def finish(self) -> None:
        """The run is over: judge the remaining connections, and give the alerts that were held back."""
        for connection in list(self._unjudged.values()):
            self._judge(connection)
        self._unjudged.clear()
        if self.now_ns:
            self._look()
        self._cooldown.flush(self.now_ns, over=True)

    def _advance(self, now_ns: int) -> None:
        """Advance the time. States are checked before the present event counts, so that a silence is noticed before it ends."""
        if not self.now_ns:
            self._look_ns = now_ns
        self.now_ns = now_ns
        if now_ns >= self._look_ns:
            self._look()

    def _look(self) -> None:
        now_ns = self.now_ns
        measured = len(self._open)
        for number, connection in list(self._unjudged.items()):
            if now_ns - connection.tcp.first_ns >= _JUDGE_NS:
                del self._unjudged[number]
                self._judge(connection)
        for watch in self._states:
            self._adopt(watch)
            for about, make in watch.look(now_ns):
                measured += 1
                self._cooldown.state(watch.rule, about, now_ns, make)
        self._look_ns = now_ns + LOOK_NS * (1 + measured // _MANY)
        self._cooldown.flush(now_ns)

    def _adopt(self, watch: StateWatch) -> None:
        """Pass the connections without a transaction so far to the watch of a rule."""
        for number, connection in self._open.items():
            if number not in watch.connections:
                pair = self._pairs.of(connection)
                if self._covers(watch.rule, pair):
                    watch.opened(connection, pair, self.now_ns)

    # ---- alerts -----------------------------------------------------------------------------------------------------

    def _judge(self, connection: Connection) -> None:
        watch = self._watch
        if watch is not None:
            for deviation in watch.connection(self._pairs.of(connection), connection):
                self._deviates(deviation, connection)

    def _deviates(self, deviation: Deviation, connection: Connection) -> None:
        for rule in self._new_rules:
            if deviation.kind in rule.kinds and self._covers(rule, deviation.pair):
                make = partial(_new, rule, deviation, int(connection.number))
                about = (deviation.kind, deviation.pair, deviation.what)
                self._cooldown.event(rule, about, self.now_ns, make)

    def _found(self, rule: Rule, finding: Finding, pair: Pair | None, now_ns: int) -> Alert:
        text = f"{finding.rule.sentence} {finding.detail}".rstrip()
        detail: dict[str, object] = {"finding": finding_as_dict(finding, self._places)}
        severity = rule.severity or finding.severity
        return Alert(rule, now_ns, severity, pair, text, detail, int(finding.connection))

    def _covers(self, rule: Rule, pair: Pair) -> bool:
        if rule.anyone:
            return True
        known = self._covered.get((rule, pair))
        if known is None:
            if len(self._covered) > 16384:
                self._covered.clear()
            known = self._covered[rule, pair] = rule.covers(pair)
        return known

    def _pass_on(self, alert: Alert) -> None:
        self.count += 1
        if self._tell is not None:
            self._tell(alert)


def _new(rule: Rule, deviation: Deviation, connection: int, now_ns: int) -> Alert:
    detail: dict[str, object] = {"new": {"kind": deviation.kind, "what": deviation.what}}
    return Alert(rule, now_ns, rule.severity or WARNING, deviation.pair, deviation.text, detail, connection)


def _troubled(rule: Rule, kind: str, text: str, over: bool, now_ns: int) -> Alert:
    severity = NOTE if over else rule.severity or WARNING
    return Alert(rule, now_ns, severity, None, text, {"problem": {"kind": kind, "over": over}})
