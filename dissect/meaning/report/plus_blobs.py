"""Compressed blobs of S7comm-plus as lines: interfaces, comments and code of blocks, all of them XML (docs/s7plus.md).

Most need a preset dictionary of the package s7commplus, which is imported when the first such blob is shown.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from functools import cache
from importlib import import_module
from typing import Final

from dissect.meaning.report import words
from dissect.protocols.s7plus.blobs import BAD, NO_DICTIONARY, TOO_LARGE, Opened, open_blob
from dissect.wire.text import shortened

#: Limits: lines of a blob, characters of a line, levels of indentation, and decompressed octets.
_LINES: Final = 400
_WIDTH: Final = 180
_LEVELS: Final = 20
_KEPT: Final = 1 << 20
_BETWEEN: Final = re.compile("(?<=>)\\s*(?=<)")
_HINT: Final = "pip install 's7dissect[s7plus]'"


@cache
def dictionaries() -> Mapping[int, bytes]:
    """Return the preset dictionaries by their Adler-32; empty if the package s7commplus is not installed."""
    try:
        found = import_module("s7commplus.zlib_dicts").ZLIB_DICTIONARIES
    except (ImportError, AttributeError):
        return {}
    return {int(adler): bytes(octets) for adler, octets in found.items()}


def blob_lines(octets: bytes) -> Iterator[str]:
    """Yield the text of a compressed blob as lines, or why it cannot be decompressed; escaped."""
    known = dictionaries()
    opened = open_blob(octets, known, _KEPT)
    yield f"{words.count(len(octets), 'byte')} compressed{_said(opened, known)}"
    if opened.octets and opened.fault != BAD:
        yield from _text_lines(opened.octets, opened.size > len(opened.octets))


def _said(opened: Opened, known: Mapping[int, bytes]) -> str:
    if opened.fault == NO_DICTIONARY:
        named = f"dictionary 0x{opened.dictionary:08x}"
        what = f", {words.count(opened.size, 'byte')} in all, not shown: they need {named}"
        return f"{what}, which s7commplus does not have" if known else f"{what}: {_HINT}"
    if opened.fault == TOO_LARGE:
        return f", decompressed to {opened.size} or more, which is too much: they stay closed"
    if opened.fault == BAD:
        return ", which cannot be decompressed to the end"
    return f", {words.count(opened.size, 'byte')} in all"


def _text_lines(octets: bytes, more: bool) -> Iterator[str]:
    """Yield XML with one tag per line, indented by nesting; ``more``: there are octets after these, which are not shown."""
    text = octets.decode("utf-8-sig", "replace")
    level = 0
    shown = 0
    for line in [line.strip() for piece in _BETWEEN.split(text) for line in piece.splitlines()]:
        if not line:
            continue
        if shown == _LINES:
            more = True
            break
        level -= line.startswith("</")
        yield f"{'  ' * min(max(level, 0), _LEVELS)}{shortened(line, _WIDTH)}"
        level += _opens(line)
        shown += 1
    if more:
        yield f"… only the first {words.count(shown, 'line')} shown"


def _opens(line: str) -> bool:
    """Return whether a line begins an element that it does not end."""
    return line.startswith("<") and line[1:2] not in {"/", "?", "!"} and not line.endswith("/>") and "</" not in line
