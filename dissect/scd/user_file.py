"""TOML files that a user writes about a plant: bindings, alert rules, a baseline. One reader, one form of errors.

An error has the line of its key and, if a name is similar to a known one, that name. All tables of a file are read before the
first error is raised, and that error contains the others.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from ipaddress import IPv4Network, IPv6Network, ip_network
from pathlib import Path
from typing import Any, Final, TypeVar

from dissect.scd.bounds import check_bounds
from dissect.scd.errors import DictionaryError, Troubles, shown
from dissect.scd.reading import Table
from dissect.scd.toml_tables import parse_tables, source_text
from dissect.wire.config.lines import Lines, Place
from dissect.wire.errors import Error
from dissect.wire.text import printable

MAX_FILE: Final = 16 << 20
#: Maximum number of characters of a name, and of names in a list.
MAX_NAME: Final = 200
MAX_NAMES: Final = 65536
#: Errors of a file that its text lists; the others are counted.
_LISTED: Final = 20

Parsed = TypeVar("Parsed")


class FileError(Error):
    """A file that cannot be used; ``line`` counts from 1 (0: unknown), ``key`` is the table and its key.

    ``others`` are the further errors of the file. As text, each has its own line.
    """

    def __init__(self, path: str, line: int, key: str, detail: str, others: tuple[DictionaryError, ...] = ()) -> None:
        self.path = path
        self.line = line
        self.key = key
        self.detail = detail
        self.others = others
        super().__init__(path, line, key, detail)

    def __str__(self) -> str:
        told = [(self.line, self.key, self.detail)]
        told += [(error.line, error.where, error.detail) for error in self.others]
        texts = [self._text(*one) for one in told[:_LISTED]]
        if len(told) > _LISTED:
            texts.append(f"{len(told) - _LISTED} more errors in {printable(self.path)}")
        return "\n".join(texts)

    def _text(self, line: int, key: str, detail: str) -> str:
        place = f"{self.path}:{line}" if line else self.path
        return printable(": ".join(part for part in (place, key, detail) if part))


class UserFile:
    """The content of a file: `top` is its top level; ``lists`` and ``singles`` are its [[tables]] and [tables].

    Put ``with file.troubles:`` around code that reads a part, and call `done` at the end.
    """

    def __init__(self, text: str, lists: tuple[str, ...], singles: tuple[str, ...] = ()) -> None:
        self._content: dict[str, Any] = parse_tables(text)
        check_bounds(self._content, "file")
        self._lines = Lines(text)
        self.troubles = Troubles()
        self.top = Table(self._content, "file", place=Place(self._lines, ()))
        for name in (*lists, *singles):
            self.top.mark(name)

    def single(self, name: str) -> Table | None:
        """Return the [table] with a name, None if there is none."""
        if name not in self._content:
            return None
        with self.troubles:
            return Table(self._content[name], f"[{name}]", place=Place(self._lines, (name,)))
        return None

    def tables(self, name: str, most: int) -> Iterator[Table]:
        """Yield the [[tables]] with a name; if there are more than ``most``, that is an error, and none is yielded."""
        rows = self._content.get(name, [])
        if not isinstance(rows, list) or len(rows) > most:
            detail = (
                f"{len(rows)} of them, expected {most} at most"
                if isinstance(rows, list)
                else f"must be written as [[{name}]]"
            )
            with self.troubles:
                raise DictionaryError(f"[{name}]", detail, line=self._lines.at(name))
            return
        for number, row in enumerate(rows):
            with self.troubles:
                yield Table(row, f"[[{name}]] {number + 1}", place=Place(self._lines, (name, number)))

    def done(self) -> None:
        """Raise the first error of the file by line, with the others, if there is one."""
        with self.troubles:
            self.top.done()
        self.troubles.found.sort(key=lambda error: error.line)
        self.troubles.done()


def read_file(
    path: str | os.PathLike[str], parse: Callable[[str], Parsed], kind: type[FileError], most: int = MAX_FILE
) -> Parsed:
    """Return ``parse(text of the file)``; its `DictionaryError` is raised as ``kind``. OSError is not changed.

    A file of more than ``most`` octets, or one that is not UTF-8, is an error like any other.
    """
    try:
        return parse(_text_of(path, most))
    except DictionaryError as error:  # `Table` raises this type of error only
        raise kind(os.fspath(path), error.line, error.where, error.detail, error.others) from None


def _text_of(path: str | os.PathLike[str], most: int) -> str:
    with Path(path).open("rb") as stream:
        octets = stream.read(most + 1)
    if len(octets) > most:
        raise DictionaryError("file", f"more than {most} bytes")
    return source_text(octets, os.fspath(path))


def network_of(table: Table, key: str) -> IPv4Network | IPv6Network | None:
    """Return an address or a network, None if the key is missing."""
    if not table.has(key):
        table.mark(key)
        return None
    written = table.text(key)
    try:
        return ip_network(written)
    except ValueError:
        detail = f'{shown(written)} is neither an address such as "10.0.0.5" nor a network such as "10.0.0.0/24"'
        raise table.fail(key, detail) from None


def number_within(table: Table, key: str, low: int, high: int) -> int:
    """Return a whole number from ``low`` to ``high``."""
    number = table.number(key)
    if not low <= number <= high:
        raise table.fail(key, f"{shown(number)} is outside {low} to {high}")
    return number


def names_of(table: Table, key: str) -> frozenset[str] | None:
    """Return a list of names, None if the key is missing."""
    if not table.has(key):
        table.mark(key)
        return None
    names = table.items(key)
    if len(names) > MAX_NAMES:
        raise table.fail(key, f"{len(names)} entries, {MAX_NAMES} at most")
    for name in names:
        if not isinstance(name, str) or not 1 <= len(name) <= MAX_NAME:
            raise table.fail(key, f"{shown(name)} is not a string of 1 to {MAX_NAME} characters")
    return frozenset(names)
