"""The option ``--config``: settings of `s7dissect.toml` become the defaults of a command's options (docs/config.md).

`dissect.cli.main` adds it to every command with an option that a file may set. The command line always counts more.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, Final

import click

from dissect.cli.task import current
from dissect.wire.config.finding import find_files
from dissect.wire.text import printable

#: Parameters that a key sets, by key; how its value is written for them.
_NONE: Final = "none"
_HOSTS: Final = "dissect.cli.configuration.hosts"
_TYPED: Final = "dissect.cli.configuration.typed"
_PARAMETERS: Final[dict[str, tuple[str, Callable[[Any], Any]]]] = {
    "tags": ("tags", list),
    "tags-encoding": ("encoding", str),
    "tags-db": ("numbers", lambda table: [f"{name}={number}" for name, number in table.items()]),
    "scd": ("scd", str),
    "bind": ("bind", str),
    "slow": ("slow_ns", str),
    "format": ("format_", str),
    "checksums": ("checksums", bool),
    "local-time": ("local_time", bool),
    "color": ("color", str),
}
#: A command with one of these parameters reads the files of settings.
_WANTED: Final = frozenset(("tags", "encoding", "scd", "checksums"))


def wants_config(command: click.Command) -> bool:
    """Return whether a command has an option that belongs to the analysis of captures."""
    return any([parameter.name in _WANTED for parameter in command.params])


def config_option() -> click.Option:
    """Return the option ``--config``."""
    return click.Option(
        ["--config"],
        is_eager=True,
        expose_value=False,
        callback=_apply,
        metavar="FILE",
        help="Settings file to use instead of the s7dissect.toml of this folder or one above it; none for no settings.",
    )


def hosts() -> Mapping[str, str]:
    """Return the names of hosts by address in the settings of the running command."""
    ctx = click.get_current_context(silent=True)
    names: Mapping[str, str] = ctx.meta.get(_HOSTS, {}) if ctx is not None else {}
    return names


def config_typed() -> list[str]:
    """Return the value of ``--config`` of the running command, as a list of one; an empty list without it."""
    return list(click.get_current_context().meta.get(_TYPED, []))


def read_again() -> None:
    """Read the settings of the running command again; afterwards `hosts` and `settings_now` use the new contents.

    Raises `click.ClickException` for files that cannot be used, and changes nothing.
    """
    ctx = click.get_current_context()
    typed = config_typed()
    _apply(ctx, config_option(), typed[0] if typed else None)


def settings_now() -> Mapping[str, Any]:
    """Return the defaults of the current command's options by its settings, by parameter."""
    return dict(click.get_current_context().default_map or {})


def _apply(ctx: click.Context, _param: click.Parameter, value: str | None) -> None:
    """Read the files and make their settings the defaults of the command."""
    if value is not None:
        ctx.meta[_TYPED] = [value]
    if value == _NONE or ctx.resilient_parsing:
        return
    of = current()
    if of is not None and of.settings is not None:
        ctx.default_map = dict(of.settings)
        return
    user = Path(click.get_app_dir("s7dissect"))
    files = find_files(Path.cwd(), user)
    if value is not None:
        files = [Path(value), *[path for path in files if path.parent == user]]
    if not files:
        return
    from dissect.meaning.report.formats import FORMATS
    from dissect.wire.config.settings import ConfigError, load_settings

    try:
        settings = load_settings(files, FORMATS)
    except ConfigError as error:
        raise click.ClickException("\n".join(error.problems)) from None
    except OSError as error:
        raise click.ClickException(f"{printable(str(error.filename))}: {error.strerror}") from None
    known = {str(parameter.name): parameter for parameter in ctx.command.params}
    defaults: dict[str, Any] = {}
    for key, setting in settings.values.items():
        name, form = _PARAMETERS.get(key, ("", str))
        parameter = known.get(name)
        if parameter is not None and _takes(key, parameter, setting):
            defaults[name] = form(setting)
    ctx.meta[_HOSTS] = settings.values.get("hosts", {})
    ctx.default_map = {**(ctx.default_map or {}), **defaults}


def _takes(key: str, parameter: click.Parameter, setting: object) -> bool:
    """Return whether a setting applies to a parameter: ``slow`` if it is a threshold, ``format`` if the command has it."""
    if key == "slow":
        return parameter.default is not None  # elsewhere it chooses transactions
    if key != "format":
        return True
    from dissect.meaning.report.formats import FORMATS

    return getattr(parameter.type, "kind", "") in FORMATS[str(setting)].writers
