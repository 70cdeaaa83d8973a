"""The options of all commands that select: ``-Y``, ``--connection``, ``--time``, ``-c``, and ``-e`` for ``-T fields``.

Together they are a `Chosen`, the argument ``chosen``.
"""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import click

from dissect.cli.display import clock, plain
from dissect.cli.main import EXIT_OK, EXIT_USAGE
from dissect.cli.options.completing import connections
from dissect.cli.task import current

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

    from dissect.meaning.report.formats import Format
    from dissect.meaning.report.writer import MessageChoice, Writer
    from dissect.meaning.select import Where
    from dissect.meaning.select.things import Context
    from dissect.meaning.select.window import Window
    from dissect.online.live.selected import SelectedEvents
    from dissect.online.live.session import Session
    from dissect.wire.text import Clock

    _ParamType = click.ParamType[str]
else:
    _ParamType = click.ParamType

#: The most items that a line on a terminal names.
MOST_ITEMS: Final = 12
#: Name of the format that writes only fields.
FIELDS_FORMAT: Final = "fields"


class Chosen:
    """The selection by the options of a command: ``where`` (None for everything), and at most ``most`` results (0 for all).

    ``columns`` are the fields of ``-T fields``. ``connections`` and ``window`` are the values of `--connection` and `--time`,
    which are part of ``where`` as well. After reading, ``impossible`` says that the selected thing does not exist, ``wrong``
    that the selected number does not.
    """

    def __init__(
        self,
        where: Where | None,
        most: int = 0,
        columns: Sequence[str] = (),
        connections: Sequence[int] = (),
        window: AskedTime | None = None,
    ) -> None:
        self.where = where
        self.connections = tuple(connections)
        self.window = window
        self.impossible = ""
        self.wrong = ""
        self.most = most
        self.columns = tuple(columns)
        self.taken = 0
        self._context: Context | None = where.context if where is not None else None

    @property
    def context(self) -> Context:
        """The facts about the run that fields need."""
        if self._context is None:
            from dissect.meaning.select.things import Context

            self._context = Context()
        return self._context

    @property
    def full(self) -> bool:
        """True when the requested number of results was reached."""
        return bool(self.most) and self.taken >= self.most

    def ended(self, code: int) -> int:
        """Return the exit code of a command that would end with ``code``: a number that does not exist is wrong use."""
        return EXIT_USAGE if self.wrong and code == EXIT_OK else code

    def choice(self, kind: str, also: Callable[[Any], bool] | None = None) -> Callable[[Any], bool] | None:
        """Return a function that selects objects of a kind, by these options and ``also``; None for all."""
        wanted = self.where.predicate(kind) if self.where is not None else None
        if wanted is None and not self.most:
            return also
        if not self.most and also is None:
            return wanted

        def takes(thing: Any) -> bool:
            if self.full or (also is not None and not also(thing)) or (wanted is not None and not wanted(thing)):
                return False
            self.taken += 1
            return True

        return takes

    def events(self, session: Session) -> SelectedEvents | None:
        """Return a filter for the events of a live session; None if all pass."""
        if self.where is None:
            return None
        from dissect.online.live.selected import SelectedEvents

        self.where.context.start = lambda: int(session.run.pipeline.first_ns)
        return SelectedEvents(self.where)

    def message_choice(self) -> MessageChoice | None:
        """Return a function that selects messages of `show`; None for all."""
        takes = self.choice("message")
        if takes is None:
            return None
        from dissect.meaning.select.things import Message

        return lambda *message: takes(Message(*message))

    def writer(self, format_: Format, kind: str, clock: Clock, verbose: bool = False) -> Writer:
        """Return the writer of a format; UsageError unless ``-e`` and ``-T fields`` are given together."""
        if (format_.name == FIELDS_FORMAT) != bool(self.columns):
            missing = "-e FIELD (repeatable)" if not self.columns else f"-T {FIELDS_FORMAT}"
            given = f"-T {FIELDS_FORMAT}" if not self.columns else "-e"
            raise click.UsageError(f"{given} needs {missing}.")
        writer = format_.writer(kind, clock, verbose)
        of = current()
        if of is None or of.direct is not None:  # otherwise another process writes the lines
            writer.plain = plain()
        if of is None and sys.stdout.isatty():
            writer.most = MOST_ITEMS
        if self.columns:
            from dissect.meaning.select.columns import FieldsWriter

            assert isinstance(writer, FieldsWriter)
            writer.write_fields(self.columns, self.context)
        return writer


class ExpressionType(_ParamType):
    """An expression, checked when everything else is known; the shell completes the names of fields."""

    name = "expression"

    def __init__(self, kinds: Sequence[str] = ()) -> None:
        self._kinds = kinds

    def shell_complete(self, ctx: click.Context, param: click.Parameter, incomplete: str) -> list[CompletionItem]:
        """Return the typed text completed with the names of fields that match its last word."""
        from click.shell_completion import CompletionItem

        from dissect.meaning.select.fields import FIELDS

        head, word = _last_word(incomplete)
        return [
            CompletionItem(f"{head}{field.name}", help=field.about)
            for field in FIELDS.values()
            if field.name.startswith(word) and (not self._kinds or not field.getters.keys().isdisjoint(self._kinds))
        ]


