"""The option ``--fail-on``: which findings make a command end with the exit code of a failed gate."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.main import EXIT_DAMAGED, EXIT_GATE, EXIT_OK
from dissect.findings.catalogue import CATALOGUE
from dissect.findings.finding import SEVERITIES

if TYPE_CHECKING:
    from dissect.session import Run

#: Ends a prefix: ``session.*`` means every slug that begins with ``session.``.
_ANY: Final = "*"


def slugs_of(text: str) -> frozenset[str]:
    """Return the slugs that one value of the option means: a severity (that or worse), a slug, or a prefix with ``*``.

    Raises ValueError, naming what is near, when it means nothing.
    """
    if text in SEVERITIES:
        worse = SEVERITIES[: SEVERITIES.index(text) + 1]
        return frozenset([slug for slug, rule in CATALOGUE.items() if rule.severity in worse])
    if text.endswith(_ANY):
        found = frozenset([slug for slug in CATALOGUE if slug.startswith(text[:-1])])
    else:
        found = frozenset([text]) & frozenset(CATALOGUE)
    if not found:
        raise ValueError(f"{text!r} is no severity and no finding{_near(text)}.")
    return found


def _near(text: str) -> str:
    rooms = sorted({slug.partition(".")[0] + ".*" for slug in CATALOGUE})
    import difflib  # late: a run without this mistake does not need it

    near = difflib.get_close_matches(text, [*SEVERITIES, *rooms, *CATALOGUE], n=3)
    begun = [slug for slug in CATALOGUE if text and (slug.startswith(text) or slug.endswith("." + text))]
    named = list(dict.fromkeys([*begun[:3], *near]))
    return f"; did you mean {', '.join(named)}?" if named else ": docs/findings.md lists them"


def _slugs(ctx: click.Context, param: click.Parameter, values: Iterable[str]) -> frozenset[str]:
    wanted: set[str] = set()
    for value in values:
        try:
            wanted |= slugs_of(value)
        except ValueError as error:
            raise click.BadParameter(str(error), ctx, param) from None
    return frozenset(wanted)


#: The option; the command gets the slugs that it means as ``fail_on``.
fail_on_option: Final[Callable[[Any], Any]] = click.option(
    "--fail-on",
    "fail_on",
    multiple=True,
    callback=_slugs,
    metavar="WHAT",
    help="End with exit code 1 when there is a finding that is WHAT: note, warning or error (that or worse), a slug such as "
    "transaction.slow, or all that begin alike, such as 'session.*'. May be given several times.",
)


def gate(run: Run, fail_on: frozenset[str], code: int) -> int:
    """Return the exit code of a command that would end with ``code``; say on stderr why the gate failed.

    A damaged file is told on stderr anyway, so a failed gate counts more; an interruption counts most.
    """
    counts = run.pipeline.conversation.judge.counts
    found = [slug for slug in CATALOGUE if slug in fail_on and counts.get(slug)]
    if not found:
        return code
    found.sort(key=lambda slug: SEVERITIES.index(CATALOGUE[slug].severity))
    said = ", ".join([f"{slug} ({counts[slug]})" for slug in found])
    click.echo(f"s7dissect: --fail-on: {said}", err=True)
    return EXIT_GATE if code in {EXIT_OK, EXIT_DAMAGED} else code
