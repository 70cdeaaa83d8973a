"""Lines for a person: a text, how it looks, and how it is wrapped where there is too little room."""

from __future__ import annotations

from typing import Final, NamedTuple

HEADING: Final = "heading"
DIM: Final = "dim"
#: A line of what failed, among others.
FAILED: Final = "failed"
#: Further styles are the severities; the default leaves a line plain.
PLAIN: Final = ""
#: Where the continuation of a line begins that tells of one thing: a transaction, an operation, a PDU.
HANG: Final = 6
#: The same of a field in a tree, below its value.
TREE_HANG: Final = 33


class Line(NamedTuple):
    """One line of the report: its text, what it weighs, and where its continuation begins if a terminal is too narrow.

    Several lines that look alike, such as those of a field tree, may stand in one text with line feeds between them.
    """

    text: str
    style: str = PLAIN
    hang: int = 0

    def wrapped(self, width: int) -> list[str]:
        """Return the line as lines of at most ``width`` columns; a word that is longer stays whole.

        It is broken between words, or between fields (which stand two blanks apart) where a whole field fits on the next line.
        """
        text = self.text
        if "\n" in text:
            return [piece for line in text.split("\n") for piece in Line(line, self.style, self.hang).wrapped(width)]
        indent = self.hang if self.hang <= width // 2 else len(text) - len(text.lstrip()) + 4
        lines: list[str] = []
        margin = ""
        while len(margin) + _columns(text) > width:
            at = _break(text, width - len(margin), width - indent)
            if at <= 0:
                break
            lines.append(margin + text[:at].rstrip())
            text = text[at:].lstrip()
            margin = " " * indent
        return [*lines, margin + text]


#: A line as a writer of records makes it: text, text with a style, or the octets that are to be written, in UTF-8.
Written = str | Line | bytes


def _columns(text: str) -> int:
    """Return the columns that a text takes on a terminal."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len  # late: what goes to a file needs no widths

    return cell_len(text)


def _break(text: str, room: int, room_after: int) -> int:
    """Return where to break ``text`` so that what stands before it takes ``room`` columns at most; 0 for nowhere.

    ``room_after`` columns there are on the next line.
    """
    begun = len(text) - len(text.lstrip())
    most, columns = len(text), 0
    for at, character in enumerate(text):
        columns += _columns(character)
        if columns > room:
            most = at
            break
    blank = text.rfind(" ", begun, most + 1)
    if blank <= begun:  # the first word alone is too long
        return max(text.find(" ", most), 0)
    gap = text.rfind("  ", begun, most + 1)
    if gap > room // 3:
        field = text[gap:].lstrip().split("  ", 1)[0]
        if _columns(field) <= room_after:
            return gap
    return blank
