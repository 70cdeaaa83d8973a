"""The options of the analysing commands for SCD: where it is transported, and its dictionary."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import click

if TYPE_CHECKING:
    from dissect.engine.exchange import PayloadDecoder

_FILE = click.Path(dir_okay=False, readable=False)


def scd_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add ``--scd`` and ``--bind`` to a command; their decoder is passed to it as ``decoder``, None without them."""

    @click.option(
        "--scd",
        "scd",
        type=_FILE,
        metavar="DICT",
        help="Decode SCD with this dictionary (needs --bind).",
    )
    @click.option(
        "--bind",
        "bind",
        type=_FILE,
        metavar="BINDINGS",
        help="Where SCD is carried: a bindings file (needs --scd).",
    )
    @functools.wraps(command)
    def with_decoder(*arguments: Any, scd: str | None, bind: str | None, **options: Any) -> int:
        return command(*arguments, decoder=_decoder(scd, bind), **options)

    return with_decoder


def _decoder(scd: str | None, bind: str | None) -> PayloadDecoder | None:
    if scd is None and bind is None:
        return None
    if scd is None or bind is None:
        missing = "--scd DICT, the dictionary" if scd is None else "--bind BINDINGS, which says where SCD is carried"
        raise click.UsageError(f"missing {missing}: the two options belong together.")
    from dissect.meaning.bindings import BindingError, load_carrier
    from dissect.scd.errors import DictionaryError
    from dissect.wire.text import printable

    try:
        return load_carrier(scd, bind)
    except BindingError as error:
        raise click.ClickException(str(error)) from None
    except DictionaryError as error:
        raise click.ClickException("\n".join([printable(str(one)) for one in (error, *error.others)])) from None
    except OSError as error:
        raise click.ClickException(f"{printable(str(error.filename))}: {error.strerror}") from None
