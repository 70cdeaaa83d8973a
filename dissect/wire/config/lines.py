"""The line numbers of the tables and keys of a TOML text, which `tomllib` does not give.

`tomllib` has parsed the text before, so it is valid TOML; its tokens are read again only when an error needs a line number.
"""

from __future__ import annotations

import re
from functools import cached_property
from typing import Final, NamedTuple

from dissect.wire.config.hostile import ContentError, read_toml

#: Keys and positions from the top: ("object", 2, "fields", 0, "name").
Path = tuple[str | int, ...]

_TOKEN: Final = re.compile(
    r"""
    (?P<skip>[ \t\r]+|\#[^\n]*)
    |(?P<text>\"{3}(?:[^\\]|\\.)*?\"{3,5}|'{3}.*?'{3,5}|\"(?:[^"\\\n]|\\.)*\"|'[^'\n]*')
    |(?P<mark>[\[\]{}=,.\n])
    |(?P<word>[^\s\[\]{}=,.\#"']+)
    |(?P<rest>.)
    """,
    re.VERBOSE | re.DOTALL,
)
_ENDS: Final = frozenset((",", "]", "}", "\n", ""))


class Lines:
    """Finds the line of a table or key in a text; an empty text has no lines."""

    def __init__(self, text: str) -> None:
        self._text = text

    @cached_property
    def _known(self) -> dict[Path, int]:
        try:
            return _Walk(self._text).document()
        except RecursionError:
            return {}

    def at(self, *path: str | int) -> int:
        """Return the line of a key or table, counted from 1; if it has none, that of the table around it, or 0."""
        known = self._known
        for size in range(len(path), 0, -1):
            line = known.get(path[:size])
            if line is not None:
                return line
        return 0


class Place(NamedTuple):
    """A table in a text: the lines of the text, and the place of the table."""

    lines: Lines
    path: Path

    def line(self, *more: str | int) -> int:
        """Return the line of the table, or of a key in it."""
        return self.lines.at(*self.path, *more)

    def inside(self, *more: str | int) -> Place:
        """Return the place of a table in this one."""
        return Place(self.lines, (*self.path, *more))


class _Walk:
    """One walk through a text that is TOML."""

    def __init__(self, text: str) -> None:
        self._found: dict[Path, int] = {}
        self._sizes: dict[Path, int] = {}
        self._tokens: list[tuple[str, int]] = []
        line = 1
        for match in _TOKEN.finditer(text):
            token = match.group()
            if match.lastgroup != "skip":
                self._tokens.append((token, line))
            line += token.count("\n")
        self._last = line
        self._at = 0

    def document(self) -> dict[Path, int]:
        """Return the line of every table, key and element."""
        base: Path = ()
        while self._at < len(self._tokens):
            if self._token() == "\n":
                self._at += 1
            elif self._token() == "[":
                base = self._header()
            else:
                self._pair(base)
        return self._found

    def _token(self) -> str:
        return self._tokens[self._at][0] if self._at < len(self._tokens) else ""

    def _line(self) -> int:
        return self._tokens[self._at][1] if self._at < len(self._tokens) else self._last

    def _header(self) -> Path:
        line = self._line()
        self._at += 1
        is_list = self._token() == "["
        self._at += is_list
        path: Path = ()
        keys = self._keys(line)
        for number, key in enumerate(keys):
            path = (*path, key)
            last = number == len(keys) - 1
            if last and is_list:
                self._found.setdefault(path, line)
                self._sizes[path] = self._sizes.get(path, 0) + 1
            if path in self._sizes:
                path = (*path, self._sizes[path] - 1)
        self._found.setdefault(path, line)
        while self._token() == "]":
            self._at += 1
        return path

    def _keys(self, line: int) -> list[str]:
        """Return the parts of a key, up to the token that ends it."""
        keys = []
        while self._at < len(self._tokens):
            piece = self._token()
            if piece in ("=", "]", "\n"):
                break
            if piece != ".":
                keys.append(_plain_key(piece))
            self._at += 1
        return keys or [f"line {line}"]

    def _pair(self, base: Path) -> None:
        line = self._line()
        path = base
        for key in self._keys(line):
            path = (*path, key)
            self._found.setdefault(path, line)
        if self._token() == "=":
            self._at += 1
        self._value(path)

    def _value(self, path: Path) -> None:
        opening = self._token()
        if opening not in ("[", "{"):
            while self._token() not in _ENDS:
                self._at += 1
            return
        closing = "]" if opening == "[" else "}"
        self._at += 1
        number = 0
        while self._at < len(self._tokens) and self._token() != closing:
            if self._token() in (",", "\n"):
                self._at += 1
            elif opening == "{":
                self._pair(path)
            else:
                self._found.setdefault((*path, number), self._line())
                self._value((*path, number))
                number += 1
        self._at += 1


def _plain_key(token: str) -> str:
    """Return a key without its quotes, unescaped."""
    if token[0] not in "\"'":
        return token
    try:
        (key,) = read_toml(f"{token} = 0")
    except ContentError:
        return token
    return key
