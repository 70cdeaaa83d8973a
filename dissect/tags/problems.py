"""What is wrong with a file of tags, or worth knowing: file, line, what was found, what to do."""

from __future__ import annotations

from typing import Final, NamedTuple

from dissect.wire.text import shortened

ERROR: Final = "error"
WARNING: Final = "warning"
NOTE: Final = "note"
#: Characters of what a file says that a message repeats, and problems of one file that are kept.
_LONGEST: Final = 400
MAX_PROBLEMS: Final = 1000


class Problem(NamedTuple):
    """One of them. ``line`` counts from 1, 0 for the file as a whole; ``text`` says what is wrong and what to do about it."""

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
        """Note what makes the file unusable."""
        self._add(ERROR, line, text)

    def warning(self, line: int, text: str) -> None:
        """Note what costs a row or may mislead."""
        self._add(WARNING, line, text)

    def note(self, line: int, text: str) -> None:
        """Note what is worth knowing."""
        self._add(NOTE, line, text)

    def _add(self, severity: str, line: int, text: str) -> None:
        if len(self.found) >= MAX_PROBLEMS:
            self.more += 1
        else:
            self.found.append(Problem(severity, self.file, line, text))
