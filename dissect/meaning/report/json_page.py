"""JSON over several lines, as the standard library writes it with ``indent``, in a third of its time.

The standard library uses a Python generator for each level of each value.
"""

from __future__ import annotations

import json
from typing import Final

from mypy_extensions import i64

from dissect.wire.text import JsonTexts, json_text

_CONSTANTS: Final[dict[object, str]] = {None: "null", True: "true", False: "false"}


#: Maximum number of names that are kept per depth, each with the text before and after it: names are few, and are repeated.
_MAX_NAMES: Final = 4096


#: Only texts of at least this many characters are kept for reuse: sentences and advice, not times and addresses.
_LONG: Final = 40


class JsonPage:
    """Writes values with ``indent`` blanks for each level; repeated names and sentences are formatted only once."""

    __slots__ = ("_before", "_indent", "_lines", "_names", "_parts", "_texts")

    def __init__(self, indent: int) -> None:
        self._parts: list[str] = []
        self._indent = " " * indent
        self._before = ""
        # By depth: the beginning of a line there, and names with the text before and after them.
        self._lines: list[str] = ["\n"]
        self._names: list[dict[str, str]] = [{}]
        self._texts: JsonTexts = JsonTexts()

    def text(self, value: object, before: str = "") -> str:
        r"""Return ``json.dumps(value, indent=…)`` with ``before`` at the start of each line but the first, and DEL escaped."""
        if before != self._before:
            self._before = before
            self._lines = [f"\n{before}"]
            self._names = [{}]
        self._parts = []
        self._lay(value, 0)
        return "".join(self._parts)

    def _lay(self, value: object, depth: i64) -> None:
        """Add the pieces of a value whose lines have the indentation of ``depth``."""
        if isinstance(value, str):
            self._parts.append(json_text(value) if len(value) < _LONG else self._texts.of(value))
        elif value is None or isinstance(value, bool):
            self._parts.append(_CONSTANTS[value])
        elif type(value) is int:
            self._parts.append(str(value))
        elif isinstance(value, dict):
            self._object(value, depth)
        elif isinstance(value, (list, tuple)):
            self._list(value, depth)
        else:
            self._parts.append(json.dumps(value).replace("\x7f", "\\u007f"))

    def _deeper(self, depth: i64) -> None:
        """Make sure that `_lines` and `_names` have an entry for ``depth``."""
        if depth == len(self._lines):
            self._lines.append(self._lines[depth - 1] + self._indent)
            self._names.append({})

    def _object(self, value: dict[object, object], depth: i64) -> None:
        inner = depth + 1
        self._deeper(inner)
        names = self._names[inner]
        parts = self._parts
        begin = "{"
        for key, one in value.items():
            parts.append(begin)
            begin = ","
            name = names.get(key) if isinstance(key, str) else None
            parts.append(name if name is not None else _named(names, key, self._lines[inner]))
            self._lay(one, inner)
        parts.append(f"{self._lines[depth]}}}" if value else "{}")

    def _list(self, value: list[object] | tuple[object, ...], depth: i64) -> None:
        if not value:
            self._parts.append("[]")
            return
        inner = depth + 1
        self._deeper(inner)
        line = self._lines[inner]
        begin = "["
        for one in value:
            self._parts.append(begin)
            begin = ","
            self._parts.append(line)
            self._lay(one, inner)
        self._parts.append(f"{self._lines[depth]}]")


def _named(names: dict[str, str], key: object, inner: str) -> str:
    """Return the beginning of a line with this key, and keep it if the key is a text."""
    if not isinstance(key, str):
        # The standard library converts other keys to text in its own ways.
        return f"{inner}{json.dumps({key: 0})[1:-4]}: "
    name = f"{inner}{json_text(key)}: "
    if len(names) < _MAX_NAMES:
        names[key] = name
    return name
