"""`Summary`: the outcome of `analyze`, for the formats of option -T."""

from __future__ import annotations

from collections.abc import Iterable, Mapping

from dissect.meaning.report.analysis import Analysis
from dissect.meaning.report.outcome import Outcome
from dissect.meaning.report.styled import Line
from dissect.wire.text import Clock


class Summary(Outcome):
    """An analysis as an outcome. ``interrupted``: reading was broken off. ``brief``: the text is the short form.

    ``clock`` writes the times of the text, by default in UTC. ``hosts`` are names of hosts by address, for the text.
    """

    def __init__(
        self,
        analysis: Analysis,
        interrupted: bool = False,
        clock: Clock | None = None,
        hosts: Mapping[str, str] | None = None,
        brief: bool = False,
    ) -> None:
        self.analysis = analysis
        self.interrupted = interrupted
        self.clock = clock or Clock()
        self.hosts = hosts
        self.brief = brief

    def text(self) -> Iterable[str | Line]:
        """Return the report."""
        if self.brief:
            from dissect.meaning.report.brief import brief_lines

            return brief_lines(self.analysis, self.interrupted, self.clock, self.hosts)
        from dissect.meaning.report.text import analysis_lines  # imported late: each form needs only its own module

        return analysis_lines(self.analysis, self.interrupted, self.clock, self.hosts)

    def as_dict(self) -> Mapping[str, object]:
        """Return the object of the JSON contract."""
        from dissect.meaning.report.contract import analysis_as_dict

        return analysis_as_dict(self.analysis, self.interrupted)

    def sections(self) -> Iterable[tuple[str, object]]:
        """Yield the sections of the JSON contract one by one."""
        from dissect.meaning.report.contract import analysis_sections

        return analysis_sections(self.analysis, self.interrupted)
