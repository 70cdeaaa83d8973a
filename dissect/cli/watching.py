"""Shared by the commands that show live events: topics, lines, and the end of the run."""

from __future__ import annotations

from collections.abc import Callable
from types import FrameType
from typing import TYPE_CHECKING, Any, Final, Protocol, cast

import click

from dissect.cli.display import clock
from dissect.cli.formats import write_out
from dissect.cli.run import Signals, nanoseconds
from dissect.meaning.report.formats import EVENTS, Format

if TYPE_CHECKING:
    from collections.abc import Iterable, Sequence

    from dissect.engine.exchange import PayloadDecoder
    from dissect.meaning.report.styled import Line
    from dissect.online.live.events import Event
    from dissect.online.live.session import Session, Status

_SCD: Final = "scd"
_TOPICS: Final = ("connections", "transactions", "operations", "findings", "devices", _SCD)

#: How long a poll waits for events, in seconds, and how many it takes.
POLL_S: Final = 0.2
POLL_MOST: Final = 512


def _topics(ctx: click.Context, param: click.Parameter, value: str | None) -> tuple[str, ...]:
    topics = tuple([topic.strip() for topic in value.split(",")]) if value is not None else ()
    for topic in topics:
        if topic not in _TOPICS:
            raise click.BadParameter(f"expected {', '.join(_TOPICS)}, got {topic!r}.", ctx, param)
    return topics


def expect_scd(topics: tuple[str, ...], decoder: PayloadDecoder | None) -> None:
    """Refuse to report only messages that nothing searches for."""
    if set(topics) == {_SCD} and decoder is None:
        raise click.UsageError("--only scd needs --scd DICT and --bind BINDINGS, to decode SCD and to find it.")


#: ``--only TOPICS``; the command's argument is called ``topics``.
only_option: Final[Callable[[Any], Any]] = click.option(
    "--only",
    "topics",
    callback=_topics,
    metavar="TOPICS",
    help=f"Only these kinds of lines, comma-separated: {', '.join(_TOPICS)}.",
)


#: ``--overdue MS``; the command's argument is ``overdue_ns``.
overdue_option: Final[Callable[[Any], Any]] = click.option(
    "--overdue",
    "overdue_ns",
    callback=nanoseconds,
    default="2000",
    show_default=True,
    metavar="MS",
    help="Report requests that have waited longer than this many milliseconds; 0 disables.",
)


class Shower(Protocol):
    """Makes lines of events; it is created with the wanted kinds of events, and a clock."""

    def written(self, events: Iterable[Event], lost: Iterable[str] = ()) -> list[str | Line]:
        """Return the lines of events, in order, followed by those of `lost`."""

    def lost(self, now_ns: int, counts: dict[str, int]) -> str:
        """Return the line that says how many events, by kind, were left out."""

    def end(self, status: Status) -> list[str | Line]:
        """Return the end of the output after the last event; the summary for people is on standard error."""


def new_shower(format_: Format, topics: Iterable[str]) -> Shower:
    """Return an object that makes lines of events, only those of ``topics`` if there are any."""
    from dissect.online.live.lines import kinds_of

    return cast("Shower", format_.maker(EVENTS)(kinds_of(topics), clock()))


def write_events(shower: Shower, events: Sequence[Event], lost: Iterable[str]) -> None:
    """Write the lines of events, and those about lost ones."""
    if lines := shower.written(events, lost):
        write_out(lines)


class LostEvents:
    """Reports events that a session had to leave out, each once."""

    def __init__(self, session: Session, shower: Shower) -> None:
        self._session = session
        self._shower = shower
        self._reported: dict[str, int] = {}

    def lines(self) -> list[str]:
        """Return the line about events lost since the last call; no line if there are none."""
        if self._session.lost == self._reported:
            return []
        lost, reported = dict(self._session.lost), self._reported
        self._reported = lost
        fresh = {kind: count - reported.get(kind, 0) for kind, count in lost.items() if count > reported.get(kind, 0)}
        return [self._shower.lost(self._session.run.now_ns, fresh)]


class LiveInterruption(Signals):
    """Signals end a run in order, by calling ``stop``; a second one aborts it."""

    def __init__(self, stop: Callable[[], None]) -> None:
        super().__init__()
        self._stop = stop

    def react(self, again: bool, frame: FrameType | None) -> None:
        """End the run in order, or abort it."""
        if again:
            raise KeyboardInterrupt
        self._stop()
