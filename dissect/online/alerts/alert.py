"""`Alert`: what a rule reports, as JSON for programs and as a line for people."""

from __future__ import annotations

import json
from typing import Final

from dissect.meaning.report import words
from dissect.online.alerts.rules import Rule
from dissect.output.baseline.subjects import Pair
from dissect.wire.text import Clock, encodable, printable, shortened

SCHEMA: Final = "s7dissect.alert/1"
#: At most this many characters of the text are on a line.
_MAX_TEXT: Final = 1000


class Alert:
    """One alert of a rule.

    ``text`` is a sentence. ``pair`` and ``connection`` (0: none) are the hosts concerned; ``detail`` has the observed values
    for JSON: ``finding``, ``new``, ``measured`` or ``problem``. ``repeated`` counts how often the alert was suppressed since it
    was last given. ``since_ns`` is when a lasting state began (0: an event). Texts may contain text from the wire, not escaped.
    """

    __slots__ = ("connection", "detail", "pair", "repeated", "rule", "severity", "since_ns", "text", "time_ns")

    def __init__(
        self,
        rule: Rule,
        time_ns: int,
        severity: str,
        pair: Pair | None,
        text: str,
        detail: dict[str, object],
        connection: int = 0,
    ) -> None:
        self.rule = rule
        self.time_ns = time_ns
        self.severity = severity
        self.pair = pair
        self.text = text
        self.detail = detail
        self.connection = connection
        self.repeated = 0
        self.since_ns = 0

    def __repr__(self) -> str:
        return f"Alert({self.rule.name!r}, {self.text!r}, repeated={self.repeated})"

    @property
    def kind(self) -> str:
        """The kind of the alert within its rule: the slug of a finding, the kind of a new thing or of a problem, or empty."""
        found, new = self.detail.get("finding"), self.detail.get("new") or self.detail.get("problem")
        if isinstance(found, dict):
            return str(found.get("slug", ""))
        return str(new.get("kind", "")) if isinstance(new, dict) else ""

    def as_dict(self) -> dict[str, object]:
        """Return the alert, JSON-ready (docs/alerts.md)."""
        clock = Clock()
        client, server = self.pair if self.pair is not None else (None, None)
        return {
            "schema": SCHEMA,
            "rule": self.rule.name,
            "when": self.rule.when,
            "severity": self.severity,
            "time": clock.iso(self.time_ns),
            "client": client,
            "server": server,
            "connection": self.connection or None,
            "text": encodable(self.text),
            "line": self.line(),
            "repeated": self.repeated,
            "since": clock.iso(self.since_ns) if self.since_ns else None,
            **self.detail,
        }

    def as_json(self) -> str:
        """Return the alert as one line of ASCII."""
        return json.dumps(self.as_dict()).replace("\x7f", "\\u007f")

    def message(self) -> str:
        """Return what happened on one line, without time and severity, safe for a terminal."""
        parts = [f"{printable(self.rule.name)}: {shortened(self.text, _MAX_TEXT)}"]
        if self.since_ns and self.time_ns > self.since_ns:
            parts.append(f"for {words.duration(self.time_ns - self.since_ns)}")
        if self.repeated:
            parts.append(f"{self.repeated} more")
        return ", ".join(parts)

    def line(self, clock: Clock | None = None) -> str:
        """Return the alert for a person, on one line; ``clock`` writes its time, by default in UTC."""
        return f"{(clock or Clock()).moment(self.time_ns)}  ALERT {self.severity}  {self.message()}"
