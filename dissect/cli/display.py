"""The appearance of results: colours, the width at which they are wrapped, the time zone. The same for all commands.

`dissect.cli.main` gives every command ``--color``, and ``--local-time`` to those that show times. Neither is an argument of the
command: they are kept in the click context and read here.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.run import write
from dissect.wire.text import Clock

if TYPE_CHECKING:
    from dissect.meaning.report.styled import Line

AUTO: Final = "auto"
ALWAYS: Final = "always"
NEVER: Final = "never"

_COLOR: Final = "dissect.cli.display.color"
_LOCAL: Final = "dissect.cli.display.local_time"
_COLOURS: Final = {"heading": "cyan", "error": "red", "failed": "red", "warning": "yellow", "note": "blue"}
_BOLD: Final = frozenset(("heading", "error"))


def _keep(key: str) -> Callable[[click.Context, click.Parameter, Any], None]:
    def keep(ctx: click.Context, _param: click.Parameter, value: Any) -> None:
        if value:
            ctx.meta[key] = value

    return keep


def color_option() -> click.Option:
    """Return the option ``--color``."""
    return click.Option(
        ["--color"],
        type=click.Choice((AUTO, ALWAYS, NEVER)),
        expose_value=False,
        callback=_keep(_COLOR),
        metavar="WHEN",
        help="auto (default: on a terminal, unless NO_COLOR is set), always or never.",
    )


def local_time_option(shows: bool) -> click.Option:
    """Return the option ``--local-time`` of a command that ``shows`` times, or only reads some."""
    taken = "of --time and -Y are in the time zone of this machine (TZ) instead of UTC"
    return click.Option(
        ["--local-time"],
        is_flag=True,
        expose_value=False,
        callback=_keep(_LOCAL),
        help=f"Times shown, and those {taken}; JSON and CSV stay in UTC." if shows else f"Times {taken}.",
    )


def _kept(key: str) -> Any:
    ctx = click.get_current_context(silent=True)
    return ctx.meta.get(key) if ctx is not None else None


def clock() -> Clock:
    """Return a clock that writes times the way the user wants to read them."""
    return Clock(bool(_kept(_LOCAL)))


def coloured(terminal: bool) -> bool:
    """Return whether to use colours on an output, which may be a ``terminal``."""
    when = _kept(_COLOR) or AUTO
    if when == AUTO:
        return terminal and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"
    return bool(when == ALWAYS)


def plain() -> bool:
    """Return whether lines with a style are written unchanged, neither wrapped nor coloured."""
    terminal = sys.stdout.isatty()
    return not terminal and not coloured(terminal)


def write_lines(lines: Iterable[Line]) -> None:
    """Write lines with a style: on a terminal in its width, in colours if enabled, otherwise unchanged."""
    terminal = sys.stdout.isatty()
    width = _columns() if terminal else 0
    write(_dressed(lines, width, coloured(terminal)))


def _columns() -> int:
    import shutil  # which loads three libraries for archives

    return shutil.get_terminal_size().columns


def write_text(lines: Iterable[str], hang: int = 4) -> None:
    """Write lines without a style; on a terminal they are wrapped, with continuations indented to column ``hang``."""
    from dissect.meaning.report.styled import PLAIN, Line

    write_lines([Line(line, PLAIN, hang) for line in lines])


def _dressed(lines: Iterable[Line], width: int, colours: bool) -> Iterator[str]:
    for line in lines:
        for text in line.wrapped(width) if width else [line.text]:
            if not colours or not line.style or not text:
                yield text
            elif line.style == "dim":
                yield click.style(text, dim=True)
            else:
                yield click.style(text, fg=_COLOURS[line.style], bold=line.style in _BOLD)
