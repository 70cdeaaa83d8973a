"""The application of `s7dissect monitor`: connections, transactions as they come, findings, and the details of each.

It takes events from the session five times a second while there are some, else twice a second; a bounded number each time. It
redraws only what changed. The screen can be saved as text, but never over an existing file or through a symbolic link.
"""

from __future__ import annotations

import asyncio
import signal
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import ClassVar, Final

from textual.app import App, ComposeResult
from textual.binding import Binding, BindingType
from textual.events import Resize
from textual.widgets import Input

from dissect.engine.findings.catalogue import SEVERITIES
from dissect.files.recording.names import time_word
from dissect.meaning.report import words
from dissect.meaning.report.finding_lines import finding_lines
from dissect.meaning.report.happened import FactWording, times_of
from dissect.meaning.report.styled import HEADING, Line
from dissect.meaning.report.text import connection_lines
from dissect.meaning.report.words import Places
from dissect.meaning.select import SelectError, Where
from dissect.meaning.select.things import Context
from dissect.online.live.session import Session, Status
from dissect.online.monitor import details
from dissect.online.monitor.filter import FAILED, SLOW
from dissect.online.monitor.lists import FindingFacts
from dissect.online.monitor.model import Model
from dissect.online.monitor.panes import ConnectionsPane, EntriesPane, FindingsPane, Pane, ValuesPane
from dissect.online.monitor.rows import PLACES, entry_line
from dissect.online.monitor.screens import HELP, Bar, PageScreen, ValuesScreen
from dissect.output.variables.wanted import WantedSet
from dissect.output.variables.writers import value_line
from dissect.wire.text import Clock, printable, shortened

#: This many file names are tried before saving fails.
_TRIES: Final = 1000


def save(directory: Path, time_ns: int, lines: Iterable[str]) -> Path:
    """Write ``lines`` to a new file in ``directory``, named after a time; return its path. Raises OSError if that fails."""
    stem = f"s7dissect-{time_word(time_ns, Clock())}"
    for number in range(1, _TRIES):
        path = directory / (f"{stem}.txt" if number == 1 else f"{stem}-{number}.txt")
        try:
            file = path.open("x", encoding="utf-8", errors="backslashreplace", newline="\n")
        except FileExistsError:
            continue
        with file:
            file.writelines([f"{line}\n" for line in lines])
        return path
    raise FileExistsError(f"{directory}: too many files {stem}…")


#: Seconds until events are taken again: after some came, and after none did.
_BUSY_S: Final = 0.2
_QUIET_S: Final = 0.5
#: For this many seconds a message says that the screen was saved.
_SAID_S: Final = 6
#: At most this many events are taken at once.
_MOST: Final = 5000
#: Signals on which the application quits in order; Windows has no SIGHUP.
_SIGNALS: Final = tuple(getattr(signal, name) for name in ("SIGTERM", "SIGINT", "SIGHUP") if hasattr(signal, name))
#: Hints in the empty input line.
_WORDS: Final = "words, failed, slow, c12; Enter shows, Esc shows all"
_EXPRESSION: Final = "an expression, such as host == 192.168.0.1 and latency > 20ms; Enter shows, Esc shows all"
_END_KEYS: Final = "q quit  / filter  f select  Enter details  s save  ? help"
_KEYS: Final = "q quit  p pause  F freeze  / filter  f select  Enter details  s save  z zoom  v values  ? help"


def run_app(
    session: Session,
    slow_ns: int = 1_000_000_000,
    clock: Clock | None = None,
    where: Where | None = None,
    places: Places = PLACES,
    wanted: WantedSet | None = None,
) -> bool:
    """Show ``session``, which was started, until the user quits; return whether that was by a signal or Ctrl+C."""
    app = MonitorApp(session, slow_ns, clock=clock, where=where, places=places, wanted=wanted)
    return bool(app.run(mouse=False))


