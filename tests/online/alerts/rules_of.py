"""Rules from a few lines of TOML, and an engine that keeps its alerts."""

from __future__ import annotations

from dissect.online.alerts import Alert, AlertEngine, Rule
from dissect.online.alerts.loading import parse_rules
from dissect.output.baseline import Baseline
from tests.output.baseline.wire import Wire, at_ns


class Kept(AlertEngine):
    """An engine with its alerts."""

    def __init__(self, toml: str, baseline: Baseline | None = None) -> None:
        self.alerts: list[Alert] = []
        super().__init__(parse_rules(f'[[rule]]\nname = "rule"\n{toml}\n'), baseline, self.alerts.append)
        self.wire = Wire(self)

    @property
    def texts(self) -> list[str]:
        return [alert.text for alert in self.alerts]

    def ticks(self, begin: float, end: float, step: float = 0.5) -> None:
        """Let time pass on a silent line."""
        for number in range(int((end - begin) / step) + 1):
            self.tick(at_ns(begin + number * step))

    def over(self) -> None:
        """End the capture."""
        self.wire.finish()
        self.finish()


def rule(name: str = "rule", when: str = "finding", actions: tuple[str, ...] = ("stderr",)) -> Rule:
    return Rule(name, when, actions=actions)


def alert(
    text: str = "something happened",
    *,
    name: str = "rule",
    actions: tuple[str, ...] = ("stderr",),
    severity: str = "warning",
) -> Alert:
    detail: dict[str, object] = {"new": {"kind": "write", "what": "DB12"}}
    return Alert(rule(name, "new", actions), at_ns(1.5), severity, ("10.0.0.1", "10.0.0.2"), text, detail, 7)
