"""Variables as the user names them on the command line: addresses and tags."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder
    from dissect.engine.transactions.naming import Naming
    from dissect.output.variables.wanted import WantedSet


def wanted_of(names: Sequence[str], naming: Naming | None, decoder: PayloadDecoder | None) -> WantedSet | None:
    """Return the named variables, None for none; a name that is neither an address nor a tag is wrong use."""
    if not names:
        return None
    from dissect.output.variables.choosing import Known, WantedError, choose, scd_names

    try:
        return choose(names, Known(naming, scd_names(decoder)))
    except WantedError as error:
        raise click.UsageError(f"{error}.") from None
