"""`Cooldown` limits how often a rule gives alerts: the first at once, then one per cooldown with the number of suppressed ones.

The number of different alerts is limited, too: a rule gives `Rule.burst` alerts of one kind and severity a minute, then one
that sums up the rest. So a flood of warnings cannot hide an error.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Final

from dissect.meaning.report import words
from dissect.online.alerts.alert import Alert
from dissect.online.alerts.rules import FINDING, Rule
from dissect.wire.text import Clock

#: Greatest number of different things that are remembered; a new one replaces the oldest.
MAX_REMEMBERED: Final = 16384
#: Interval (capture time) of the checks of all entries; it grows with every this many entries.
_FLUSH_NS: Final = 1_000_000_000
_MANY: Final = 1024
#: At most this many servers get their first alert of a minute beyond the limit `Rule.burst`, or are named in a summary.
MAX_SERVERS: Final = 100
_NAMED: Final = 3
#: The period for the limit `Rule.burst`.
BURST_NS: Final = 60_000_000_000

#: Makes an alert; called with the time, only when the alert is given.
Make = Callable[[int], Alert]


class _Reported:
    """The memory of one thing that a rule may report."""

    __slots__ = ("counted", "looked_ns", "make", "repeated", "since_ns", "spoken", "told_ns")

    def __init__(self, make: Make) -> None:
        self.make = make
        self.told_ns = 0
        self.spoken = False  # whether an alert was given
        self.repeated = 0  # how often it happened since then, without an alert
        self.since_ns = -1  # for a state: when it began, -1 while it does not hold
        self.looked_ns = 0  # when it was last found to hold
        self.counted = False  # an alert was given for this duration of the state, or counted


class _Burst:
    """The alerts of one kind and severity that a rule gave since ``since_ns``, and those held back."""

    __slots__ = ("further", "given", "held", "last", "servers", "since_ns")

    def __init__(self, since_ns: int) -> None:
        self.since_ns = since_ns
        self.given = 0
        self.held = 0
        self.last: Alert | None = None
        self.servers: set[str] = set()  # servers whose alerts were given
        self.further: dict[str, None] = {}  # servers of which all alerts were held back

    def spares(self, alert: Alert) -> bool:
        """Return whether an alert is given beyond the limit: the first alert of a server, so that a flood does not hide it."""
        server = alert.pair[1] if alert.pair is not None else ""
        if not server or server in self.servers:
            return False
        if len(self.servers) < MAX_SERVERS:
            return True
        if len(self.further) < MAX_SERVERS:
            self.further[server] = None
        return False


class Cooldown:
    """Passes alerts on to ``tell``. ``crowded`` counts things that were forgotten because there were too many."""

    def __init__(self, tell: Callable[[Alert], None]) -> None:
        self.crowded = 0
        self._tell = tell
        self._flush_ns = 0
        self._told: OrderedDict[tuple[Rule, Hashable], _Reported] = OrderedDict()
        self._bursts: dict[tuple[Rule, str, str], _Burst] = {}

    def event(self, rule: Rule, about: Hashable, now_ns: int, make: Make) -> None:
        """Take an event that ``rule`` looks for; events with the same ``about`` are alike."""
        told = self._entry(rule, about, make)
        told.make = make
        self._speak(rule, told, now_ns)

    def more(self, rule: Rule, about: Hashable, number: int, now_ns: int, make: Make) -> None:
        """Take ``number`` events at once; they are reported with the next alert about the same subject."""
        told = self._entry(rule, about, make)
        if told.spoken:
            told.repeated += number
            return
        told.make = make
        told.repeated = number - 1
        self._say(told, now_ns)

    def state(self, rule: Rule, about: Hashable, now_ns: int, make: Make | None) -> None:
        """Note that the state of ``rule`` is present, or (``make`` is None) absent."""
        if make is None:
            known = self._told.get((rule, about))
            if known is not None:
                known.since_ns = -1
            return
        told = self._entry(rule, about, make)
        told.make = make
        if told.since_ns < 0:
            told.since_ns = now_ns
            told.counted = False
        told.looked_ns = now_ns
        if now_ns - told.since_ns < rule.for_ns:
            return
        if not told.counted:
            told.counted = True
            self._speak(rule, told, now_ns)
        elif now_ns - told.told_ns >= rule.cooldown_ns and not rule.once:
            self._say(told, now_ns)  # the state lasts

    def flush(self, now_ns: int, over: bool = False) -> None:
        """Give the held-back alerts whose time has come; all of them if the run is ``over``.

        A state that was not reported at ``now_ns`` is taken as over, because its connection is gone.
        """
        if now_ns < self._flush_ns and not over:
            return
        self._flush_ns = now_ns + _FLUSH_NS * (1 + len(self._told) // _MANY)
        for key, told in list(self._told.items()):
            rule = key[0]
            if told.looked_ns < now_ns:
                told.since_ns = -1
            waited = now_ns - told.told_ns >= rule.cooldown_ns
            if told.repeated and (waited or over) and not rule.once:
                told.repeated -= 1  # one of them is reported by the alert itself
                self._say(told, now_ns)
            elif waited and not told.repeated and not rule.once and told.since_ns < 0:
                del self._told[key]
        for kind, burst in list(self._bursts.items()):
            if over or now_ns - burst.since_ns >= BURST_NS:
                del self._bursts[kind]
                self._sum_up(burst, now_ns)

    def rewind(self, now_ns: int) -> None:
        """The clock was set back to ``now_ns``: limit all remembered times to it."""
        self._flush_ns = now_ns
        for told in self._told.values():
            told.looked_ns = 0
            told.told_ns = min(told.told_ns, now_ns)
            told.since_ns = -1
        for burst in self._bursts.values():
            burst.since_ns = min(burst.since_ns, now_ns)

    def _entry(self, rule: Rule, about: Hashable, make: Make) -> _Reported:
        key = (rule, about)
        told = self._told.get(key)
        if told is None:
            if len(self._told) >= MAX_REMEMBERED:
                self.crowded += 1
                self._told.popitem(last=False)
            told = self._told[key] = _Reported(make)
        return told

    def _speak(self, rule: Rule, told: _Reported, now_ns: int) -> None:
        if not told.spoken or (not rule.once and now_ns - told.told_ns >= rule.cooldown_ns):
            self._say(told, now_ns)
        else:
            told.repeated += 1

    def _say(self, told: _Reported, now_ns: int) -> None:
        alert = told.make(now_ns)
        alert.repeated = told.repeated
        if told.since_ns >= 0:
            alert.since_ns = told.since_ns
        told.spoken = True
        told.told_ns = now_ns
        told.repeated = 0
        self._give(alert, now_ns)

    def _give(self, alert: Alert, now_ns: int) -> None:
        """Give an alert, or hold it back if its rule has given enough of its kind."""
        rule = alert.rule
        if not rule.burst:
            self._tell(alert)
            return
        key = (rule, alert.severity, alert.kind)
        burst = self._bursts.get(key)
        if burst is None or now_ns - burst.since_ns >= BURST_NS:
            if burst is not None:
                self._sum_up(burst, now_ns)
            burst = self._bursts[key] = _Burst(now_ns)
        if burst.given < rule.burst or (rule.when == FINDING and burst.spares(alert)):
            burst.given += 1
            if alert.pair is not None and len(burst.servers) < MAX_SERVERS:
                burst.servers.add(alert.pair[1])
            self._tell(alert)
        else:
            burst.held += 1
            burst.last = alert

    def _sum_up(self, burst: _Burst, now_ns: int) -> None:
        """Give one alert that sums up those that were held back."""
        last = burst.last
        if last is None:
            return
        what = f" ({last.kind})" if last.kind else ""
        span = words.duration(max(now_ns - burst.since_ns, 1))
        text = f"{words.count(burst.held, 'more alert')}{what} in {span}{_further(burst)}; the last: {last.text}"
        summary: dict[str, object] = {"alerts": burst.held, "kind": last.kind, "since": Clock().iso(burst.since_ns)}
        alert = Alert(
            last.rule, now_ns, last.severity, last.pair, text, {"summary": summary, **last.detail}, last.connection
        )
        alert.repeated = burst.held
        self._tell(alert)


def _further(burst: _Burst) -> str:
    """Return the servers of which every alert was held back."""
    if not burst.further:
        return ""
    named = ", ".join(list(burst.further)[:_NAMED])
    more = f" and {len(burst.further) - _NAMED} more" if len(burst.further) > _NAMED else ""
    least = "at least " if len(burst.further) == MAX_SERVERS else ""
    return f", of {least}{words.count(len(burst.further), 'further server')} {named}{more}"
