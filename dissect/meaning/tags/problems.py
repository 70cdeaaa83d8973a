"""Problems of a file of tags: errors, warnings and notes, with file, line, the problem and the remedy."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.wire.text import shortened

ERROR: Final = "error"
WARNING: Final = "warning"
NOTE: Final = "note"
#: Maximum number of characters of a message, and of problems of one file that are kept.
_LONGEST: Final = 400
MAX_PROBLEMS: Final = 1000


class Problem(NamedTuple):
    """One problem. ``line`` counts from 1, 0 is the file as a whole; ``text`` states the problem and the remedy."""

    severity: str
    file: str
    line: int
    text: str

    def __str__(self) -> str:
        place = shortened(self.file, _LONGEST) + (f":{self.line}" if self.line else "")
        return f"{place}: {shortened(self.text, _LONGEST)}"


class Problems:
    """The problems of a file as they are found; beyond `MAX_PROBLEMS` they are only counted."""

    def __init__(self, file: str) -> None:
        self.file = file
        self.found: list[Problem] = []
        self.more = 0

    def error(self, line: int, text: str) -> None:
        """Note an error: the file cannot be used."""
        self._add(ERROR, line, text)

    def warning(self, line: int, text: str) -> None:
        """Note a warning: a row was left out, or something may mislead."""
        self._add(WARNING, line, text)

    def note(self, line: int, text: str) -> None:
        """Note something that is worth knowing."""
        self._add(NOTE, line, text)

    def _add(self, severity: str, line: int, text: str) -> None:
        if len(self.found) >= MAX_PROBLEMS:
            self.more += 1
        else:
            self.found.append(Problem(severity, self.file, line, text))
