"""Decodes file content: by its byte order mark, else by the code page that the user gave, else as UTF-8 or a Windows code page.

Content that is not UTF-8 counts as Windows-1251 if its letters above ASCII form words, else as Windows-1252; the user is
informed which (sheet 0.1).
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
#: UTF-16 without a byte order mark is recognised by this many octets.
_BEGINNING: Final = 100
DEFAULT_PAGE: Final = "cp1252"
CYRILLIC_PAGE: Final = "cp1251"
#: Letters of Windows-1251, which form words. In Windows-1252 these octets are accented letters, mostly isolated.
_LETTERS: Final = re.compile(rb"[\xa8\xb8\xc0-\xff]+")
_WORD: Final = 3


class EncodingError(ValueError):
    """Content does not have the expected encoding; ``line`` is the first line that does not."""

    def __init__(self, line: int, text: str) -> None:
        self.line = line
        super().__init__(text)


def decode_text(octets: bytes, encoding: str) -> tuple[str, str]:
    """Return the text of a file, and the code page if it was only assumed, else empty.

    ``encoding`` is the one that the user named, or empty. Raises `EncodingError`.
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
    """Return whether letters above ASCII form words of their own, as Cyrillic letters do."""
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
