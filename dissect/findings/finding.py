"""A finding: something in the traffic that deserves attention, with the frames that show it."""

from __future__ import annotations

from typing import Final

from mypy_extensions import i64

ERROR: Final = "error"
WARNING: Final = "warning"
NOTE: Final = "note"

#: Severities from the heaviest to the lightest.
SEVERITIES: Final = (ERROR, WARNING, NOTE)


class Rule:
    """One row of the catalogue: a stable slug, how much it weighs, one sentence, and what to do about it."""

    __slots__ = ("advice", "sentence", "severity", "slug")

    def __init__(self, slug: str, severity: str, sentence: str, advice: str) -> None:
        self.slug = slug
        self.severity = severity
        self.sentence = sentence
        self.advice = advice


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
