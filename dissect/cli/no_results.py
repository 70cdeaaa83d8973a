"""Explains on stderr, in one line, why a command shows nothing: the selection cannot match, or nothing matches it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.display import clock
from dissect.cli.formats import write_out
from dissect.cli.options.select import Chosen
from dissect.meaning.report.styled import Written
from dissect.wire.text import duration_text, shortened

if TYPE_CHECKING:
    from dissect.files.session import Run

#: A time of day or date, in a range, that names no zone: a string, which `re` compiles where it is needed.
_ZONELESS: Final = r"(:[0-9]{2}(\.[0-9]+)?|-[0-9]{2})(?=\.\.|$)(?<![+-][0-9]{2}:[0-9]{2})"
#: Characters of a selection that are shown.
_SHOWN = 200


class CountedOutput:
    """Writes the results of a command, and explains it if there are none.

    ``noun`` is the name of a result; an output begins with ``heading`` lines that are not results.
    """

    def __init__(self, noun: str, heading: int = 0) -> None:
        self._noun = noun
        self._heading = heading
        self._lines = 0

    def write(self, lines: Sequence[Written]) -> None:
        """Write lines of results."""
        self._lines += len(lines)
        write_out(lines)

    def explain(self, run: Run, chosen: Chosen, narrowed: Iterable[str] = ()) -> None:
        """Explain why nothing was shown, if so; ``narrowed`` are other options that select."""
        if not complain_impossible(run, chosen) and self._lines <= self._heading:
            complain_no_results(self._noun, chosen, narrowed)
            for text in _unknown(run, chosen):
                click.echo(f"s7dissect: {text}", err=True)


def no_results_text(noun: str, chosen: Chosen, narrowed: Iterable[str] = ()) -> str:
    """Return the message that there is no ``noun``; ``narrowed`` are other options that select."""
    wanted = [*narrowed, *([shortened(chosen.where.text, _SHOWN)] if chosen.where is not None else [])]
    condition = f"matches {' and '.join(wanted)}" if wanted else "in what was read"
    return f"no {noun} {condition}" if noun else f"nothing {condition}"


def complain_no_results(noun: str, chosen: Chosen, narrowed: Iterable[str] = ()) -> None:
    """Write that message to stderr."""
    click.echo(f"s7dissect: {no_results_text(noun, chosen, narrowed)}", err=True)


def _unknown(run: Run, chosen: Chosen) -> list[str]:
    """Return an error about unknown variables in the brackets of a selection, because a misspelt one matches nothing."""
    if chosen.where is None or not chosen.where.variables:
        return []
    from dissect.meaning.select.literals import place_of
    from dissect.output.variables.choosing import Known, WantedError, one_of, scd_names

    exchange = run.pipeline.exchange
    known = Known(exchange.naming, scd_names(exchange.decoder), files=False)
    tags = {tag.name: tag.name.lower() for tag, _ in known.tags}
    problems = []
    for name in chosen.where.variables:
        alike = [] if name in tags else [tag for tag, lower in tags.items() if lower == name.lower()]
        try:
            if alike:
                problems.append(f"{shortened(name, 60)}: the tag is called {shortened(alike[0], 60)}")
            elif place_of(name) is None:
                one_of(name, known)
        except WantedError as error:
            problems.append(str(error))
    return problems


def complain_impossible(run: Run, chosen: Chosen) -> bool:
    """Report on stderr a number or time that does not exist; return False if it may exist.

    An unknown number is wrong use, which `Chosen.ended` makes the exit code.
    """
    wrong = _wrong_number(run, chosen)
    impossible = wrong or _no_time(run, chosen)
    if impossible:
        click.echo(f"s7dissect: {impossible}", err=True)
        chosen.wrong = wrong or chosen.wrong  # of two captures, an error in either counts
        chosen.impossible = impossible
    return bool(impossible)


def expect_possible(run: Run, chosen: Chosen) -> None:
    """Do the same for a command that writes a file: a number that does not exist is refused."""
    if wrong := _wrong_number(run, chosen):
        raise click.ClickException(f"{wrong}; nothing was written.")
    complain_impossible(run, chosen)


def _wrong_number(run: Run, chosen: Chosen) -> str:
    """Return which connections of a selection do not exist in the captures; empty if all do."""
    if chosen.full:
        return ""  # the rest was not read
    total = int(run.pipeline.connections.count)
    beyond = [number for number in chosen.connections if number > total]
    if not beyond:
        return ""
    numbers = ", ".join([str(number) for number in beyond])
    whole = "the captures have" if len(run.files) > 1 else "the capture has"
    return f"no connection {numbers}; {whole} {total or 'none'}"


def _no_time(run: Run, chosen: Chosen) -> str:
    """Return the message that the time of a selection is not in the captures; empty if it may be."""
    pipeline = run.pipeline
    if chosen.window is not None and pipeline.frames and not chosen.full:
        first, last = int(pipeline.first_ns), int(pipeline.now_ns)
        begin, end = chosen.window.window.resolve(first, last)
        if begin > last or end < first:
            lasts = duration_text(max(last - first, 0))
            asked = chosen.window.text
            zone = f" ({clock().zone(first)})" if re.search(_ZONELESS, asked) else ""
            return f"no packet within {asked}{zone}; what was read begins at {clock().moment(first)} and lasts {lasts}"
    return ""
