"""How `monitor` and `extcap` open an interface and then drop privileges, so that hostile packets are parsed without them."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import click

from dissect.wire.text import printable

if TYPE_CHECKING:
    from dissect.cli.options.monitor import Beside
    from dissect.packets.source.live.privileges import User
    from dissect.packets.source.live.reader import LiveReader

#: The user named in -Z to keep all privileges.
_ROOT: Final = "root"
#: Rooms with imports that are delayed until a packet needs them, and codecs, which are imported in the same way.
_ROOMS: Final = (
    "protocols.s7",
    "protocols.s7plus",
    "engine.transactions",
    "engine.findings",
    "meaning.report",
    "meaning.select",
    "output.export",
    "online.live",
    "files.recording",
)
_CODECS: Final = ("ascii", "latin-1", "utf-16-be", "utf-16-le", "idna")


def check_user(user: str, engine: str) -> None:
    """Refuse a ``-Z`` that is not possible."""
    from dissect.packets.source.live.privileges import is_root

    if not is_root():
        raise click.UsageError("-Z USER: only root can become another user.")
    if engine == "dumpcap" and user != _ROOT:
        raise click.UsageError("-Z USER needs --engine ring: dumpcap started as root can only be stopped by root.")


def _relinquish(beside: Beside | None, become: User | None, on_screens: bool) -> None:
    """Drop all privileges, and check that the files needed later can be written and read."""
    from dissect.packets.source.live import privileges

    if become is not None:
        _import_all()
        if beside is not None:
            privileges.give(beside.made, become)
    privileges.relinquish(become)
    for directory in beside.directories if beside is not None else ():
        privileges.check_writable(directory, become)
    if on_screens and not privileges.program_readable():
        raise privileges.unreadable(become)


def open_interface(
    interface: str | Sequence[str],
    expression: str,
    engine: str,
    user: str,
    beside: Beside | None,
    on_screens: bool,
    buffer_mib: int,
) -> LiveReader:
    """Open an interface, or several, and drop all privileges as far as the engine allows; ``beside`` continues without them.

    Root reads from the ring if possible: a process that started dumpcap as root must stay root to end it.
    """
    from dissect.packets.source.live import privileges
    from dissect.packets.source.live.opening import open_all
    from dissect.packets.source.live.reader import LiveError

    names = [interface] if isinstance(interface, str) else list(interface)
    root = privileges.is_root()
    keeps = user == _ROOT
    become = privileges.heir(user) if root and not keeps else None
    reader: LiveReader | None = None
    remedy = "--engine ring drops all privileges"
    if become is not None and engine == "auto":
        try:
            reader = open_all(names, expression, "ring", buffer_mib=buffer_mib)
        except LiveError as why:  # dumpcap may have the privilege, or reports why not
            if user:
                remedies = why.advice or (f"-Z {user} needs the ring; -Z root keeps all privileges",)
                raise LiveError(str(why), remedies) from None
            remedy = f"the ring, which drops all privileges, cannot be used: {why}"
    if reader is None:
        reader = open_all(names, expression, engine, buffer_mib=buffer_mib)
    if keeps or reader.engine != "ring":
        if root and not keeps:
            _say(printable(f"{reader.engine} and the dissection run as root; {remedy}"))
        return reader
    try:
        _relinquish(beside, become, on_screens)
    except BaseException:
        reader.close()
        raise
    if become is not None:
        _say(f"interface opened; now running as {become} without privileges")
    return reader


def _import_all() -> None:
    """Import modules that may be needed later: a Python below /root can no longer be read then."""
    import pkgutil

    import dissect

    for name in _CODECS:
        "".encode(name)
    importlib.import_module(f"{dissect.__name__}.packets.source.statistics")  # at the end of a file with a loss count
    for room in _ROOMS:
        package = importlib.import_module(f"{dissect.__name__}.{room}")
        for module in pkgutil.iter_modules(package.__path__):
            importlib.import_module(f"{package.__name__}.{module.name}")


def _say(text: str) -> None:
    click.echo(f"s7dissect: {text}", err=True)
