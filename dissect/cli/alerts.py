"""`s7dissect alerts`: try the actions of a file of rules before they are needed."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Final

import click

from dissect.cli.main import EXIT_OK, LazyGroup
from dissect.cli.run import write
from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.online.alerts.actions import Action
    from dissect.online.alerts.alert import Alert

_EXIT_FAILED: Final = 1


class _AlertsGroup(LazyGroup):
    prefix = "alerts "

    def summaries(self) -> dict[str, str]:
        """Return each command and its line in the list of commands."""
        return {"test": "Deliver a test alert by every action of a file of rules."}

    def load(self, name: str) -> click.Command:
        """Return a command."""
        return test_command


@click.command("alerts", cls=_AlertsGroup)
def command() -> None:
    """Alerts of `monitor`: see that their actions work before they are needed."""


@click.command(
    "test", epilog="Exit code: 0 every action delivered, 1 one did not, 2 wrong use or rules that cannot be used."
)
@click.argument("rules", type=click.Path(dir_okay=False, readable=False), metavar="RULES")
def test_command(rules: str) -> int:
    """Deliver a test alert by every action of RULES, and report the result of each.

    The alert says that it is a test ("test": true in its JSON). It is delivered at once, without the spool.
    """
    from dissect.online.alerts.actions import DeliveryError, Printed
    from dissect.online.alerts.loading import load_rules
    from dissect.online.alerts.rules import STDERR
    from dissect.scd.user_file import FileError

    try:
        loaded = load_rules(rules)
    except FileError as error:
        raise click.ClickException(str(error)) from None
    alert = _alert()
    failed = 0
    actions: dict[str, Action] = {STDERR: Printed(STDERR), **loaded.actions}
    for name, action in actions.items():
        try:
            action.deliver(alert)
            text = "delivered"
        except DeliveryError as error:
            failed += 1
            text = f"not delivered: {error}"
        finally:
            action.close()
        write([printable(f"{name}: {text}")])
    unused = sorted(loaded.actions.keys() - {name for rule in loaded.rules for name in rule.actions})
    if unused:
        write([printable(f"used by no rule: {', '.join(unused)}")])
    return _EXIT_FAILED if failed else EXIT_OK


def _alert() -> Alert:
    from dissect.engine.findings.catalogue import NOTE
    from dissect.online.alerts.alert import Alert
    from dissect.online.alerts.rules import PROBLEM, Rule

    text = "This is a test of s7dissect; nothing happened."
    return Alert(Rule("test alert", PROBLEM), time.time_ns(), NOTE, None, text, {"test": True})
