"""The option ``--fail-on``: which findings make a command end with the exit code of a failed gate."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.main import EXIT_DAMAGED, EXIT_GATE, EXIT_OK
from dissect.cli.options.completing import findings
from dissect.engine.findings.catalogue import CATALOGUE, SEVERITIES
from dissect.meaning.report.slugs import slugs_of

if TYPE_CHECKING:
    from dissect.files.session import Run
    from dissect.online.live.run import LiveRun


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
    shell_complete=findings,
    metavar="WHAT",
    help="Exit with code 1 on a finding that matches WHAT: a severity (note, warning or error, or worse), a slug such as "
    "transaction.slow, or a pattern such as 'session.*'. A finding that another one explains does not count. Repeatable.",
)


def gate(run: Run | LiveRun, fail_on: frozenset[str], code: int, selected: Mapping[str, int] | None = None) -> int:
    """Return the exit code of a command that would end with ``code``; report on stderr why the gate failed.

    Of a selection only the findings in ``selected`` count.

    A damaged file is reported on stderr anyway, so a failed gate has priority; an interruption has the highest priority.
    """
    return gate_of(selected if selected is not None else run.pipeline.finding_counts, fail_on, code)


def gate_of(counts: Mapping[str, int], fail_on: frozenset[str], code: int) -> int:
    """Do the same if only the count of each finding is known."""
    failing = [slug for slug in CATALOGUE if slug in fail_on and counts.get(slug)]
    if not failing:
        return code
    failing.sort(key=lambda slug: SEVERITIES.index(CATALOGUE[slug].severity))
    listed = ", ".join([f"{slug} ({counts[slug]})" for slug in failing])
    click.echo(f"s7dissect: --fail-on: {listed}", err=True)
    return EXIT_GATE if code in {EXIT_OK, EXIT_DAMAGED} else code
