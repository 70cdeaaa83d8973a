"""The sentence of a verdict about data that are missing from the capture."""

from __future__ import annotations

from typing import Final

from dissect.meaning.report import words
from dissect.output.page.gathered import Gathered
from dissect.output.page.numbers import counted

#: This many gaps that are all between messages cannot be an accident: packet loss does not depend on content.
_FILTERED: Final = 8


def gaps_in(gathered: Gathered) -> list[str]:
    """Return the sentence about the gaps of the whole capture; empty if it has none, or if the report covers a part of it."""
    analysis = gathered.analysis
    if analysis.pipeline is None or analysis.part is not None:
        return []
    octets = analysis.pipeline.counters.octets
    gaps, missing, inside = int(octets.holes), int(octets.missing), int(octets.inside)
    if not gaps:
        return []
    share = words.percent(missing, missing + int(octets.delivered))
    return [f"{counted(gaps, 'gap')}, {words.size(missing)}, {share}, {_where(gaps, inside, int(octets.skipped))}."]


def _where(gaps: int, inside: int, skipped: int) -> str:
    """Return where the gaps are; ``skipped``: captured bytes that belong to no message, as after a gap that ends inside one."""
    if inside:
        return f"{'inside a message' if gaps == 1 else f'{inside} of them inside messages'}: packets were lost"
    if skipped:
        return "begins between messages" if gaps == 1 else "all begin between messages"
    if gaps >= _FILTERED:
        return "all between messages: a filtered capture"
    return "between messages" if gaps == 1 else "all between messages"
