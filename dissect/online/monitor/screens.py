"""The other screens: a page of details or help, and the values of variables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Final

from rich.text import Text
from textual.app import ComposeResult
from textual.binding import Binding, BindingType
from textual.events import Resize
from textual.screen import Screen
from textual.widget import Widget

from dissect.meaning.report.styled import HEADING, Line
from dissect.online.monitor.panes import Page, ValuesPane
from dissect.online.monitor.rows import LEGEND, fit


class Bar(Widget):
    """One line: ``left`` and, if there is room, ``right``."""

    def __init__(self, name: str, reverse: bool = False) -> None:
        super().__init__(id=name)
        self.left = ""
        self.right = ""
        self._reverse = reverse

    def say(self, left: str, right: str = "") -> None:
        """Show these texts."""
        if (left, right) != (self.left, self.right):
            self.left, self.right = left, right
            self.refresh()

    def render(self) -> Text:
        """Draw the line."""
        width = self.size.width
        room = max(width - len(self.right) - 1, 0) if self.right else width
        said = f"{fit(self.left, room)} {self.right}" if self.right else fit(self.left, room)
        return Text(fit(said, width), style="reverse" if self._reverse else "", no_wrap=True, end="")


class PageScreen(Screen[None]):
    """Lines to read, such as a transaction with its field tree."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,enter,backspace,left", "dismiss", show=False)]

    def __init__(self, title: str, lines: Sequence[Line]) -> None:
        super().__init__()
        self.page = Page(lines)
        self.foot = Bar("foot")
        self._head = Bar("head", reverse=True)
        self._title = title

    def compose(self) -> ComposeResult:
        """Lay out the page between a title and the line of keys."""
        yield self._head
        yield self.page
        yield self.foot

    def on_mount(self) -> None:
        """Begin at the first line."""
        self.page.focus()
        self.foot.say("Esc back  ↑ ↓ PgUp PgDn Home End scroll  s save  q quit")

    def on_resize(self, _event: Resize) -> None:
        """Show again which lines are visible."""
        self.call_after_refresh(self._place)

    def on_page_moved(self) -> None:
        """Show again which lines are visible."""
        self._place()

    def _place(self) -> None:
        self._head.say(self._title, self.page.place)


class ValuesScreen(Screen[None]):
    """Watched variables with their trends, updated while they are shown."""

    BINDINGS: ClassVar[list[BindingType]] = [Binding("escape,v,backspace,left", "dismiss", show=False)]

    def __init__(self, pane: ValuesPane) -> None:
        super().__init__()
        self.pane = pane
        self.head = Bar("head", reverse=True)
        self.foot = Bar("foot")

    def compose(self) -> ComposeResult:
        """Lay out the variables between the status line and the line of keys."""
        yield self.head
        yield self.pane
        yield self.foot

    def on_mount(self) -> None:
        """Begin at the first variable."""
        self.pane.focus()
        self.foot.say("Esc back  ↑ ↓ PgUp PgDn Home End move  Enter details  s save  q quit")


HELP: Final = (
    Line("Panes", HEADING),
    Line("  Tab, Shift+Tab   next or previous pane", "", 19),
    Line("  ↑ ↓ PgUp PgDn    move; also k j b Space", "", 19),
    Line("  Home End         first and last; also g G. In the transactions, End follows new ones", "", 19),
    Line("  Enter            details of the row: fields and bytes, a connection, all findings of a rule", "", 19),
    Line("  z                this pane only, or all panes", "", 19),
    Line("  v                the values of variables, when they changed and by whom, with a trend", "", 19),
    Line(""),
    Line("Time", HEADING),
    Line("  p                pause: the screen stops, the capture continues", "", 19),
    Line("  F                freeze: the transactions stop scrolling; moving up in them does the same", "", 19),
    Line(""),
    Line("Filter", HEADING),
    Line("  /                what of the transactions to show: words that occur in the addresses of the ends, the function, "
         "the addresses asked for, and the errors; failed, slow; c12 for connection 12. Nothing: all", "", 19),
    Line("  f                an expression as option -Y takes it, such as latency > 20ms (`s7dissect help select`); the words "
         "of / narrow it further. Nothing: all", "", 19),
    Line("  e                failed only, on or off", "", 19),
    Line("  l                slow (late) only, on or off", "", 19),
    Line(""),
    Line("Keeping", HEADING),
    Line("  s                save the shown text to a new file in the working directory", "", 19),
    Line(""),
    Line("Reading", HEADING),
    *[Line(f"  {sign:<16} {meaning}", "", 19) for sign, meaning in LEGEND],
    Line(""),
    Line("  q, Ctrl+C        quit", "", 19),
)  # fmt: skip
