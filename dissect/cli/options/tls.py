"""The option of the analysing commands that opens TLS."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from dissect.protocols.tls.key_log import KeyLog


def tls_option(command: Callable[..., int]) -> Callable[..., int]:
    """Add ``--tls-keys`` to a command; the keys in the files are passed to it as ``tls_keys``, None without them."""

    @click.option(
        "--tls-keys",
        "tls_keys",
        type=click.Path(dir_okay=False, readable=False),
        multiple=True,
        metavar="FILE",
        help="Decrypt TLS with the session keys in FILE (SSLKEYLOGFILE form). Repeatable.",
    )
    @functools.wraps(command)
    def with_keys(*arguments: Any, tls_keys: tuple[str, ...], **options: Any) -> int:
        return command(*arguments, tls_keys=_keys(tls_keys), **options)

    return with_keys


def _keys(files: tuple[str, ...]) -> KeyLog | None:
    if not files:
        return None
    from dissect.files.session import KeyLogError, read_tls_keys
    from dissect.wire.text import printable, reason

    try:
        keys = read_tls_keys(files)
    except KeyLogError as error:
        raise click.ClickException(printable(str(error))) from None
    except ImportError as error:
        raise click.UsageError(f"--tls-keys {error}") from None
    except OSError as error:
        raise click.ClickException(reason(error)) from None
    if keys.wrong:
        lines = "1 line has" if keys.wrong == 1 else f"{keys.wrong} lines have"
        click.echo(f"s7dissect: --tls-keys: {lines} another form and no key", err=True)
    if keys.unfinished:
        click.echo(
            "s7dissect: --tls-keys: the last line is cut off and gives no key unless the rest is added", err=True
        )
    return keys
