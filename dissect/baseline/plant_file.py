"""Files of TOML that a user writes about a plant: read within bounds, with one form of error."""

from __future__ import annotations

import os
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Final

from dissect.scd.bounds import check_bounds
from dissect.scd.errors import DictionaryError, shown
from dissect.scd.reading import Table
from dissect.scd.toml_tables import header_lines, parse_tables, source_text
from dissect.tcp.stream import address_text
from dissect.wire.text import printable

MAX_FILE: Final = 16 << 20
#: Characters of a name, and names in a list.
MAX_NAME: Final = 200
MAX_NAMES: Final = 65536


class PlantFileError(Exception):
    """A file that cannot be used; ``line`` counts from 1 (0: not known), ``key`` is the table and its key."""

    def __init__(self, path: str, line: int, key: str, detail: str) -> None:
        self.path = path
        self.line = line
        self.key = key
        self.detail = detail
        super().__init__(path, line, key, detail)

    def __str__(self) -> str:
        place = f"{self.path}:{self.line}" if self.line else self.path
        return printable(": ".join(part for part in (place, self.key, self.detail) if part))


class PlantFile:
    """The content of a file: `top` is its top level, `tables` give those of a list with their lines."""

    def __init__(self, text: str, lists: tuple[str, ...], singles: tuple[str, ...] = ()) -> None:
        self._content: dict[str, Any] = parse_tables(text)
        check_bounds(self._content, "file")
        self._lines = header_lines(text, self._content, lists, singles)
        self.top = Table(self._content, "file", 0)
        for name in (*lists, *singles):
            self.top.mark(name)

    def single(self, name: str) -> Table | None:
        """Return the [table] of a name, None where there is none."""
        if name not in self._content:
            return None
        return Table(self._content[name], f"[{name}]", self._lines.get((name, 0), 0))

    def tables(self, name: str, most: int) -> list[Table]:
        """Return the [[tables]] of a name."""
        rows = self._content.get(name, [])
        if not isinstance(rows, list) or not all(isinstance(row, dict) for row in rows):
            raise DictionaryError(f"[[{name}]]", f"is written [[{name}]]")
        if len(rows) > most:
            raise DictionaryError(f"[[{name}]]", f"{len(rows)} of them, a file has {most} at most")
        lines = self._lines
        return [
            Table(row, f"[[{name}]] {number}", lines.get((name, number - 1), 0)) for number, row in enumerate(rows, 1)
        ]


def read_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a file. Raises `DictionaryError` where it is too large or no UTF-8, OSError as the system does."""
    with Path(path).open("rb") as stream:
        octets = stream.read(MAX_FILE + 1)
    if len(octets) > MAX_FILE:
        raise DictionaryError("file", f"more than {MAX_FILE} bytes")
    return source_text(octets, os.fspath(path))


def address_of(table: Table, key: str) -> str:
    """Return an address as traffic is told with it."""
    written = table.text(key)
    try:
        return address_text(ip_address(written).packed)
    except ValueError:
        raise table.fail(key, f'{shown(written)} is not an address such as "10.0.0.5"') from None


def names_of(table: Table, key: str) -> frozenset[str] | None:
    """Return a list of names, None where the key is missing."""
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
