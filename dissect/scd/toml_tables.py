"""TOML of a dictionary's source and of bindings: text and tables."""

from __future__ import annotations

from typing import Any, Final

from dissect.scd.errors import DictionaryError
from dissect.wire.config.hostile import ContentError, read_toml

#: Byte order marks at the beginning of a text (longer ones first), as Windows editors write them.
_MARKS: Final = (
    (b"\xef\xbb\xbf", "utf-8"),
    (b"\xff\xfe\x00\x00", "utf-32-le"),
    (b"\x00\x00\xfe\xff", "utf-32-be"),
    (b"\xff\xfe", "utf-16-le"),
    (b"\xfe\xff", "utf-16-be"),
)


def source_text(octets: bytes, path: str) -> str:
    """Return the text of a source: UTF-8, or as a byte order mark says.

    Raises `DictionaryError` with the line that cannot be decoded.
    """
    mark, encoding = next((row for row in _MARKS if octets.startswith(row[0])), (b"", "utf-8"))
    try:
        return octets[len(mark) :].decode(encoding)
    except UnicodeDecodeError as error:
        at = len(mark) + error.start
        line = octets[len(mark) : at].decode(encoding, "ignore").count("\n") + 1
        said = f"invalid {encoding.upper()}" + (", which its byte order mark says it is" if mark else "")
        hint = "" if mark else "; save the file as UTF-8"
        raise DictionaryError(f"byte {at}", f"{said}: {error.reason}{hint}", path=path, line=line) from None


def parse_tables(text: str, path: str = "") -> dict[str, Any]:
    """Return the tables of a TOML text; raises `DictionaryError` with ``path`` and line."""
    try:
        return read_toml(text)
    except ContentError as error:
        raise DictionaryError("TOML", str(error), path=path, line=error.line) from None
