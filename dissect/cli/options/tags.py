"""The options of the analysing commands that give addresses names."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import click

from dissect.cli.options.given import was_given

if TYPE_CHECKING:
    from dissect.engine.transactions.naming import Naming
    from dissect.meaning.tags import TagSet
    from dissect.meaning.tags.problems import Problem

#: The most problems of tags that are listed in full; further ones are only counted.
MAX_LISTED: Final = 50


def tag_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add ``--tags`` and related options to a command; the result is passed to it as ``naming``, None without them."""

    @click.option(
        "--tags",
        "tags",
        multiple=True,
        metavar="FILE",
        help="Names, types and units for addresses: a tag table, symbol table, source of a DB or CSV; HOST=FILE for one PLC. "
        "Repeatable.",
    )
    @tag_reading_options
    @functools.wraps(command)
    def with_naming(
        *arguments: Any, tags: tuple[str, ...], encoding: str, numbers: dict[str, int], **options: Any
    ) -> int:
        return command(*arguments, naming=naming_of(tags, encoding, numbers), **options)

    return with_naming


def tag_reading_options(command: Callable[..., int]) -> Callable[..., int]:
    """Add ``--tags-encoding`` and ``--tags-db``; the command gets them as ``encoding`` and ``numbers``."""
    command = click.option(
        "--tags-db",
        "numbers",
        multiple=True,
        callback=_numbers,
        metavar="NAME=N",
        help="The number of a data block of which a tag file gives only the name. Repeatable.",
    )(command)
    return click.option(
        "--tags-encoding",
        "encoding",
        default="",
        callback=_encoding,
        metavar="NAME",
        help="Code page of tag files that are not UTF-8, such as cp1251 or cp1252.",
    )(command)


def _encoding(ctx: click.Context, param: click.Parameter, name: str) -> str:
    from dissect.wire.config.hostile import ContentError, check_code_page

    try:
        if name:
            check_code_page(name)
    except ContentError:
        raise click.BadParameter(
            f"{name!r} is not an encoding: try cp1252, cp1251, gbk or utf-8.", ctx, param
        ) from None
    return name


def _numbers(ctx: click.Context, param: click.Parameter, texts: Sequence[str]) -> dict[str, int]:
    numbers = {}
    for text in texts:
        name, equals, number = text.rpartition("=")
        if not equals or not name.strip() or not number.strip().isdigit() or not 0 < int(number) <= 65535:
            raise click.BadParameter(f"expected NAME=NUMBER with a number from 1 to 65535, got {text!r}.", ctx, param)
        numbers[name.strip().strip('"')] = int(number)
    return numbers


def naming_of(paths: Sequence[str], encoding: str, numbers: dict[str, int]) -> Naming | None:
    """Return the names for values from files of tags, None for no file. Raises `click.ClickException`."""
    if not paths:
        if was_given("encoding", "numbers"):
            raise click.UsageError("missing --tags FILE: --tags-encoding and --tags-db are options for reading it.")
        return None
    from dissect.meaning.tags.naming import HostNaming
    from dissect.wire.config.settings import split_host

    by_host: dict[str, list[str]] = {}
    for path in paths:
        host, name = split_host(path)
        by_host.setdefault(host, []).append(name)
    several = len(by_host) > 1
    sets = {host: load(names, encoding, numbers, several) for host, names in by_host.items()}
    for name in [name for name in numbers if not any([tags.has_block(name) for tags in sets.values()])]:
        raise click.ClickException(f"--tags-db {name}: no file of tags has a data block of that name")
    namings = {host: tags.naming(host) for host, tags in sets.items()}
    rest = namings.pop("", None)
    return HostNaming(namings, rest) if namings else rest


def naming_again() -> Naming | None:
    """Return the result of `naming_of` for the current files of the running command; settings may name others.

    The options for reading them (``--tags-encoding``, ``--tags-db``) stay the same.
    """
    context = click.get_current_context()
    given = context.params
    paths = given["tags"] if was_given("tags") else (context.default_map or {}).get("tags", given["tags"])
    return naming_of(tuple(paths), given["encoding"], given["numbers"])


def load(paths: Sequence[str], encoding: str, numbers: dict[str, int], more: bool = False) -> TagSet:
    """Return the tags of files; warnings go to stderr. ``more``: files of other PLCs may have some of the ``numbers``.

    Raises `click.ClickException` with all problems.
    """
    from dissect.meaning.tags import TagError
    from dissect.meaning.tags.loading import load_tags
    from dissect.meaning.tags.problems import ERROR, WARNING

    loaded = guarded(lambda: load_tags(paths, encoding, numbers, more), TagError)
    if isinstance(loaded, TagError):
        errors = [problem for problem in loaded.problems if problem.severity == ERROR]
        listed = listing(errors)
        raise click.ClickException(
            "\n".join(
                [f"{len(errors)} mistakes in the tags; nothing of them was used:", *listed]
                if len(errors) > 1
                else listed
            )
        )
    tags: TagSet = loaded
    for text in listing([problem for problem in loaded.problems if problem.severity == WARNING]):
        click.echo(f"s7dissect: {text}", err=True)
    return tags


def guarded(read: Callable[[], Any], error: type[Exception]) -> Any:
    """Return the result of ``read``, or the ``error`` it raises; errors of the system are the user's errors."""
    from dissect.wire.text import printable

    try:
        return read()
    except error as refused:
        return refused
    except OSError as refused:
        name = str(refused.filename)
        odd = isinstance(refused, FileNotFoundError) and "=" in name
        hint = "; the text before '=' has to be the IP address of a PLC" if odd else ""
        raise click.ClickException(f"{printable(name)}: {refused.strerror}{hint}") from None
    except ImportError as refused:
        raise click.ClickException(printable(str(refused))) from None


def listing(problems: Sequence[Problem]) -> list[str]:
    """Return problems as lines, those beyond `MAX_LISTED` as their number."""
    rest = len(problems) - MAX_LISTED
    return [*[str(problem) for problem in problems[:MAX_LISTED]], *([f"and {rest} more"] if rest > 0 else [])]
