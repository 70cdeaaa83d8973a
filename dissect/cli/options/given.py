"""Which options were typed: one that has a default must not be taken in silence where its partner is missing either."""

from __future__ import annotations

import click
from click.core import ParameterSource


def was_given(*names: str) -> bool:
    """Return whether any of these arguments of the running command was typed rather than left at its default."""
    context = click.get_current_context()
    return any([context.get_parameter_source(name) is ParameterSource.COMMANDLINE for name in names])
