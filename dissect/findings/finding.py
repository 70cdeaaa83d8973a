"""A finding: something in the traffic that deserves attention, with the frames that show it."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

from dissect.findings.mitre import Technique

ERROR: Final = "error"
WARNING: Final = "warning"
NOTE: Final = "note"

#: Severities from the heaviest to the lightest.
SEVERITIES: Final = (ERROR, WARNING, NOTE)


#: What a rule is about: the capture itself; the bytes of a protocol; what was agreed on; requests and answers; what an
#: intruder would do; and what takes several requests.
CAPTURE: Final = "capture"
PROTOCOL: Final = "protocol"
NEGOTIATION: Final = "negotiation"
FUNCTION: Final = "function"
SECURITY: Final = "security"
OPERATION: Final = "operation"

KINDS: Final = (CAPTURE, PROTOCOL, NEGOTIATION, FUNCTION, SECURITY, OPERATION)


class Rule:
    """One row of the catalogue: a stable slug, how much it weighs, what it is about, one sentence, and what to do about it.

    ``techniques`` are the MITRE ATT&CK for ICS techniques that the finding may be part of; most rules have none.
    """

    __slots__ = ("advice", "kind", "sentence", "severity", "slug", "techniques")

    def __init__(
        self, slug: str, severity: str, kind: str, sentence: str, advice: str, techniques: tuple[Technique, ...] = ()
    ) -> None:
        self.slug = slug
        self.severity = severity
        self.kind = kind
        self.sentence = sentence
        self.advice = advice
        self.techniques = techniques

    def __repr__(self) -> str:
        return f"Rule({self.slug!r}, {self.severity!r})"


class Finding:
    """A rule that applied once.

    ``connection`` is the connection's number, 0 for the capture as a whole. ``frames`` are the packets that show it,
    ``time_ns`` the time of the last of them, ``detail`` what was seen this time.
    """

    __slots__ = ("connection", "detail", "frames", "rule", "time_ns")

    def __init__(self, rule: Rule, connection: i64, frames: list[int], time_ns: i64, detail: str) -> None:
        self.rule = rule
        self.connection: i64 = connection
        self.frames = frames
        self.time_ns: i64 = time_ns
        self.detail = detail

    def __repr__(self) -> str:
        return f"Finding({self.rule.slug!r}, connection={self.connection}, frames={self.frames})"

    @property
    def slug(self) -> str:
        """The rule's stable name."""
        return self.rule.slug

    @property
    def severity(self) -> str:
        """``error``, ``warning`` or ``note``."""
        return self.rule.severity
