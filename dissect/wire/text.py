"""Text from outside, made safe to show: nothing a device or a file name says may steer a terminal, a spreadsheet or an eye."""

from __future__ import annotations

import os
import re
import unicodedata
from typing import Final

#: Categories that are not shown as they are: control, format (bidi overrides, zero widths), surrogate, private, unassigned,
#: line and paragraph separators.
_HIDDEN: Final = frozenset(("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"))

#: What a spreadsheet takes for the beginning of a formula; some take the full-width forms for it too.
_FORMULA: Final = ("=", "+", "-", "@", "\uff1d", "\uff0b", "\uff0d", "\uff20")
#: The same behind a semicolon, which separates cells where the comma separates decimals.
_LATER_FORMULA: Final = re.compile("(;\\s*)(?=[=+\\-@\uff1d\uff0b\uff0d\uff20])")
_NUMBER: Final = re.compile(r"[+-]?[0-9]+(\.[0-9]+)?([eE][+-]?[0-9]+)?")


def printable(text: str) -> str:
    r"""Return ``text`` on one line with everything that does not simply print escaped (``\x1b``, ``\u202e`` …)."""
    if text.isascii() and text.isprintable():
        return text
    return "".join([_escape(character) for character in text])


def _escape(character: str) -> str:
    if unicodedata.category(character) not in _HIDDEN:
        return character
    code = ord(character)
    if 0xDC80 <= code <= 0xDCFF:
        code -= 0xDC00  # an octet that is no UTF-8, as Python holds it in file names
    if code < 0x100:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def encodable(text: str) -> str:
    r"""Return ``text`` with what UTF-8 cannot hold escaped: a file name's octet 0xFF becomes ``\xff``. All else stays."""
    if text.isascii():
        return text
    return "".join([_escape(character) if 0xD800 <= ord(character) <= 0xDFFF else character for character in text])


def reason(error: BaseException) -> str:
    """Return why something failed, on one line for a person: of a system's refusal the words, and the file it is about."""
    if isinstance(error, OSError) and error.strerror:
        about = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, (str, bytes)) else ""
        return printable(f"{about}{error.strerror}")
    return printable(str(error) or type(error).__name__)


def titled(name: str, about: str) -> str:
    """Return a name and what it is about; a word that ends the one and begins the other stands once: ``read SZL 0x0011 …``."""
    last = name.rpartition(" ")[2]
    if last and about.startswith(f"{last} "):
        about = about.removeprefix(last).lstrip()
    return f"{name} {about}" if name and about else name or about


def shortened(text: str, most: int) -> str:
    """Return ``text`` made `printable`, cut after ``most`` of its characters with a note of how many there are."""
    if len(text) <= most:
        return printable(text)
    return f"{printable(text[:most])}… ({len(text)} characters)"


def cell(text: str) -> str:
    """Return ``text`` as a spreadsheet cell that is never taken for a formula; numbers stay numbers."""
    safe = printable(text)
    if safe.startswith(_FORMULA) and not _NUMBER.fullmatch(safe):
        safe = "'" + safe
    return _LATER_FORMULA.sub(r"\1'", safe) if ";" in safe else safe
