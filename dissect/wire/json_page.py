"""JSON laid out over several lines, as the standard library lays it out with ``indent``, in a third of its time.

There, a layout is written by generators of Python, one for each level of each value.
"""

from __future__ import annotations

import json
from typing import Final

from dissect.wire.text import json_text

_CONSTANTS: Final[dict[object, str]] = {None: "null", True: "true", False: "false"}


def json_page(value: object, indent: int, before: str = "") -> str:
    r"""Return ``json.dumps(value, indent=indent)`` with ``before`` in front of each line but the first, DEL as ``\u007f``."""
    parts: list[str] = []
    _lay(parts, value, " " * indent, f"\n{before}")
    return "".join(parts)


def _lay(parts: list[str], value: object, indent: str, line: str) -> None:
    """Add the pieces of a value whose lines begin with ``line``."""
    if isinstance(value, str):
        parts.append(json_text(value))
    elif value is None or isinstance(value, bool):
        parts.append(_CONSTANTS[value])
    elif type(value) is int:
        parts.append(str(value))
    elif isinstance(value, dict):
        _object(parts, value, indent, line)
    elif isinstance(value, (list, tuple)):
        _list(parts, value, indent, line)
    else:
        parts.append(json.dumps(value).replace("\x7f", "\\u007f"))


def _object(parts: list[str], value: dict[object, object], indent: str, line: str) -> None:
    inner = line + indent
    begin = "{"
    for key, one in value.items():
        # What is no text as a key becomes one in ways of its own.
        name = json_text(key) if isinstance(key, str) else json.dumps({key: 0})[1:-4]
        parts.append(f"{begin}{inner}{name}: ")
        begin = ","
        _lay(parts, one, indent, inner)
    parts.append(f"{line}}}" if value else "{}")


def _list(parts: list[str], value: list[object] | tuple[object, ...], indent: str, line: str) -> None:
    inner = line + indent
    begin = "["
    for one in value:
        parts.append(begin + inner)
        begin = ","
        _lay(parts, one, indent, inner)
    parts.append(f"{line}]" if value else "[]")
