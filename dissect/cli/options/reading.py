"""The options that determine what a command reads and how; together they are a `Reading`, the argument ``reading``."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, Final

from dissect.cli.gate import fail_on_option
from dissect.cli.options.jobs import indexed_option, separate_options
from dissect.cli.options.scd import scd_options
from dissect.cli.options.select import select_options
from dissect.cli.options.tags import tag_options
from dissect.cli.options.tls import tls_option
from dissect.cli.reading import Reading
from dissect.cli.run import checksums_option, files_argument, slow_option

#: Arguments that go into the `Reading`, whatever options they come from.
_TAKEN: Final = (
    "files", "chosen", "decoder", "naming", "tls_keys", "checksums", "slow_ns", "fail_on", "separate", "jobs",
)  # fmt: skip


def reading_options(
    *kinds: str,
    files: Callable[[Any], Any] | None = files_argument,
    selects: bool = True,
    results: str = "",
    slow: bool = False,
    checksums: bool = True,
    fails: bool = False,
    scd: bool = True,
    tags: bool = True,
    separate: bool = False,
    indexed: bool = True,
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Return a function that adds them to a command about results of ``kinds``.

    ``files`` is its argument for files, None if it has its own. ``selects`` and ``results`` are those of `select_options`,
    which is left out without the former. The others add options: ``fails`` is --fail-on, ``separate`` --separate, -j and
    --cluster, with ``indexed`` --indexed as well.
    """

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        @functools.wraps(command)
        def with_reading(*arguments: Any, **given: Any) -> int:
            taken = {name: given.pop(name) for name in _TAKEN if name in given}
            return command(*arguments, reading=Reading(**taken), **given)

        added: list[tuple[object, Callable[[Any], Any]]] = [
            (separate and indexed, indexed_option),
            (separate, separate_options),
            (True, tls_option),
            (tags, tag_options),
            (scd, scd_options),
            (fails, fail_on_option),
            (checksums, checksums_option),
            (selects, select_options(*kinds, results=results)),
            (slow, slow_option),
        ]
        decorated: Any = with_reading
        for wanted, option in added:
            if wanted:
                decorated = option(decorated)
        return decorated if files is None else files(decorated)  # type: ignore[no-any-return]

    return decorate