class MonitorApp(App[bool]):
    """The main screen. An answer later than ``slow_ns`` is shown as slow; files go to ``directory``, ``clock`` writes times.

    Only transactions that ``where`` selects are shown, until the user enters another expression. ``places`` has names of hosts.
    ``wanted`` variables are watched from the beginning; None means all, once the user opens the screen of values.
    """

    ENABLE_COMMAND_PALETTE = False
    CSS = """
    Screen { background: ansi_default; color: ansi_default; layout: vertical; }
    Bar { height: 1; }
    Pane { height: 1fr; }
    Page { height: 1fr; }
    Input, Input:focus { height: 1; border: none; padding: 0; background: ansi_default; color: ansi_default; display: none; }
    """
    BINDINGS: ClassVar[list[BindingType]] = [
        Binding("q", "quit", show=False),
        Binding("ctrl+c", "interrupt", show=False, priority=True),
        Binding("p", "pause", show=False),
        Binding("F", "freeze", show=False),
        Binding("f", "ask_select", show=False),
        Binding("slash", "ask_filter", show=False),
        Binding("e", "show_only('failed')", show=False),
        Binding("l", "show_only('slow')", show=False),
        Binding("s", "save", show=False),
        Binding("z", "zoom", show=False),
        Binding("v", "values", show=False),
        Binding("question_mark,f1,h", "help", show=False),
        Binding("escape", "leave_filter", show=False),
    ]

    def __init__(
        self,
        session: Session,
        slow_ns: int = 1_000_000_000,
        directory: Path | None = None,
        clock: Clock | None = None,
        where: Where | None = None,
        places: Places = PLACES,
        wanted: WantedSet | None = None,
    ) -> None:
        super().__init__(ansi_color=True)  # the terminal's own colours, and none with NO_COLOR
        self.model = Model(slow_ns)
        self._selecting = where.context if where is not None else Context(clock is not None and clock.local)
        self._selecting.start = lambda: int(session.run.pipeline.first_ns)
        self.model.select(where)
        self.paused = False
        self.zoomed = False
        self.head = Bar("head", reverse=True)
        self.foot = Bar("foot")
        self.connections = ConnectionsPane(places)
        self.entries = EntriesPane(clock, places)
        self.findings = FindingsPane(clock, places)
        self._panes: tuple[ConnectionsPane, EntriesPane, FindingsPane] = (self.connections, self.entries, self.findings)
        self._input = Input(placeholder=_WORDS)
        self._asked_select = False
        self._places = places
        if wanted is not None:
            self.model.watch(wanted)
        self._session = session
        self._directory = directory if directory is not None else Path()
        self._clock = clock or Clock()
        self._came_at_pause = 0
        self._second = 0.0
        self._height = 24
        self._told_end = False
        self._told = 0

    # ---- coming and going -------------------------------------------------------------------------------------------

    def compose(self) -> ComposeResult:
        """Lay out the panes between the status line and the line of keys."""
        yield self.head
        yield from self._panes
        yield self.foot
        yield self._input

    def on_mount(self) -> None:
        """Begin to take events."""
        loop = asyncio.get_running_loop()
        for number in _SIGNALS:
            with suppress(NotImplementedError):  # on Windows, event loops cannot handle signals, and Ctrl+C is a key
                loop.add_signal_handler(number, self.action_interrupt)
        self.entries.focus()
        self.foot.say(_KEYS)
        self.look()

    def on_unmount(self) -> None:
        """Remove the signal handlers."""
        loop = asyncio.get_running_loop()
        for number in _SIGNALS:
            with suppress(NotImplementedError):
                loop.remove_signal_handler(number)

    def action_interrupt(self) -> None:
        """Quit because of a signal."""
        self.exit(True)

    # ---- looking ----------------------------------------------------------------------------------------------------

    def look(self) -> None:
        """Take events, show them, and schedule the next look."""
        running = self._session.running  # checked before `poll`, so that the last events are taken
        events = self._session.poll(0.0, _MOST)
        self.model.take(events)
        now = time.monotonic()
        if events or now - self._second >= 1:
            self._second = now
            self.show()
        if not running and not self._session.waiting:
            self._tell_end()
            return
        self.set_timer(_BUSY_S if events else _QUIET_S, self.look)

    def show(self) -> None:
        """Bring the main screen up to date, unless it is paused."""
        status = self._session.status()
        if not self.paused and len(self.screen_stack) == 1:
            self._show_panes(status)
        if not self.paused and isinstance(self.screen, ValuesScreen):
            self._show_values(self.screen, status)
        self._show_head(status)
        if self.model.said > self._told:
            self.foot.say(printable(self.model.latest))
        self._told = self.model.said

    def _show_panes(self, status: Status) -> None:
        facts = self.model.connections(status.now_ns)
        left_out = f", {self.model.connections_left_out} not listed" if self.model.connections_left_out else ""
        title = f"CONNECTIONS {status.connections_open} open of {status.connections}{left_out}"
        self.connections.update_rows(facts, title)
        pipeline = self._session.run.pipeline
        counts = {
            slug: times_of(slug, number, pipeline.exchange.ledger)
            for slug, number in dict(pipeline.finding_counts).items()
        }
        found = self.model.findings(counts)
        self.findings.update_rows(found, self._findings_title(status, found))
        self.entries.update_rows(self.model.entries, self._entries_title(status))
        self._arrange()

    def _show_values(self, screen: ValuesScreen, status: Status) -> None:
        watched = self.model.watched
        if watched is None:
            return
        facts = watched.facts
        parts = [f"{watched.refused} refused"] if watched.refused else []
        parts += [f"{watched.not_listed} of others"] if watched.not_listed else []
        parts += [f"{watched.likely} only likely, left out"] if watched.likely else []
        title = f"VALUES {len(facts)}" + (f" ({', '.join(parts)})" if parts else "")
        screen.pane.update_values(facts, title, status.now_ns)

    def _findings_title(self, status: Status, found: list[FindingFacts]) -> str:
        """Return the title with the number of findings of each severity, the worst first."""
        if not status.findings:
            return "FINDINGS none"
        weights = {
            severity: sum([one.times for one in found if one.rule.severity == severity]) for severity in SEVERITIES
        }
        told = ", ".join([words.count(count, severity) for severity, count in weights.items() if count])
        return f"FINDINGS {status.findings} ({told})"

    def _entries_title(self, status: Status) -> str:
        odd = [f"{status.unanswered} unanswered"] if status.unanswered else []
        odd += [f"{status.with_errors} with errors"] if status.with_errors else []
        parts = [f"TRANSACTIONS {status.transactions}" + (f" ({', '.join(odd)})" if odd else "")]
        if status.open_requests:
            parts.append(f"{status.open_requests} open")
        if self.entries.frozen:
            parts.append(f"FROZEN, {self.entries.held_back} newer")
        wanted = self.model.wanted
        if not wanted.everything:
            missed = f" ({wanted.unsearched} not searched)" if wanted.unsearched else ""
            parts.append(f"filter: {shortened(wanted.text, 60)}{missed}")
        return "  ".join(parts)

    def _show_head(self, status: Status) -> None:
        session = self._session
        engine = f" ({session.engine})" if session.engine not in {"", "file"} else ""
        time_of_day = self._clock.time_of_day(status.now_ns)[:8]
        parts = [
            f"s7dissect {printable(session.run.file.name)}{engine}",
            f"{time_of_day} {self._clock.zone(status.now_ns)}",
        ]
        parts.append(words.count(status.packets, "packet"))
        if session.engine not in {"", "file"}:
            counted = [count for count in status.drops if count is not None]
            parts.append(f"{sum(counted)} LOST" if sum(counted) else ("0 lost" if counted else "loss unknown"))
        if status.lost_events:
            parts.append(f"{status.lost_events} NOT SHOWN")
        for bar in (self.head, *([self.screen.head] if isinstance(self.screen, ValuesScreen) else [])):
            bar.say("  ".join(parts), self._state())

    def _state(self) -> str:
        if self.paused:
            return f"PAUSED, {self.model.came - self._came_at_pause} new"
        if self._session.running:
            return "LIVE"
        return "BROKEN OFF" if self._session.error is not None or self._session.run.file.loss else "ENDED"

    def _tell_end(self) -> None:
        """Show once that the run is over; the screen stays."""
        if self._told_end:
            return
        self._told_end = True
        self.show()
        error = self._session.error
        why = str(error) or type(error).__name__ if error is not None else self._session.run.file.loss
        if why:
            self.foot.say(f"BROKEN OFF: {printable(why)}")
        elif not self.model.said:
            self.foot.say(f"the source has ended  {_END_KEYS}")

    # ---- room -------------------------------------------------------------------------------------------------------

    def on_resize(self, event: Resize) -> None:
        """Divide the space again."""
        self._height = event.size.height
        self._arrange()

    def _arrange(self) -> None:
        """Give each pane its height: connections and findings what they need, up to a quarter; transactions get the rest."""
        room = max(self._height - 2, 3)
        quarter = max(room // 4, 3)
        # All errors are shown, up to half of the height; a longer list says how many rows are hidden.
        share = {self.connections: quarter, self.findings: max(quarter, min(self.findings.errors + 1, room // 2))}
        for pane in self._panes:
            alone = self.zoomed and pane.has_focus
            pane.display = alone or not self.zoomed
            pane.styles.height = (
                "1fr" if pane is self.entries or alone else min(max(len(pane.rows) + 1, 2), share[pane])
            )

    def action_zoom(self) -> None:
        """Show the pane alone, or all of them."""
        self.zoomed = not self.zoomed and any([pane.has_focus for pane in self._panes])
        self._arrange()

    # ---- time -------------------------------------------------------------------------------------------------------

    def action_pause(self) -> None:
        """Pause the screen, or continue."""
        self.paused = not self.paused
        self._came_at_pause = self.model.came
        self.show()

    def action_freeze(self) -> None:
        """Freeze the list of transactions, or continue."""
        self.entries.freeze(not self.entries.frozen)
        self.show()

    # ---- the filter -------------------------------------------------------------------------------------------------

    def action_ask_filter(self) -> None:
        """Ask for words that select what to show."""
        self._ask(False, _WORDS, self.model.wanted.typed)

    def action_ask_select(self) -> None:
        """Ask for an expression that selects what to show."""
        where = self.model.wanted.where
        self._ask(True, _EXPRESSION, where.text if where is not None else "")

    def _ask(self, select: bool, hint: str, value: str) -> None:
        if len(self.screen_stack) > 1:
            return
        self._asked_select = select
        self.foot.display = False
        self._input.display = True
        self._input.placeholder = hint
        self._input.value = value
        self._input.focus()

    def on_input_submitted(self, event: Input.Submitted) -> None:
        """Apply the words or expression that the user entered; for an invalid expression show the error, and ask again."""
        if not self._asked_select:
            self._filter(event.value)
            return
        try:
            where = Where(event.value, context=self._selecting) if event.value.strip() else None
        except SelectError as error:
            self.foot.display = True
            self.foot.say(f"NOT SELECTED: {printable(error.reason)}")
            self._input.cursor_position = min(error.start, len(event.value))
            return
        self.model.select(where)
        self._filter(self.model.wanted.typed)

    def action_leave_filter(self) -> None:
        """Show everything again."""
        self.model.select(None)
        self._filter("")

    def action_show_only(self, word: str) -> None:
        """Show only failed or slow transactions, or all again."""
        self._filter(self.model.wanted.toggled({"failed": FAILED, "slow": SLOW}[word]))

    def _filter(self, typed: str) -> None:
        self._input.display = False
        self.foot.display = True
        self.foot.say(_KEYS)
        self.model.filter(typed)
        self.entries.replace(self.model.entries)
        self.entries.focus()
        status = self._session.status()
        self.entries.update_rows(self.model.entries, self._entries_title(status))

    # ---- what is behind ---------------------------------------------------------------------------------------------

    def on_pane_opened(self, event: Pane.Opened) -> None:
        """Show the details of a row."""
        if event.pane is self.connections and (one := self.connections.selected) is not None:
            self._open(
                f"Connection {one.key}", details.connection_details(one, self.model.entries, self._clock, self._places)
            )
        elif event.pane is self.findings and (found := self.findings.selected) is not None:
            self._open(f"Finding {found.key}", details.finding_details(found, self._places, self._facts(found)))
        elif event.pane is self.entries and (entry := self.entries.selected) is not None:
            what = entry.what
            title = "SCD message" if isinstance(what, tuple) else f"{type(what).__name__} {what.number}"
            self._open(title, details.entry_lines(entry, self._clock, self._places))
        elif isinstance(event.pane, ValuesPane) and (variable := event.pane.selected) is not None:
            self._open(
                f"Variable {variable.variable.name}", details.watched_details(variable, self._clock, self._places)
            )

    def action_values(self) -> None:
        """Show the values of variables."""
        if len(self.screen_stack) > 1:
            return
        if self.model.watched is None:
            self.model.watch(None)
        _ = self.push_screen(ValuesScreen(ValuesPane(self._clock, self._places)), self._back)
        self.call_after_refresh(self.show)

    def action_help(self) -> None:
        """Show the keys."""
        if len(self.screen_stack) == 1:
            self._open("Keys and signs", HELP)

    def _open(self, title: str, lines: Sequence[Line]) -> None:
        _ = self.push_screen(PageScreen(title, lines), self._back)  # need not be awaited

    def _back(self, _: None) -> None:
        self.show()

    # ---- keeping ----------------------------------------------------------------------------------------------------

    def action_save(self) -> None:
        """Save the present screen as text."""
        top = self.screen
        lines = list(self._shown())
        bar = self.foot
        if isinstance(top, PageScreen):
            lines, bar = top.page.lines, top.foot
        elif isinstance(top, ValuesScreen):
            lines, bar = self._values_shown(top), top.foot
        try:
            path = save(self._directory, self._session.status().now_ns, [line.text for line in lines])
        except OSError as error:
            bar.say(f"NOT SAVED: {printable(str(error))}")
            return
        keys = bar.left
        bar.say(f"saved {words.count(len(lines), 'line')} to {printable(path.name)}")
        if not keys.startswith("saved"):
            self.set_timer(_SAID_S, lambda: bar.say(keys))

    def _values_shown(self, screen: ValuesScreen) -> list[Line]:
        """Return the watched variables, each with the row of its latest value."""
        latest = [value_line(facts.latest, self._clock, self._places) for facts in screen.pane.rows]
        return [Line(f"{screen.head.left}  {screen.head.right}", HEADING), *[Line(f"  {text}") for text in latest]]

    def _facts(self, found: FindingFacts) -> str:
        """Return how often and when a rule applied, and between whom."""
        pipeline = self._session.run.pipeline
        counters = pipeline.counters
        return FactWording(pipeline.exchange.ledger, self._clock, counters.earliest_ns, counters.latest_ns).phrase(
            found.rule
        )

    def _shown(self) -> Iterator[Line]:
        """Yield the full contents of all panes."""
        yield Line(f"{self.head.left}  {self.head.right}", HEADING)
        yield Line("")
        yield Line(self.connections.title, HEADING)
        for one in self.connections.rows:
            yield from connection_lines(one.connection, self._places)
        yield Line("")
        yield Line(self.entries.title, HEADING)
        for entry in self.entries.rows:
            yield Line(f"  {entry_line(entry, self._clock, self._places)}")
        yield Line("")
        yield Line(self.findings.title, HEADING)
        for found in self.findings.rows:
            said = self._facts(found)
            yield from finding_lines(
                found.rule, found.times, found.details, self._places, len(found.details), facts=said
            )
