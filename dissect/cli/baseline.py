"""`s7dissect baseline`: learns normal traffic from captures, or reports deviations."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from dissect.cli.display import clock
from dissect.cli.formats import format_option, write_outcome
from dissect.cli.main import EXIT_DAMAGED, EXIT_GATE, EXIT_OK, EXIT_USAGE
from dissect.cli.options.given import was_given
from dissect.cli.options.reading import reading_options
from dissect.cli.reading import Reading
from dissect.cli.run import write
from dissect.engine.pipeline import Options
from dissect.files.session import Run
from dissect.meaning.report.formats import ALERTS, Format
from dissect.meaning.report.outcome import SPACED_LINE, Outcome
from dissect.meaning.report.styled import HANG, Line
from dissect.packets.source.packet import CONTINUES_NS
from dissect.wire.config.saving import expect_place, is_special, save
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.engine.observer import Observer
    from dissect.online.alerts import Alert, AlertRules
    from dissect.output.baseline import Baseline
    from dissect.wire.text import Clock

_EXIT_CODES = (
    "Exit code: 0 success, or nothing new; 1 --against or --rules reported something; 2 wrong use, or an unreadable or "
    "unwritable file; 3 a damaged or truncated capture; 5 the output could not be written; 130 interrupted. With 3 and 130 the "
    "results cover what was read."
)


@click.command("baseline", epilog=_EXIT_CODES)
@click.option(
    "-o",
    "--output",
    metavar="PLANT.toml",
    type=click.Path(readable=False),
    help="File to write the baseline to (default: standard output).",
)
@click.option(
    "--update",
    metavar="OLD.toml",
    type=click.Path(readable=False),
    help="Extend this baseline; it may also be the output.",
)
@click.option(
    "--against",
    metavar="PLANT.toml",
    type=click.Path(readable=False),
    help="Do not learn; report what this baseline does not contain.",
)
@click.option(
    "--rules",
    metavar="ALERTS.toml",
    type=click.Path(readable=False),
    help="Report alerts that these rules would raise; no action is executed.",
)
@click.option(
    "--rate-factor", type=click.FloatRange(0, 1e6), default=2.0, show_default=True, metavar="FACTOR",
    help="With --against: report rates above this multiple of the baseline; 0 disables.",
)  # fmt: skip
@click.option(
    "--silence-factor", type=click.FloatRange(0, 1e6), default=0.0, show_default=True, metavar="FACTOR",
    help="With --against: report gaps longer than this multiple of the baseline; 0 disables.",
)  # fmt: skip
@format_option(ALERTS)
@reading_options(selects=False, checksums=False, scd=False, tags=False)
def command(
    reading: Reading,
    output: str | None,
    update: str | None,
    against: str | None,
    rules: str | None,
    rate_factor: float,
    silence_factor: float,
    format_: Format,
) -> int:
    """Learn from captures which client requests what from which server and how often, as a TOML file to read and edit.

    With --against PLANT.toml, report what the captures contain and the baseline does not, one line each; the exit code is 1 if
    there is any. With --rules ALERTS.toml, try alert rules on captures.

    FILE is a pcap or pcapng file, plain or compressed with gzip or zstd; - is standard input.
    """
    if (against is None or rules is not None) and was_given("rate_factor", "silence_factor"):
        rates = " without --rules, which has its own rates and gaps" if rules is not None else ""
        raise click.UsageError(f"--rate-factor and --silence-factor need --against{rates}.")
    if against is not None or rules is not None:
        if output is not None or update is not None:
            raise click.UsageError("--output and --update cannot be combined with --against and --rules.")
        return _compare(reading, against, rules, (rate_factor, silence_factor), format_)
    if was_given("format_"):
        raise click.UsageError("-T needs --against or --rules: a baseline is written as TOML.")
    return _learn(reading, output, update)


class _Run(Run):
    """A run that reports when a file is a new capture, at another time."""

    def __init__(
        self, restart: Callable[[int], None], files: Sequence[str], observer: Observer, options: Options
    ) -> None:
        super().__init__(files, observer, options)
        self._restart = restart
        self._looked = 1

    def join(self, time_ns: int) -> None:
        """Take the time of a packet of a file's beginning."""
        gap = time_ns - self.pipeline.now_ns
        super().join(time_ns)
        if self._looked < len(self.files):
            self._looked = len(self.files)
            if not 0 <= gap <= CONTINUES_NS:
                self._restart(int(time_ns))


# ---- learn ----------------------------------------------------------------------------------------------------------


