"""File content → text: byte order mark, else strict UTF-8, else the code page the user gave, or the likelier Windows one.

Without a name a file of bytes that are no UTF-8 is Windows-1251 where its letters above ASCII make words, else Windows-1252;
the user is told which (sheet 0.1).
"""

from __future__ import annotations

import codecs
import re
from typing import Final

_MARKS: Final = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
#: Octets in which UTF-16 without a mark shows.
_BEGINNING: Final = 100
DEFAULT_PAGE: Final = "cp1252"
CYRILLIC_PAGE: Final = "cp1251"
#: Letters of Windows-1251 are above this octet, and stand together in words; accented ones of western Europe mostly alone.
_LETTERS: Final = re.compile(rb"[\xa8\xb8\xc0-\xff]+")
_WORD: Final = 3


class EncodingError(ValueError):
    """Content that is not in the encoding it should be in; ``line`` is the first line that is not."""

    def __init__(self, line: int, text: str) -> None:
        self.line = line
        super().__init__(text)


def decode_text(octets: bytes, encoding: str) -> tuple[str, str]:
    """Return the text of a file, and the code page that was assumed because nothing tells it, else empty.

    ``encoding`` is what the user named, or empty. Raises `EncodingError`.
    """
    for mark, name in _MARKS:
        if octets.startswith(mark):
            return _decoded(octets, name), ""
    if encoding:
        return _decoded(octets, encoding), ""
    if b"\0" in octets[:_BEGINNING]:
        raise EncodingError(1, "has zeros between its letters: UTF-16 without its mark? try --tags-encoding utf-16-le")
    try:
        return octets.decode("utf-8"), ""
    except UnicodeDecodeError:
        pass
    page = CYRILLIC_PAGE if _cyrillic(octets) else DEFAULT_PAGE
    try:
        return octets.decode(page), page
    except UnicodeDecodeError as error:
        raise _wrong(octets, error, "UTF-8") from None


def _cyrillic(octets: bytes) -> bool:
    """Tell whether letters above ASCII stand in words of their own, as Cyrillic ones do."""
    runs = [len(found) for found in _LETTERS.findall(octets)]
    return 2 * sum([length for length in runs if length >= _WORD]) > sum(runs)


def _decoded(octets: bytes, encoding: str) -> str:
    try:
        return octets.decode(encoding)
    except UnicodeDecodeError as error:
        raise _wrong(octets, error, encoding) from None


def _wrong(octets: bytes, error: UnicodeDecodeError, encoding: str) -> EncodingError:
    at = error.start
    line = octets.count(b"\n", 0, at) + 1
    return EncodingError(
        line,
        f"byte 0x{octets[at]:02X} is not {encoding}: TIA SDF and STEP 7 exports use the code page of the PC: "
        "try --tags-encoding cp1252 (or cp1251, gbk)",
    )
