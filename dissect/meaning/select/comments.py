"""A finding as a packet comment, which Wireshark shows."""

from __future__ import annotations

from typing import Final

from dissect.engine.findings.reporter import Finding
from dissect.wire.text import printable, some

#: The beginning of all our comments, by which a display filter finds them: ``frame.comment contains "s7dissect:"``.
MARK: Final = "s7dissect:"

#: Maximum number of frames of a finding that are named in a comment.
_NAMED: Final = 8


def finding_comment(finding: Finding) -> str:
    """Return one line: mark, severity, slug, sentence and detail, and the connection."""
    said = finding.rule.sentence
    if finding.detail:
        said = f"{said} {finding.detail}"
    where = f" (connection {finding.connection})" if finding.connection else ""
    return printable(f"{MARK} {finding.severity} {finding.slug}: {said}{where}")


def frames_in_words(frames: list[int]) -> str:
    """Return packet numbers as text, the first few of them: ``packet 8``, ``packets 8, 9 and 3 more``."""
    if not frames:
        return "the capture"
    return f"packet{'s' if len(frames) > 1 else ''} {some([str(frame) for frame in frames], _NAMED)}"