def _last_word(text: str) -> tuple[str, str]:
    at = max([text.rfind(mark) for mark in " (!&|"]) + 1
    return text[:at], text[at:]


class FieldType(ExpressionType):
    """The name of a field."""

    name = "field"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return the name unchanged; a wrong one is reported with the nearest."""
        from dissect.meaning.select.fields import NAMES
        from dissect.wire.config.hints import close_names

        field = NAMES.get(value.lower())
        if field is None:
            near = close_names(value, NAMES)
            hint = f" Did you mean {' or '.join(near)}?" if near else " `s7dissect fields` lists them."
            raise click.BadParameter(f"no field {value!r}.{hint}", ctx, param)
        if self._kinds and field.getters.keys().isdisjoint(self._kinds):
            raise click.BadParameter(f"{value!r} is a field of {' and '.join(field.things)}s.", ctx, param)
        return str(value)


#: The forms of a range of time, for help.
_TIMES: Final = (
    "times of day such as 14:03 or 14:03:10.5, dates, or both (UTC, or with a zone such as +01:00), or seconds from the first "
    "packet; END may be +5s after BEGIN; either end may be omitted; 14:03 alone is that minute."
)


def time_option(help: str) -> Callable[[Any], Any]:  # noqa: A002 - as click
    """Return the option ``--time``; the command gets its text as ``window``, for `read_time`."""
    return click.option("--time", "window", metavar="BEGIN..END", help=f"{help} {_TIMES}")


class AskedTime(NamedTuple):
    """The value of ``--time``, and its time range."""

    text: str
    window: Window


def read_time(text: str | None) -> AskedTime | None:
    """Return the value of ``--time``, in the zone of ``--local-time``; None if it was not given. A wrong one is wrong use."""
    if text is None:
        return None
    from dissect.meaning.select.window import parse_window

    try:
        return AskedTime(text, parse_window(text, clock().local))
    except ValueError as error:
        raise click.BadParameter(f"{error}.", param_hint="'--time'") from None


_where: Final = (
    "Only what this expression selects, such as 'host == 192.168.0.1 and latency > 20ms' (see `s7dissect help select`)."
)


def where_option(*kinds: str, help: str = _where) -> Callable[[Any], Any]:  # noqa: A002 - as click
    """Return the option ``-Y`` alone; the command gets its text as ``where``."""
    return click.option("-Y", "--where", "where", type=ExpressionType(kinds), metavar="EXPR", help=help)


def read_where(text: str | None, also: Sequence[str] = (), kinds: Sequence[str] = ()) -> Where | None:
    """Return the selection of an option; None if it was not given. A wrong one is wrong use."""
    if not text and not also:
        if text is not None:
            raise click.BadParameter("the expression is empty.", param_hint="'-Y' / '--where'")
        return None
    from dissect.meaning.select import SelectError, Where
    from dissect.meaning.select.things import KINDS, Context

    try:
        return Where(text or "", also, kinds or KINDS, Context(clock().local))
    except SelectError as error:
        raise click.BadParameter(str(error), param_hint="'-Y' / '--where'") from None


def select_options(
    *kinds: str, numbers: bool = True, results: str = ""
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Return a function that adds the options to a command about results of ``kinds``; it gets a `Chosen` as ``chosen``.

    ``numbers``: ``--connection`` and ``--time`` as well. ``results``, the name of its results: ``-c`` and ``-e`` too.
    """

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(command)
        def with_chosen(
            *arguments: Any,
            where: str | None,
            numbers_of: tuple[int, ...] = (),
            window: str | None = None,
            first_results: int | None = None,
            columns: tuple[str, ...] = (),
            **options: Any,
        ) -> int:
            also = []
            if numbers_of:
                also.append(f"connection in {{{', '.join([str(number) for number in numbers_of])}}}")
            asked = read_time(window)
            if asked is not None:
                stretch = (
                    f'"{asked.text}"' if " " in asked.text else asked.text
                )  # a date and a time may be separated by a space
                also.append(f"time in {{{stretch}}}")
            return command(
                *arguments,
                chosen=Chosen(read_where(where, also, kinds), first_results or 0, columns, numbers_of, asked),
                **options,
            )

        added: list[Callable[[Any], Any]] = [where_option(*kinds)]
        if numbers:
            added.append(
                click.option(
                    "--connection", "numbers_of", multiple=True, type=click.IntRange(min=1), metavar="N",
                    shell_complete=connections,
                    help="Only connection N of the analyze report. Repeatable.",
                )
            )  # fmt: skip
            added.append(time_option("Only within this time range:"))
        if results:
            added.append(
                click.option(
                    "-c", "--count", "first_results", type=click.IntRange(min=1), default=None, metavar="N",
                    help=f"Only the first N {results}; then stop reading.",
                )
            )  # fmt: skip
            added.append(
                click.option(
                    "-e", "columns", multiple=True, type=FieldType(kinds), metavar="FIELD",
                    help=f"With -T {FIELDS_FORMAT}: a column with this field (see `s7dissect fields`). Repeatable.",
                )
            )  # fmt: skip
        decorated: Any = with_chosen
        for option in reversed(added):
            decorated = option(decorated)
        return decorated  # type: ignore[no-any-return]

    return decorate
