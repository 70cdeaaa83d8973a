"""Text from the wire, made safe to show: nothing a device sends may steer a terminal, a spreadsheet or a reader's eye."""

from __future__ import annotations

import unicodedata
from typing import Final

#: Categories that are not shown as they are: control, format (bidi overrides, zero widths), surrogate, private, unassigned,
#: line and paragraph separators.
_HIDDEN: Final = frozenset(("Cc", "Cf", "Cs", "Co", "Cn", "Zl", "Zp"))

#: What a spreadsheet takes for the beginning of a formula.
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")


def printable(text: str) -> str:
    r"""Return ``text`` on one line with everything that does not simply print escaped (``\x1b``, ``\u202e`` …)."""
    if text.isascii() and text.isprintable():
        return text
    return "".join([_escape(character) for character in text])


def _escape(character: str) -> str:
    if unicodedata.category(character) not in _HIDDEN:
        return character
    code = ord(character)
    if code < 0x100:
        return f"\\x{code:02x}"
    return f"\\u{code:04x}" if code < 0x10000 else f"\\U{code:08x}"


def cell(text: str) -> str:
    """Return ``text`` as a spreadsheet cell that is never taken for a formula; numbers stay numbers."""
    safe = printable(text)
    if safe.startswith(_FORMULA) and not _is_number(safe):
        return "'" + safe
    return safe


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def octets_text(octets: bytes) -> str:
    """Return octets as text where all of them print, else as hexadecimal pairs."""
    if octets and all([0x20 <= octet < 0x7F for octet in octets]):
        return f'"{octets.decode("ascii")}"'
    return octets.hex(" ") if octets else "(empty)"
