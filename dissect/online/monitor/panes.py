"""The lists of the main screen and the page of details, as widgets. They draw only the rows for which there is room.

Text is drawn as `rich.text.Text`, never as markup, so that text from a device cannot contain commands for the terminal.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import ClassVar, Final, Generic, TypeVar

from rich.text import Text
from textual.binding import Binding, BindingType
from textual.message import Message
from textual.widget import Widget

from dissect.engine.findings.catalogue import ERROR
from dissect.meaning.report.styled import Line
from dissect.meaning.report.words import Places
from dissect.online.monitor import rows
from dissect.online.monitor.entries import Entry
from dissect.online.monitor.lists import ConnectionFacts, FindingFacts
from dissect.online.monitor.rows import Piece
from dissect.online.monitor.watched import WatchedFacts
from dissect.wire.text import Clock

Row = TypeVar("Row")

#: Styles for the lines of a report.
_LINE_STYLES: Final = {"heading": "bold", "error": rows.BAD, "warning": rows.ODD, "note": "", "dim": rows.DIM, "": ""}

_MOVES: Final[list[BindingType]] = [
    Binding("up,k", "move(-1)", show=False),
    Binding("down,j", "move(1)", show=False),
    Binding("pageup,b", "page(-1)", show=False),
    Binding("pagedown,space", "page(1)", show=False),
    Binding("home,g", "home", show=False),
    Binding("end,G", "end", show=False),
]


def drawn(lines: Sequence[Sequence[Piece]], styles: Sequence[str], width: int) -> Text:
    """Return lines of pieces as text; each line gets a style of its own and is filled to ``width``."""
    text = Text(no_wrap=True, overflow="crop", end="")
    for number, (pieces, style) in enumerate(zip(lines, styles, strict=True)):
        line = Text(no_wrap=True, overflow="crop", end="")
        for piece, piece_style in pieces:
            line.append(piece, piece_style or None)
        line.truncate(width, overflow="crop", pad=True)
        if style:
            line.stylize(style)
        if number:
            text.append("\n")
        text.append_text(line)
    return text


class Pane(Widget, Generic[Row], can_focus=True):
    """A list with a heading and a cursor. The cursor stays on its row while others come and go.

    ``draw`` returns the text of a row for a width in columns; ``key`` returns the permanent key of a row.
    """

    BINDINGS: ClassVar[list[BindingType]] = [*_MOVES, Binding("enter", "open", show=False)]

    class Opened(Message):
        """The user opened the row under the cursor."""

        def __init__(self, pane: Pane[Row]) -> None:
            super().__init__()
            self.pane = pane

    def __init__(self, name: str, draw: Callable[[Row, int], list[Piece]], key: Callable[[Row], object]) -> None:
        super().__init__(id=name)
        self._draw = draw
        self._key = key
        self.rows: list[Row] = []
        self.title = ""
        self.cursor = 0
        self._top = 0

    @property
    def selected(self) -> Row | None:
        """The row under the cursor."""
        return self.rows[self.cursor] if self.cursor < len(self.rows) else None

    def update_rows(self, fresh: list[Row], title: str) -> None:
        """Show these rows."""
        if fresh == self.rows and title == self.title:
            return
        before = self.selected
        self.rows = fresh
        self.title = title
        self._keep_cursor(before)
        self.refresh()

    def render(self) -> Text:
        """Draw the heading and as many rows as fit."""
        width, height = self.size.width, self.size.height
        room = max(height - 1, 0)
        self._top = self._first(room)
        shown = self.rows[self._top : self._top + room]
        mark = "▶ " if self.has_focus else "  "
        hidden = self._hidden(len(shown))
        lines: list[Sequence[Piece]] = [[(self.heading(f"{mark}{self.title}{hidden}", width), "")]]
        styles = ["bold reverse" if self.has_focus else "underline"]
        for at, row in enumerate(shown, self._top):
            lines.append(self._draw(row, width))
            styles.append("reverse" if at == self.cursor and self.has_focus else "")
        return drawn(lines, styles, width)

    def _first(self, room: int) -> int:
        """Return the index of the first row to show: 0 without focus, else so that the cursor is visible."""
        if not self.has_focus:
            return 0
        return min(max(self._top, self.cursor - room + 1, 0), self.cursor, max(len(self.rows) - room, 0))

    def _hidden(self, shown: int) -> str:
        """Return in words how many rows are hidden."""
        below = len(self.rows) - self._top - shown
        parts = [f"{self._top} more above"] if self._top else []
        parts += [f"{below} more below" if self._top else f"{below} more"] if below > 0 else []
        return f"  ({', '.join(parts)})" if parts else ""

    def heading(self, title: str, width: int) -> str:
        """Return the heading."""
        return rows.fit(title, width)

    def _keep_cursor(self, before: Row | None) -> None:
        if not self.has_focus and not self.cursor:
            return  # the user has not chosen a row: the cursor stays on top
        if before is not None:
            key = self._key(before)
            for at, row in enumerate(self.rows):
                if self._key(row) == key:
                    self.cursor = at
                    return
        self.cursor = min(self.cursor, max(len(self.rows) - 1, 0))

    def move_to(self, at: int) -> None:
        """Put the cursor on row ``at``, or the nearest that exists."""
        self.cursor = min(max(at, 0), max(len(self.rows) - 1, 0))
        self.refresh()

    def action_move(self, by: int) -> None:
        """Move the cursor by rows."""
        self.move_to(self.cursor + by)

    def action_page(self, by: int) -> None:
        """Move the cursor by pages."""
        self.move_to(self.cursor + by * max(self.size.height - 2, 1))

    def action_home(self) -> None:
        """Go to the first row."""
        self.move_to(0)

    def action_end(self) -> None:
        """Go to the last row."""
        self.move_to(len(self.rows) - 1)

    def action_open(self) -> None:
        """Open the details of the selected row."""
        if self.selected is not None:
            self.post_message(self.Opened(self))


class ConnectionsPane(Pane[ConnectionFacts]):
    """The connections."""

    def __init__(self, places: Places = rows.PLACES) -> None:
        look = rows.Look(rows.sparks(), places)
        super().__init__("connections", lambda row, width: rows.connection_row(row, width, look), lambda row: row.key)

    def heading(self, title: str, width: int) -> str:
        """Return the title and the headings of the columns."""
        return rows.connection_heads(title, width)


class FindingsPane(Pane[FindingFacts]):
    """The findings by their rules; ``clock`` writes times, ``places`` names hosts."""

    def __init__(self, clock: Clock | None = None, places: Places = rows.PLACES) -> None:
        shown = clock or Clock()
        super().__init__(
            "findings", lambda row, width: rows.finding_row(row, width, shown, places), lambda row: row.key
        )

    @property
    def errors(self) -> int:
        """The number of rows that are errors; these come first."""
        return len([row for row in self.rows if row.rule.severity == ERROR])


class EntriesPane(Pane[Entry]):
    """The rolling list of entries, the newest last.

    While the cursor is on the last row it stays on the newest; when it is moved away, the list is frozen.
    """

    def __init__(self, clock: Clock | None = None, places: Places = rows.PLACES) -> None:
        shown = clock or Clock()
        super().__init__(
            "transactions", lambda row, width: rows.entry_row(row, width, shown, places), lambda row: row.order
        )
        self.frozen = False
        self._latest: list[Entry] = []

    def update_rows(self, fresh: list[Entry], title: str) -> None:
        """Show these rows with the cursor on the last; while the list is frozen, only keep them for later."""
        self._latest = fresh
        if self.frozen:
            fresh = self.rows
        if title == self.title and fresh[-1:] == self.rows[-1:] and len(fresh) == len(self.rows):
            return
        self.rows, self.title = fresh, title
        if not self.frozen:
            self.cursor = max(len(fresh) - 1, 0)
        self.refresh()

    def _first(self, room: int) -> int:
        """Return the index of the first row to show, so that the cursor is visible."""
        return min(max(self._top, self.cursor - room + 1, 0), self.cursor, max(len(self.rows) - room, 0))

    def _hidden(self, shown: int) -> str:
        """Return an empty text: the title counts the entries."""
        return ""

    def freeze(self, frozen: bool) -> None:
        """Freeze the list, or continue with the entries that came since."""
        self.frozen = frozen
        if not frozen:
            self.rows = self._latest
            self.cursor = max(len(self.rows) - 1, 0)
        self.refresh()

    def replace(self, fresh: list[Entry]) -> None:
        """Show other rows after the filter has changed."""
        self._latest = fresh
        self.freeze(False)

    @property
    def held_back(self) -> int:
        """The number of entries that are newer than the last one shown."""
        if not self._latest:
            return 0
        return self._latest[-1].order - (self.rows[-1].order if self.rows else 0)

    def move_to(self, at: int) -> None:
        """Put the cursor on a row; any row but the last freezes the list."""
        if not self.frozen and at < len(self.rows) - 1:
            self.frozen = True
        super().move_to(at)

    def action_end(self) -> None:
        """Go to the newest entry, and follow new ones."""
        self.freeze(False)


class ValuesPane(Pane[WatchedFacts]):
    """Watched variables. ``now_ns`` is the time by the clock of the capture at which trends end."""

    def __init__(self, clock: Clock | None = None, places: Places = rows.PLACES) -> None:
        look = rows.Look(rows.sparks(), places)
        shown = clock or Clock()
        self.now_ns = 0
        super().__init__(
            "values",
            lambda row, width: rows.watched_row(row, width, shown, look, self.now_ns),
            lambda row: row.variable,
        )

    def heading(self, title: str, width: int) -> str:
        """Return the title and the headings of the columns."""
        return rows.watched_heads(title, width)

    def update_values(self, fresh: list[WatchedFacts], title: str, now_ns: int) -> None:
        """Show variables with their present values; the row objects may be the same as before."""
        self.now_ns = now_ns
        self.update_rows(fresh, title)
        self.refresh()


class Page(Widget, can_focus=True):
    """Lines to read, wrapped to the width of the widget."""

    BINDINGS: ClassVar[list[BindingType]] = _MOVES

    def __init__(self, lines: Sequence[Line]) -> None:
        super().__init__(id="page")
        self.lines = list(lines)
        self.top = 0
        self._wrapped: list[tuple[str, str]] = []
        self._width = -1

    @property
    def place(self) -> str:
        """Which lines are visible, and how many there are."""
        total = len(self._fitted())
        last = min(self.top + self.size.height, total)
        return "" if self.top == 0 and last == total else f"lines {self.top + 1}-{last} of {total}"

    def render(self) -> Text:
        """Draw the lines for which there is room."""
        fitted = self._fitted()
        self.top = min(max(self.top, 0), max(len(fitted) - self.size.height, 0))
        shown = fitted[self.top : self.top + self.size.height]
        return drawn([[(text, "")] for text, _ in shown], [style for _, style in shown], self.size.width)

    def _fitted(self) -> list[tuple[str, str]]:
        width = max(self.size.width, 20)
        if width != self._width:
            self._width = width
            self._wrapped = [
                (text, _LINE_STYLES[line.style]) for line in self.lines for text in line.wrapped(width) or [""]
            ]
        return self._wrapped

    def action_move(self, by: int) -> None:
        """Scroll by lines."""
        self.top = min(max(self.top + by, 0), max(len(self._fitted()) - self.size.height, 0))
        self.refresh()
        self.post_message(self.Moved())

    class Moved(Message):
        """The visible lines have changed."""

    def action_page(self, by: int) -> None:
        """Scroll by pages."""
        self.action_move(by * max(self.size.height - 1, 1))

    def action_home(self) -> None:
        """Go to the first line."""
        self.action_move(-len(self._fitted()))

    def action_end(self) -> None:
        """Go to the last line."""
        self.action_move(len(self._fitted()))
