"""Which options were typed: an option with a default must not be ignored silently if its partner is missing."""

from __future__ import annotations

import click
from click.core import ParameterSource


def was_given(*names: str) -> bool:
    """Return whether any of these arguments of the running command was typed rather than left at its default."""
    context = click.get_current_context()
    return any([context.get_parameter_source(name) is ParameterSource.COMMANDLINE for name in names])