def _learn(reading: Reading, output: str | None, update: str | None) -> int:
    from dissect.output.baseline import Learner, baseline_toml, merged

    old = _baseline(update) if update is not None else None
    if (
        output is not None
        and os.path.lexists(output)
        and not is_special(output)
        and not (update is not None and _same(output, update))
    ):
        raise click.UsageError(f"{printable(output)} exists; use --update, or choose another file")
    if output is not None:
        expect_place(output)
    learner = Learner()
    reading.run(learner, make=partial(_Run, lambda _: learner.restart()))
    files, code = reading.files, reading.code
    names = tuple(dict.fromkeys(["stdin" if file == "-" else Path(file).name for file in files]))
    learned = learner.baseline(names)
    if not learned.pairs:
        reading.complain()
        click.echo("s7dissect: nothing to learn: the captures contain no S7 conversation", err=True)
        return EXIT_USAGE if code == EXIT_OK else code
    text = baseline_toml(learned if old is None else merged(old, learned))
    if output is None:
        write(text.splitlines())
    else:
        save(output, text.encode())
    reading.complain()
    if learner.left_out:
        click.echo(
            f"s7dissect: the baseline is incomplete: {learner.left_out} entries did not fit and were left out", err=True
        )
    return code


def _same(one: str, other: str) -> bool:
    return Path(one).exists() and Path(one).samefile(other)


# ---- compare --------------------------------------------------------------------------------------------------------


def _compare(
    reading: Reading,
    against: str | None,
    rules: str | None,
    factors: tuple[float, float],
    format_: Format,
) -> int:
    from dissect.online.alerts import AlertEngine, RuleError

    baseline = _baseline(against) if against is not None else None
    asked = _rules(rules) if rules is not None else _usual_rules(*factors)
    alerts: list[Alert] = []
    try:
        engine = AlertEngine(asked, baseline, alerts.append)
    except RuleError as error:
        raise click.UsageError(f"{error} with --against") from None

    times = clock()

    def show() -> None:
        for alert in alerts:
            write_outcome(format_, ALERTS, _AlertOutcome(alert, times))
        alerts.clear()

    reading.run(engine, make=partial(_Run, engine.restart), each=show)
    code = reading.code
    engine.finish()
    show()
    reading.complain()
    if engine.crowded or engine.forgotten:
        lost = f"{engine.crowded} alerts lost, {engine.forgotten} pairs or connections no longer measured"
        click.echo(f"s7dissect: too many different alerts: {lost}", err=True)
    return EXIT_GATE if engine.count and code in {EXIT_OK, EXIT_DAMAGED} else code


class _AlertOutcome(Outcome):
    """An alert."""

    layout = SPACED_LINE

    def __init__(self, alert: Alert, clock: Clock) -> None:
        self._alert = alert
        self._clock = clock

    def text(self) -> list[str | Line]:
        """Return the line of the departure."""
        return [Line(self._alert.line(self._clock), self._alert.severity, HANG)]

    def as_dict(self) -> dict[str, object]:
        """Return all its data."""
        return self._alert.as_dict()


def _usual_rules(rate_factor: float, silence_factor: float) -> AlertRules:
    """Return the default rules of a comparison, used when no rule file is given: each thing is reported once."""
    from dissect.online.alerts import AlertRules, Rule
    from dissect.online.alerts.rules import NEW, RATE, SILENCE
    from dissect.online.alerts.states import TRANSACTIONS
    from dissect.output.baseline.watch import KINDS

    rules = [Rule("new", NEW, kinds=frozenset(KINDS), once=True)]
    if rate_factor:
        for seconds in (1, 10):
            window = seconds * 1_000_000_000
            name = f"rate {seconds} s"
            rules.append(Rule(name, RATE, of=TRANSACTIONS, window_ns=window, learned=rate_factor, once=True))
    if silence_factor:
        rules.append(Rule("silence", SILENCE, of=TRANSACTIONS, learned=silence_factor, once=True))
    return AlertRules(tuple(rules))


def _baseline(path: str) -> Baseline:
    from dissect.output.baseline import BaselineError, load_baseline

    try:
        return load_baseline(path)
    except BaselineError as error:
        raise click.ClickException(str(error)) from None


def _rules(path: str) -> AlertRules:
    """Return the rules of a file in a form that can be tried on a capture.

    No clock runs between transactions, so silence is measured on transactions.
    """
    from dissect.online.alerts import RuleError, load_rules
    from dissect.online.alerts.rules import SILENCE
    from dissect.online.alerts.states import TRANSACTIONS

    try:
        loaded = load_rules(path, trial=True)
    except RuleError as error:
        raise click.ClickException(str(error)) from None
    tried = [dataclasses.replace(rule, of=TRANSACTIONS) if rule.when == SILENCE else rule for rule in loaded.rules]
    return dataclasses.replace(loaded, rules=tuple(tried))
