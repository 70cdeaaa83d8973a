"""`Reloading`: at SIGHUP a probe reads its rules, baseline, tags and settings again, and begins new files of evidence.

Files are read in the thread of the command while the capture continues; their contents take effect between two packets. If a
file cannot be used, nothing changes.
"""

from __future__ import annotations

import signal
from functools import partial
from typing import TYPE_CHECKING, Any, Final, Self

import click

from dissect.cli.configuration import hosts, read_again
from dissect.cli.options.tags import naming_again

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

    from dissect.cli.options.monitor import Beside
    from dissect.engine.transactions.naming import Naming
    from dissect.online.live.session import Session

#: None on systems without the signal.
_HUP: Final = getattr(signal, "SIGHUP", None)


class Reloading:
    """Handles SIGHUP during a ``with``, and acts on it in `check`. If a process ignores the signal (`nohup`), it stays so."""

    def __init__(self, session: Session, beside: Beside) -> None:
        self._session = session
        self._beside = beside
        self._asked = False
        self._pending = False
        self._previous: Any = None

    def __enter__(self) -> Self:
        if _HUP is not None and signal.getsignal(_HUP) is not signal.SIG_IGN:
            self._previous = signal.signal(_HUP, self._note)
        return self

    def __exit__(self, *_: object) -> None:
        if self._previous is not None and _HUP is not None:
            signal.signal(_HUP, self._previous)

    def _note(self, _number: int, _frame: object) -> None:
        self._asked = True

    def check(self) -> None:
        """Read the files again if a signal arrived. Call it often; during an earlier change it waits."""
        alerting = self._beside.alerting
        if not self._asked or self._pending or (alerting is not None and not alerting.settled):
            return
        self._asked = False
        run = self._session.run
        try:
            read_again()
            naming = naming_again()
            rules = self._beside.rules_again()
        except click.ClickException as error:
            run.between(partial(self._refuse, error.format_message()))
            return
        self._pending = True
        run.between(partial(self._change, rules, naming, hosts()))

    def _refuse(self, why: str) -> None:
        self._session.run.renew()
        self._session.say(f"HUP: rules, baseline, tags and hosts stay as they were: {why}; new files begin")

    def _change(self, rules: Callable[[], None] | None, naming: Naming | None, names: Mapping[str, str]) -> None:
        """Apply the new contents; called between two packets, in a different thread from the command's."""
        try:
            if rules is not None:
                rules()
            self._session.run.name_values(naming)
            if self._beside.reporting is not None:
                self._beside.reporting.name_hosts(names)
            self._session.run.renew()
        finally:
            self._pending = False  # the run reports a failure; the next signal is handled as usual
        self._session.say("HUP: rules, baseline, tags and hosts were read again; new files begin")
