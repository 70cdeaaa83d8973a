"""Lines of text: a text, its style, and how it is wrapped on a narrow terminal."""

from __future__ import annotations

from typing import Final, NamedTuple

HEADING: Final = "heading"
DIM: Final = "dim"
#: The line of something that failed, in a list of mostly successful ones.
FAILED: Final = "failed"
#: Further styles are the severities; the default leaves a line plain.
PLAIN: Final = ""
#: Column in which the wrapped line of a transaction, an operation or a PDU continues.
HANG: Final = 6
#: Column in which the wrapped line of a field in a tree continues: that of its value.
TREE_HANG: Final = 33


class Line(NamedTuple):
    """One line of a report: its text, its style, and the column in which it continues if a terminal is too narrow.

    Several lines of the same style, such as those of a field tree, may be one text with line feeds between them.
    """

    text: str
    style: str = PLAIN
    hang: int = 0

    def wrapped(self, width: int) -> list[str]:
        """Return the text as lines of at most ``width`` columns; a longer word stays whole.

        Lines are broken between words, or between fields (two blanks apart) if the next line has room for the whole field.
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


#: A line as a writer of records returns it: text, text with a style, or its octets in UTF-8.
Written = str | Line | bytes


def _columns(text: str) -> int:
    """Return the columns that a text takes on a terminal."""
    if text.isascii():
        return len(text)
    from rich.cells import cell_len  # late: output to a file is not wrapped

    return cell_len(text)


def _break(text: str, room: int, room_after: int) -> int:
    """Return the index at which to break ``text``: at most ``room`` columns come before it; 0 if it cannot be broken.

    The next line has ``room_after`` columns.
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
